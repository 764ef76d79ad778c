"""The measured pressure p(r) = sigma_sliding/mu beside its models: Hertz, and Greenwood and Tripp.

The width of p(r) gives Young's modulus from the geometry of the contact, independent of the shear
force: comparing it with that of their balance shows whether force and traction agree.

References
----------
Greenwood, Tripp 1967; Johnson, Contact Mechanics, sections 4.2 and 13.5; Prevost et al. 2013,
section 2.3.1 and Fig. 3b.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy

from analysis.arrays import F64
from analysis.friction.local_law import LocalLaw
from analysis.mechanics import greenwood_tripp, hertz

DISAGREE = 3.0  # standard uncertainties from which force and traction do not go together
MIN_RINGS = 5
MIN_PRESSURE_SHARE = 0.02  # of the peak: rings with a lower pressure tell nothing of its shape
MAX_MODULUS_RATIO = 3.0  # factor by which the modulus from the geometry may be off the other


@dataclass(frozen=True, slots=True, kw_only=True)
class PressureCheck:
    """How the measured pressure compares with models of the same force, radius and modulus.

    Attributes
    ----------
    hertz, rough : ndarray, shape (nr,)
        Pressures after Hertz and after Greenwood and Tripp at the radii measured, pascals.
    hertz_chi2, rough_chi2 : float
        Mean square distance of the measured pressure from each, in its uncertainty.
    effective_radius, effective_radius_sd : float
        ``(3 pi/4) sum of p r dr / sum of p dr`` of the measured pressure, metres: Hertz's radius of
        a smooth contact.
    is_rough : bool
        Greenwood and Tripp's pressure is nearer to the measured one than Hertz's.
    E, E_sd : float
        Modulus for which the contact after the nearer model has that radius, pascals.
    ratio, ratio_sd : float
        E from the balance of the forces over E from the geometry; 1 where force and traction agree.
    notes : tuple of str
    """

    hertz: F64
    rough: F64
    hertz_chi2: float = math.nan
    rough_chi2: float = math.nan
    effective_radius: float = math.nan
    effective_radius_sd: float = math.nan
    is_rough: bool = False
    E: float = math.nan
    E_sd: float = math.nan
    ratio: float = math.nan
    ratio_sd: float = math.nan
    notes: tuple[str, ...] = ()


def check_pressure(
    law: LocalLaw, P: float, nu: float, R: float, h: float, *, relative_sd: float = 0.0
) -> PressureCheck:
    """Compare the pressure of a law with its models.

    Parameters
    ----------
    law : LocalLaw
        With a pressure and a modulus.
    P, nu, R, h : float
        Normal force (N), Poisson's ratio, radius of the sphere (m), standard deviation of the
        heights (m).
    relative_sd : float
        Relative uncertainty of the ratio of the two moduli from what both rest on: pixel size,
        forces, R.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> r = np.linspace(3e-5, 3e-3, 50)
    >>> a = analysis.hertz.contact_radius(0.5, 3.4e6, 0.5, 0.13)
    >>> p = analysis.hertz.pressure(r, 0.5, a)
    >>> measured = {"radius": r, "pressure": p, "pressure_sd": np.full(50, 500.0)}
    >>> law = analysis.LocalLaw(mu=0.9, mu_sd=0.01, E=3.4e6, E_sd=3e4, **measured)
    >>> found = analysis.check_pressure(law, P=0.5, nu=0.5, R=0.13, h=6e-7)
    >>> found.hertz_chi2 < 1 < found.rough_chi2
    True
    """
    r, p, sd = law.radius, law.pressure, law.pressure_sd
    if not (len(r) >= MIN_RINGS and math.isfinite(law.E) and P > 0 and p.max() > 0):
        return PressureCheck(
            hertz=np.empty(0),
            rough=np.empty(0),
            notes=("pressure: no law was found, so there is none to compare",),
        )
    a = hertz.contact_radius(P, law.E, nu, R)
    smooth = hertz.pressure(r, P, a)
    contact = _rough(P, law.E, nu, R, h)
    rough = contact.pressure(r) if contact else smooth
    seen = np.isfinite(sd) & (sd > 0)
    hertz_chi2, rough_chi2 = (_chi2(p, model, sd, seen) for model in (smooth, rough))
    is_rough = rough_chi2 < hertz_chi2
    width, width_sd = _effective_radius(r, p, sd)
    E, slope = modulus_of_width(law, P, nu, R, h if is_rough else 0.0)
    E_sd, ratio = abs(slope) * width_sd, law.E / E
    ratio_sd = ratio * math.sqrt((law.E_sd / law.E) ** 2 + (E_sd / E) ** 2 + relative_sd**2)
    notes: tuple[str, ...] = ()
    if abs(ratio - 1) > DISAGREE * ratio_sd:
        notes = (
            f"pressure: force and traction do not agree: E from their balance is {ratio:.3f} ±"
            f" {ratio_sd:.3f} times that from the contact's width; check both cantilevers, the"
            " pixel size and R",
        )
    return PressureCheck(
        hertz=smooth,
        rough=rough,
        hertz_chi2=hertz_chi2,
        rough_chi2=rough_chi2,
        effective_radius=width,
        effective_radius_sd=width_sd,
        is_rough=is_rough,
        E=E,
        E_sd=E_sd,
        ratio=ratio,
        ratio_sd=ratio_sd,
        notes=notes,
    )


def modulus_of_width(
    law: LocalLaw, P: float, nu: float, R: float, h: float = 0.0
) -> tuple[float, float]:
    """E (Pa) by the width of the pressure of a law, and its derivative by the effective radius
    (Pa/m); NaN where the pressure does not tell it. Parameters as for `check_pressure`.
    """
    r, p = law.radius, law.pressure
    if not (p > MIN_PRESSURE_SHARE * p.max(initial=0.0)).sum() >= MIN_RINGS:
        return math.nan, math.nan
    width = _effective_radius(r, p, law.pressure_sd)[0]
    return _modulus_of_radius(width, P, law.E, nu, R, h)


def _rough(
    P: float, E: float, nu: float, R: float, h: float
) -> greenwood_tripp.RoughContact | None:
    """Greenwood and Tripp's contact; None where it is Hertz's."""
    is_smooth = h * R / hertz.contact_radius(P, E, nu, R) ** 2 < greenwood_tripp.SMOOTHEST
    return None if is_smooth else greenwood_tripp.rough_contact(P, E, nu, R, h)


def _chi2(p: F64, model: F64, sd: F64, seen: np.ndarray) -> float:
    return float(np.mean(((p - model)[seen] / sd[seen]) ** 2)) if seen.any() else math.nan


def _effective_radius(r: F64, p: F64, sd: F64) -> tuple[float, float]:
    """``(3 pi/4) sum of p r dr / sum of p dr`` of evenly spaced rings, and its uncertainty: errors
    of neighbouring rings are shared, those of the whole profile are in neither sum.
    """
    radius = hertz.effective_radius(r, p)
    gain = (0.75 * math.pi * r - radius) / float(p.sum())
    # smooth errors: each is shared by the ring and its two neighbours
    spread = math.sqrt(3 * float((gain * np.nan_to_num(sd)) @ (gain * np.nan_to_num(sd))))
    return radius, spread


def _modulus_of_radius(
    width: float, P: float, near: float, nu: float, R: float, h: float
) -> tuple[float, float]:
    """E at which the contact has an effective radius, and its derivative by the radius; NaN where
    no modulus within a factor of `MAX_MODULUS_RATIO` has it.
    """

    def radius(E: float) -> float:
        contact = _rough(P, E, nu, R, h)
        return contact.effective_radius if contact else hertz.contact_radius(P, E, nu, R)

    low, high = near / MAX_MODULUS_RATIO, near * MAX_MODULUS_RATIO
    if not radius(high) < width < radius(low):
        return math.nan, math.nan
    E = float(scipy.optimize.brentq(lambda E: radius(E) - width, low, high, rtol=1e-6))
    step = 0.01 * E
    return E, 2 * step / (radius(E + step) - radius(E - step))
