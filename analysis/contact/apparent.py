"""Apparent contact on one image: centre, radius a and profile I(r) from the difference with the
free block (paper, section 2.3.1).
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from analysis.arrays import F32, F64, Array, Bool
from analysis.contact.disc import Disc, micro_contact_disc
from analysis.contact.marks import Marks, marks
from analysis.contact.microcontacts import far_from_dark_spots, micro_contacts
from analysis.contact.registration import NotRegistered, rigid_shift, shifted
from analysis.dic import Tracker
from analysis.robust import robust_sd

RING_PIXELS = 3000
LEAST_RIM = 0.4  # share of the contact's rim that must be seen
DARK_RINGS = 3  # rings in a row below background + 3 sd that end the contact
MIN_MICRO_CONTACTS = 12
# by which the disc must explain the micro-contacts better than chance does, in log-likelihood
LEAST_GAIN = 15.0
NEAR_PX = 3.0  # a dark spot and its echo are the block's displacement apart, and that wide
ROUNDING = 1e-6  # rounding of a grey level in single precision
NOWHERE = (np.nan, np.nan)


@dataclass(frozen=True, slots=True, kw_only=True)
class ApparentContact:
    """The apparent contact; pixels and grey levels. NaN where it is not seen; `notes` then gives
    the reason.

    Attributes
    ----------
    centre_px : (x, y)
        Centre of the disc of micro-contacts.
    centre_sd_px : (float, float)
        Its standard uncertainty.
    radius_px, radius_sd_px : float
        a, where the micro-contacts end, and its standard uncertainty; of an ellipse, the radius of
        a disc of its area.
    axes_px, angle : (float, float), float
        Half axes of the ellipse that they fill, the long one first, and the angle of that one from
        +x towards +y, radians; NaN where they fill a disc as far as they show.
    dark_radius_px : float
        The paper's criterion to the letter: first of several rings in a row whose mean stays below
        background + 3 sd.
    shift_px : (dx, dy)
        Rigid displacement of the block from the background to the image.
    profile_radius_px, profile_grey : ndarray, shape (n,)
        I(r): means over rings of 3000 px of the difference, less the background far from the
        contact.
    micro_contacts : int
        Number of micro-contacts that were found.
    marks : Marks or None
        That stay in the picture and were taken off both images before; None: there are none, or
        they were not looked for.
    difference : ndarray or None
        Image less the moved background, 0 where that is not known; None without a contact.
    notes : tuple of str
    """

    centre_px: tuple[float, float] = NOWHERE
    centre_sd_px: tuple[float, float] = NOWHERE
    radius_px: float = np.nan
    radius_sd_px: float = np.nan
    axes_px: tuple[float, float] = NOWHERE
    angle: float = np.nan
    dark_radius_px: float = np.nan
    shift_px: tuple[float, float] = NOWHERE
    profile_radius_px: F64 = field(default_factory=lambda: np.empty(0))
    profile_grey: F64 = field(default_factory=lambda: np.empty(0))
    micro_contacts: int = 0
    marks: Marks | None = None
    difference: F32 | None = None
    notes: tuple[str, ...] = ()


def apparent_contact(
    background: Array,
    image: Array,
    *,
    take_marks_off: bool = True,
    tracker: Tracker | None = None,
) -> ApparentContact:
    """Centre, radius and profile of the apparent contact that `image` shows and `background`, the
    free block, does not.

    Parameters
    ----------
    background, image : ndarray, shape (rows, columns)
        Grey levels, same shape.
    take_marks_off : bool
        Whether to find marks that stay in the picture, and take them off
        (`analysis.contact.marks`).
    tracker : Tracker, optional
        The background's, for `rigid_shift`, which closes it.

    Notes
    -----
    The paper takes a where the ring means I(r) reach zero. They do so where the micro-contacts end,
    but a threshold on I(r) finds that late or early by tens of micrometres, as the last rings hold
    a handful of them. So a and the centre come from the places of the micro-contacts
    (`analysis.contact.disc`), whatever the law by which they thin out;
    `ApparentContact.dark_radius_px` keeps the threshold's answer.

    References
    ----------
    Prevost et al. 2013, section 2.3.1, Figs 2b and 3.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> flat = np.full((120, 120), 90, np.uint8)
    >>> found = analysis.apparent_contact(flat, flat)  # no speckle: its notes say so
    >>> found.micro_contacts, found.radius_px
    (0, nan)
    """
    try:
        shift = rigid_shift(background, image, tracker)
    except NotRegistered as error:
        return ApparentContact(notes=(str(error),))
    stay = marks(background, image, shift) if take_marks_off else None
    if stay is not None:
        background, image = stay.taken_off(background), stay.taken_off(image)
    difference, known = background_difference(background, image, shift)
    x, y = micro_contacts(difference, ROUNDING * float(np.abs(image).max()))
    seen = known[y.astype(int), x.astype(int)]
    if stay is not None:  # some are too faint to be found
        seen &= far_from_dark_spots(difference, x, y, float(np.hypot(*shift)) + NEAR_PX)
    x, y = x[seen], y[seen]

    def unseen(reason: str) -> ApparentContact:
        notes = (f"contact: {reason}",)
        return ApparentContact(shift_px=shift, micro_contacts=len(x), marks=stay, notes=notes)

    if len(x) < MIN_MICRO_CONTACTS:
        return unseen(
            f"{len(x)} micro-contacts stand out of the background, {MIN_MICRO_CONTACTS} are needed"
        )
    rows, columns = difference.shape
    disc = micro_contact_disc(x, y, (rows, columns))
    if disc.gain < LEAST_GAIN:
        return unseen(
            f"the {len(x)} bright spots of the difference are scattered over the picture and form"
            " no disc"
        )
    visible = _visible_rim(disc, (rows, columns))
    if visible < LEAST_RIM:
        return unseen(
            f"{1 - visible:.0%} of its rim lies outside the picture, so a cannot be measured; use"
            " a lower force or magnification"
        )
    radius, grey, dark = _profile(difference, known, disc)
    return ApparentContact(
        centre_px=disc.centre_px,
        centre_sd_px=disc.centre_sd_px,
        radius_px=disc.radius_px,
        radius_sd_px=disc.radius_sd_px,
        axes_px=disc.axes_px,
        angle=disc.angle,
        dark_radius_px=dark,
        shift_px=shift,
        profile_radius_px=radius,
        profile_grey=grey,
        micro_contacts=len(x),
        marks=stay,
        difference=difference,
    )


def _visible_rim(disc: Disc, shape: tuple[int, int]) -> float:
    """Share of the circle of radius a that lies in the picture."""
    angle = np.linspace(0, 2 * np.pi, 360, endpoint=False)
    x = disc.centre_px[0] + disc.radius_px * np.cos(angle)
    y = disc.centre_px[1] + disc.radius_px * np.sin(angle)
    return float(np.mean((x >= 0) & (x < shape[1]) & (y >= 0) & (y < shape[0])))


def background_difference(
    background: Array, image: Array, shift: tuple[float, float]
) -> tuple[F32, Bool]:
    """Image minus the background moved by `shift` and scaled to its brightness, and which pixels
    are known; both (rows, columns).

    Pixels that the moved background does not cover are 0 and not known.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> background = np.random.default_rng(0).integers(50, 200, (60, 70)).astype(np.uint8)
    >>> image = np.roll(background, 3, axis=1)
    >>> difference, known = analysis.background_difference(background, image, (3.0, 0.0))
    >>> float(np.abs(difference[known]).max().round(3))
    0.0
    """
    if np.ndim(image) != 2 or np.shape(image) != np.shape(background) or not np.size(image):
        raise ValueError(
            f"background difference: pictures of shapes {np.shape(background)} and"
            f" {np.shape(image)} found; give two of one camera, (rows, columns)"
        )
    moved = shifted(background, *shift)
    rows, columns = moved.shape
    dx, dy = shift
    known = np.zeros((rows, columns), np.bool_)
    edge = 6  # the interpolating kernel's reach
    known[
        max(0, int(np.ceil(dy))) + edge : rows + min(0, int(np.floor(dy))) - edge,
        max(0, int(np.ceil(dx))) + edge : columns + min(0, int(np.floor(dx))) - edge,
    ] = True
    grey = np.asarray(image, dtype=np.float32)
    # micro-contacts add light to a few pixels in a hundred: the median ratio is that of the lamp
    sparse = (slice(None, None, 7), slice(None, None, 7))
    usable = known[sparse] & (moved[sparse] > 0)
    gain = float(np.median(grey[sparse][usable] / moved[sparse][usable])) if usable.any() else 1.0
    return np.where(known, grey - np.float32(gain) * moved, np.float32(0)), known


def _profile(difference: F32, known: Bool, disc: Disc) -> tuple[F64, F64, float]:
    """I(r) on rings of 3000 known pixels, and the first radius from which it stays dark."""
    rows, columns = difference.shape
    x, y = np.arange(columns) - disc.centre_px[0], np.arange(rows) - disc.centre_px[1]
    r2 = np.add.outer((y * y).astype(np.float32), (x * x).astype(np.float32))
    chosen = known & (r2 < (1.6 * disc.radius_px) ** 2)
    square, grey = r2[chosen], difference[chosen]
    order = np.argsort(square)
    n = len(order) // RING_PIXELS
    order = order[: n * RING_PIXELS].reshape(n, RING_PIXELS)
    radius = np.sqrt(square[order].mean(axis=1, dtype=np.float64))
    mean = grey[order].mean(axis=1, dtype=np.float64)
    outside = radius > 1.15 * disc.radius_px
    if np.count_nonzero(outside) < 8:
        return radius, mean, np.nan
    level = float(np.median(mean[outside]))
    mean -= level
    dark = mean < 3 * robust_sd(mean[outside])
    run = np.convolve(dark, np.ones(DARK_RINGS), mode="valid") == DARK_RINGS
    return radius, mean, float(radius[np.argmax(run)]) if run.any() else np.nan
