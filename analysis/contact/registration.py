"""Rigid displacement of the block between two images, sub-pixel, from the part of the picture that
the contact leaves alone.
"""

from __future__ import annotations

import cv2
import numpy as np

from analysis.arrays import F32, F64, Array

LARGEST_SHIFT_PX = 44  # tiles stay this far from the border, so that the block may move by as much
SEARCH_PX = 4  # around the coarse displacement
TILE_PX = 128
BORDER_TILES = (7, 5)  # along x and y; only those on the rim of the picture are used
LEAST_CORRELATION = 0.3
MIN_TILES = 3
SMALLEST_PX = 8
SINC_HALF = 5  # taps of the interpolating kernel on each side
# of the least squares of a tile; noise in its gradients slows them down
ITERATIONS, AT_REST_PX, FURTHEST_PX = 50, 1e-3, 2.0


class NotRegistered(ValueError):
    """Two images show no common speckle."""


def rigid_shift(background: Array, image: Array) -> tuple[float, float]:
    """Displacement (dx, dy) in pixels of the block from `background` to `image`.

    Whole pixels come from the phase correlation of the whole pictures. Tiles along the rim are then
    followed one by one, by zero-mean normalised correlation and least squares; the median over the
    tiles whose speckle was recognised is immune to a contact that covers some of them.

    Parameters
    ----------
    background, image : ndarray, shape (rows, columns)
        Grey levels of the free and of the loaded block, same shape.

    Returns
    -------
    dx, dy : float
        A feature at (x, y) of the background is at (x + dx, y + dy) of the image.

    Raises
    ------
    NotRegistered
        Fewer than three tiles are recognised.
    ValueError
        The shapes differ, or are too small for tiles.

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
    first, second = flattened(background), flattened(image)
    coarse = _coarse_shift(first, second)
    tiles = [_tile_shift(first, second, *corner, coarse) for corner in _rim(background.shape)]
    found = [shift for shift in tiles if shift is not None]
    if len(found) < MIN_TILES:
        raise NotRegistered(
            f"registration: {len(found)} tiles of the background are found in the image within"
            f" {LARGEST_SHIFT_PX} px, {MIN_TILES} are needed; take the background on the same"
            " spot and with the same light"
        )
    dx, dy = np.median(found, axis=0)
    return float(dx), float(dy)


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


def flattened(image: Array) -> F32:
    """The image without the slow changes of its light: its local mean removed."""
    grey = np.asarray(image, dtype=np.float32)
    return np.asarray(grey - cv2.blur(grey, (31, 31)))


def _rim(shape: tuple[int, ...]) -> list[tuple[int, int, int]]:
    """Corner (x, y) and side of the tiles along the rim, each with room for the search where the
    picture is large enough.
    """
    rows, columns = shape
    side = min(TILE_PX, rows // 3, columns // 3)
    room = min(LARGEST_SHIFT_PX, (min(rows, columns) - side) // 4)
    nx, ny = BORDER_TILES
    xs = np.linspace(room, columns - room - side, nx).round().astype(int).tolist()
    ys = np.linspace(room, rows - room - side, ny).round().astype(int).tolist()
    return [(x, y, side) for y in ys for x in xs if x in (xs[0], xs[-1]) or y in (ys[0], ys[-1])]


def _coarse_shift(first: F32, second: F32) -> tuple[int, int]:
    """Whole-pixel displacement, good to about 2 px, by phase correlation of the whole pictures at
    half size.
    """
    area = cv2.INTER_AREA
    first, second = (
        cv2.resize(a, None, fx=0.5, fy=0.5, interpolation=area) for a in (first, second)
    )
    window = cv2.createHanningWindow(first.shape[::-1], cv2.CV_32F)
    (dx, dy), _ = cv2.phaseCorrelate(first, second, window)
    return round(2 * dx), round(2 * dy)


def _tile_shift(
    first: F32, second: F32, x: int, y: int, side: int, coarse: tuple[int, int]
) -> tuple[float, float] | None:
    """Displacement of one tile of `first`, None where its speckle is not found in `second`."""
    rows, columns = second.shape
    left, top = x + coarse[0] - SEARCH_PX, y + coarse[1] - SEARCH_PX
    right, bottom = left + side + 2 * SEARCH_PX, top + side + 2 * SEARCH_PX
    tile = np.ascontiguousarray(first[y : y + side, x : x + side])
    if min(left, top) < 0 or right > columns or bottom > rows or not tile.std() > 0:
        return None
    near = np.ascontiguousarray(second[top:bottom, left:right])
    _, best, _, (px, py) = cv2.minMaxLoc(cv2.matchTemplate(near, tile, cv2.TM_CCOEFF_NORMED))
    if best < LEAST_CORRELATION:
        return None
    return _refined(first, second, x, y, side, left + px - x, top + py - y)


def _refined(
    first: F32, second: F32, x: int, y: int, side: int, dx: float, dy: float
) -> tuple[float, float] | None:
    """Least squares of zero-mean, unit-variance tiles by Gauss-Newton, from a whole-pixel start;
    None where that runs away or does not come to rest.
    """
    margin = SINC_HALF + 1
    size, inner = side + 2 * margin, slice(margin + 1, margin + side - 1)
    rows, columns = second.shape
    start = dx, dy
    tile = first[y : y + side, x : x + side].astype(np.float64)
    gx, gy = 0.5 * (tile[1:-1, 2:] - tile[1:-1, :-2]), 0.5 * (tile[2:, 1:-1] - tile[:-2, 1:-1])
    tile = tile[1:-1, 1:-1] - tile[1:-1, 1:-1].mean()
    hessian = np.array([[_sum(gx, gx), _sum(gx, gy)], [_sum(gx, gy), _sum(gy, gy)]])
    for _ in range(ITERATIONS):
        ix, iy = round(dx), round(dy)
        top, left = y + iy - margin, x + ix - margin
        if min(top, left) < 0 or top + size > rows or left + size > columns:
            return None
        piece = second[top : top + size, left : left + size]
        moved = shifted(piece, ix - dx, iy - dy)[inner, inner].astype(np.float64)
        moved -= moved.mean()
        error = moved * (_sum(moved, tile) / _sum(moved, moved)) - tile
        try:
            step = np.linalg.solve(hessian, [_sum(gx, error), _sum(gy, error)])
        except np.linalg.LinAlgError:  # stripes: nothing tells the displacement along them
            return None
        dx, dy = dx - step[0], dy - step[1]
        if max(abs(dx - start[0]), abs(dy - start[1])) > FURTHEST_PX:
            return None
        if np.abs(step).max() < AT_REST_PX:
            return float(dx), float(dy)
    return None


def _sum(a: F64, b: F64) -> float:
    """Sum of products.

    Not by BLAS, whose threads cost ten times the work on tiles of this size when other threads are
    busy.
    """
    return float(np.einsum("ij,ij->", a, b))
