"""One interface under several loads: E and h common to all, mu as a power of the load.

References
----------
Prevost et al. 2013, Figs 8, 9 and 15; Bureau et al. 2003 (L does not depend on the load).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import F64, all_floats, floats
from analysis.friction.local_law import LocalLaw
from analysis.robust import robust_sd

MIN_LOADS = 2
LARGEST_CHI2 = 4.0
SHARED = 3.0  # rings over which the noise of one is spread, by the smoothing of the traction
LEAST_RANGE = 0.1  # least range of the logarithm of the loads; less is one load


@dataclass(frozen=True, slots=True)
class Common:
    """A weighted mean: value, standard uncertainty (widened by the scatter), and chi2 over the
    degrees of freedom, of noise and inputs together.
    """

    value: float = math.nan
    sd: float = math.nan
    reduced_chi2: float = math.nan


@dataclass(frozen=True, slots=True, kw_only=True)
class JointLaw:
    """The common results of several loads; NaN with the reason in `notes` where there are none.

    Attributes
    ----------
    E, L : Common
        Pascals, metres.
    mu : Common
        At 1 N, of ``mu = mu_1 P^-decay`` with P in newtons; where there is no decay, the mean of
        the runs, at their loads.
    decay, decay_sd : float
        NaN of two runs, and of loads within a tenth of each other.
    notes : tuple of str
    """

    E: Common = Common()
    L: Common = Common()
    mu: Common = Common()
    decay: float = math.nan
    decay_sd: float = math.nan
    notes: tuple[str, ...] = ()


def joint_law(
    laws: Sequence[LocalLaw], P: ArrayLike, *, inputs: Mapping[str, ArrayLike] | None = None
) -> JointLaw:
    """E, L and mu(P) of several runs.

    Parameters
    ----------
    laws, P : sequence of LocalLaw, array_like, shape (n,)
        Runs, and their normal forces in newtons. Those without a law are left out.
    inputs : mapping
        For "mu", "L" and "E": by how much of itself each run's value changes with one standard
        uncertainty of each input that all runs share, with its sign, shape (n, inputs). No number
        of runs reduces the error that this input causes in all of them alike.

    Examples
    --------
    >>> import analysis
    >>> laws = [
    ...     analysis.LocalLaw(mu=mu, mu_sd=0.01, L=L, L_sd=5e-8, E=3.4e6, E_sd=2e4)
    ...     for mu, L in ((0.95, 0.8e-6), (0.9, 0.9e-6), (0.88, 0.85e-6))
    ... ]
    >>> round(analysis.joint_law(laws, [0.1, 0.5, 1.0]).L.value * 1e6, 3)
    0.853
    """
    load = floats(P)
    use = np.array([_is_usable(law) and 0 < p < np.inf for law, p in zip(laws, load, strict=True)])
    if use.sum() < MIN_LOADS:
        return JointLaw(
            notes=(f"joint fit: runs with a law: {int(use.sum())}; {MIN_LOADS} or more are needed",)
        )
    found = [law for law, is_used in zip(laws, use, strict=True) if is_used]
    load = load[use]

    def fit(name: str, design: F64) -> tuple[Common, float, float]:
        value, sd = (np.array([getattr(law, n) for law in found]) for n in (name, f"{name}_sd"))
        shared = floats((inputs or {}).get(name, np.zeros((len(use), 0))))[use]
        return _common(design, np.log(value), sd / value, shared)

    one, logarithm = np.ones((len(load), 1)), -np.log(load)[:, None]
    means = {name: fit(name, one)[0] for name in ("L", "E")}
    has_range = np.ptp(logarithm) > LEAST_RANGE and len(load) > MIN_LOADS
    mu, decay, decay_sd = fit("mu", np.hstack([one, logarithm]) if has_range else one)
    notes = [
        f"joint fit: {name} differs from load to load by more than its uncertainty (chi2"
        f" {common.reduced_chi2:.2g}); the loads have no common one"
        for name, common in (("mu", mu), *means.items())
        if common.reduced_chi2 > LARGEST_CHI2
    ]
    if not has_range:
        notes.append(
            f"joint fit: runs at {load.min():.3g} to {load.max():.3g} N do not determine"
            " how mu falls with the load; mu is their mean, not that at 1 N: give more than"
            " two, whose loads differ by a tenth or more"
        )
    return JointLaw(
        E=means["E"], L=means["L"], mu=mu, decay=decay, decay_sd=decay_sd, notes=tuple(notes)
    )


def common_value(values: ArrayLike, sds: ArrayLike, inputs: ArrayLike | None = None) -> Common:
    """The common value of positive results of several runs; NaN for none. `inputs` as for
    `joint_law`, shape (n, inputs).
    """
    value, sd = all_floats(values, sds)
    shared = np.zeros((len(value), 0)) if inputs is None else floats(inputs)
    use = np.isfinite(value) & np.isfinite(sd) & (value > 0)
    if not use.any():
        return Common()
    design = np.ones((int(use.sum()), 1))
    return _common(design, np.log(value[use]), sd[use] / value[use], shared[use])[0]


def stiffness_length(
    pressure: ArrayLike, pressure_sd: ArrayLike, k: ArrayLike, k_sd: ArrayLike
) -> tuple[float, float]:
    """L as p/k, the mean over the rings of a run, and its uncertainty, metres: neighbouring rings
    share their noise. NaN where no ring has both, or where there is another number of one.
    """
    p, p_sd, k, k_sd = rings = all_floats(pressure, pressure_sd, k, k_sd)
    if len({values.shape for values in rings}) > 1:
        return math.nan, math.nan
    with np.errstate(divide="ignore", invalid="ignore"):
        length, share = p / k, np.hypot(p_sd / p, k_sd / k)
    use = np.isfinite(share) & (share > 0) & (p > 0) & (k > 0)
    if not use.any():
        return math.nan, math.nan
    logs = np.log(length[use])
    # how far rings lie apart beyond their noise is no noise of any of them
    apart = robust_sd(logs - np.median(logs))
    weight = 1 / (share[use] ** 2 + apart**2)
    value = float(np.exp(np.average(logs, weights=weight)))
    return value, value * math.sqrt(SHARED / float(weight.sum()))


def _is_usable(law: LocalLaw) -> bool:
    """Whether mu, L and E are positive numbers with uncertainties."""
    values = law.mu, law.L, law.E
    known = (*values, law.mu_sd, law.L_sd, law.E_sd)
    return all(map(math.isfinite, known)) and min(values) > 0


def _common(design: F64, y: F64, sd: F64, shared: F64) -> tuple[Common, float, float]:
    """Generalised least squares in logarithms: the first coefficient as a value, and the second.

    The values scatter by `sd` each, and together by each column of `shared`. Scatter beyond both
    widens the uncertainty.
    """
    noise = np.diag(np.maximum(sd, 1e-9) ** 2)
    together = shared @ shared.T
    inverse = np.linalg.inv(noise + together)
    gain = np.linalg.inv(design.T @ inverse @ design) @ design.T @ inverse
    b = gain @ y
    freedom = len(y) - design.shape[1]
    off = y - design @ b
    chi2 = float(off @ inverse @ off) / freedom if freedom else math.nan
    sds = np.sqrt(np.diag(gain @ (noise * np.fmax(chi2, 1.0) + together) @ gain.T))
    value = math.exp(b[0])
    common = Common(value, value * float(sds[0]), chi2)
    return (common, float(b[1]), float(sds[1])) if len(b) > 1 else (common, math.nan, math.nan)
