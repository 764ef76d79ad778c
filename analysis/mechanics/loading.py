"""A sphere on a rough plane, loaded tangentially: block displacement, shear force, traction and
surface displacement. SI units throughout.

Every point of the contact obeys ``s = D - G*sigma(s)``: D is the block's displacement, G*sigma the
elastic displacement of its surface (azimuthal mean) and sigma(s) the local law of `interface`. A
block that relaxes takes that of another traction (`analysis.mechanics.relaxation`). In the
polynomials of `modes` G is diagonal, and both Hertz's pressure and Greenwood and Tripp's make
``xi sigma`` a smooth even function of xi: a few modes give many digits.

References
----------
Prevost et al. 2013, sections 5 and 6.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy
from numpy.polynomial import chebyshev
from numpy.typing import ArrayLike

from analysis.arrays import F64, floats
from analysis.mechanics import cattaneo_mindlin, hertz
from analysis.mechanics.greenwood_tripp import RoughContact, rough_contact
from analysis.mechanics.half_space import layer_correction
from analysis.mechanics.interface import Interface, Memory, TabulatedLaw
from analysis.mechanics.modes import basis, chebyshev_series, chebyshev_sum
from analysis.mechanics.relaxation import ELASTIC, Relaxation
from analysis.mechanics.tabulated_pressure import TabulatedPressure

MODES, ROUGH_MODES = 64, 96
FAINTEST = 1e-9  # pressure at the end of a rough contact, share of the peak
MOST_STEPS = 80
ROUNDING = 16 * np.finfo(np.float64).eps  # relative rounding of D and s in their balance
FAR = 6.0  # distance in thicknesses beyond which a layer's surface rests
LAYER_TERMS, LAYER_ANGLES = 128, 16


@dataclass(frozen=True)
class SphereContact:
    """A rough elastic block pressed on a rigid sphere.

    Parameters
    ----------
    P : float
        Normal force, newtons.
    E, nu : float
        Young's modulus (Pa) and Poisson's ratio of the block.
    R : float
        Radius of the sphere, metres.
    mu, L : float
        Friction coefficient and elastic length (m) of the interface; the limit L -> 0 is
        `cattaneo_mindlin`.
    h : float
        Standard deviation of the heights of the rough face, metres: the pressure is Greenwood and
        Tripp's for exponential heights; 0: Hertz's.
    table : TabulatedPressure, optional
        Takes the place of both.
    thickness : float
        Of the block on its rigid plate, metres, two contact radii or more; default a half-space.
        The pressure is that on a half-space.
    relaxation : Relaxation, optional
        Of the block, to the modulus E; the pressure has relaxed.

    Raises
    ------
    ValueError
        A parameter is out of its range.
    """

    P: float
    E: float
    nu: float
    R: float
    mu: float
    L: float
    thickness: float = math.inf
    h: float = 0.0
    table: TabulatedPressure | None = None
    relaxation: Relaxation = ELASTIC

    def __post_init__(self) -> None:
        positive = {"normal_force": self.P, "E": self.E, "R": self.R, "mu": self.mu, "L": self.L}
        hertz.check("loading", nu=self.nu, **positive)
        if self.h:
            hertz.check("loading", h=self.h)
        if not self.thickness >= 2 * self.a:
            raise ValueError(
                f"loading: a block {self.thickness:g} m thick found; give two contact radii"
                f" ({2 * self.a:.3g} m) or more"
            )

    @cached_property
    def a(self) -> float:
        """Hertz's contact radius or, of a table, the effective one, metres."""
        if self.table:
            return self.table.at_load(self.P).effective_radius
        return hertz.contact_radius(self.P, self.E, self.nu, self.R)

    @cached_property
    def rough(self) -> RoughContact | TabulatedPressure | None:
        """The rough face, or the pressure of the table; None where it is smooth."""
        if self.table:
            return self.table.at_load(self.P)
        return rough_contact(self.P, self.E, self.nu, self.R, self.h) if self.h else None

    @cached_property
    def reach(self) -> float:
        """Radius beyond which there is no pressure, metres: a, or where a rough face carries
        `FAINTEST` of the peak.
        """
        if isinstance(self.rough, TabulatedPressure):
            return self.rough.reach
        return self.rough.radius_at(FAINTEST) if self.rough else self.a

    @property
    def peak_pressure(self) -> float:
        """At the centre, pascals."""
        return self.rough.peak_pressure if self.rough else hertz.peak_pressure(self.P, self.a)

    @property
    def G(self) -> float:
        """Shear modulus, pascals."""
        return hertz.shear_modulus(self.E, self.nu)

    @property
    def limit(self) -> float:
        """Greatest shear force mu P, newtons."""
        return self.mu * self.P

    @property
    def full_shift(self) -> float:
        """Displacement of the block (m) at which the whole contact would slide for L = 0, on a
        half-space.
        """
        return cattaneo_mindlin.full_shift(self.mu, self.P, self.a, self.E, self.nu)

    def pressure(self, r: ArrayLike) -> F64:
        """Pressure in pascals, shape of `r`."""
        if self.rough is None:
            return hertz.pressure(r, self.P, self.a)
        return np.where(np.abs(r) <= self.reach, self.rough.pressure(r), 0.0)


@dataclass(frozen=True)
class LoadingState:
    """The contact at one moment of its history.

    Attributes
    ----------
    loading : AxisymmetricLoading
        The contact under the normal force of this moment.
    D, Q : float
        Displacement of the block far away (m), and shear force (N).
    stiffness : float
        dQ/dD as the motion goes on, N/m.
    s, sigma : ndarray, shape (modes,)
        Displacement of the surface (m), as a camera at rest with the sphere sees it, and shear
        traction (Pa), at the radii `r`.
    memory : Memory
        Of the interface, at the same radii.
    lagged : ndarray, shape (modes,)
        Traction (Pa) behind the low-pass of a block that relaxes, see
        `analysis.mechanics.relaxation`; sigma after a long time.
    """

    loading: AxisymmetricLoading
    D: float
    Q: float
    stiffness: float
    s: F64
    sigma: F64
    memory: Memory
    lagged: F64

    @property
    def r(self) -> F64:
        """Radii of the nodes, metres, falling from about a to about 0."""
        return self.loading.r

    @property
    def pressure(self) -> F64:
        """Pressure at the nodes, pascals."""
        return self.loading.p

    @property
    def stick_radius(self) -> float:
        """Cattaneo and Mindlin's c(Q) of a first loading, metres."""
        contact = self.loading.contact
        return float(cattaneo_mindlin.stick_radius(self.Q, contact.limit, contact.a))

    @property
    def peak_radius(self) -> float:
        """Radius (m) of the greatest shear traction: c as read from a measured traction."""
        r = np.linspace(0, self.loading.contact.reach, 1025)
        sigma = np.abs(self.traction(r))
        i = int(np.argmax(sigma))
        if i == 0:
            return 0.0
        down, up = sigma[i] - sigma[i - 1], sigma[i] - sigma[i + 1]
        return float(r[i] + 0.5 * (down - up) / (down + up) * (r[1] - r[0]))

    def traction(self, r: ArrayLike) -> F64:
        """Shear traction along x at any distance r (m) from the centre, pascals, shape of `r`."""
        contact = self.loading.contact
        x = np.minimum(floats(r) / contact.reach, 1.0)
        share = chebyshev.chebval(1 - 2 * x * x, self._series.share)
        return np.asarray(contact.pressure(r) * share)

    def displacement(self, r: ArrayLike) -> tuple[F64, F64]:
        """Surface displacement G*sigma as (g0, g2), metres, at any r: ``gx = g0 + g2 cos 2 theta``,
        ``gy = g2 sin 2 theta``.
        """
        contact = self.loading.contact
        r = floats(r)
        x = r.ravel() / contact.reach
        is_in = x <= 1
        inner, opening = 1 - 2 * x[is_in] ** 2, np.arcsin(1 / x[~is_in])
        outer = 2 * (2 / np.pi * opening) ** 2 - 1
        fields = []
        for inside, outside, layer in self._series.parts:
            g = np.empty_like(x)
            g[is_in] = chebyshev_sum(inner, inside)
            g[~is_in] = opening * chebyshev_sum(outer, outside)
            if layer.size:
                near = 2 * x * contact.reach / (FAR * contact.thickness) - 1
                g = np.where(near <= 1, g + chebyshev_sum(np.minimum(near, 1.0), layer), 0.0)
            fields.append(g.reshape(r.shape))
        return fields[0], fields[1]

    @cached_property
    def _series(self) -> LoadingSeries:
        share = self.loading.contact.relaxation.share
        surface = (1 - share) * self.sigma + share * self.lagged
        return self.loading.series(self.sigma, surface)


class LoadingSeries(NamedTuple):
    """Chebyshev series of a traction over the pressure, and of both parts of the displacement:
    inside, outside, by the layer.
    """

    share: F64
    parts: tuple[tuple[F64, F64, F64], tuple[F64, F64, F64]]


class AxisymmetricLoading:
    """States of a contact whose block is displaced, from rest or from another state; newtons,
    metres, pascals.

    Parameters
    ----------
    contact : SphereContact
    modes : int, optional
        Number of Legendre polynomials, and of radii; default 64, on a rough face 96.
    law : TabulatedLaw, optional
        Instead of the contact's interface, with the same mu and L. First loadings only.

    Notes
    -----
    Friction acts along x and the azimuthal mean of u_x decides on slip: exact for nu = 0, else 0.1
    % in Q. The equations are solved by Newton's method with a line search, together with what
    drives the contact: ``D + compliance Q = stage``, or Q given.

    A first loading depends only on where it ends. Otherwise each radius keeps the memory described
    in `analysis.mechanics.interface`, which has Mindlin and Deresiewicz's unloading as its limit
    L -> 0. A step first changes P, then D, and is exact for that path; when both change together,
    make small steps.
    """

    def __init__(
        self,
        contact: SphereContact,
        modes: int | None = None,
        *,
        law: TabulatedLaw | None = None,
    ) -> None:
        if modes is None:
            modes = ROUGH_MODES if contact.rough else MODES
        if modes < 4:
            raise ValueError(f"loading: {modes} modes were asked for; use 4 or more")
        self.contact, self.modes, self._basis = contact, int(modes), basis(int(modes))
        a, xi = contact.reach, self._basis.xi
        self.r = a * np.sqrt((1 - xi) * (1 + xi))
        # to the last digit also where nearly none is left
        self.p = contact.pressure(self.r) if contact.rough else contact.peak_pressure * xi
        self._law = law
        self._interface = Interface(contact.mu, contact.L)
        self._scale = a / (2 * np.pi * contact.G) * np.array([1 - contact.nu / 2, contact.nu / 2])
        self._weight = 2 * np.pi * a * a * self._basis.weight
        if contact.table:  # which the nodes add up less well than a pressure that is smooth
            self.p *= contact.P / float(self._weight @ self.p)
        self._green = self._scale[0] * self._basis.green
        self._layer = (np.empty((0, modes)), np.empty((0, modes)))
        if math.isfinite(contact.thickness):
            nodes, series = chebyshev_series(LAYER_TERMS)
            far = FAR * contact.thickness / 2 * (1 + nodes)
            mean, double = self._layer_matrices(np.concatenate([self.r, far]))
            self._green = self._green + mean[:modes]
            self._layer = (series @ mean[modes:], series @ double[modes:])

    def _layer_matrices(self, r: F64) -> tuple[F64, F64]:
        """From the traction at the nodes to what the layer adds to both parts of the displacement
        at the radii r.
        """
        contact = self.contact
        angle = np.pi * (np.arange(LAYER_ANGLES) + 0.5) / LAYER_ANGLES
        x = r[:, None, None] - self.r[:, None] * np.cos(angle)
        y = self.r[:, None] * np.sin(angle)
        even, double = layer_correction(np.hypot(x, y), contact.E, contact.nu, contact.thickness)
        turned = double * np.cos(2 * np.arctan2(y, x))
        return even.mean(axis=2) * self._weight, turned.mean(axis=2) * self._weight

    def at_block(self, D: float) -> LoadingState:
        """State after a first loading to the block displacement D, metres."""
        return self.driven(D)

    def at_force(self, Q: float) -> LoadingState:
        """State after a first loading to the shear force Q, newtons, less than mu P."""
        if not abs(Q) < self.contact.limit:
            raise ValueError(
                f"loading: a shear force of {Q:g} N was asked for; the contact carries less than mu"
                f" P = {self.contact.limit:g} N"
            )
        return self._solved(self.rest, 0.0, 1.0, Q)

    def driven(self, stage: float, compliance: float = 0.0) -> LoadingState:
        """State after a first loading by a stage (m) in series with a compliance (m/N) of all else
        that gives way.
        """
        return self.advance(self.rest, stage, compliance=compliance)

    def advance(
        self,
        state: LoadingState,
        stage: float,
        *,
        P: float | None = None,
        compliance: float = 0.0,
        duration: float = math.inf,
    ) -> LoadingState:
        """State that follows another one, once P (default: its own) and then the stage have come to
        their new values.

        With no compliance the stage is the block: its displacement D. The step takes `duration`
        seconds, which matters to a block that relaxes: by default so long that it does.
        """
        if not (math.isfinite(stage) and 0 <= compliance < math.inf):
            raise ValueError(
                f"loading: a stage at {stage:g} m behind {compliance:g} m/N was asked for; give"
                " finite ones, the compliance 0 or more"
            )
        loading = state.loading
        if self._law is not None and state.s.any():
            raise ValueError(
                "loading: a step from a loaded state was asked of a tabulated law, which has no"
                " memory; load from rest"
            )
        if P is not None and P != loading.contact.P:
            if loading.contact.relaxation.share:
                raise ValueError(
                    "loading: a change of the normal force was asked of a block that relaxes, whose"
                    " contact has one area; keep P, or take a relaxation of 0"
                )
            loading = AxisymmetricLoading(replace(loading.contact, P=P), loading.modes)
        return loading._solved(state, 1.0, compliance, stage, duration)

    def table(self, n: int, furthest: float | None = None) -> tuple[LoadingState, ...]:
        """States (n) of a first loading, evenly spaced in D from 0 to `furthest` (m); default:
        until all but 1e-6 of mu P is carried.
        """
        if furthest is None:
            furthest = self.at_force((1 - 1e-6) * self.contact.mu * self.contact.P).D
        states = [self.rest]
        for D in np.linspace(0.0, furthest, n)[1:].tolist():
            states.append(self.at_block(D) if self._law else self.advance(states[-1], D))
        return tuple(states)

    def series(self, sigma: F64, surface: F64) -> LoadingSeries:
        """Chebyshev series of a traction given at the nodes, and of the displacement by another."""
        own, load = self._basis, self._basis.xi * surface
        first, second = (
            (scale * inside @ load, scale * outside @ load, layer @ surface)
            for scale, inside, outside, layer in zip(
                self._scale, own.inside, own.outside, self._layer, strict=True
            )
        )
        return LoadingSeries(own.share @ (sigma / self.p), (first, second))

    @cached_property
    def rest(self) -> LoadingState:
        """The state before any shear."""
        zero, k = np.zeros(self.modes), self.p / self.contact.L
        moved = np.linalg.solve(np.eye(self.modes) + self._green * k, np.ones(self.modes))
        stiffness = float((self._weight * k) @ moved)
        return LoadingState(self, 0.0, 0.0, stiffness, zero, zero, Memory.fresh(self.modes), zero)

    def _taken_over(self, state: LoadingState) -> tuple[Memory, F64]:
        """Memory and displacement s of another state, at the radii and pressures of this one."""
        old, memory = state.loading, state.memory
        if old is self or old.contact == self.contact:
            return memory, state.s
        before = old.contact.pressure(self.r)
        if memory.slopes.size:
            nodes = old._basis.xi
            xi = np.sqrt(np.maximum(1 - (self.r / old.contact.reach) ** 2, 0.0))
            share = np.where(memory.touched > 1e-100 * old.p, memory.touched / old.p, 0.0)
            along = scipy.interpolate.PchipInterpolator(nodes, share, axis=1)
            there = along(np.clip(xi, nodes[0], nodes[-1]))
            memory = replace(memory, touched=before * there)
        s = state.D - state.displacement(self.r)[0]
        return self._interface.under(memory, before, self.p), s

    def _solved(
        self,
        state: LoadingState,
        per_D: float,
        per_Q: float,
        target: float,
        duration: float = math.inf,
    ) -> LoadingState:
        """Newton's method for ``s + G (left + share sigma) = D`` and ``per_D D + per_Q Q =
        target``, where `left` and `share` are those of a block that relaxes, else 0 and 1.
        """
        memory, before = self._taken_over(state)
        relaxation = self.contact.relaxation
        left, at_once = relaxation.step(state.lagged, state.sigma, duration)
        law = self._law or self._interface
        respond, eye, one = law.respond, np.eye(self.modes), np.ones(self.modes)
        s, D = before.copy(), state.D
        soft = 1 / (per_D + per_Q * 8 * self.contact.G * self.contact.a / (2 - self.contact.nu))

        def excess(sigma: F64, s: F64, D: float) -> tuple[F64, float, float]:
            local = D - s - self._green @ (left + at_once * sigma)
            rest = target - per_D * D - per_Q * float(self._weight @ sigma)
            return local, rest, math.hypot(float(np.sqrt(local @ local / local.size)), soft * rest)

        # at rest, the direction in which a point will move decides its stiffness
        move = one * math.copysign(1e-12 * self.contact.L, target - per_D * D - per_Q * state.Q)
        sigma, stiffness, front = respond(memory, self.p, move)
        local, rest, size = excess(sigma, s, D)
        shortest = math.inf
        for _ in range(MOST_STEPS):
            matrix = eye + self._green * (at_once * stiffness)
            first, moved = np.linalg.solve(matrix, np.stack([local, one], axis=1)).T
            drive = self._weight * stiffness
            dD = (rest - per_Q * float(drive @ first)) / (per_D + per_Q * float(drive @ moved))
            ds = first + dD * moved
            share = 1.0
            while True:
                move = s + share * ds - before
                sigma, stiffness, front = respond(memory, self.p, move)
                after = excess(sigma, s + share * ds, D + share * dD)
                lost = ROUNDING * (abs(D) + float(np.abs(s).max()))
                if after[2] <= max((1 - 1e-4 * share) * size, lost) or share < 1e-3:
                    break
                share /= 2
            s, D, (local, rest, size) = s + share * ds, D + share * dD, after
            # the next step would be at most half the square of this one over mu L
            length = float(np.abs(ds).max())
            if length**2 <= 1e-13 * self.contact.mu * self.contact.L * np.abs(s).max():
                break
            # close to full slip what is left of the force is rounding, and so is the step
            if size <= lost and abs(rest) <= ROUNDING * abs(target) and length > shortest / 2:
                break
            shortest = length
        else:
            raise ValueError(
                f"loading: no equilibrium was found in {MOST_STEPS} steps towards {target:g}; go"
                " there in smaller steps"
            )
        memory, Q = law.remember(memory, self.p, move, front), float(self._weight @ sigma)
        lagged = relaxation.lagged(state.lagged, state.sigma, sigma, duration)
        return LoadingState(self, D, Q, float(drive @ moved), s, sigma, memory, lagged)
