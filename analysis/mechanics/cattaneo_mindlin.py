"""Cattaneo and Mindlin: a Hertz contact under a shear force, stuck inside radius c and slipping
from c to a. SI units throughout.

The traction is that of full slip over the whole contact, less the same over the stick disc scaled
by c/a. Friction is taken along x everywhere; for nu > 0 the slip in the annulus is not quite
parallel to x, so that the solution is approximate there (exact in the stick zone). Q is the shear
force, mu the friction coefficient, P the normal force, a Hertz's contact radius.

Both tractions nearly cancel for small Q, and so do the angles of a contact seen from afar: nothing
here is a difference of such numbers. Forces, tractions and displacements hold 12 digits from Q =
1e-12 mu P up to full slip, at any distance.

References
----------
Cattaneo (1938); Mindlin (1949); Johnson, Contact Mechanics, section 7.2; Prevost et al. 2013,
section 5.
"""

from __future__ import annotations

import numpy as np
from numpy.polynomial import polynomial
from numpy.typing import ArrayLike

from analysis.arrays import F64, all_floats, as_grid, floats
from analysis.mechanics import hertz
from analysis.mechanics.hertz import check

ROUNDING = 1 + 1e-12  # a force within it of mu P is mu P
# of y - sin y = y^3 (1/6 - y^2/120 + ...)
_DEFECT = np.cumprod([1 / 6] + [-1 / ((2 * k + 2) * (2 * k + 3)) for k in range(1, 14)])


def phi0(r: ArrayLike, a: ArrayLike) -> F64:
    """Isotropic part Phi0 (metres) of the displacement under a traction sqrt(1 - r^2/a^2) along x;
    `r` and `a` broadcast.

    ``u_x = q0/(2 pi G) [(1 - nu/2) Phi0 + (nu/2) Phi2 cos 2 theta]``, ``u_y = q0/(2 pi G) (nu/2)
    Phi2 sin 2 theta``.
    """
    return _phi(r, a, 0.0, a)[0]


def phi2(r: ArrayLike, a: ArrayLike) -> F64:
    """Part Phi2 (metres) that goes with the double angle under a traction sqrt(1 - r^2/a^2) along
    x; see `phi0`.
    """
    return _phi(r, a, 0.0, a)[1]


def _phi(r: ArrayLike, a: ArrayLike, c: float, width: ArrayLike) -> tuple[F64, F64]:
    """Phi0(r; a) - c/a Phi0(r; c) and the same of Phi2; `width` is a - c, which a difference would
    not hold for c close to a.

    A traction 1/sqrt(b^2 - r^2) gives 2 pi asin(min(1, b/r)); Hertz's is b times that summed over
    b. With b = r sin(angle) the sums from c to a are r^2/4 times that of ``2 angle sin(2 angle)``,
    r^2 times that of ``sin^2(2 angle)``. What follows is their closed form in the sum m and the
    difference d of the two ends: no two terms cancel but those of ``y - sin y``.
    """
    r, a, width = all_floats(r, a, width)
    beyond = np.maximum(_gap(r, a, c, width), 0.0)  # r - c
    far = np.where(beyond > 1e-100 * a, r, a)
    sin_a, cos_a = np.minimum(a / far, 1.0), np.sqrt(np.maximum(r - a, 0.0) * (far + a)) / far
    sin_c, cos_c = c / far, np.sqrt(beyond * (far + c)) / far
    ring = width * (a + c)  # a^2 - c^2
    square = np.minimum(ring, beyond * (far + c)) / (far * far)  # sin m sin d
    sin_m, cos_m = sin_a * cos_c + cos_a * sin_c, cos_a * cos_c - sin_a * sin_c
    cos_d = cos_a * cos_c + sin_a * sin_c
    m = np.arctan2(sin_a, cos_a) + np.arctan2(sin_c, cos_c)
    d = np.arctan2(np.divide(square, sin_m, out=np.zeros_like(square), where=sin_m > 0), cos_d)
    edge = np.maximum(np.minimum(ring, (a - r) * (a + r)), 0.0)
    swing = 2 * d * np.sin(d / 2) ** 2 - _defect(d)  # sin d - d cos d
    isotropic = np.pi / (2 * a) * (np.pi * edge + far * far * (m * square + cos_m * swing))
    return isotropic, np.pi / (8 * a) * far * far * (_defect(2 * d) + 4 * square * sin_m * cos_d)


def _gap(r: F64, a: F64 | float, c: float, width: F64 | float) -> F64:
    """Distance r - c beyond the stick zone, exact even where c, nearly a, is given by a - c."""
    return np.where(2 * c < a, r - c, (r - a) + width)


def _defect(y: F64) -> F64:
    """Difference y - sin y for y from 0 to pi."""
    return np.asarray(y * y * y * polynomial.polyval(y * y, _DEFECT))


def _stick(Q: ArrayLike, limit: float) -> tuple[F64, F64]:
    """c/a and 1 - c/a, each to full precision; 0 and 1 beyond the limit."""
    check("Cattaneo-Mindlin", limit=limit)
    size = np.abs(floats(Q))
    # some libraries' cube root of the largest number below 1 is above 1
    share = np.minimum(np.cbrt(np.maximum((limit - size) / limit, 0.0)), 1.0)
    small = -np.expm1(np.log1p(-np.minimum(size / limit, 0.5)) / 3)
    return share, np.where(2 * size < limit, small, 1 - share)


def _carried(Q: float, mu: float, P: float, a: float) -> tuple[float, float]:
    """Stick radius c, and a - c, of a contact that carries Q."""
    check("Cattaneo-Mindlin", mu=mu, P=P, radius=a)
    if not abs(Q) <= mu * P * ROUNDING:
        raise ValueError(
            f"Cattaneo-Mindlin: Q = {Q:g} N asked of a contact that slides at mu P = {mu * P:g} N;"
            " give no more than that"
        )
    if P == 0:
        return 0.0, a
    share, rest = _stick(Q, mu * P)
    return float(a * share), float(a * rest)


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
    check("Cattaneo-Mindlin", a=a)
    return np.asarray(a * _stick(Q, limit)[0])


def full_shift(mu: float, P: float, a: float, E: float, nu: float) -> float:
    """Shift delta_max (metres) of the block against the sphere, far from the contact, at which the
    whole contact slides.
    """
    check("Cattaneo-Mindlin", mu=mu, P=P, radius=a)
    return 3 * mu * P * (2 - nu) / (16 * hertz.shear_modulus(E, nu) * a)


def shift(Q: ArrayLike, mu: float, P: float, a: float, E: float, nu: float) -> F64:
    """Shift delta (metres) of the block against the sphere, far from the contact, under the shear
    force Q; shape of `Q`.

    ``delta = 3 mu P (2 - nu)/(16 G a) [1 - (1 - Q/(mu P))^(2/3)]``; NaN where the size of Q is
    above mu P by more than rounding, which no contact carries.

    References
    ----------
    Johnson, Contact Mechanics, eq. 7.42.
    """
    share, rest = _stick(Q, mu * P)
    part = np.where(np.abs(Q) <= mu * P * ROUNDING, rest * (1 + share), np.nan)
    return np.asarray(np.copysign(full_shift(mu, P, a, E, nu) * part, Q))


def shear_force(shift: ArrayLike, mu: float, P: float, a: float, E: float, nu: float) -> F64:
    """Shear force Q (newtons) at which the block has shifted that far (metres) against the sphere;
    mu P beyond the onset of sliding.

    The inverse of `shift`.
    """
    check("Cattaneo-Mindlin", limit=mu * P)
    delta = floats(shift)
    part = np.abs(delta) / full_shift(mu, P, a, E, nu)
    inside = np.where(part < 1, part, 0.0)
    share = np.where(part < 1, -np.expm1(1.5 * np.log1p(-inside)), 1.0)
    return np.asarray(np.copysign(mu * P * share, delta))


def driven_shear_force(
    distance: ArrayLike, compliance: float, mu: float, P: float, a: float, E: float, nu: float
) -> F64:
    """Shear force Q (newtons) after a drive started from rest has advanced by a distance, through a
    spring in series with the contact.

    Solves ``distance = shift(Q) + compliance Q``; mu P once the whole contact slides, 0 for a
    distance below 0. Shape of `distance`.

    Parameters
    ----------
    distance : array_like
        Distance driven since the contact bore no shear, metres; monotone in time.
    compliance : float
        Of everything in series with the contact, metres per newton.

    Notes
    -----
    With s = c/a, Q = mu P (1 - s^3) and shift = delta_max (1 - s^2): a cubic in s, convex and
    increasing. Newton from above converges monotonically; it starts at most a factor sqrt(2) away
    and is at 4e-16 of mu P after five steps. Their number is fixed, so that a value does not depend
    on its neighbours. A last step for 1 - s makes the smallest forces right to as many digits.

    References
    ----------
    Prevost et al. 2013, Fig. 5.
    """
    limit, soft = mu * P, full_shift(mu, P, a, E, nu)
    stiff = limit * compliance
    check("driven contact", limit=limit)
    if not 0 <= compliance < np.inf:
        raise ValueError(
            f"driven contact: a compliance of {compliance:g} m/N found; give a finite number, 0 or"
            " more"
        )
    way = np.clip(floats(distance), 0.0, soft + stiff)
    left = soft + stiff - way
    s = np.minimum(np.minimum(np.sqrt(left / soft), np.cbrt(left / max(stiff, 1e-300))), 1.0)
    for _ in range(6):
        slope = s * (3 * stiff * s + 2 * soft)
        excess = s * s * (stiff * s + soft) - left
        s = np.clip(s - np.divide(excess, slope, out=np.zeros_like(s), where=slope > 0), 0.0, 1.0)
    rest = 1 - s
    missing = way - rest * (soft * (2 - rest) + stiff * (3 - rest * (3 - rest)))
    rest = rest + np.where(s > 0.5, missing / (2 * soft + 3 * stiff), 0.0) / np.maximum(s, 0.5)
    return np.asarray(limit * rest * (3 - rest * (3 - rest)))


def traction(r: ArrayLike, Q: float, mu: float, P: float, a: float) -> F64:
    """Shear traction along x at the distance r from the centre, pascals, shape of `r`; its sum over
    the contact is Q.

    Raises
    ------
    ValueError
        Q is more than mu P, or another parameter out of its range.
    """
    r = floats(r)
    c, width = _carried(Q, mu, P, a)
    root_a = np.sqrt(np.maximum((a - r) * (a + r), 0.0))
    root_c = np.sqrt(np.maximum(-_gap(r, a, c, width) * (c + r), 0.0))
    depth = np.divide(width * (a + c), root_a + root_c, out=np.array(root_a), where=root_c > 0)
    return np.asarray(np.copysign(hertz.peak_pressure(mu * P, a) / a, Q) * depth)


def radial_displacement(
    r: ArrayLike, Q: float, mu: float, P: float, a: float, E: float, nu: float
) -> tuple[F64, F64]:
    """Surface displacement G*sigma under the shear force Q, as (g0, g2): ``gx = g0 + g2 cos 2
    theta``, ``gy = g2 sin 2 theta``.

    Parameters
    ----------
    r : array_like
        Distance from the contact's centre, metres, inside or outside the contact.
    Q, mu, P, a, E, nu : float
        Shear force (N), at most mu P; friction; normal force (N); contact radius (m); modulus (Pa)
        and Poisson's ratio.

    Returns
    -------
    g0, g2 : ndarray
        Metres, shape of `r`. g0 is the azimuthal mean of gx (that of gy is 0). In the stick zone
        g0 is the shift and g2 is 0.

    Raises
    ------
    ValueError
        Q is more than mu P, or another parameter out of its range.
    """
    c, width = _carried(Q, mu, P, a)
    full = hertz.peak_pressure(mu * P, a) / (2 * np.pi * hertz.shear_modulus(E, nu))
    scale = np.copysign(full, Q)
    isotropic, double = _phi(r, a, c, width)
    return np.asarray(scale * (1 - nu / 2) * isotropic), np.asarray(scale * nu / 2 * double)


def displacement(
    x: ArrayLike, y: ArrayLike, Q: float, mu: float, P: float, a: float, E: float, nu: float
) -> tuple[F64, F64]:
    """Surface displacement G*sigma (gx, gy) in metres under the shear force Q, at points (x, y)
    from the contact's centre.

    `x` and `y` broadcast; the other parameters are those of `radial_displacement`. The block far
    away has not moved: seen from a sphere at rest, with the block driven by D, a point of the
    surface has moved by D - G*sigma.
    """
    x, y = np.broadcast_arrays(floats(x), floats(y))
    r = np.hypot(x, y)
    g0, g2 = radial_displacement(r, Q, mu, P, a, E, nu)
    cos, sin = (np.divide(v, r, out=np.zeros_like(r), where=r > 0) for v in (x, y))
    return g0 + g2 * (cos * cos - sin * sin), g2 * 2 * cos * sin


def field(
    x: ArrayLike, y: ArrayLike, Q: float, mu: float, P: float, a: float, E: float, nu: float
) -> tuple[F64, F64, F64]:
    """Shear stress along x in pascals, and the displacement G*sigma (gx, gy) that it causes, in
    metres, on a grid about the contact's centre; all of shape (ny, nx).

    Parameters
    ----------
    x, y : array_like, shape (nx,) and (ny,), or both (ny, nx)
        Of the grid's points, metres.
    Q, mu, P, a, E, nu : float
        As for `radial_displacement`.

    References
    ----------
    Prevost et al. 2013, section 5, Figs 12 and 13.

    Examples
    --------
    >>> import numpy as np
    >>> x, y = np.linspace(-2e-3, 2e-3, 41), np.linspace(-1e-3, 1e-3, 21)
    >>> sigma, gx, gy = field(x, y, Q=0.3, mu=0.9, P=0.5, a=2e-3, E=3.4e6, nu=0.5)
    >>> sigma.shape, round(float(gx.max()) * 1e6, 2)
    ((21, 41), 28.99)
    """
    x, y = as_grid(x, y)
    sigma = traction(np.hypot(x, y), Q, mu, P, a)
    return sigma, *displacement(x, y, Q, mu, P, a, E, nu)
