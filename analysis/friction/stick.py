"""Stick radius c from u_x(r): the Cattaneo-Mindlin profile, fitted live on every frame (paper,
section 5).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import F64, floats, in_step
from analysis.kernels import compiled
from analysis.mechanics.cattaneo_mindlin import phi0

MIN_RINGS = 6
LARGEST = 0.999  # c/a: at 1 the profile is zero
ZOOMS = 5  # most zooms into the grid of candidates
NODES = 17
TABLE = 8193
SHARED = 3  # rings on each side
MIN_CHI2_DROP = (
    16.0  # drop of chi2 (4 sigma) below which the profile does not stand out of the noise
)


@dataclass(frozen=True, slots=True)
class StickFit:
    """A Cattaneo-Mindlin profile through u_x(r): ``u = offset - amplitude (Phi0(r; a) - c/a Phi0(r;
    c))``.

    Attributes
    ----------
    stick_radius, stick_radius_sd : float
        c and its standard uncertainty, metres. At full slip c is 0. NaN where it cannot be
        determined: too few rings, or no profile above the noise. Below about 0.1 a, where c is
        lost, c = 0 lies within two standard uncertainties.
    amplitude : float
        q0 (1 - nu/2) / (2 pi G), where q0 = 3 mu P / (2 pi a^2): dimensionless, 0 or more.
    offset : float
        Displacement of the block far away, D, metres.
    reduced_chi2 : float
        Per degree of freedom; the uncertainty is widened by its root where it is above 1.
    """

    stick_radius: float
    stick_radius_sd: float
    amplitude: float
    offset: float
    reduced_chi2: float


NO_FIT = StickFit(np.nan, np.nan, np.nan, np.nan, np.nan)


def cattaneo_mindlin_profile(r: ArrayLike, stick_radius: ArrayLike, hertz_radius: float) -> F64:
    """Azimuthal mean of u_x under Cattaneo-Mindlin's traction, for a unit amplitude; metres.

    `stick_radius` of shape (k,) gives shape (k, n); it may be zero (full slip).

    References
    ----------
    Mindlin (1949); Johnson, Contact Mechanics, section 7.2.
    """
    r, a = floats(r), hertz_radius
    c = np.atleast_1d(floats(stick_radius))
    share = np.expand_dims(np.maximum(c / a, 1e-9), tuple(range(1, r.ndim + 1)))
    # Phi0(r; c) = c Phi0(r/c; 1)
    return a * (_unit_phi0(r / a) - share**2 * _unit_phi0(r / (share * a)))


@cache
def _phi0_table() -> tuple[F64, F64]:
    """Phi0(1/t; 1) outside the disc for t from 0 to 1, and its steps."""
    t = np.linspace(0, 1, TABLE)
    values = np.concatenate([[0.0], phi0(1 / t[1:], 1.0)])
    return values, np.append(np.diff(values), 0.0)


def _unit_phi0(x: F64) -> F64:
    """Phi0(x; 1) from a table, within 1e-6: the closed form and its series would take most of the
    time of a fit.
    """
    found: F64 = _interpolated(np.ravel(x), *_phi0_table())
    return found.reshape(x.shape)


@compiled
def _interpolated(x: F64, values: F64, steps: F64) -> F64:
    out = np.empty(x.size)
    for p in range(x.size):
        if not x[p] >= 1:  # NaN stays NaN
            out[p] = np.pi**2 / 4 * (2 - x[p] * x[p])
        else:
            place = (TABLE - 1) / x[p]
            node = int(place)
            out[p] = values[node] + (place - node) * steps[node]
    return out


def seen_in_rings(
    profile: Callable[[F64], F64], r: ArrayLike, box: float = 0.0, width: float = 0.0
) -> F64:
    """A profile of r as measured: averaged over square boxes of a given side, then over rings of a
    given width (all metres).

    Four points about r, of the variance of box and ring along and across the radius: exact to third
    order in box/r.
    """
    r = floats(r)
    if box == width == 0:
        return profile(r)
    along, across = np.sqrt((box**2 + width**2) / 6), box / np.sqrt(6)
    places = np.stack([np.abs(r - along), r + along, np.hypot(r, across)])
    near, far, beside = np.moveaxis(profile(places), -2, 0)
    return np.asarray(0.25 * (near + far) + 0.5 * beside)


def fit_stick_radius(
    r: ArrayLike,
    u: ArrayLike,
    sd: ArrayLike,
    hertz_radius: float,
    *,
    box: float = 0.0,
    width: float = 0.0,
) -> StickFit:
    """Stick radius, with its uncertainty, from the azimuthal mean of u_x.

    Parameters
    ----------
    r, u, sd : array_like, shape (n,)
        Radius of each ring, mean of u_x over it and its standard error, metres; `sd` may be one
        for all. Rings with a NaN are ignored. They should reach well beyond the contact: what the
        displacement tends to far away is an unknown of the fit.
    hertz_radius : float
        Radius a of the pressure, metres.
    box, width : float
        Side of the correlation boxes and width of the rings, over which the profile is averaged
        before it is fitted, metres.

    Raises
    ------
    ValueError
        The shapes of `r`, `u` and `sd` differ.

    Notes
    -----
    For each c the two other unknowns are linear, so that chi2 is a function of c alone; it is
    tabulated on a grid that closes in on its least value. The standard uncertainty is half of the
    distance at which it is 4 larger, on the longer side. Neighbouring rings share noise because
    correlation boxes overlap: the uncertainty is widened by the correlation between the residuals
    of successive rings.

    References
    ----------
    Prevost et al. 2013, section 5 and Fig. 14 (there c is taken where the stress is largest).

    Examples
    --------
    >>> import numpy as np, analysis
    >>> r = np.linspace(5e-5, 5e-3, 100)
    >>> block = {"mu": 0.9, "P": 0.5, "a": 2.4e-3}
    >>> g0, _ = analysis.cattaneo_mindlin.radial_displacement(r, Q=0.3, E=3.4e6, nu=0.5, **block)
    >>> found = analysis.fit_stick_radius(r, 20e-6 - g0, np.full(100, 1e-8), hertz_radius=2.4e-3)
    >>> c = analysis.cattaneo_mindlin.stick_radius(0.3, 0.45, 2.4e-3)
    >>> round(found.stick_radius * 1e3, 3), round(float(c) * 1e3, 3)
    (1.664, 1.664)
    """
    r, u, sd = in_step("stick radius", r=r, u=u, sd=sd)
    good = np.isfinite(r) & np.isfinite(u) & np.isfinite(sd) & (sd > 0)
    a = float(hertz_radius)
    if good.sum() < MIN_RINGS or not 0 < a < np.inf:
        return NO_FIT
    r, u, sd = r[good], u[good], sd[good]
    # a ring of three points may agree by chance: the scatter of a point is shared with the three
    # rings on each side
    window = np.ones(2 * SHARED + 1)
    points, scatter = (  # "same" gives seven for six rings
        np.convolve(of, window)[SHARED:-SHARED] for of in (np.ones(len(r)), sd * sd * r)
    )
    weight = r * points / scatter

    def profile(share: ArrayLike) -> F64:
        c = np.asarray(share) * a
        return seen_in_rings(lambda at: cattaneo_mindlin_profile(at, c, a), r, box, width)

    low, high = 0.0, LARGEST
    for _ in range(ZOOMS):
        share = np.linspace(low, high, NODES)
        chi2, _, _ = _linear_fit(profile(share), u, weight)
        best = int(np.argmin(chi2))
        scale = max(1.0, chi2[best] / (len(r) - 3))
        inside = np.flatnonzero(chi2 <= chi2[best] + 6 * scale)
        if len(inside) >= NODES // 2:
            break
        low, high = share[max(inside[0] - 1, 0)], share[min(inside[-1] + 1, NODES - 1)]

    minimum, at = _parabola(share, chi2, best)
    best_profile = profile([minimum])
    _, (amplitude,), (offset,) = _linear_fit(best_profile, u, weight)
    residual = (u - offset + amplitude * best_profile[0]) * np.sqrt(weight)
    reduced = float(residual @ residual) / (len(r) - 3)
    flat, _, _ = _linear_fit(np.zeros((1, len(r))), u, weight)
    correlation = correlation_factor(residual)
    if flat[0] - at < MIN_CHI2_DROP * max(1.0, reduced) * correlation:
        return NO_FIT
    spread = 0.5 * _longer_side(share, chi2, minimum, at + 4 * max(1.0, reduced))
    sd_c = spread * a * np.sqrt(correlation)
    return StickFit(minimum * a, sd_c, float(amplitude), float(offset), reduced)


def _linear_fit(profiles: F64, u: F64, weight: F64) -> tuple[F64, F64, F64]:
    """chi2, amplitude (0 or more) and offset of ``u = offset - amplitude profile`` for each
    profile, shape (k, n) to (k,).
    """
    total = weight.sum()
    mean_u, mean_s = weight @ u / total, profiles @ weight / total
    du, ds = u - mean_u, profiles - mean_s[:, None]
    square = (ds * ds) @ weight
    product = np.maximum(-(ds @ (weight * du)), 0.0)
    amplitude = np.divide(product, square, out=np.zeros_like(product), where=square > 0)
    # from residuals, not from differences of large sums
    residual = du + amplitude[:, None] * ds
    return (residual * residual) @ weight, amplitude, mean_u + amplitude * mean_s


def _parabola(x: F64, y: F64, best: int) -> tuple[float, float]:
    """Place and value of the least y: of the parabola through the least node and its neighbours, or
    the node at an end.
    """
    if 0 < best < len(x) - 1:
        down, up = y[best - 1] - y[best], y[best + 1] - y[best]
        if down + up > 0:
            shift = 0.5 * (down - up) / (down + up)
            place = x[best] + shift * (x[1] - x[0])
            return float(place), float(y[best] - 0.25 * (down - up) * shift)
    return float(x[best]), float(y[best])


def _longer_side(x: F64, y: F64, minimum: float, level: float) -> float:
    """How far from the minimum y stays below a level, on the longer side; the range's ends count as
    crossings.
    """
    below = np.flatnonzero(y < level)
    first, last = (below[0], below[-1]) if len(below) else (int(np.argmin(y)),) * 2
    left, right = x[first], x[last]
    if first > 0:
        left = np.interp(level, [y[first], y[first - 1]], [x[first], x[first - 1]])
    if last < len(x) - 1:
        right = np.interp(level, [y[last], y[last + 1]], [x[last], x[last + 1]])
    return float(max(minimum - left, right - minimum))


def correlation_factor(residual: F64) -> float:
    """By how much the variance of a mean over rings exceeds that of independent rings: 1 + 2 (rho_1
    + rho_2), 1 or more.

    Residuals of shape (rings,) or (frames, rings), in standard deviations. The three parameters of
    a fit take a part of the slow errors away from them, which is given back.
    """
    power, n = float((residual * residual).sum()), residual.shape[-1]
    if not power > 0:
        return 1.0
    rho = sum(float((residual[..., lag:] * residual[..., :-lag]).sum()) for lag in (1, 2)) / power
    return float(max(1.0, (1 + 2 * rho) / (1 - 12 / max(n, 24))))
