"""Apparent contact on one image: centre, radius a and profile I(r) from the difference with the
free block (paper, section 2.3.1).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.contact.disc import Disc, micro_contact_disc
from analysis.contact.microcontacts import micro_contacts
from analysis.contact.registration import NotRegistered, rigid_shift, shifted

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]

RING_PIXELS = 3000
LEAST_RIM = 0.4  # share of the contact's rim that must be seen
DARK_RINGS = 3  # rings in a row below background + 3 sd that end the contact
FEWEST_MICRO_CONTACTS = 12
# by which the disc must explain the micro-contacts better than chance does, in log-likelihood
LEAST_GAIN = 15.0


@dataclass(frozen=True, slots=True)
class ApparentContact:
    """The apparent contact; pixels and grey levels. NaN where it is not seen, with the reason in
    `notes`.

    Attributes
    ----------
    centre_px : (x, y)
        Centre of the disc of micro-contacts.
    centre_sd_px : (float, float)
        Its standard uncertainty.
    radius_px, radius_sd_px : float
        a, where the micro-contacts end, and its standard uncertainty.
    dark_radius_px : float
        The paper's criterion to the letter: first of several rings in a row whose mean stays below
        background + 3 sd.
    shift_px : (dx, dy)
        Rigid displacement of the block from the background to the image.
    profile_radius_px, profile_grey : ndarray, shape (n,)
        I(r): means over rings of 3000 px of the difference, the background far from the contact
        taken off.
    micro_contacts : int
        How many were found.
    notes : tuple of str
    """

    centre_px: tuple[float, float]
    centre_sd_px: tuple[float, float]
    radius_px: float
    radius_sd_px: float
    dark_radius_px: float
    shift_px: tuple[float, float]
    profile_radius_px: F64
    profile_grey: F64
    micro_contacts: int
    notes: tuple[str, ...] = ()


def apparent_contact(
    background: NDArray[np.generic], image: NDArray[np.generic]
) -> ApparentContact:
    """Centre, radius and profile of the apparent contact that `image` shows and `background`, the
    free block, does not.

    Parameters
    ----------
    background, image : ndarray, shape (rows, columns)
        Grey levels, same shape.

    Notes
    -----
    The paper takes a where the ring means I(r) reach zero. They do so where the micro-contacts end,
    but a threshold on I(r) finds that late or early by tens of micrometres, as the last rings hold
    a handful of them. So a and the centre come from the places of the micro-contacts
    (`analysis.contact.disc`), whatever the law by which they thin out; `dark_radius_px` keeps the
    threshold's answer.

    References
    ----------
    Prevost et al. 2013, section 2.3.1, Figs 2b and 3.
    """
    try:
        shift = rigid_shift(background, image)
    except NotRegistered as error:
        return _unseen(str(error), (np.nan, np.nan))
    difference, known = background_difference(background, image, shift)
    x, y = micro_contacts(difference)
    seen = known[y.astype(int), x.astype(int)]
    x, y = x[seen], y[seen]
    if len(x) < FEWEST_MICRO_CONTACTS:
        return _unseen(
            f"contact: {len(x)} micro-contacts stand out of the background,"
            f" {FEWEST_MICRO_CONTACTS} are needed",
            shift,
            len(x),
        )
    rows, columns = difference.shape
    disc = micro_contact_disc(x, y, (rows, columns))
    if disc.gain < LEAST_GAIN:
        return _unseen(
            f"contact: the {len(x)} bright spots of the difference are scattered over the picture"
            " and form no disc",
            shift,
            len(x),
        )
    visible = _visible_rim(disc, (rows, columns))
    if visible < LEAST_RIM:
        return _unseen(
            f"contact: {1 - visible:.0%} of its rim lies outside the picture, so a can not be"
            " measured; use a lower force or magnification",
            shift,
            len(x),
        )
    radius, grey, dark = _profile(difference, known, disc)
    return ApparentContact(
        disc.centre_px, disc.centre_sd_px, disc.radius_px, disc.radius_sd_px, dark, shift, radius, grey, len(x),
    )  # fmt: skip


def _visible_rim(disc: Disc, shape: tuple[int, int]) -> float:
    """Share of the circle of radius a that lies in the picture."""
    angle = np.linspace(0, 2 * np.pi, 360, endpoint=False)
    x, y = (
        disc.centre_px[0] + disc.radius_px * np.cos(angle),
        disc.centre_px[1] + disc.radius_px * np.sin(angle),
    )
    return float(np.mean((x >= 0) & (x < shape[1]) & (y >= 0) & (y < shape[0])))


def background_difference(
    background: NDArray[np.generic], image: NDArray[np.generic], shift: tuple[float, float]
) -> tuple[F32, NDArray[np.bool_]]:
    """Image minus the background moved by `shift` and scaled to its brightness, and which pixels
    are known; both (rows, columns).

    Pixels that the moved background does not cover are 0 and not known.
    """
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


def _profile(difference: F32, known: NDArray[np.bool_], disc: Disc) -> tuple[F64, F64, float]:
    """I(r) on rings of 3000 known pixels, and the first radius from which it stays dark."""
    rows, columns = difference.shape
    x, y = np.arange(columns) - disc.centre_px[0], np.arange(rows) - disc.centre_px[1]
    r2 = np.add.outer((y * y).astype(np.float32), (x * x).astype(np.float32))
    reach = 1.6 * disc.radius_px
    chosen = known & (r2 < reach**2)
    square, grey = r2[chosen], difference[chosen]
    order = np.argsort(square)
    n = len(order) // RING_PIXELS
    order = order[: n * RING_PIXELS].reshape(n, RING_PIXELS)
    radius = np.sqrt(square[order].mean(axis=1, dtype=np.float64))
    mean = grey[order].mean(axis=1, dtype=np.float64)
    outside = radius > 1.15 * disc.radius_px
    if np.count_nonzero(outside) < 8:
        return radius, mean, np.nan
    level, spread = (
        float(np.median(mean[outside])),
        1.4826 * float(np.median(np.abs(mean[outside] - np.median(mean[outside])))),
    )
    mean -= level
    dark = mean < 3 * spread
    run = np.convolve(dark, np.ones(DARK_RINGS), mode="valid") == DARK_RINGS
    return radius, mean, float(radius[np.argmax(run)]) if run.any() else np.nan


def _unseen(reason: str, shift: tuple[float, float], count: int = 0) -> ApparentContact:
    nothing = np.empty(0)
    nowhere = (np.nan, np.nan)
    return ApparentContact(
        nowhere, nowhere, np.nan, np.nan, np.nan, shift, nothing, nothing, count, (reason,)
    )
