"""The error of image correlation on a bench's own pictures, against the size of the box (paper,
section 2.3.2 and Fig. 4): a free block moves at a constant velocity, and every picture is
correlated with the first; lengths in pixels.

References
----------
Prevost et al. 2013, Fig. 4; Hild and Roux 2006 (floor by noise and gradients).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import F64, Array, floats, grey_pictures
from analysis.dic.correlation import open_tracker
from analysis.dic.direct import gaussian_peak
from analysis.dic.field import Field
from analysis.dic.spectrum import slopes, texture
from analysis.settings import Correlation

MIN_IMAGES = 4  # beside the first
MIN_BOXES = 24  # that are measured in a picture: twice the coefficients of what is smooth in it
LEAST_SHIFT_PX = 1.0  # of the last picture: all fractions of a pixel
LARGEST_SWING_PX = 0.5  # of a picture from the steady motion
LARGEST_BEND_PX = 1.0  # of the field, of which a lens makes some tenths
INDEPENDENT = 10  # displacements along the contact (paper)


@dataclass(frozen=True, slots=True)
class ErrorByBox:
    """Errors of u_x by the size of the box, in pixels; arrays of shape (boxes,) or (boxes, images).

    Attributes
    ----------
    box : ndarray, shape (boxes,)
        Sides of the boxes.
    sigma, sigma_sd : ndarray, shape (boxes,)
        Standard deviation of u_x - v t over the boxes of all pictures, what is smooth in the field
        of one (the lens) left out, and its standard uncertainty.
    bias : ndarray, shape (boxes, images)
        Mean of u_x - v t in each picture: that of the interpolation, with what the stage adds.
    floor : ndarray, shape (boxes,)
        Least sigma that the noise of two pictures and their gradients allow.
    shift : ndarray, shape (images,)
        v t.
    bend : float
        Largest departure of a field from one vector that is smooth: of the lens.
    """

    box: F64
    sigma: F64
    sigma_sd: F64
    bias: F64
    floor: F64
    shift: F64
    bend: float


@dataclass(frozen=True, slots=True)
class CorrelationMap:
    """The correlation of one box with the places around it, shape (ny, nx), at the displacements
    `tau_x`, `tau_y`; and its highest place, between pixels (px).
    """

    tau_x: F64
    tau_y: F64
    c: F64
    peak: tuple[float, float]


def noise_by_box(
    images: Sequence[Array],
    time_s: ArrayLike,
    boxes: Sequence[int],
    correlation: Correlation | None = None,
) -> ErrorByBox:
    """Errors of the displacement of a free block by the size of the box.

    Parameters
    ----------
    images : sequence of ndarray, shape (rows, columns)
        Of a block that touches nothing and moves along x at a constant velocity; displacements from
        0.14 to 14 px in the paper. All are correlated with the first.
    time_s : array_like, shape (images,)
    boxes : sequence of int
        Sides of the boxes, px; boxes of a picture do not overlap.
    correlation : Correlation, optional
        How it is correlated; its box and step do not count.

    Raises
    ------
    ValueError
        Too few pictures, boxes or motion; the field is no translation; the motion is not steady.

    Examples
    --------
    >>> import numpy as np, scipy, analysis
    >>> random = np.random.default_rng(0).uniform(0, 255, (200, 240))
    >>> grey = scipy.ndimage.gaussian_filter(random, 1.5, mode="wrap")
    >>> series = [np.roll(grey, n, axis=1) for n in range(6)]
    >>> found = analysis.dic_noise.noise_by_box(series, range(6), [16, 32])
    >>> bool(np.all(found.sigma < 0.01)), found.shift.round(3).tolist()
    (True, [1.0, 2.0, 3.0, 4.0, 5.0])
    """
    t = floats(time_s)
    known = np.unique(t[np.isfinite(t)])
    is_timed = t.shape == (len(images),) and np.isfinite(t).all() and len(known) > 1
    if len(images) <= MIN_IMAGES or not is_timed:
        raise ValueError(
            f"DIC noise: {len(images)} pictures at {len(known)} times were given;"
            f" {MIN_IMAGES + 1} or more of a block that moves are needed"
        )
    settings = correlation or Correlation()
    rows = [_of_box(images, t - t[0], int(box), settings) for box in boxes]
    scatter, shares, bias, shift, bend = (np.array(one) for one in zip(*rows, strict=True))
    return ErrorByBox(
        floats(boxes),
        scatter,
        scatter * shares,
        bias,
        np.array([noise_floor(images[0], int(box)) for box in boxes]),
        np.median(shift, axis=0),
        float(bend.max()),
    )


def noise_floor(image: Array, box: int) -> float:
    """Root mean square over the boxes of a picture, shape (rows, columns), of the least standard
    deviation (px) of u_x that two pictures of its noise allow.

    Raises
    ------
    ValueError
        No box of this side (px) fits into the picture.

    Examples
    --------
    >>> import numpy as np, scipy, analysis
    >>> random = np.random.default_rng(0)
    >>> grey = scipy.ndimage.gaussian_filter(random.uniform(0, 255, (200, 240)), 1.5)
    >>> noisy = grey + random.standard_normal(grey.shape)
    >>> floors = [analysis.dic_noise.noise_floor(noisy, box) for box in (16, 32)]
    >>> round(floors[0] / floors[1])
    2
    """
    grey = grey_pictures("noise floor", [image])[0].astype(np.float32)
    if not 0 < box <= min(grey.shape):
        raise ValueError(
            f"noise floor: a box of {box} px was given for a picture of shape {grey.shape}; give"
            " one that fits into it"
        )
    grain = texture(grey)
    steep = floats(slopes(grey, grain)[0]) ** 2
    rows, columns = (size // box for size in steep.shape)
    cut = steep[: rows * box, : columns * box].reshape(rows, box, columns, box)
    return grain.noise * math.sqrt(2 * float(np.mean(1 / cut.sum(axis=(1, 3)))))


def correlation_map(
    reference: Array, image: Array, x: int, y: int, box: int = 20, search: int = 16
) -> CorrelationMap:
    """The correlation function of one box (paper, Fig. 4c), directly computed; its top is that of a
    2D Gaussian through nine places.

    Parameters
    ----------
    reference, image : ndarray, shape (rows, columns)
    x, y : int
        The first column and row of the box in the reference, pixels.
    box, search : int
        Its side, and the displacements along x and y to which it is searched, pixels.

    Raises
    ------
    ValueError
        The box or what is searched leaves the picture, or the correlation has no peak within.

    Examples
    --------
    >>> import numpy as np, scipy, analysis
    >>> random = np.random.default_rng(0).uniform(0, 255, (80, 90))
    >>> grey = scipy.ndimage.gaussian_filter(random, 1.5, mode="wrap")
    >>> found = analysis.dic_noise.correlation_map(grey, np.roll(grey, 3, axis=1), 30, 30, 20, 8)
    >>> round(found.peak[0], 1), abs(found.peak[1]) < 0.05, found.c.shape
    (3.0, True, (17, 17))
    """
    reference, image = grey_pictures("correlation function", (reference, image))
    rows, columns = reference.shape
    low, high = min(x, y) - search, (x + box + search, y + box + search)
    if low < 0 or high[0] > columns or high[1] > rows:
        raise ValueError(
            f"correlation function: a box of {box} px at ({x}, {y}), searched to {search} px,"
            f" leaves the picture of {columns} x {rows} px; take a box further inside"
        )
    template = np.asarray(reference[y : y + box, x : x + box], np.float32)
    around = np.asarray(image[y - search : high[1], x - search : high[0]], np.float32)
    c = floats(cv2.matchTemplate(around, template, cv2.TM_CCOEFF_NORMED))
    i, j = (int(n) for n in np.unravel_index(np.argmax(c), c.shape))
    is_inside = 0 < i < 2 * search and 0 < j < 2 * search
    dx, dy, is_peak = gaussian_peak(c[i - 1 : i + 2, j - 1 : j + 2]) if is_inside else (0, 0, False)
    if not is_peak:
        raise ValueError(
            f"correlation function: it has no peak within {search} px; search further, or take"
            " another box"
        )
    tau = np.arange(-search, search + 1.0)
    return CorrelationMap(tau, tau, c, (float(tau[j] + dx), float(tau[i] + dy)))


def recommended_box(
    found: ErrorByBox, wanted_px: float, diameter_px: float, independent: int = INDEPENDENT
) -> int:
    """The smallest box, px, whose sigma is below the one wanted (px), of those that leave so many
    independent displacements across a contact of a diameter (px).

    Between the boxes of the measurement sigma is a power law.

    Raises
    ------
    ValueError
        No box does both.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> box = np.array([10.0, 20, 40, 80])
    >>> nothing = np.zeros((4, 1))
    >>> found = analysis.dic_noise.ErrorByBox(
    ...     box, 0.66 / box, 0 * box, nothing, 0.1 / box, nothing[0], 0.0
    ... )
    >>> analysis.dic_noise.recommended_box(found, 0.033, 434)
    20
    """
    sides = np.arange(int(found.box.min()), int(found.box.max()) + 1)
    sigma = np.exp(np.interp(np.log(sides), np.log(found.box), np.log(found.sigma)))
    most = diameter_px / independent
    enough = sides[sigma <= wanted_px * (1 + 1e-9)]
    if not len(enough) or enough[0] > most:
        least = f"{enough[0]} px" if len(enough) else f"more than {sides[-1]} px"
        raise ValueError(
            f"box: an error of {wanted_px:.3g} px needs a box of {least}, {independent} independent"
            f" displacements across {diameter_px:.4g} px one of {most:.3g} px or less; ask for"
            " less, or take pictures with less noise or more pixels"
        )
    return int(enough[0])


def _of_box(
    images: Sequence[Array], t: F64, box: int, settings: Correlation
) -> tuple[float, float, F64, F64, float]:
    """Sigma, its relative uncertainty, bias, v t and bend for one size."""
    fixed = replace(settings, box=box, step=box, update="never", region=())
    with open_tracker(fixed, images[0]) as tracker:
        parts = [_parted(tracker.track(image), box) for image in images[1:]]
    means, lefts, bends = zip(*parts, strict=True)
    shift, bend, count = np.array(means), max(bends), sum(map(len, lefts))
    later = t[1:]
    speed = float(later @ shift / (later @ later))
    # the error of the first picture is in all of them
    steady = np.polynomial.Polynomial.fit(later, shift, 1)(later)
    bias = shift - steady
    if abs(speed * t[-1]) < LEAST_SHIFT_PX:
        raise ValueError(
            f"DIC noise: the block has moved by {speed * t[-1]:.3g} px along x; {LEAST_SHIFT_PX:g}"
            " px or more are needed, along x"
        )
    if np.abs(bias).max() > LARGEST_SWING_PX:
        raise ValueError(
            f"DIC noise: the block was up to {np.abs(bias).max():.2g} px from a steady motion;"
            f" {LARGEST_SWING_PX:g} px is what is taken, so let the stage move steadily"
        )
    if bend > LARGEST_BEND_PX:
        raise ValueError(
            f"DIC noise: the field of a picture bends by {bend:.2g} px, a lens bends it by less"
            f" than {LARGEST_BEND_PX:g} px; let the block touch nothing"
        )
    sigma = math.sqrt(sum(float(left @ left) for left in lefts) / count)
    # the noise of the first picture is in all of them: errors are correlated by 1/2, squares by 1/4
    independent = count / (1 + (len(lefts) - 1) / 4)
    return sigma, 1 / math.sqrt(2 * independent), bias, steady, bend


def _parted(field: Field, box: int) -> tuple[float, F64, float]:
    """Mean of u_x, what is left beside a smooth field, and by how much that bends; px."""
    known = np.isfinite(field.ux_px)
    n = int(known.sum())
    if n < MIN_BOXES:
        raise ValueError(
            f"DIC noise: {n} boxes of {box} px were measured in a picture; {MIN_BOXES} or more are"
            " needed: take smaller boxes, larger pictures, or better light"
        )
    x, y = (one[known] for one in np.meshgrid(field.x_px, field.y_px))
    x, y = (2 * (one - one.mean()) / max(np.ptp(one), 1.0) for one in (x, y))
    u = field.ux_px[known].astype(np.float64)
    columns = np.column_stack([np.ones(n), x, y, x * x, x * y, y * y])
    smooth = columns @ np.linalg.lstsq(columns, u)[0]
    left = (u - smooth) * math.sqrt(n / (n - columns.shape[1]))
    return float(u.mean()), left, float(np.abs(smooth - u.mean()).max())
