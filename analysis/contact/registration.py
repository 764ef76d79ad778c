"""Rigid displacement of the block between two images, sub-pixel, from the part of the picture that
the contact leaves alone.
"""

from __future__ import annotations

import cv2
import numpy as np

from analysis.arrays import F32, F64, Array
from analysis.dic import Correlation, Status, Tracker, open_tracker

LARGEST_SHIFT_PX = 44
TILE_PX = 128  # side of the boxes that are followed, one every quarter of it
LEAST_CORRELATION = 0.3
MIN_TILES = 12
SMALLEST_PX = 8
AT_REST_PX = 2e-4  # a shift of less is rounding: the block has not moved
SINC_HALF = 5  # taps of the interpolating kernel on each side


class NotRegistered(ValueError):
    """Two images show no common speckle."""


def background_tracker(background: Array) -> Tracker:
    """What `rigid_shift` follows the tiles of the free block with; to prepare it takes longer than
    to follow them.

    Raises
    ------
    ValueError
        The picture cannot be correlated, or is too small for tiles.
    """
    side = max(4, min(TILE_PX, *(size // 3 for size in background.shape)))
    settings = Correlation(
        box=side,
        step=side // 4,
        search=LARGEST_SHIFT_PX,
        min_correlation=LEAST_CORRELATION,
        min_contrast=0.0,
        max_saturated=1.0,
    )
    return open_tracker(settings, background)


def rigid_shift(
    background: Array, image: Array, tracker: Tracker | None = None
) -> tuple[float, float]:
    """Displacement (dx, dy) in pixels of the block from `background` to `image`.

    It is the median over the tiles within a tile's side of the outermost ones whose speckle is
    recognised: a contact may cover some of them.

    Parameters
    ----------
    background, image : ndarray, shape (rows, columns), uint8, uint16, float32 or float64
        Grey levels of the free and of the loaded block, of one shape and type.
    tracker : Tracker, optional
        What ``analysis.contact.registration.background_tracker`` makes of this background; it is
        closed. Default: a new one.

    Returns
    -------
    dx, dy : float
        A feature at (x, y) of the background is at (x + dx, y + dy) of the image.

    Raises
    ------
    NotRegistered
        Fewer than twelve tiles are recognised.
    ValueError
        The shapes or types differ, or the images are too small for tiles.

    References
    ----------
    Prevost et al. 2013, section 2.3.1 (note on the rigid displacement of the block).

    Examples
    --------
    >>> import numpy as np, scipy, analysis
    >>> random = np.random.default_rng(0).uniform(0, 255, (240, 240))
    >>> grey = scipy.ndimage.gaussian_filter(random, 1.5)
    >>> dx, dy = analysis.rigid_shift(grey, np.roll(grey, (2, -3), (0, 1)))
    >>> round(dx, 1), round(dy, 1)
    (-3.0, 2.0)
    """
    if background.shape != image.shape or background.ndim != 2 or min(image.shape) < SMALLEST_PX:
        raise ValueError(
            f"registration: two grey images of one shape, {SMALLEST_PX} px or more each way, are"
            f" needed, found {background.shape} and {image.shape}"
        )
    with tracker or background_tracker(background) as of:
        field, grid = of.track(image), of.grid
    rim = [np.minimum(at - at[0], at[-1] - at) < grid.box_px for at in (grid.y_px, grid.x_px)]
    found = (field.status == Status.OK) & np.logical_or.outer(*rim)
    if found.sum() < MIN_TILES:
        raise NotRegistered(
            f"registration: {found.sum()} tiles of the background are found in the image within"
            f" {LARGEST_SHIFT_PX} px, {MIN_TILES} are needed; take the background on the same"
            " spot and with the same light"
        )
    shift = (float(np.median(u[found])) for u in (field.ux_px, field.uy_px))
    dx, dy = (0.0 if abs(u) < AT_REST_PX else u for u in shift)
    return dx, dy


def shifted(image: Array, dx: float, dy: float) -> F32:
    """The image moved by (dx, dy) px by a Blackman-windowed sinc of 10 taps; the outermost pixels
    are repeated beyond the border.
    """
    ix, iy = round(dx), round(dy)
    moved = np.asarray(image, dtype=np.float32)
    edge = cv2.BORDER_REPLICATE
    if ix or iy:
        pad = max(abs(ix), abs(iy))
        rows, columns = moved.shape
        padded = cv2.copyMakeBorder(moved, pad, pad, pad, pad, edge)
        moved = padded[pad - iy : pad - iy + rows, pad - ix : pad - ix + columns]
    along_x, along_y = _taps(dx - ix), _taps(dy - iy)
    return np.asarray(cv2.sepFilter2D(moved, cv2.CV_32F, along_x, along_y, borderType=edge))


def _taps(fraction: float) -> F64:
    """Correlation kernel that moves a signal by `fraction` of a pixel; its sum is 1."""
    # sample at x - fraction: tap k weighs the pixel x + k
    distance = np.arange(-SINC_HALF, SINC_HALF + 1) + fraction
    angle = np.pi * distance / (SINC_HALF + 1)
    taps = np.sinc(distance) * (0.42 + 0.5 * np.cos(angle) + 0.08 * np.cos(2 * angle))
    return np.asarray(taps / taps.sum())
