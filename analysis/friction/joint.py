"""One interface under several loads: E and h common to all, mu as a power of the load.

References
----------
Prevost et al. 2013, Figs 8, 9 and 15; Bureau et al. 2003 (L does not depend on the load).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import F64
from analysis.friction.local_law import LocalLaw

FEWEST = 2  # loads
LARGEST_CHI2 = 4.0
LEAST_RANGE = 1e-6  # of the logarithm of the loads; with less they are one load


@dataclass(frozen=True, slots=True)
class Common:
    """A weighted mean: value, standard uncertainty (widened by the scatter), reduced chi2."""

    value: float = math.nan
    sd: float = math.nan
    reduced_chi2: float = math.nan


@dataclass(frozen=True, slots=True, kw_only=True)
class JointLaw:
    """What several loads have in common; NaN with the reason in `notes` where they have not.

    Attributes
    ----------
    E, L : Common
        Pascals, metres.
    mu : Common
        At 1 N, of ``mu = mu_1 P^-decay`` with P in newtons.
    decay, decay_sd : float
    notes : tuple of str
    """

    E: Common = Common()
    L: Common = Common()
    mu: Common = Common()
    decay: float = math.nan
    decay_sd: float = math.nan
    notes: tuple[str, ...] = ()


def joint_law(
    laws: Sequence[LocalLaw], P: ArrayLike, *, relative_sd: tuple[float, float, float] = (0, 0, 0)
) -> JointLaw:
    """E, L and mu(P) of several runs.

    Parameters
    ----------
    laws, P : sequence of LocalLaw, array_like, shape (n,)
        Runs, and their normal forces in newtons. Those without a law are left out.
    relative_sd : (float, float, float)
        Relative uncertainties of mu, L and E that all runs share: no number of runs reduces them.
    """
    load = np.asarray(P, dtype=np.float64)
    use = np.array([_is_usable(law) and 0 < p < np.inf for law, p in zip(laws, load, strict=True)])
    if use.sum() < FEWEST:
        return JointLaw(
            notes=(f"joint fit: {int(use.sum())} runs have a law; {FEWEST} or more are needed",)
        )
    found = [law for law, is_used in zip(laws, use, strict=True) if is_used]
    load = load[use]

    def column(name: str) -> tuple[F64, F64]:
        value = np.array([getattr(law, name) for law in found])
        return value, np.array([getattr(law, f"{name}_sd") for law in found]) / value

    one, logarithm = np.ones((len(load), 1)), -np.log(load)[:, None]
    means = {}
    for name, shared in zip(("L", "E"), relative_sd[1:], strict=True):
        value, sd = column(name)
        means[name] = _common(one, np.log(value), sd, shared)[0]
    value, sd = column("mu")
    has_range = np.ptp(logarithm) > LEAST_RANGE and len(load) > FEWEST
    design = np.hstack([one, logarithm]) if has_range else one
    mu, decay, decay_sd = _common(design, np.log(value), sd, relative_sd[0])
    notes = [
        f"joint fit: {name} differs from load to load by more than its uncertainty (chi2"
        f" {common.reduced_chi2:.2g}); the loads have no common one"
        for name, common in (("mu", mu), *means.items())
        if common.reduced_chi2 > LARGEST_CHI2
    ]
    return JointLaw(
        E=means["E"], L=means["L"], mu=mu, decay=decay, decay_sd=decay_sd, notes=tuple(notes)
    )


def _is_usable(law: LocalLaw) -> bool:
    """Whether mu, L and E are positive numbers with uncertainties."""
    values = law.mu, law.L, law.E
    known = (*values, law.mu_sd, law.L_sd, law.E_sd)
    return all(map(math.isfinite, known)) and min(values) > 0


def _common(design: F64, y: F64, sd: F64, shared: float) -> tuple[Common, float, float]:
    """Weighted least squares in logarithms: the first coefficient as a value, and the second."""
    root = 1 / np.maximum(sd, 1e-9)
    X = design * root[:, None]
    covariance = np.linalg.inv(X.T @ X)
    b = covariance @ (X.T @ (y * root))
    freedom = len(y) - design.shape[1]
    off = (y - design @ b) * root
    chi2 = float(off @ off) / freedom if freedom else math.nan
    sds = np.sqrt(np.diag(covariance) * np.fmax(chi2, 1.0))
    value = math.exp(b[0])
    common = Common(value, value * math.hypot(float(sds[0]), shared), chi2)
    return (common, float(b[1]), float(sds[1])) if len(b) > 1 else (common, math.nan, math.nan)
