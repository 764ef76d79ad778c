"""Apparent contact radius over many loads against Hertz, and against the extension sqrt(R h) of a
rough contact (paper, section 2.3.1 and Fig. 3; Greenwood and Tripp).

With ``s = P^(1/3)`` Hertz's radius is a line through 0, and a rough contact the same line higher by
its extension: ``a = k s + extension`` with ``k = (3 R/(4 E*))^(1/3)``.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtrc, ndtr, stdtrit

from analysis.arrays import F64, floats, in_step
from analysis.mechanics import hertz
from analysis.mechanics.greenwood_tripp import apparent_radius

MIN_LOADS = 4
LEAST_RANGE = 2.0  # of the greatest load over the least
ROUNDS = 3
UNLIKELY = 1e-3  # probability of a chi2 below which a law does not hold


@dataclass(frozen=True, slots=True)
class FittedRadii:
    """One law fitted to the radii.

    Attributes
    ----------
    E, E_sd : float
        Young's modulus in pascals and its standard uncertainty by everything that was stated.
    extension, extension_sd : float
        Radius beyond Hertz's, metres; its uncertainty is that of what was stated of it where it was
        not fitted.
    chi2, freedom : float, int
        Sum of the squared residuals over their variances, and the degrees of freedom.
    residual_m : ndarray, shape (n,)
        Radius less that of the law.
    """

    E: float
    E_sd: float
    extension: float
    extension_sd: float
    chi2: float
    freedom: int
    residual_m: F64

    @property
    def likelihood(self) -> float:
        """Probability, 0 to 1, of a larger chi2 where the law holds; NaN without freedom."""
        return float(chdtrc(self.freedom, self.chi2)) if self.freedom > 0 else math.nan


@dataclass(frozen=True, slots=True)
class RadiusLaw:
    """Radii against load by three laws.

    Attributes
    ----------
    smooth : FittedRadii
        Hertz: E from the radii, no extension.
    rough : FittedRadii
        E from the radii, extension sqrt(R h).
    free : FittedRadii
        Both from the radii.
    correlation : float
        Of E and the extension in `free`.
    excess_m, excess_sd_m : ndarray, shape (n,)
        Radius less Hertz's with the modulus that was stated, metres; NaN without one.
    expected_m : float
        sqrt(R h), metres.
    notes : tuple of str
    """

    smooth: FittedRadii
    rough: FittedRadii
    free: FittedRadii
    correlation: float
    excess_m: F64
    excess_sd_m: F64
    expected_m: float
    notes: tuple[str, ...]


def radius_law(
    P: ArrayLike,
    a: ArrayLike,
    R: float,
    h: float,
    nu: float,
    *,
    P_sd: ArrayLike,
    a_sd: ArrayLike,
    h_sd: float = 0.0,
    relative_sd: tuple[float, float, float] = (0.0, 0.0, 0.0),
    modulus: tuple[float, float] = (math.nan, math.nan),
) -> RadiusLaw:
    """Fit Hertz's radius, with and without the extension of a rough contact, to apparent radii.

    Parameters
    ----------
    P, a : array_like, shape (n,)
        Normal force (N) and apparent radius (m) of each contact; a NaN is left out.
    R, h, nu : float
        Radius of the sphere, rms of the heights (m), Poisson's ratio.
    P_sd, a_sd : float or array_like, shape (n,)
        Standard uncertainties of each force (N) and radius (m).
    h_sd : float
        Of h, metres.
    relative_sd : (float, float, float)
        Relative standard uncertainties of the sphere's radius, of the scale of the picture, and of
        the scale of the force, which all loads share.
    modulus : (float, float), optional
        E and its standard uncertainty (Pa) from elsewhere, such as a JKR test: the radii are then
        compared with Hertz's, too.

    Raises
    ------
    ValueError
        Too few loads, too narrow a range of them, or radii that do not grow with the load.

    Notes
    -----
    Weighted least squares, the uncertainty of the force as that of the radius it makes. Where the
    points scatter more than stated the uncertainties of the free fit are widened; chi2 is not.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> P = np.array([0.1, 0.3, 0.5, 0.7, 1.0, 1.4])
    >>> a = [analysis.hertz.contact_radius(each, 3.43e6, 0.5, 0.1288) + 277e-6 for each in P]
    >>> law = analysis.radius_law(P, a, 0.1288, 0.595e-6, 0.5, P_sd=1e-3, a_sd=2e-5)
    >>> round(law.free.E * 1e-6, 2), round(law.free.extension * 1e6), law.smooth.likelihood < 1e-3
    (3.43, 277, True)
    """
    expected = apparent_radius(0.0, R, h)
    hertz.check("apparent radius", R=R, nu=nu)
    columns = [*map(np.ravel, in_step("apparent radius", P=P, a=a, P_sd=P_sd, a_sd=a_sd))]
    known = np.isfinite(columns[0]) & np.isfinite(columns[1])
    load, radius, load_sd, radius_sd = (v[known] for v in columns)
    _check(load, radius, load_sd, radius_sd)
    s = np.cbrt(load)
    line = np.stack([s, np.ones_like(s)], axis=1)
    extension_sd = 0.5 * expected * math.hypot(h_sd / h if h else 0.0, relative_sd[0])
    k, _ = np.polyfit(s, radius, 1)
    for _ in range(ROUNDS):
        sd = np.hypot(radius_sd, k * load_sd / (3 * s * s))
        k = float(np.linalg.lstsq(line / sd[:, None], radius / sd)[0][0])
    if not k > 0:
        raise ValueError(
            f"apparent radius: the radii do not grow with the load (slope {k:.3g} m/N^(1/3)); check"
            " the forces, and that the radii are those of the contact"
        )
    # how much of an extension the slope takes where it is not fitted
    shared = float((s / sd**2).sum() / (s**2 / sd**2).sum())
    lens, picture, newtons = relative_sd

    def law(columns: F64, held: float, held_sd: float) -> tuple[FittedRadii, F64]:
        """Slope and, in a second column, an extension beside the one that is held; covariance."""
        found, covariance, chi = _solved(columns, radius - held, sd)
        freedom = len(s) - len(found)
        k, extension, extension_sd = float(found[0]), held, held_sd
        taken = shared
        if len(found) > 1:
            # few radii tell badly how far they scatter
            wider = float(stdtrit(freedom, ndtr(1.0))) if freedom else 1.0
            covariance = covariance * max(1.0, wider**2 * chi / max(freedom, 1))
            extension, taken = float(found[1]), 0.0
            extension_sd = math.hypot(math.sqrt(covariance[1, 1]), picture * extension)
        E = 0.75 * R * (1 - nu**2) / k**3
        # of E ~ R P/k^3; the scale of the picture makes k and the extension larger together, and an
        # extension that is off makes k smaller by what it is shared
        scale = picture * (k + taken * extension) / k
        inputs = (lens, 3 * scale, newtons, 3 * taken * extension_sd / k)
        E_sd = E * math.hypot(3 * math.sqrt(covariance[0, 0]) / k, *inputs)
        residual = np.full(len(known), np.nan)
        residual[known] = radius - k * s - extension
        return FittedRadii(E, E_sd, extension, extension_sd, chi, freedom, residual), covariance

    free, covariance = law(line, 0.0, 0.0)
    (smooth, _), (rough, _) = law(line[:, :1], 0.0, 0.0), law(line[:, :1], expected, extension_sd)
    notes = [
        f"apparent radius: {name} does not hold (chi2 {fit.chi2:.3g} for {fit.freedom} degrees of"
        " freedom); its E means little"
        for name, fit in (("Hertz's contact", smooth), ("the extension sqrt(R h)", rough))
        if fit.likelihood < UNLIKELY
    ]
    E, E_sd = modulus
    k_known = np.cbrt(0.75 * R * (1 - nu**2) / E) if E > 0 else np.nan
    excess, excess_sd = (np.full(len(known), np.nan) for _ in range(2))
    excess[known] = radius - k_known * s
    shared_sd = np.hypot(E_sd / E, math.hypot(relative_sd[0], relative_sd[2])) / 3 * k_known * s
    excess_sd[known] = np.sqrt(sd**2 + shared_sd**2 + (relative_sd[1] * radius) ** 2)
    return RadiusLaw(
        smooth=smooth,
        rough=rough,
        free=free,
        # E falls with the slope
        correlation=-float(covariance[0, 1] / math.sqrt(covariance[0, 0] * covariance[1, 1])),
        excess_m=excess,
        excess_sd_m=excess_sd,
        expected_m=expected,
        notes=tuple(notes),
    )


def _check(load: F64, radius: F64, load_sd: F64, radius_sd: F64) -> None:
    if len(load) < MIN_LOADS:
        raise ValueError(
            f"apparent radius: {len(load)} loads have a radius; {MIN_LOADS} or more are needed"
        )
    sds = np.append(load_sd, radius_sd)
    if not (np.all((sds > 0) & (sds < np.inf)) and np.all(load > 0) and np.all(radius > 0)):
        raise ValueError(
            "apparent radius: a load, radius or uncertainty that is no finite number above 0 was"
            " found; leave that contact out"
        )
    if load.max() < LEAST_RANGE * load.min():
        raise ValueError(
            f"apparent radius: the loads span a factor of {load.max() / load.min():.3g};"
            f" {LEAST_RANGE:g} or more are needed to separate the extension from the modulus"
        )


def _solved(columns: F64, values: F64, sd: F64) -> tuple[F64, F64, float]:
    """Weighted least squares: parameters, covariance, chi2."""
    scaled = columns / sd[:, None]
    covariance = floats(np.linalg.inv(scaled.T @ scaled))
    found = covariance @ (scaled.T @ (values / sd))
    off = (values - columns @ found) / sd
    return found, covariance, float(off @ off)
