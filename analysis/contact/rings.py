"""Means over the azimuth: u_x(r) and other profiles about the contact's centre (paper, Figs 3, 7
and 11 to 13).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

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
    r, values, azimuth = in_step("rings", r=r, values=values, theta=0.0 if theta is None else theta)
    chosen = np.isfinite(values) & np.isfinite(azimuth) & (r >= 0) & (r < limit)
    r, values = r[chosen], values[chosen]
    n = int(limit // width) if r_max is not None else int(r.max() // width) + 1 if len(r) else 0
    ring = (r / width).astype(np.int64)
    inside = ring < n
    r, values, ring = r[inside], values[inside], ring[inside]
    floor = ROUNDING * float(np.abs(values).max(initial=0.0))
    keep = ~_outlying(values, ring, n, floor)
    if theta is None:
        return _plain_means(r[keep], values[keep], ring[keep], n, width)
    columns = _columns(r / width - ring - 0.5, azimuth[chosen][inside])
    fits = _ring_fits(columns, values, ring, keep, n)
    residual, before = values - _modelled(columns, fits[0], ring), keep
    # outliers show better against the fit than against the ring's median
    keep = ~_outlying(residual, ring, n, floor)
    if not np.array_equal(keep, before):
        fits = _ring_fits(columns, values, ring, keep, n, fits[2])
        residual = values - _modelled(columns, fits[0], ring)
    return _fitted_means(r, values, ring, keep, width, fits, residual)


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
def _outlying(values: F64, ring: I64, n: int, floor: float) -> Bool:
    """Which points lie too far from their ring's median, and further than `floor`."""
    first = np.zeros(n + 1, np.int64)
    for k in ring:
        first[k + 1] += 1
    for k in range(n):
        first[k + 1] += first[k]
    free, by_ring = first[:-1].copy(), np.empty(values.size)
    for i in range(values.size):
        by_ring[free[ring[i]]] = values[i]
        free[ring[i]] += 1
    middle, limit = np.zeros(n), np.zeros(n)
    for k in range(n):
        own = by_ring[first[k] : first[k + 1]]
        if own.size:
            middle[k] = np.median(own)
            spread = OUTLIER_SD * (SCALED * np.median(np.abs(own - middle[k])))
            limit[k] = max(spread, floor)
    out = np.empty(values.size, np.bool_)
    for i in range(values.size):
        out[i] = abs(values[i] - middle[ring[i]]) > limit[ring[i]]
    return out


@compiled
def _normal_equations(columns: F64, values: F64, ring: I64, keep: Bool, n: int) -> tuple[F64, F64]:
    """Sums over the kept points of each ring of the products of the columns, shape (n, k, k), and
    of the columns with the values, shape (n, k).
    """
    size = columns.shape[1]
    normal, right = np.zeros((n, size, size)), np.zeros((n, size))
    for p in range(values.size):
        if not keep[p]:
            continue
        k = ring[p]
        for i in range(size):
            right[k, i] += columns[p, i] * values[p]
            for j in range(i + 1):
                normal[k, i, j] += columns[p, i] * columns[p, j]
    for k in range(n):
        for i in range(size):
            for j in range(i):
                normal[k, j, i] = normal[k, i, j]
    return normal, right


def _plain_means(r: F64, values: F64, ring: I64, n: int, width: float) -> Rings:
    count = np.bincount(ring, minlength=n)
    middle = (np.arange(n) + 0.5) * width
    radius = np.where(count > 0, np.bincount(ring, r, minlength=n) / np.maximum(count, 1), middle)
    full = np.where(count > 0, count, np.nan)
    mean = np.bincount(ring, values, minlength=n) / full
    squares = np.bincount(ring, (values - mean[ring]) ** 2, minlength=n)
    freedom = np.where(count > 1, count - 1.0, np.nan)
    return Rings(radius, mean, np.sqrt(squares / freedom / full), count)


@compiled
def _columns(offset: F64, theta: F64) -> F64:
    """What the values of a ring may depend on, shape (points, 6): 1, distance from the ring's
    middle, two harmonics of the azimuth.
    """
    out = np.empty((offset.size, 6))
    for p in range(offset.size):
        cos, sin = np.cos(theta[p]), np.sin(theta[p])
        out[p, 0], out[p, 1], out[p, 2], out[p, 3] = 1.0, offset[p], cos, sin
        out[p, 4], out[p, 5] = cos * cos - sin * sin, 2 * sin * cos
    return out


@compiled
def _modelled(columns: F64, coefficients: F64, ring: I64) -> F64:
    """The fit of each point's ring at the point."""
    out = np.zeros(ring.size)
    for p in range(ring.size):
        for i in range(columns.shape[1]):
            out[p] += columns[p, i] * coefficients[ring[p], i]
    return out


def _ring_fits(
    columns: F64,
    values: F64,
    ring: I64,
    keep: Bool,
    n: int,
    before: tuple[Bool, F64] | None = None,
) -> tuple[F64, F64, tuple[Bool, F64]]:
    """Least squares of the kept points in each ring: coefficients, shape (n, 6), the matrices of
    their normal equations, shape (n, 6, 6), and which rings are poor with their numbers of points.

    Poor rings have too few points, or too small a part of the circle: their only coefficient is the
    plain mean. With `before`, those of another choice of points, only rings are looked at anew that
    have other points.
    """
    size = columns.shape[1]
    normal, sums = _normal_equations(columns, values, ring, keep, n)
    count = normal[:, 0, 0].copy()
    poor, known = before or (np.zeros(n, np.bool_), np.full(n, -1.0))
    new = count != known
    poor = poor.copy()
    poor[new] = np.linalg.eigvalsh(normal[new])[:, 0] < 1e-2 * count[new]
    poor |= count < MIN_FITTED_POINTS
    normal[poor] = np.eye(size)
    sums[poor, 1:] = 0
    sums[poor, 0] /= np.maximum(count[poor], 1)
    return np.linalg.solve(normal, sums[:, :, None])[:, :, 0], normal, (poor, count)


def _fitted_means(
    r: F64,
    values: F64,
    ring: I64,
    keep: Bool,
    width: float,
    fits: tuple[F64, F64, tuple[Bool, F64]],
    residual: F64,
) -> Rings:
    coefficients, normal, (poor, _) = fits
    n, size = coefficients.shape
    kept: Any = slice(None) if keep.all() else keep  # spares copies
    plain = _plain_means(r[kept], values[kept], ring[kept], n, width)
    # from the variance of a point to that of the mean
    factor = np.where(poor, np.nan, np.linalg.inv(normal)[:, 0, 0])
    squares = np.bincount(ring, np.where(keep, residual, 0.0) ** 2, minlength=n)
    error = np.sqrt(squares / np.maximum(plain.count - size, 1) * factor)
    fitted = np.isfinite(factor)
    return Rings(
        np.where(fitted, (np.arange(n) + 0.5) * width, plain.radius),
        np.where(fitted, coefficients[:, 0], plain.mean),
        np.where(fitted, error, plain.standard_error),
        plain.count,
        np.where(fitted[:, None], coefficients[:, 2:], np.nan),
    )
