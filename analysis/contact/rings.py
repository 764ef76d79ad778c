"""Means over the azimuth: u_x(r) and other profiles about the contact's centre (paper, Figs 3, 7
and 11 to 13).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import F64, I64, Bool, floats, in_step
from analysis.kernels import compiled
from analysis.robust import SCALED

# of a ring whose mean comes from a fit; with fewer it is the plain mean
MIN_FITTED_POINTS = 12
CENTRAL_RINGS = 4
MOST_OFF = 3.0  # standard uncertainties of the centre from which a slope tells a tilt instead
TINY = float(np.finfo(np.float64).tiny)
OUTLIER_SD = 5.0  # robust standard deviations from its ring at which a point is left out
ROUNDING = 1e-6  # of the largest value: nearer to its ring no point is left out
ROUNDED = 1e-12  # of a quotient, more than its rounding
COLUMNS = 6  # of a fit


@dataclass(frozen=True, slots=True)
class Rings:
    """An azimuthally averaged profile, one entry per ring; all of shape (n,).

    Attributes
    ----------
    radius : ndarray
        Mean radius of the ring's points; the ring's middle where it is empty.
    mean, standard_error : ndarray
        NaN in empty rings; the error also in rings with too few points for one.
    count : ndarray of int
        Number of points in the mean.
    harmonics : ndarray, shape (n, 4)
        Amplitudes of cos and sin of the azimuth, and of cos and sin of twice the azimuth; NaN in
        rings whose mean is the plain one. Of shape (0, 4) where they were not fitted.
    """

    radius: F64
    mean: F64
    standard_error: F64
    count: I64
    harmonics: F64 = field(default_factory=lambda: np.empty((0, 4)))


def ring_means(
    r: ArrayLike,
    values: ArrayLike,
    width: float,
    r_max: float | None = None,
    *,
    theta: ArrayLike | None = None,
) -> Rings:
    """Azimuthal mean of a field in rings of a given width about r = 0, and its standard error.

    Parameters
    ----------
    r, values : array_like, any common shape
        Distance from the centre and value of each grid point; points where either is NaN are
        ignored.
    width : float
        Width of a ring, in the units of `r`.
    r_max : float, optional
        No ring reaches beyond; default: up to the farthest point.
    theta : array_like, optional
        Azimuth of each point. With it the mean is that of the fit ``mean + slope (r - radius) +
        first and second harmonics of theta`` in each ring: a grid samples a ring unevenly, and the
        cos 2 theta of a sheared contact (u_x of a Hertz-like traction) would leak into the mean and
        swell its standard error.

    Notes
    -----
    Points further than five scaled median absolute deviations from their ring's median (or fit) are
    left out. The standard error counts points as independent; boxes that overlap share noise, so
    that it is too small by up to the square root of the number of boxes that overlap in a place.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> x, y = np.meshgrid(np.linspace(-1e-3, 1e-3, 41), np.linspace(-1e-3, 1e-3, 41))
    >>> rings = analysis.ring_means(np.hypot(x, y), 2.0 + x, 2e-4, 1e-3)
    >>> rings.mean.round(3).tolist()
    [2.0, 2.0, 2.0, 2.0]
    """
    limit = np.inf if r_max is None else r_max
    if not (width > 0 and (r_max is None or 0 <= r_max < np.inf)):
        raise ValueError(
            f"rings: a width of {width} up to {limit} was requested; it must be positive"
        )
    given = in_step("rings", r=r, values=values, theta=0.0 if theta is None else theta)
    at, of, azimuth = given
    chosen = np.isfinite(of) & np.isfinite(azimuth) & (at >= 0) & (at < limit)
    at, of, azimuth = (each[chosen] for each in given)
    n = int(limit // width) if r_max is not None else int(at.max() // width) + 1 if len(at) else 0
    first, at, of, azimuth = _by_ring(at, of, azimuth, width, n)
    floor = ROUNDING * float(np.abs(of).max(initial=0.0))
    keep = ~_outlying(of, first, floor)
    if theta is None:
        return _plain_means(at, of, first, keep, width)
    columns, residual, rings = _columns(at, azimuth, first, width), of.copy(), np.arange(n)
    fits = np.empty((n, COLUMNS)), np.empty(n)
    _fit(columns, of, first, keep, rings, *fits, residual)
    before = keep
    # outliers show better against the fit than against the ring's median
    keep = ~_outlying(residual, first, floor)
    rings = np.unique(np.searchsorted(first, np.flatnonzero(keep != before), side="right") - 1)
    if rings.size:
        _fit(columns, of, first, keep, rings, *fits, residual)
    squares = _squares(residual, first, keep, np.zeros(n))
    return _fitted_means(_plain_means(at, of, first, keep, width), *fits, squares, width)


def central_value(
    r: ArrayLike,
    theta: ArrayLike,
    values: ArrayLike,
    radius: float,
    *,
    box: float = 0.0,
    shared: float = 1.0,
    centre_sd: float = 0.0,
) -> tuple[float, float]:
    """Value of a field at the centre, and its standard uncertainty: of the parabola ``u0 + k r^2``
    through its means over the rings within `radius`, outliers left out.

    A plain mean over the disc would be off by half of what the field bends over it. A field that
    bends is symmetric about its own centre, which is not known to any digit: its slope at r = 0
    tells where that is, and the value there is taken. A slope so steep that the centre would be off
    by more than three of its uncertainties counts as a tilt of another origin, and moves the value
    the less the steeper it is. A smaller tilt looks like a centre that is off. NaN where there are
    too few points.

    Parameters
    ----------
    r, theta, values : array_like, any common shape
        Distance from the centre, azimuth and value of each grid point.
    radius : float
        In the units of `r`, as is `box`.
    box : float
        Side of the boxes over which the values are means: the bending over them, k box^2/6, is
        taken off.
    shared : float
        Number of boxes that overlap in a place, which share their noise.
    centre_sd : float
        Standard uncertainty of r = 0 along each axis, in the units of `r`. 0: it is the centre.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> x, y = np.meshgrid(np.linspace(-1e-3, 1e-3, 41), np.linspace(-1e-3, 1e-3, 41))
    >>> r = np.hypot(x, y)
    >>> u0, _ = analysis.central_value(r, np.arctan2(y, x), 5e-6 - 3 * r**2, 8e-4)
    >>> round(u0 * 1e6, 4)
    5.0014
    """
    if not radius > 0:
        return math.nan, math.nan
    width = radius / CENTRAL_RINGS
    rings = ring_means(r, values, width, radius, theta=floats(theta))
    full = rings.count > 1
    if full.sum() < CENTRAL_RINGS - 1:
        return math.nan, math.nan
    count = rings.count[full].astype(np.float64)
    middle = ((np.arange(len(full)) + 0.5) * width)[full]
    # the mean of a fit along the radius is at the ring's middle, and bends over its width
    is_fitted = np.isfinite(rings.harmonics[full, 0])
    square = middle**2 + width**2 / 12
    if not is_fitted.all():
        plain = ring_means(r, np.square(r), width, radius).mean[full]
        square = np.where(is_fitted, square, plain)
    square = square + box**2 / 6
    columns = np.column_stack([np.ones(len(count)), square / radius**2])
    covariance = np.linalg.inv(columns.T @ (columns * count[:, None]))
    centre, bend = (covariance @ (columns.T @ (rings.mean[full] * count))).tolist()
    usable = is_fitted if is_fitted.any() else np.ones(len(count), np.bool_)
    point = shared * float(np.average((rings.standard_error[full] ** 2 * count)[usable]))
    off, at_place, unshared = 0.0, np.array([1.0, 0.0]), 0.0
    if centre_sd > 0 and is_fitted.any():
        turning = rings.harmonics[full][is_fitted].T
        at, each = middle[is_fitted], count[is_fitted]
        second, fourth = float(each @ at**2), float(each @ at**4)
        slope = turning[:2] @ (each * at) / second
        long, cross = turning[2:] @ (each * at**2) / fourth
        round_part = bend / radius**2
        # along the axes of the bending each is a matter of its own
        bends, axes = np.linalg.eigh(
            2 * np.array([[round_part + long, cross], [cross, round_part - long]])
        )
        # an amplitude has twice the variance of a mean
        off, turned, unshared = _lift(bends, slope @ axes, 2 * point / second, centre_sd)
        at_place[1] = turned.sum() / radius**2
        unshared += 2 * point * float(np.abs(turned).sum()) ** 2 / fourth
    variance = point * float(at_place @ covariance @ at_place) + unshared
    return centre - off, math.sqrt(variance)


def _lift(
    bends: F64, slope: F64, slope_variance: float, centre_sd: float
) -> tuple[float, F64, float]:
    """By how much a field lies higher at r = 0 than at its own centre, by its bending and slope
    along two axes, shape (2,); minus twice the change of that by a unit of each bending, and the
    variance of that by the place of the centre.
    """
    # a slope that the centre does not explain is a tilt
    variance = np.maximum(slope_variance, (slope / MOST_OFF) ** 2 - (bends * centre_sd) ** 2)
    floor = variance / centre_sd**2
    size = np.maximum(bends**2 + floor, TINY)
    gain, steeper = bends / size, (floor - bends**2) / size / size
    square, spread = (gain * slope) ** 2, variance * gain
    turned = -square - (2 * bends * gain * slope**2 + variance) * steeper
    unsure = bends * square @ spread + spread @ spread / 2
    return float(bends @ square + spread.sum()) / 2, turned, float(unsure)


@compiled
def _by_ring(r: F64, values: F64, theta: F64, width: float, n: int) -> tuple[I64, F64, F64, F64]:
    """The points of n rings, ring by ring and else in their order: where those of each ring begin,
    shape (n + 1,), and their distances, values and azimuths.
    """
    first = np.zeros(n + 1, np.int64)
    for distance in r:
        ring = int(distance / width)
        if ring < n:
            first[ring + 1] += 1
    for k in range(n):
        first[k + 1] += first[k]
    free, (at, of, azimuth) = first[:-1].copy(), np.empty((3, first[n]))
    for p in range(r.size):
        ring = int(r[p] / width)
        if ring < n:
            at[free[ring]], of[free[ring]], azimuth[free[ring]] = r[p], values[p], theta[p]
            free[ring] += 1
    return first, at, of, azimuth


@compiled
def _outlying(values: F64, first: I64, floor: float) -> Bool:
    """Which points lie too far from their ring's median, and further than `floor`."""
    out = np.zeros(values.size, np.bool_)
    for k in range(first.size - 1):
        own = values[first[k] : first[k + 1]]
        if not own.size:
            continue
        off = np.abs(own - np.median(own))
        # so large a median deviation would spare all; to count is quicker than to find it
        enough = off.max() / (OUTLIER_SD * SCALED) * (1 + ROUNDED)
        if off.max() <= floor or (off < enough).sum() <= (own.size - 1) // 2:
            continue
        spread = OUTLIER_SD * (SCALED * np.median(off))
        out[first[k] : first[k + 1]] = off > max(spread, floor)
    return out


@compiled
def _normal_equations(
    columns: F64, values: F64, first: I64, keep: Bool, rings: I64
) -> tuple[F64, F64]:
    """Sums over the kept points of each of those rings of the products of the columns, shape (k,
    COLUMNS, COLUMNS), and of the columns with the values, shape (k, COLUMNS).
    """
    size = columns.shape[1]
    normal, right = np.zeros((rings.size, size, size)), np.zeros((rings.size, size))
    for k, ring in enumerate(rings):
        for p in range(first[ring], first[ring + 1]):
            if not keep[p]:
                continue
            for i in range(size):
                right[k, i] += columns[p, i] * values[p]
                for j in range(i + 1):
                    normal[k, i, j] += columns[p, i] * columns[p, j]
        for i in range(size):
            for j in range(i):
                normal[k, j, i] = normal[k, i, j]
    return normal, right


@compiled
def _sums(r: F64, values: F64, first: I64, keep: Bool) -> tuple[I64, F64, F64]:
    """Number of the kept points of each ring, and sums of their distances and values."""
    n = first.size - 1
    count, distance, total = np.zeros(n, np.int64), np.zeros(n), np.zeros(n)
    for k in range(n):
        for p in range(first[k], first[k + 1]):
            if keep[p]:
                count[k] += 1
                distance[k] += r[p]
                total[k] += values[p]
    return count, distance, total


@compiled
def _squares(values: F64, first: I64, keep: Bool, mean: F64) -> F64:
    """Sums of the squares of the kept points' deviations from a value of each ring."""
    squares = np.zeros(first.size - 1)
    for k in range(first.size - 1):
        for p in range(first[k], first[k + 1]):
            if keep[p]:
                squares[k] += (values[p] - mean[k]) * (values[p] - mean[k])
    return squares


def _plain_means(r: F64, values: F64, first: I64, keep: Bool, width: float) -> Rings:
    count, distance, total = _sums(r, values, first, keep)
    middle = (np.arange(count.size) + 0.5) * width
    radius = np.where(count > 0, distance / np.maximum(count, 1), middle)
    full = np.where(count > 0, count, np.nan)
    mean = total / full
    squares = _squares(values, first, keep, mean)
    freedom = np.where(count > 1, count - 1.0, np.nan)
    return Rings(radius, mean, np.sqrt(squares / freedom / full), count)


@compiled
def _columns(r: F64, theta: F64, first: I64, width: float) -> F64:
    """What the values of a ring may depend on, shape (points, COLUMNS): 1, distance from the ring's
    middle, two harmonics of the azimuth.
    """
    out = np.empty((r.size, COLUMNS))
    for k in range(first.size - 1):
        for p in range(first[k], first[k + 1]):
            cos, sin = np.cos(theta[p]), np.sin(theta[p])
            out[p, 0], out[p, 1], out[p, 2], out[p, 3] = 1.0, r[p] / width - k - 0.5, cos, sin
            out[p, 4], out[p, 5] = cos * cos - sin * sin, 2 * sin * cos
    return out


@compiled
def _residuals(
    columns: F64, values: F64, first: I64, rings: I64, coefficients: F64, out: F64
) -> None:
    """What the fits of some rings leave of the values of their points."""
    for ring in rings:
        for p in range(first[ring], first[ring + 1]):
            model = 0.0
            for i in range(columns.shape[1]):
                model += columns[p, i] * coefficients[ring, i]
            out[p] = values[p] - model


def _fit(
    columns: F64,
    values: F64,
    first: I64,
    keep: Bool,
    rings: I64,
    coefficients: F64,
    factor: F64,
    residual: F64,
) -> None:
    """Least squares of the kept points in each of those rings: coefficients, shape (n, COLUMNS),
    the variance of the mean over that of a point, shape (n,), and the residuals of their points.

    Rings with too few points, or too small a part of the circle, are poor: their only coefficient
    is the plain mean, and the variance is NaN.
    """
    normal, sums = _normal_equations(columns, values, first, keep, rings)
    count = normal[:, 0, 0].copy()
    poor = (np.linalg.eigvalsh(normal)[:, 0] < 1e-2 * count) | (count < MIN_FITTED_POINTS)
    normal[poor] = np.eye(COLUMNS)
    sums[poor, 1:] = 0
    sums[poor, 0] /= np.maximum(count[poor], 1)
    coefficients[rings] = np.linalg.solve(normal, sums[:, :, None])[:, :, 0]
    factor[rings] = np.where(poor, np.nan, np.linalg.inv(normal)[:, 0, 0])
    _residuals(columns, values, first, rings, coefficients, residual)


def _fitted_means(
    plain: Rings, coefficients: F64, factor: F64, squares: F64, width: float
) -> Rings:
    error = np.sqrt(squares / np.maximum(plain.count - COLUMNS, 1) * factor)
    fitted = np.isfinite(factor)
    return Rings(
        np.where(fitted, (np.arange(len(factor)) + 0.5) * width, plain.radius),
        np.where(fitted, coefficients[:, 0], plain.mean),
        np.where(fitted, error, plain.standard_error),
        plain.count,
        np.where(fitted[:, None], coefficients[:, 2:], np.nan),
    )
