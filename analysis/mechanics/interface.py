"""Local shear law of a rough interface: sigma = mu p (1 - exp(-s/(mu L))) under a first loading,
with its memory. SI units throughout.

Bureau's interface is a population of Mindlin contacts with exponentially distributed heights. Each
behaves as a row of springs that stick until their deflection reaches what their normal load allows
(Jaeger). Put together, the spring that first touched when the local pressure was q holds, under the
pressure p, up to a deflection ``mu L ln(p/q)``, and the springs that touched between q and q + dq
carry dq/L per metre of deflection. Loaded from rest this is the law above. The same springs
determine, with nothing added, what happens next: at constant pressure a reversal repeats the first
loading at twice its size (Masing; Mindlin and Deresiewicz for one sphere); where the pressure grows
new springs touch unstressed; where it falls, those that touched last let go.

References
----------
Bureau, Caroli and Baumberger 2003; Prevost et al. 2013, section 6; Jaeger 1993 (Mindlin contacts
under any history); Mindlin and Deresiewicz 1953; Iwan 1966 (springs and sliders).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike

from analysis.arrays import F64, all_floats, floats
from analysis.kernels import compiled
from analysis.mechanics import hertz


def elastic_length(roughness: float, nu: float) -> float:
    """L = (2 - nu)/(2 (1 - nu)) h in metres, of a surface with rms roughness h (Bureau et al.
    2003).

    Raises
    ------
    ValueError
        A roughness below 0, or a Poisson's ratio outside 0 to 0.5.

    Examples
    --------
    >>> import analysis
    >>> round(analysis.elastic_length(6e-7, nu=0.5) * 1e6, 3)
    0.9
    """
    if not 0 <= roughness < np.inf:
        raise ValueError(f"elastic length: a roughness of {roughness:g} m found; give 0 or more")
    hertz.check("elastic length", nu=nu)
    return (2 - nu) / (2 * (1 - nu)) * roughness


def cusp_length(r: ArrayLike, p: ArrayLike, E: float, nu: float, L: float) -> float:
    """Distance from the rim of the stuck zone of a round contact over which the slip grows to mu L,
    metres: ``sqrt(E* L a/p(0))`` of Hertz's contact with the same mean distance of the pressure.

    Parameters
    ----------
    r, p : array_like
        Evenly spaced distances from the centre (m), and the pressure there (Pa), shape (n,).
    E, nu, L : float
        Young's modulus (Pa), Poisson's ratio, length of the friction law (m).

    Examples
    --------
    Hertz's pressure gives ``sqrt(pi R L/2)``, whatever the force:

    >>> import numpy as np, analysis
    >>> from analysis.mechanics.interface import cusp_length
    >>> r = 7e-5 * (np.arange(45) + 0.5)
    >>> a = analysis.hertz.contact_radius(0.5, 3.4e6, 0.5, 0.13)
    >>> p = analysis.hertz.pressure(r, 0.5, a)
    >>> found = cusp_length(r, p, E=3.4e6, nu=0.5, L=0.8e-6)
    >>> round(found * 1e6), round(np.sqrt(np.pi * 0.13 * 0.8e-6 / 2) * 1e6)
    (404, 404)
    """
    r, p = all_floats(r, p)
    a, line = hertz.effective_radius(r, p), float(p.sum() * (r[1] - r[0]))
    # of Hertz's pressure the line integral is pi a p(0)/4
    return math.sqrt(hertz.reduced_modulus(E, nu) * L * a**2 * math.pi / (4 * line))


@dataclass(frozen=True)
class Memory:
    """What the springs of each point remember: their deflection, by the pressure at which they
    touched.

    Attributes
    ----------
    touched : ndarray, shape (m, points)
        Pressures, falling from the current one towards 0, at which the deflection bends, pascals.
    slopes : ndarray, shape (m,)
        Deflection gained per metre of what a spring may deflect, from one bend to the next: 1 or -1
        (slipped that way) or 0 (touched without stress). Beyond the last bend all springs moved
        together.
    """

    touched: F64
    slopes: F64

    @classmethod
    def fresh(cls, points: int) -> Memory:
        """That of an interface that was never sheared."""
        return cls(np.empty((0, points)), np.empty(0))


@dataclass(frozen=True)
class Interface:
    """A rough interface: friction coefficient `mu` and elastic length `L` (metres; 0: rigid until
    it slips).

    Raises
    ------
    ValueError
        `mu` is not positive, or `L` is negative.
    """

    mu: float
    L: float

    def __post_init__(self) -> None:
        if not 0 < self.mu < np.inf:
            raise ValueError(
                f"interface: a friction coefficient of {self.mu:g} was given; use a positive one"
            )
        if not 0 <= self.L < np.inf:
            raise ValueError(
                f"interface: an elastic length of {self.L:g} m was given; use 0 or more"
            )

    def traction(self, s: ArrayLike, p: ArrayLike) -> F64:
        """Shear traction (Pa) after a first displacement `s` (m) of the block's surface under the
        pressure `p` (Pa); they broadcast.
        """
        s, p = all_floats(s, p)
        share = (s != 0).astype(np.float64)
        if self.L > 0:
            share = -np.expm1(-np.abs(s) / (self.mu * self.L))
        return np.asarray(np.copysign(self.mu * p * share, s))

    def stiffness(self, s: ArrayLike, p: ArrayLike) -> F64:
        """Stiffness d sigma/d s (Pa/m) at the displacement `s`: p/L at rest; for L = 0 infinite at
        rest, then 0.
        """
        s, p = np.broadcast_arrays(floats(s), floats(p))
        if self.L == 0:
            return np.where((s == 0) & (p > 0), np.inf, 0.0)
        return np.asarray(p / self.L * np.exp(-np.abs(s) / (self.mu * self.L)))

    def displacement(self, sigma: ArrayLike, p: ArrayLike) -> F64:
        """Displacement (m) at which the traction is `sigma` (Pa), the inverse of `traction`;
        infinite at mu p, NaN above it.
        """
        both = all_floats(sigma, p)
        sigma, p = np.broadcast_arrays(*both)
        unloaded = np.where(sigma == 0, 0.0, np.inf)
        share = np.divide(np.abs(sigma), self.mu * p, out=unloaded, where=p > 0)
        with np.errstate(divide="ignore"):
            depth = -np.log1p(-np.minimum(share, 1.0))
        reach = self.mu * self.L * depth if self.L > 0 else np.where(share < 1, 0.0, np.inf)
        return np.asarray(np.where(share > 1, np.nan, np.copysign(reach, sigma)))

    def respond(self, memory: Memory, p: F64, move: F64) -> tuple[F64, F64, F64]:
        """Traction (Pa), stiffness (Pa/m) and pressure at which the last slipping spring touched
        (Pa), after a `move` of each point (m).

        Raises
        ------
        ValueError
            For L = 0: a rigid interface has no stiffness.
        """
        if self.L == 0:
            raise ValueError(
                "interface: the memory of a rigid interface (L = 0) was asked for; give a small L,"
                " or use cattaneo_mindlin"
            )
        sigma, stiffness, front = _respond(memory.touched, memory.slopes, p, move, self.mu, self.L)
        return sigma, stiffness, front

    def remember(self, memory: Memory, p: F64, move: F64, front: F64) -> Memory:
        """The memory after a `move` of each point, with the `front` that `respond` gave for it."""
        forward = move > 0
        touched = [
            np.where(forward, p, front),
            np.where(forward, front, p),
            *np.minimum(memory.touched, front),
        ]
        return _compact(touched, [-1.0, 1.0, *memory.slopes], p)

    def under(self, memory: Memory, before: F64, p: F64) -> Memory:
        """The memory once the pressure went from `before` to `p` with the points at rest."""
        edge = _deflection(memory.touched, memory.slopes, before, p, self.mu * self.L)
        touched = [np.minimum(before, p), *np.minimum(memory.touched, p)]
        kept = _compact(touched, [0.0, *memory.slopes], p)
        # the springs nearest to letting go now slip
        return self.remember(kept, p, edge, self.respond(kept, p, edge)[2])


class TabulatedLaw:
    """A law of the slip given by a table: share of mu p against the displacement. First loadings
    only: it has no memory.

    Parameters
    ----------
    mu : float
    slip, share : array_like, shape (n,)
        Displacement (m), from 0 and increasing, and share of mu p, from 0 to 1 and never falling;
        smooth between (PCHIP), 1 beyond.

    Raises
    ------
    ValueError
        The table is something else.
    """

    def __init__(self, mu: float, slip: ArrayLike, share: ArrayLike) -> None:
        slip, share = all_floats(slip, share)
        is_table = slip.ndim == 1 and slip.shape == share.shape and len(slip) >= 2
        if (
            not (is_table and np.isfinite([slip, share]).all())
            or not (slip[0] == share[0] == 0 and share[-1] == 1)
            or not ((np.diff(slip) > 0).all() and (np.diff(share) >= 0).all())
        ):
            raise ValueError(
                f"interface: a table of {slip.size} slips and {share.size} shares was given; let"
                " the slip rise from 0 and the share of mu p rise from 0 to 1, never falling"
            )
        self.mu, self._end = mu, float(slip[-1])
        self._share = scipy.interpolate.PchipInterpolator(slip, share)
        self._slope = self._share.derivative()
        steepest = float(self._slope(0.0))
        if not steepest > 0:
            raise ValueError(
                "interface: the table begins flat, but an interface at rest has a stiffness; let"
                " the share rise from the first row on"
            )
        self.L = 1 / (mu * steepest)

    def respond(self, memory: Memory, p: F64, move: F64) -> tuple[F64, F64, F64]:
        """Traction (Pa) and stiffness (Pa/m) after a first `move` of each point (m); see
        `Interface.respond`.
        """
        s = np.minimum(np.abs(move), self._end)
        rising = np.where(np.abs(move) < self._end, self._slope(s), 0.0)
        sigma = np.copysign(self.mu * p * self._share(s), move)
        return sigma, self.mu * p * rising, np.zeros_like(p)

    def remember(self, memory: Memory, p: F64, move: F64, front: F64) -> Memory:
        """The memory as it was: there is none."""
        return memory


def _compact(touched: list[F64], slopes: list[float], p: F64) -> Memory:
    """A memory without the bends that coincide everywhere, or bend nothing."""
    keep: list[int] = []
    above = p
    for i, row in enumerate(touched):
        # a row may not rise above the one before it
        touched[i] = np.minimum(row, above)
        if (touched[i] < above).any():
            if keep and slopes[keep[-1]] == slopes[i]:
                keep.pop()
            keep.append(i)
        above = touched[i]
    rows = np.stack([touched[i] for i in keep]) if keep else np.empty((0, len(p)))
    return Memory(rows, np.array([slopes[i] for i in keep]))


@compiled
def _respond(
    touched: F64, slopes: F64, p: F64, move: F64, mu: float, L: float
) -> tuple[F64, F64, F64]:
    n, reach = p.size, mu * L
    sigma, stiffness, front = np.zeros(n), np.zeros(n), np.zeros(n)
    for i in range(n):
        if p[i] <= 0:
            continue
        sign = 1.0 if move[i] > 0 else -1.0
        left = abs(move[i])  # what is still to be taken up by springs that start to slip
        slipped, above, j = 0.0, p[i], 0
        while j < slopes.size:
            if touched[j, i] < above:
                length = reach * np.log(above / touched[j, i]) if touched[j, i] > 0 else np.inf
                gap = 1 - sign * slopes[j]
                if gap > 0 and gap * length > left:
                    slipped += left / gap
                    left = 0.0
                    break
                slipped += length
                left -= gap * length if gap > 0 else 0.0
                above = touched[j, i]
            j += 1
        slipped += left
        held = np.exp(-slipped / reach)
        front[i] = p[i] * held
        stiffness[i] = front[i] / L
        total, above = -sign * p[i] * np.expm1(-slipped / reach), front[i]
        while j < slopes.size:
            if touched[j, i] < above:
                total += slopes[j] * (above - touched[j, i])
                above = touched[j, i]
            j += 1
        sigma[i] = mu * total
    return sigma, stiffness, front


@compiled
def _deflection(touched: F64, slopes: F64, before: F64, p: F64, reach: float) -> F64:
    """Deflection of the spring that touched at the pressure p, 0 where p is above `before`."""
    edge = np.zeros(p.size)
    for i in range(p.size):
        above = before[i]
        if p[i] <= 0:
            continue
        for j in range(slopes.size):
            below = max(touched[j, i], p[i])
            if below < above:
                edge[i] += slopes[j] * reach * np.log(above / below)
                above = below
    return edge
