"""Stick radius c where the shear stress is largest (paper, section 5 and Fig. 14).

The stress from measured displacements is rounded by the correlation boxes and by the inversion's
regularisation, which moves its maximum.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import floats, in_step

MIN_RINGS = 5  # least rings in the cubic
ROUNDS = 4
MIN_PEAK_SIGMAS = 4.0  # sds from which a stress stands out of the noise
FLATTEST = 1e-9  # of the stress, over the reach: less curvature is rounding


@dataclass(frozen=True, slots=True)
class StressPeak:
    """Maximum of sigma(r). NaN where it cannot be determined; `notes` then gives the reason.

    Attributes
    ----------
    radius, radius_sd : float
        c as the paper takes it and its standard uncertainty, metres.
    stress : float
        The largest stress, pascals.
    notes : tuple of str
    """

    radius: float = np.nan
    radius_sd: float = np.nan
    stress: float = np.nan
    notes: tuple[str, ...] = ()


def stress_peak(
    r: ArrayLike, sigma: ArrayLike, uncertainty: ArrayLike, *, reach: float
) -> StressPeak:
    """Radius of the largest stress, from a cubic through the profile about it: the traction falls
    more steeply outside c than inside, which moves the vertex of a parabola by up to 0.03 a.

    Parameters
    ----------
    r, sigma : array_like, shape (n,)
        Radii, increasing (m), and stress (Pa); rings with a NaN are ignored.
    uncertainty : array_like, shape (n,) or (n, n)
        Standard uncertainties of sigma (Pa), or its covariance (Pa^2): errors of a regularised
        stress are shared by neighbours.
    reach : float
        The cubic goes through the rings within this distance of the largest one, metres; about
        0.12 a.

    Raises
    ------
    ValueError
        The shapes do not fit each other, or `reach` is not positive.

    References
    ----------
    Prevost et al. 2013, Fig. 14.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> r = np.linspace(5e-5, 2.5e-3, 50)
    >>> sigma = analysis.cattaneo_mindlin.traction(r, Q=0.3, mu=0.9, P=0.5, a=2.4e-3)
    >>> round(analysis.stress_peak(r, sigma, np.full(50, 100.0), reach=3e-4).radius * 1e3, 2)
    1.75
    """
    r, sigma = in_step("stress peak", r=r, sigma=sigma)
    covariance = floats(uncertainty)
    if covariance.ndim < 2:
        _, sd = in_step("stress peak", sigma=sigma, uncertainty=covariance)
        covariance = np.diag(sd * sd)
    if r.ndim != 1 or covariance.shape != 2 * r.shape or not reach > 0:
        raise ValueError(
            f"stress peak: a profile of shape {r.shape}, a covariance of shape {covariance.shape}"
            f" and a reach of {reach} m found; give shapes (n,) and (n, n), and a positive reach"
        )
    good = np.isfinite(r) & np.isfinite(sigma) & np.isfinite(np.diag(covariance))
    r, sigma, covariance = r[good], sigma[good], covariance[np.ix_(good, good)]
    if len(r) < MIN_RINGS:
        return _no_peak(f"{len(r)} rings have a stress; {MIN_RINGS} or more are needed")
    middle, reach = r[np.argmax(sigma)], max(reach, MIN_RINGS / 2 * float(np.median(np.diff(r))))
    for _ in range(ROUNDS):  # about the highest ring, then about the top
        x = (r - middle) / reach
        # weights that fade out, so that one ring more or less does not show
        root = np.sqrt(np.maximum(1 - x * x, 0.0))
        # from stress to coefficients
        cubic = np.linalg.pinv(np.vander(x, 4) * root[:, None]) * root
        skew, bend, slope, level = cubic @ sigma
        turn = bend * bend - 3 * skew * slope
        if not turn > 0 or not math.sqrt(turn) > bend:
            return _no_peak("the stress has no maximum that stands out of the noise")
        shift = float(np.clip(slope / (math.sqrt(turn) - bend), -1.0, 1.0))
        found, middle = middle + shift * reach, float(np.clip(middle + shift * reach, 0.0, r[-1]))
    curvature = 2 * bend + 6 * skew * shift
    at_top = np.array([shift**3, shift**2, shift, 1.0]) @ cubic
    top, top_sd = float(at_top @ sigma), float(np.sqrt(at_top @ covariance @ at_top))
    is_bent = curvature < -FLATTEST * abs(level)
    if not is_bent or abs(shift) == 1 or not top > MIN_PEAK_SIGMAS * top_sd:
        return _no_peak("the stress has no maximum that stands out of the noise")
    gradient = -np.array([3 * shift**2, 2 * shift, 1.0]) @ cubic[:3] / curvature * reach
    spread = float(np.sqrt(gradient @ covariance @ gradient))
    if not reach < found < r[-1] or spread > reach:
        why = "which does not stand out of the noise"
        if found <= reach:
            why = f"within {reach * 1e3:.2g} mm of the centre, where c is lost"
        return _no_peak(f"at {found * 1e3:.3g} +- {spread * 1e3:.2g} mm, {why}")
    return StressPeak(found, spread, top)


def _no_peak(reason: str) -> StressPeak:
    return StressPeak(notes=(f"stress peak: {reason}",))
