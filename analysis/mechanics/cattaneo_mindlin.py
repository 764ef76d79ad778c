"""Cattaneo and Mindlin: a Hertz contact under a shear force, stuck inside radius c and slipping from c to a. SI units throughout.

The traction is that of full slip over the whole contact, less the same over the stick disc scaled by c/a. Friction is taken along x
everywhere; for nu > 0 the slip in the annulus is not quite parallel to x, so that the solution is approximate there (exact in the stick
zone). `Q` is the shear force, `mu` the friction coefficient, `P` the normal force, `a` Hertz's contact radius.

References
----------
Cattaneo (1938); Mindlin (1949); Johnson, Contact Mechanics, section 7.2; Prevost et al. 2013, section 5.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import ArrayLike, NDArray

from analysis.mechanics import hertz

F64 = NDArray[np.float64]

_FAR = 0.35  # a/r below which the closed forms lose more digits than their series
_N = np.arange(1, 18)
_ASIN = np.cumprod((2 * _N - 1) / (2 * _N))  # (2n)! / (4^n n!^2)
_SERIES0 = _ASIN * 8 * _N / ((2 * _N - 1) ** 2 * (2 * _N + 1))
_SERIES2 = _ASIN * 16 * _N / ((2 * _N - 1) * (2 * _N + 1) * (3 - 2 * _N))


def phi0(r: ArrayLike, a: ArrayLike) -> F64:
    """Isotropic part Phi0 (metres) of the displacement under a traction sqrt(1 - r^2/a^2) along x; `r` and `a` broadcast.

    ``u_x = q0/(2 pi G) [(1 - nu/2) Phi0 + (nu/2) Phi2 cos 2 theta]``, ``u_y = q0/(2 pi G) (nu/2) Phi2 sin 2 theta``.
    """
    r, a = np.asarray(r, dtype=np.float64), np.asarray(a, dtype=np.float64)
    x = r / a
    t = 1 / np.maximum(x, 1.0)
    near = (2 * t * t - 1) * np.arcsin(t) + t * np.sqrt((1 - t) * (1 + t))
    outside = np.pi / 2 * _far_or_near(t, near, _SERIES0)
    return np.asarray(a * np.where(x <= 1, np.pi**2 / 4 * (2 - x * x), outside))


def phi2(r: ArrayLike, a: ArrayLike) -> F64:
    """Part Phi2 (metres) that goes with the double angle under a traction sqrt(1 - r^2/a^2) along x; see `phi0`."""
    r, a = np.asarray(r, dtype=np.float64), np.asarray(a, dtype=np.float64)
    x = r / a
    t = 1 / np.maximum(x, 1.0)
    near = np.arcsin(t) + (2 * t * t - 1) * t * np.sqrt((1 - t) * (1 + t))
    outside = np.pi / 4 * _far_or_near(t, near, _SERIES2)
    return np.asarray(a * np.where(x <= 1, np.pi**2 / 8 * x * x, outside))


def _far_or_near(t: F64, near: F64, series: F64) -> F64:
    """The bracket of Phi over t^2: from its closed form, or for t = a/r small, where that cancels to order t^3, from its series."""
    square = t * t
    return np.where(t < _FAR, t * polynomial.polyval(square, series), near / square)


def stick_radius(Q: ArrayLike, limit: float, a: float) -> F64:
    """Stick radius c = a (1 - Q/(mu P))^(1/3) in metres, shape of `Q`; 0 once the contact slides.

    Parameters
    ----------
    Q : array_like
        Shear force, newtons.
    limit : float
        Greatest shear force mu P, newtons.
    a : float
        Contact radius, metres.

    References
    ----------
    Prevost et al. 2013, section 5 (the equation for c).
    """
    return np.asarray(a * np.cbrt(np.maximum(1 - np.abs(np.asarray(Q, dtype=np.float64)) / limit, 0.0)))


def full_shift(mu: float, P: float, a: float, E: float, nu: float) -> float:
    """Shift delta_max (metres) of the block against the sphere, far from the contact, at which the whole contact slides."""
    G = E / (2 * (1 + nu))
    return 3 * mu * P * (2 - nu) / (16 * G * a)


def shift(Q: ArrayLike, mu: float, P: float, a: float, E: float, nu: float) -> F64:
    """Shift delta (metres) of the block against the sphere, far from the contact, under the shear force Q; shape of `Q`.

    ``delta = 3 mu P (2 - nu)/(16 G a) [1 - (1 - Q/(mu P))^(2/3)]``; NaN where the size of Q is above mu P, which no contact carries.

    References
    ----------
    Johnson, Contact Mechanics, eq. 7.42.
    """
    Q = np.asarray(Q, dtype=np.float64)
    part = np.abs(Q) / (mu * P)
    inside = np.where(part < 1, part, 0.0)
    share = np.where(part < 1, -np.expm1(2 / 3 * np.log1p(-inside)), np.where(part == 1, 1.0, np.nan))
    return np.asarray(np.copysign(full_shift(mu, P, a, E, nu) * share, Q))


def shear_force(shift: ArrayLike, mu: float, P: float, a: float, E: float, nu: float) -> F64:
    """Shear force Q (newtons) at which the block has shifted that far (metres) against the sphere; mu P beyond the onset of sliding.

    The inverse of `shift`.
    """
    delta = np.asarray(shift, dtype=np.float64)
    part = np.abs(delta) / full_shift(mu, P, a, E, nu)
    inside = np.where(part < 1, part, 0.0)
    share = np.where(part < 1, -np.expm1(1.5 * np.log1p(-inside)), 1.0)
    return np.asarray(np.copysign(mu * P * share, delta))


def driven_shear_force(distance: ArrayLike, compliance: float, mu: float, P: float, a: float, E: float, nu: float) -> F64:
    """Shear force Q (newtons) after a drive started from rest has advanced by a distance, through a spring in series with the contact.

    Solves ``distance = shift(Q) + compliance Q``; mu P once the whole contact slides, 0 for a distance below 0. Shape of `distance`.

    Parameters
    ----------
    distance : array_like
        Distance driven since the contact bore no shear, metres; monotone in time.
    compliance : float
        Of everything in series with the contact, metres per newton.

    Notes
    -----
    With s = c/a, Q = mu P (1 - s^3) and shift = delta_max (1 - s^2): a cubic in s, convex and increasing. Newton from above converges
    monotonically; it starts at most a factor sqrt(2) away and is at 4e-16 of mu P after five steps. Their number is fixed, so that a value
    does not depend on its neighbours.

    References
    ----------
    Prevost et al. 2013, Fig. 5.
    """
    limit, soft = mu * P, full_shift(mu, P, a, E, nu)
    stiff = limit * compliance
    left = np.clip(soft + stiff - np.asarray(distance, dtype=np.float64), 0.0, soft + stiff)
    s = np.minimum(np.minimum(np.sqrt(left / soft), np.cbrt(left / max(stiff, 1e-300))), 1.0)
    for _ in range(6):
        slope = s * (3 * stiff * s + 2 * soft)
        excess = s * s * (stiff * s + soft) - left
        s = np.clip(s - np.divide(excess, slope, out=np.zeros_like(s), where=slope > 0), 0.0, 1.0)
    return np.asarray(limit * (1 - s) * (1 + s + s * s))


def traction(r: ArrayLike, Q: float, mu: float, P: float, a: float) -> F64:
    """Shear traction along x at the distance r from the centre, pascals, shape of `r`; its sum over the contact is Q."""
    c = float(stick_radius(Q, mu * P, a))
    full = mu * hertz.pressure(r, P, a)
    return full if c == 0 else np.asarray(full - (c / a) ** 3 * mu * hertz.pressure(r, P, c))


def radial_displacement(r: ArrayLike, Q: float, mu: float, P: float, a: float, E: float, nu: float) -> tuple[F64, F64]:
    """Surface displacement G*sigma under the shear force Q, as (g0, g2): ``gx = g0 + g2 cos 2 theta``, ``gy = g2 sin 2 theta``.

    Parameters
    ----------
    r : array_like
        Distance from the contact's centre, metres, inside or outside the contact.
    Q, mu, P, a, E, nu : float
        Shear force (N), at most mu P; friction; normal force (N); contact radius (m); modulus (Pa) and Poisson's ratio.

    Returns
    -------
    g0, g2 : ndarray
        Metres, shape of `r`. `g0` is the azimuthal mean of gx. In the stick zone g0 is the shift and g2 is 0.
    """
    r = np.asarray(r, dtype=np.float64)
    scale = hertz.peak_pressure(mu * P, a) * (1 + nu) / (np.pi * E)  # q0 / (2 pi G)
    c = float(stick_radius(Q, mu * P, a))
    f0, f2 = phi0(r, a), phi2(r, a)
    if c > 0:
        f0, f2 = f0 - c / a * phi0(r, c), f2 - c / a * phi2(r, c)
    return np.asarray(scale * (1 - nu / 2) * f0), np.asarray(scale * nu / 2 * f2)


def displacement(x: ArrayLike, y: ArrayLike, Q: float, mu: float, P: float, a: float, E: float, nu: float) -> tuple[F64, F64]:
    """Surface displacement G*sigma (gx, gy) in metres under the shear force Q, at points (x, y) from the contact's centre.

    `x` and `y` broadcast; the other parameters are those of `radial_displacement`. The block far away has not moved: seen from a
    sphere at rest, with the block driven by D, a point of the surface has moved by D - G*sigma.
    """
    x, y = np.broadcast_arrays(np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64))
    r = np.hypot(x, y)
    g0, g2 = radial_displacement(r, Q, mu, P, a, E, nu)
    cos, sin = (np.divide(v, r, out=np.zeros_like(r), where=r > 0) for v in (x, y))
    return g0 + g2 * (cos * cos - sin * sin), g2 * 2 * cos * sin
