"""Size of a pixel (m) and distortion from a picture of a target whose lines are a known way apart:
a checkerboard, or the ruled lines of a graticule.

References
----------
Duda and Frese 2018, Accurate detection and localization of checkerboard corners (OpenCV's
findChessboardCornersSB); Takeda, Ina, Kobayashi, J. Opt. Soc. Am. 72 (1982) 156 (phase of lines).
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from scipy import fft

from analysis.arrays import F64, U8, Array, floats, grey_pictures
from analysis.calibration.scale import LARGEST_SD, ImageScale
from analysis.robust import huber_fit
from analysis.undistorted import ideal_places

SQUARE = 0.01  # relative difference of rows and columns from which a board is tilted
SKEW = math.radians(0.5)
SWEEPS, EXACT = 12, 1e-12  # repeats of a fit, and the least scatter that it takes for one
LARGEST_MISFIT_PX = 0.5
NEAR = 0.2  # relative difference of a pitch from the one expected
CLEAR = 8.0  # times the usual amplitude of its surroundings by which lines stand out
LEAST_LINES = 8
FAINT = 0.35  # of the usual amplitude of the lines, from which a tile does not show them
SADDLE, SMOOTH_PX, CENTRINGS = 0.35, 1.0, 40  # of a square, about a corner; and repeats
# pixels in one, along both axes: cornerSubPix interpolates linearly, which moved a corner by up to
# 0.016 px with its place in a pixel
FINER = 2
CRITERIA = cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS
FEWEST_TILES = 12
TILE, APART = 0.75, 2.5  # width of a tile (standard deviation) and what is between, pitches
REACHES = 0.4, 0.6, 0.8, 1.0, 1.0  # of half of the diagonal, from the middle of the picture
LARGEST_MISFIT = 0.1  # of the pitch


def scale_of_checkerboard(
    image: Array, corners: tuple[int, int], square_m: float, *, relative_sd: float = 0.0
) -> ImageScale:
    """The scale from a picture of a flat checkerboard in the plane of the interface.

    Parameters
    ----------
    image : ndarray, shape (rows, columns)
        Grey levels, of 8 or 16 bit or floats.
    corners : (int, int)
        Inner corners of the board along its rows and columns, all of them in the picture.
    square_m : float
        Side of a square, metres.
    relative_sd : float
        Relative standard uncertainty of that side.

    Returns
    -------
    ImageScale
        Its angle is that of the board, modulo a right angle, -pi/4 to pi/4: a board looks the same
        from four sides, and mirrored.

    Raises
    ------
    ValueError
        The board is not found, or tilted, or the picture tells no scale.

    Examples
    --------
    >>> import numpy as np, analysis.calibration.targets as targets
    >>> y, x = np.mgrid[:240, :320] / 24.0
    >>> board = np.where(np.sin(np.pi * (x + 0.1)) * np.sin(np.pi * (y + 0.3)) > 0, 200, 40)
    >>> inside = (x > 0.9) & (x < 11.9) & (y > 0.7) & (y < 8.7)
    >>> found = targets.scale_of_checkerboard(np.where(inside, board, 200), (10, 7), 170e-6)
    >>> round(found.m_per_px * 24 / 170e-6, 2)
    1.0
    """
    (image,) = grey_pictures("checkerboard", [image])
    if len(corners) != 2 or min(corners) < 3 or not 0 < square_m < math.inf:
        raise ValueError(
            f"checkerboard: {corners} inner corners and squares of {square_m} m; give 3 or more"
            " along rows and columns, and a side above 0"
        )
    flags = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
    is_found, places = cv2.findChessboardCornersSB(_eight_bit(image), corners, flags=flags)
    if not is_found:
        raise ValueError(
            f"checkerboard: {corners[0]} x {corners[1]} inner corners were looked for and not"
            " found; all must be in the picture, sharp, with a rim of one square around them"
        )
    at = floats(places).reshape(-1, 2)
    half = FINER * max(round(SADDLE * float(np.hypot(*(at[1] - at[0])))), 2)
    grey = cv2.GaussianBlur(np.asarray(image, dtype=np.float32), (0, 0), SMOOTH_PX)
    grey = cv2.resize(grey, None, fx=FINER, fy=FINER, interpolation=cv2.INTER_CUBIC)
    places = np.asarray(FINER * (at + 0.5) - 0.5, dtype=np.float32)
    cv2.cornerSubPix(grey, places, (half, half), (-1, -1), (CRITERIA, CENTRINGS, EXACT))
    at = (places.astype(np.float64) + 0.5) / FINER - 0.5
    down, along = np.divmod(np.arange(float(len(at))), corners[0])
    value, covariance, left = _lattice(at, np.stack([along, down], axis=1), image.shape)
    (ax, ay, bx, by), of_steps = value[2:6], covariance[2:6, 2:6]
    a, b, area = complex(ax, ay), complex(bx, by), ax * by - ay * bx
    skew = float(np.angle(b / a)) - math.copysign(math.pi / 2, area)
    if abs(abs(b / a) - 1) > SQUARE or abs(skew) > SKEW:
        raise ValueError(
            f"checkerboard: its squares are {abs(a):.4g} x {abs(b):.4g} px in the picture and"
            f" {math.degrees(skew):.2g} degrees from upright; lay it flat into the plane of the"
            " interface"
        )
    rms = float(np.sqrt(np.mean(left**2)))
    if rms > LARGEST_MISFIT_PX:
        raise ValueError(
            f"checkerboard: the corners are {rms:.2g} px off a lattice, {LARGEST_MISFIT_PX:g} px"
            " are allowed; the board must be flat and sharp"
        )
    of_size = np.array([by, -bx, -ay, ax]) / (2 * area)
    relative = math.hypot(math.sqrt(of_size @ of_steps @ of_size), relative_sd)
    _require_resolved("checkerboard", relative)
    m_per_px = square_m / math.sqrt(abs(area))
    # the mean direction of rows and columns
    of_angle = (
        np.array([-ay / abs(a) ** 2, ax / abs(a) ** 2, -by / abs(b) ** 2, bx / abs(b) ** 2]) / 2
    )
    angle = float(np.angle(a)) + skew / 2
    return ImageScale(
        m_per_px=m_per_px,
        m_per_px_sd=m_per_px * relative,
        angle=(angle + math.pi / 4) % (math.pi / 2) - math.pi / 4,
        angle_sd=math.sqrt(of_angle @ of_steps @ of_angle),
        k=float(value[6]),
        k_sd=math.sqrt(covariance[6, 6]),
        rms_px=rms,
    )


def _eight_bit(image: Array) -> U8:
    if image.dtype == np.uint8:
        return np.ascontiguousarray(image)
    low, high = (float(v) for v in np.percentile(image, [0.5, 99.5]))
    grey = (floats(image) - low) * (255 / max(high - low, 1e-12))
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def _lattice(at: F64, index: F64, shape: tuple[int, ...]) -> tuple[F64, F64, F64]:
    """Origin (x, y), steps along both indices (x, y) and k of a lattice seen through a lens, shape
    (7,), their covariance, and what is left at each of the places, shape (n, 2), px.
    """
    n = len(at)
    bent = np.stack(ideal_places(at[:, 0], at[:, 1], 1.0, (shape[0], shape[1])), axis=1) - at
    design = np.zeros((n, 2, 7))
    for axis in (0, 1):
        design[:, axis, axis] = 1
        design[:, axis, 2 + axis] = index[:, 0]
        design[:, axis, 4 + axis] = index[:, 1]
    design[:, :, 6] = -bent
    flat = design.reshape(2 * n, 7)
    value, covariance, left = huber_fit(flat, at.ravel(), SWEEPS, least=EXACT)
    return value, covariance, left.reshape(n, 2)


def _require_resolved(what: str, relative: float) -> None:
    """Refuse a scale that is not resolved."""
    if not relative <= LARGEST_SD:
        raise ValueError(
            f"{what}: the scale is known to {100 * relative:.2g} % only, {100 * LARGEST_SD:g} % is"
            " needed; use a sharper picture, or one with more of the target in it"
        )


def scale_of_lines(
    image: Array, pitch_m: float, about_m_per_px: float, *, relative_sd: float = 0.0
) -> ImageScale:
    """The scale from a picture of straight ruled lines, by their phase.

    Parameters
    ----------
    image : ndarray, shape (rows, columns)
        Grey levels. The lines may be thin or wide, bright or dark, and need not fill the picture.
    pitch_m : float
        Distance from one line to the next, metres.
    about_m_per_px : float
        Size of a pixel to 20 %, metres.
    relative_sd : float
        Relative standard uncertainty of the pitch.

    Returns
    -------
    ImageScale
        Its angle is that across the lines, -pi/2 to pi/2.

    Raises
    ------
    ValueError
        No lines are found at that pitch, or too few of them.

    Examples
    --------
    >>> import numpy as np, analysis.calibration.targets as targets
    >>> lines = 100 + 50 * np.cos(2 * np.pi * np.arange(400) / 14.2) * np.ones((300, 1))
    >>> found = targets.scale_of_lines(lines, 1e-4, 7e-6)
    >>> round(found.m_per_px * 14.2 / 1e-4, 4)
    1.0
    """
    (image,) = grey_pictures("graticule", [image])
    if not (pitch_m > 0 and 0 < pitch_m / about_m_per_px < max(image.shape)):
        raise ValueError(
            f"graticule: lines {pitch_m} m apart at {about_m_per_px} m per pixel; give lengths"
            " above 0, of which several fit into the picture"
        )
    rows, columns = image.shape
    pitch_px = pitch_m / about_m_per_px
    grey = np.asarray(image, dtype=np.float32)
    grey = grey - cv2.GaussianBlur(grey, (0, 0), pitch_px)
    f = _frequency(grey, pitch_px)
    wave = np.exp(-2j * np.pi * f[1] * np.arange(rows))[:, None] * np.exp(
        -2j * np.pi * f[0] * np.arange(columns)
    )
    shown = grey * wave
    width = TILE * pitch_px
    slow = sum(
        unit * cv2.GaussianBlur(np.ascontiguousarray(part), (0, 0), width)
        for unit, part in ((1, shown.real), (1j, shown.imag))
    )
    margin, apart = math.ceil(2 * pitch_px), math.ceil(APART * pitch_px)
    y, x = (
        v.ravel()
        for v in np.mgrid[margin : rows - margin : apart, margin : columns - margin : apart]
    )
    tile = slow[y, x]
    seen = np.abs(tile) > FAINT * np.percentile(np.abs(tile), 80) if len(tile) else tile.real > 0
    if seen.sum() < FEWEST_TILES:
        raise ValueError(
            f"graticule: lines {pitch_px:.3g} px apart are seen in {seen.sum()} places,"
            f" {FEWEST_TILES} are needed; take a picture that they fill"
        )
    at = np.stack([x, y], axis=1)[seen].astype(np.float64)
    number = np.angle(tile[seen]) / (2 * np.pi) + at @ f  # of the line there, but for whole ones
    middle = np.array([(columns - 1) / 2, (rows - 1) / 2])
    off = at - middle
    far = np.hypot(*off.T) / math.hypot(*middle)
    bent = np.stack(ideal_places(at[:, 0], at[:, 1], 1.0, (rows, columns)), axis=1) - at
    bent += 4 * width**2 * off / (middle @ middle)  # its mean over the tile
    f = _finer(tile[seen], off, f, 1 / (4 * max(rows, columns)))
    start = np.angle(np.exp(2j * np.pi * (number - off @ f)).sum()) / (2 * np.pi)
    value = np.array([start, *f, 0.0])
    for reach in REACHES:
        # the number of whole lines follows from what is known of the middle of the picture
        inside = far <= max(reach, np.sort(far)[FEWEST_TILES - 1])
        bending = bent @ value[1:3]
        design = np.column_stack([np.ones(len(at)), off, bending])
        whole = np.rint(design @ value - number)
        lines = (number + whole)[inside]
        value, covariance, left = huber_fit(design[inside], lines, SWEEPS, least=EXACT)
    covariance = covariance * (1 + 2 * math.exp(-((APART / TILE) ** 2) / 4)) ** 2  # tiles overlap
    size = float(np.hypot(*value[1:3]))
    if (misfit := float(np.sqrt(np.mean(left**2)))) > LARGEST_MISFIT:
        raise ValueError(
            f"graticule: the lines are off by {100 * misfit:.2g} % of their distance,"
            f" {100 * LARGEST_MISFIT:g} % is allowed; they must be straight and equally far apart"
        )
    along, across = value[1:3] / size, np.array([-value[2], value[1]]) / size**2
    own = math.sqrt(along @ covariance[1:3, 1:3] @ along) / size
    relative = math.hypot(own, relative_sd)
    _require_resolved("graticule", relative)
    angle = math.atan2(value[2], value[1])
    return ImageScale(
        m_per_px=pitch_m * size,
        m_per_px_sd=pitch_m * size * relative,
        angle=(angle + math.pi / 2) % math.pi - math.pi / 2,
        angle_sd=math.sqrt(across @ covariance[1:3, 1:3] @ across),
        k=float(value[3]),
        k_sd=math.sqrt(covariance[3, 3]),
        rms_px=misfit / size / math.sqrt(2),
    )


def _frequency(grey: Array, pitch_px: float) -> F64:
    """Lines per pixel along x and y, of the strongest repetition near the pitch."""
    rows, columns = grey.shape
    window = np.hanning(rows)[:, None] * np.hanning(columns)
    strength = np.abs(fft.rfft2(grey * window))
    fy, fx = fft.fftfreq(rows), fft.rfftfreq(columns)
    size = np.hypot(fx, fy[:, None])
    near = np.abs(size * pitch_px - 1) < NEAR
    best = np.unravel_index(np.argmax(np.where(near, strength, 0)), strength.shape)
    found = np.array([fx[best[1]], fy[best[0]]])
    usual = float(np.median(strength[near])) if near.any() else math.inf
    n_lines = float(np.abs(found) @ (columns, rows))
    if strength[best] < CLEAR * usual or n_lines < LEAST_LINES:
        strongest = np.unravel_index(
            np.argmax(strength * (size > 2 / min(rows, columns))), size.shape
        )
        raise ValueError(
            f"graticule: no {LEAST_LINES} lines about {pitch_px:.3g} px apart are seen; what"
            f" repeats most is {1 / size[strongest]:.3g} px apart: check the pitch, the expected"
            " pixel, and the focus"
        )
    return found


def _finer(tile: Array, at: F64, f: F64, step: float) -> F64:
    """The frequency at which the tiles of a picture agree best about their phase."""
    beside = step * (np.indices((9, 9)).reshape(2, -1)[::-1] - 4.0)
    together = np.abs(tile @ np.exp(-2j * np.pi * (at @ beside)))
    return f + beside[:, np.argmax(together)]
