"""Cyclic shear: hysteresis loops, what they dissipate, locally and in sum, and Masing's rule.

References
----------
Masing 1926 (a reversal repeats the first loading at twice its size); Mindlin, Deresiewicz 1953
(spheres under oblique forces, for which it holds); Prevost et al. 2013, section 6 (local slip and
traction); Johnson, Contact Mechanics, section 7.4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import F64, in_step

MIN_FRAMES = 6  # least frames of a branch
SMALL = 1.0  # slip in mu L up to which the traction tells the stiffness
SHARED = 0.5  # share of the noise's variance common to all frames: the reference's


def branches(travel: ArrayLike, *, least: float) -> list[slice]:
    """Parts of a drive that go one way, each with the frame at which it turned.

    Parameters
    ----------
    travel : array_like, shape (n,)
        Of the stage, metres; frames with a NaN tell no reversal.
    least : float
        Way back from which it is a reversal, metres: beyond what an encoder jitters.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> there, back = np.arange(0, 50e-6, 5e-6), np.arange(50e-6, 0, -5e-6)
    >>> analysis.branches(np.append(there, back), least=3e-6)
    [slice(0, 11, None), slice(10, 20, None)]
    """
    (x,) = in_step("branches", travel=travel)
    known = np.flatnonzero(np.isfinite(x)).tolist()
    parts, start, extreme, way = [], 0, min(known, default=0), 1.0
    for i in known:
        if way * (x[i] - x[extreme]) >= 0:
            extreme = i
        elif way * (x[extreme] - x[i]) > least:
            parts.append(slice(start, extreme + 1))
            start, extreme, way = extreme, i, -way
    parts.append(slice(start, len(x)))
    return [part for part in parts if part.stop - part.start >= MIN_FRAMES]


def masing_deviation(
    first_travel: ArrayLike, first_Q: ArrayLike, travel: ArrayLike, Q: ArrayLike
) -> float:
    """Root mean square distance of a branch from Masing's: the first loading at twice its size,
    over the greatest Q of the first loading. NaN where they have no travel in common.

    Parameters
    ----------
    first_travel, first_Q : array_like, shape (n,)
        Of the first loading from rest, metres and newtons.
    travel, Q : array_like, shape (m,)
        Of the branch, from its reversal on.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> x = np.linspace(0, 20e-6, 30)
    >>> Q = 0.4 * (1 - np.exp(-x / 5e-6))
    >>> round(analysis.masing_deviation(x, Q, x[-1] - 2 * x, Q[-1] - 2 * Q), 6)
    0.0
    """
    x, q = in_step("Masing's rule", first_travel=first_travel, first_Q=first_Q)
    at, force = in_step("Masing's rule", travel=travel, Q=Q)
    half, known = np.abs(at - at[:1]) / 2, np.abs(force - force[:1]) / 2
    if not len(x):
        return math.nan
    inside = (half >= x[0]) & (half <= x[-1])
    if inside.sum() < MIN_FRAMES or not np.abs(q).max() > 0:
        return math.nan
    off = known[inside] - np.interp(half[inside], x, np.abs(q))
    return float(np.sqrt(np.mean(off**2)) / np.abs(q).max())


def loop_work(travel: ArrayLike, Q: ArrayLike) -> float:
    """Area of a loop of the shear force over the travel, joules; it is closed by a straight line.

    The elastic deformation of the block and of the lens holder has no part in it.

    Examples
    --------
    >>> import analysis
    >>> round(analysis.loop_work([0, 10e-6, 10e-6, 0], [0.4, 0.4, -0.4, -0.4]) * 1e6, 3)  # uJ
    8.0
    """
    x, q = in_step("loop", travel=travel, Q=Q)
    x, q = np.append(x, x[:1]), np.append(q, q[:1])
    return float(np.sum((q[1:] + q[:-1]) / 2 * np.diff(x)))


@dataclass(frozen=True, slots=True)
class LocalWork:
    """The work of friction at each distance from the contact's centre.

    Attributes
    ----------
    per_area : ndarray, shape (nr,)
        Sum of sigma ds, J/m^2.
    total : float
        Over the contact, joules.
    """

    per_area: F64 = field(default_factory=lambda: np.empty(0))
    total: float = math.nan


def local_work(radius: ArrayLike, slip: ArrayLike, sigma: ArrayLike) -> LocalWork:
    """Work of the shear traction along the slip of a loop, which it closes.

    Parameters
    ----------
    radius : array_like, shape (nr,)
        Of even rings from the centre on, metres.
    slip, sigma : array_like, shape (nt, nr)
        Local slip (m) and shear traction (Pa) of successive frames.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> slip = np.array([0, 10e-6, 10e-6, 0])[:, None] * np.ones(5)
    >>> sigma = np.array([4e4, 4e4, -4e4, -4e4])[:, None] * np.ones(5)
    >>> work = analysis.local_work((np.arange(5) + 0.5) * 1e-4, slip, sigma)
    >>> round(work.total * 1e6, 3)  # uJ, over a disc of 0.5 mm
    0.628
    """
    (r,) = in_step("local work", radius=radius)
    s, p = in_step("local work", slip=slip, sigma=sigma)
    if r.shape != s.shape[1:] or not r.size:
        raise ValueError(
            f"local work: a slip of shape {s.shape} was given over radii of shape {r.shape}; give"
            " one row for each frame, (nt, nr), over the radii (nr,)"
        )
    s, p = (np.concatenate([v, v[:1]]) for v in (s, p))
    per_area = ((p[1:] + p[:-1]) / 2 * np.diff(s, axis=0)).sum(axis=0)
    edges = np.append(r - r[0], r[-1] + r[0])
    return LocalWork(per_area, float(per_area @ (np.pi * np.diff(edges**2))))


def interface_stiffness(
    slip: ArrayLike, sigma: ArrayLike, sigma_sd: ArrayLike, soft: float
) -> tuple[F64, F64]:
    """Stiffness k(r) of the interface under small slip, and its standard uncertainty, Pa/m; both of
    shape (nr,), NaN where fewer than three frames tell it.

    Parameters
    ----------
    slip, sigma, sigma_sd : array_like, shape (nt, nr)
        Of a first loading: local slip (m), shear traction and its uncertainty (Pa).
    soft : float
        mu L of the law, metres: the initial slope is that of ``k mu L (1 - exp(-s/(mu L)))`` up to
        a slip of mu L. Less slip would give it less well: in the middle of the contact the
        smoothing of an inversion raises the low traction of small slip (``python -m benchmarks
        analyze`` measures the error).

    Examples
    --------
    >>> import numpy as np, analysis
    >>> slip = np.linspace(0, 1e-6, 20)[:, None] * np.ones(3)
    >>> sigma = 3e4 * (1 - np.exp(-slip / 1e-6))
    >>> k, _ = analysis.interface_stiffness(slip, sigma, np.full(sigma.shape, 100.0), soft=1e-6)
    >>> (k * 1e-9).round(1).tolist()  # kPa/um
    [30.0, 30.0, 30.0]
    """
    s, p, sd = in_step("interface stiffness", slip=slip, sigma=sigma, sigma_sd=sigma_sd)
    if soft <= 0 or math.isinf(soft):
        raise ValueError(f"interface stiffness: mu L {soft:g} m found; use a positive length")
    known = np.isfinite(s) & np.isfinite(p) & (sd > 0) & (s < SMALL * soft)
    x = np.where(known, -soft * np.expm1(-np.where(known, s, 0.0) / soft), 0.0)
    weight = np.where(known, 1 / np.where(sd > 0, sd, 1.0) ** 2, 0.0)
    power = (weight * x * x).sum(axis=0)
    is_determined = (known.sum(axis=0) >= 3) & (power > 0)
    safe = np.where(is_determined, power, 1.0)
    k = np.where(is_determined, (weight * x * np.where(known, p, 0.0)).sum(axis=0) / safe, np.nan)
    common = (np.sqrt(weight) * x).sum(axis=0) ** 2 / safe
    return k, np.where(is_determined, np.sqrt((1 - SHARED + SHARED * common) / safe), np.nan)


def precursor_slip(time: ArrayLike, slip: ArrayLike, onset: float) -> F64:
    """Local slip at the onset of sliding as a whole, metres, shape (nr,): the slip that comes
    before it. `slip` is of shape (nt, nr).

    NaN where more than half of it could be of the time after the onset, as beside a gap in the
    frames: between the two beside the onset, all of the slip may come after it.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> time = np.linspace(0, 10, 21)
    >>> slip = 1e-6 * time[:, None] * np.array([1.0, 2.0])
    >>> (analysis.precursor_slip(time, slip, onset=5.0) * 1e6).round(2).tolist()
    [5.0, 10.0]
    """
    (t,) = in_step("precursor slip", time=time)
    (s,) = in_step("precursor slip", slip=slip)
    if t.ndim != 1 or s.shape[:1] != t.shape:
        raise ValueError(
            f"precursor slip: times of shape {t.shape} and a slip of shape {s.shape} found; give"
            " one row of the slip for each time, (nt, nr)"
        )
    t, s = t[np.isfinite(t)], s[np.isfinite(t)]
    if not (len(t) and t[0] <= onset <= t[-1]):
        return np.full(s.shape[1:], np.nan)
    after = min(int(np.searchsorted(t, onset)), len(t) - 1)
    before = max(after - 1, 0)
    share = (onset - t[before]) / (t[after] - t[before]) if after > before else 0.0
    found, in_doubt = s[before] * (1 - share) + s[after] * share, share * (s[after] - s[before])
    return np.where(in_doubt > found / 2, np.nan, found)
