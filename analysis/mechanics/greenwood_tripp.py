"""Greenwood and Tripp: a smooth sphere on a rough elastic plane. The mean pressure reaches beyond
Hertz's contact. SI units.

Asperities of random heights carry the sphere; their mean pressure bends the block. Heights are
measured in their standard deviation h, radii in sqrt(2 R h). For heights with an exponential
distribution (that of Bureau et al., and of the paper's section 5) the pressure depends on the
roughness ``alpha = h R/a_H^2`` alone: density and curvature of the asperities only raise the
sphere. For Gaussian heights it also depends on ``mu = (8/3) eta h sqrt(2 R beta)``, with eta
asperities of curvature radius beta per area.

References
----------
Greenwood, Tripp 1967; Johnson, Contact Mechanics, section 13.5; Prevost et al. 2013, section 2.3.1
and Fig. 3b.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike
from scipy.special import pbdv

from analysis.arrays import F64, floats
from analysis.mechanics import hertz
from analysis.mechanics.cattaneo_mindlin import phi0
from analysis.mechanics.modes import even_legendre

MODES = 128
SMOOTHEST, ROUGHEST, SOFTEST = 1e-3, 1e4, 1.0
"""Range of alpha (below, Hertz is right to 0.2 % and `MODES` do not resolve the edge), and least mu
(below, the layer is crushed).
"""
CLEAR = 36.0  # gap in h at which no asperity touches any more
LONGEST_STEP, MOST_STEPS = 3.0, 100  # of Newton, h


def apparent_radius(a: float, R: float, h: float) -> float:
    """Radius a + sqrt(R h) in metres within which a rough face touches, from Hertz's `a`: the
    paper's estimate.

    For the paper's sample the pressure of Greenwood and Tripp is 0.4 (1.4 N) to 2 % (0.1 N) of that
    at the centre there.
    """
    hertz.check("rough contact", a=a, R=R)
    if not 0 <= h < math.inf:
        raise ValueError(
            f"rough contact: heights of standard deviation {h:g} m found; give a finite number, 0"
            " or more"
        )
    return a + math.sqrt(R * h)


@dataclass(frozen=True, slots=True, eq=False)
class RoughContact:
    """Pressure between a sphere and a rough plane; equal to itself alone.

    Attributes
    ----------
    alpha : float
        Roughness h R/a_H^2.
    peak_pressure : float
        Pressure at the centre, pascals.
    effective_radius : float
        ``(3 pi/4) sum of p r dr / sum of p dr``, metres: Hertz's where the surface is smooth.
    reach : float
        Radius beyond which the pressure is below 1e-15 of the peak and given as 0, metres.
    """

    alpha: float
    peak_pressure: float
    effective_radius: float
    reach: float
    _mu: float | None
    _unit_pa: float
    _gap: F64  # Legendre coefficients of the gap in h, in sqrt(1 - r^2/reach^2)

    def pressure(self, r: ArrayLike) -> F64:
        """Mean pressure at the distance r from the centre, pascals, shape of `r`."""
        x = np.abs(floats(r)) / self.reach
        gap = legendre.legval(np.sqrt(np.maximum((1 - x) * (1 + x), 0.0)), self._gap)
        return np.asarray(np.where(x < 1, self._unit_pa * _carried(gap, self._mu)[0], 0.0))

    def radius_at(self, share: float) -> float:
        """Radius in metres at which the pressure has come down to a share, below 1, of that at the
        centre.
        """
        if not 1e-12 <= share < 1:
            raise ValueError(
                f"rough contact: the radius at {share:g} of the peak pressure was asked for; give"
                " 1e-12 to below 1"
            )
        r = np.linspace(0, self.reach, 4000)
        p = np.log(np.maximum(self.pressure(r), 1e-300))
        return float(np.interp(-math.log(share * self.peak_pressure), -p, r))


def rough_contact(
    P: float, E: float, nu: float, R: float, h: float, mu: float | None = None
) -> RoughContact:
    """Pressure and effective radius of a sphere pressed on a rough plane.

    Parameters
    ----------
    P, E, nu, R : float
        Normal force (N), above 0; modulus (Pa), Poisson's ratio, radius of the sphere (m).
    h : float
        Standard deviation of the asperities' heights, metres.
    mu : float, optional
        Asperity parameter for Gaussian heights; default: exponential heights, for which it does not
        matter.

    Raises
    ------
    ValueError
        A parameter is out of its range, or alpha not between `SMOOTHEST` and `ROUGHEST`, or mu
        below `SOFTEST`.

    Notes
    -----
    In even Legendre polynomials of xi = sqrt(1 - r^2/reach^2) the half-space is diagonal (Popov): a
    pressure P_2n(xi)/xi bends it by pi^2 P_2n(0)^2 P_2n(xi). The pressure is smooth and dies before
    the reach, so that digits come with the number of modes: 3e-5 of the peak at alpha = 1e-3, 2e-9
    at 0.016 (Gaussian, mu = 17: 3e-4 and 6e-6). Newton in the gaps and the rigid approach, no step
    longer than 3 h.
    """
    hertz.check("rough contact", force=P, R=R, height=h)
    if mu is not None and not SOFTEST <= mu < math.inf:
        raise ValueError(f"rough contact: mu = {mu:g} found; give {SOFTEST:g} or more")
    a, stiff = hertz.contact_radius(P, E, nu, R), hertz.reduced_modulus(E, nu)
    alpha, unit = h * R / a**2, math.sqrt(2 * R * h)
    if not SMOOTHEST <= alpha <= ROUGHEST:
        raise ValueError(
            f"rough contact: h R/a^2 = {alpha:g} found; give {SMOOTHEST:g} to {ROUGHEST:g}, and use"
            " Hertz below"
        )
    wide = a / unit
    reach = min(math.sqrt(2 * wide**2 + 2 * CLEAR), wide + 11 * wide ** (-1 / 3))
    xi, weight, values, at_zero = even_legendre(MODES)
    rho2 = reach**2 * (1 - xi**2)
    load = 2 * np.pi * reach**2 * weight * xi
    # of the bending, from the pressure at the nodes
    powers = (4 * np.arange(MODES) + 1) * at_zero**2
    coefficients = reach / 2 * np.pi * powers[:, None] * values.T * (weight * xi)
    flat = rho2 - 2 * wide**2 + 4 * wide / np.pi**2 * phi0(np.sqrt(rho2), wide)  # Hertz's gap
    bends, total = values @ coefficients, 16 / 3 * wide**3
    gap, approach = _solved(np.maximum(flat, 0.0), rho2, load, bends, total, mu)
    bending = coefficients @ _carried(gap, mu)[0]
    line = bending.sum()  # at the centre: the sum of p dr
    series = np.zeros(2 * MODES)
    series[::2] = bending
    series[0] += approach + 2 / 3 * reach**2
    series[2] -= 2 / 3 * reach**2
    unit_pa = stiff * math.sqrt(h / (8 * R))
    peak = unit_pa * float(_carried(legendre.legval(1.0, series), mu)[0])
    return RoughContact(alpha, peak, 2 * wide**3 / line * unit, reach * unit, mu, unit_pa, series)


def _carried(gap: ArrayLike, mu: float | None) -> tuple[F64, F64]:
    """Mean pressure of the asperities at a gap in h, in E* sqrt(h/(8 R)), and its derivative."""
    gap = floats(gap)
    if mu is None:
        p = np.exp(-gap)
        return p, -p
    # sums of (s - gap)^(3/2) and (s - gap)^(1/2) over a normal distribution of s above the gap
    scale = mu / math.sqrt(2 * math.pi) * np.exp(-(gap**2) / 4)
    p = math.gamma(2.5) * scale * pbdv(-2.5, gap)[0]
    return p, -1.5 * math.gamma(1.5) * scale * pbdv(-1.5, gap)[0]


def _solved(
    gap: F64, rho2: F64, load: F64, bends: F64, total: float, mu: float | None
) -> tuple[F64, float]:
    """Gaps and rigid approach at which ``gap = approach + rho^2 + bending`` and the pressure adds
    up to the load.
    """
    approach, n = 0.0, len(gap)
    system = np.zeros((n + 1, n + 1))
    for _ in range(MOST_STEPS):
        p, slope = _carried(gap, mu)
        system[:n, :n] = np.eye(n) - bends * slope
        system[:n, n] = -1
        system[n, :n] = load * slope / total
        off = np.append(gap - approach - rho2 - bends @ p, load @ p / total - 1)
        step = np.linalg.solve(system, off)
        step *= min(1.0, LONGEST_STEP / float(np.abs(step[:n]).max()))
        gap, approach = gap - step[:n], approach - float(step[n])
        if np.abs(step[:n]).max() < 1e-11 * (1 + rho2[0]):
            return gap, approach
    raise ValueError(
        f"rough contact: no solution after {MOST_STEPS} steps for a load of 2P/(h E* sqrt(2 R h)) ="
        f" {total:g}; give a larger mu"
    )
