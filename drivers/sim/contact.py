"""The sheared contact of the simulated world: how its force and its surface follow the drive, under
one of three laws of friction.

The normal force is constant, so that the state follows from the driven distance and from the
distances at which the drive turned back.
"""

from __future__ import annotations

import bisect
import math
import warnings
from functools import lru_cache
from pathlib import Path
from typing import Protocol

import numpy as np
import scipy
from numpy.typing import ArrayLike

from analysis.arrays import F64
from analysis.mechanics import cattaneo_mindlin, hertz
from analysis.mechanics.greenwood_tripp import ROUGHEST, RoughContact, rough_contact
from analysis.mechanics.interface import TabulatedLaw
from analysis.mechanics.loading import AxisymmetricLoading, LoadingState, SphereContact
from analysis.mechanics.relaxation import Relaxation
from analysis.mechanics.tabulated_pressure import TabulatedPressure, tabulated_pressure
from drivers.sim.aged_contact import Aged, Law
from drivers.sim.relaxing_contact import RelaxingContact
from drivers.sim.scenario import Scenario
from drivers.sim.sheared import FRESH, Past, Rests, Sheared, SolvedContact, Turns

STATES, RETURNED = 400, 160  # states of a first loading, and of one that comes back
SLIDING = 0.98  # share of mu P from which a contact that is held ages
LONGEST_TABLE = 1 << 20


class Contact(Protocol):
    """A contact under its normal force, in series with the tangential cantilever and the lens
    holder.

    Attributes
    ----------
    limit : float
        Greatest shear force mu P, newtons.
    onset : float
        Driven distance in metres at which the contact slides as a whole: where the line of steady
        sliding begins, of a block that relaxes once it has.
    has_memory : bool
        Whether the drive may turn back.
    """

    limit: float
    onset: float
    has_memory: bool

    def shear_force(self, driven: F64, past: Past) -> F64:
        """Q in newtons after a drive to `driven` metres; 0 for a first drive of an elastic block
        below 0. Of a block that relaxes, NaN without the samples.
        """
        ...

    def sheared(self, driven: float, past: Past) -> Sheared:
        """The contact after that drive."""
        ...

    def peak(self, turns: Turns, rests: Rests) -> float:
        """Greatest Q (N) of the slide after the last of these holds.

        Raises
        ------
        ValueError
            The contact would jump.
        """
        ...


class CattaneoMindlin:
    """Sticks inside c and slips under mu p outside, in closed form; a first loading only."""

    has_memory = False

    def __init__(self, scenario: Scenario) -> None:
        s = scenario
        self.limit = s.mu * s.normal_force
        self.radius = hertz.contact_radius(s.normal_force, *s.sample.bodies)
        self._compliance = s.series_compliance
        E, nu, _ = s.sample.bodies
        self._model = s.mu, s.normal_force, self.radius, E, nu
        self.onset = cattaneo_mindlin.full_shift(*self._model) + self._compliance * self.limit

    def shear_force(self, driven: F64, past: Past = FRESH) -> F64:
        """See `Contact`."""
        return cattaneo_mindlin.driven_shear_force(driven, self._compliance, *self._model)

    def sheared(self, driven: float, past: Past = FRESH) -> Sheared:
        """See `Contact`."""
        return _RigidSheared(self, float(self.shear_force(np.asarray(driven))))

    def peak(self, turns: Turns, rests: Rests) -> float:
        """See `Contact`."""
        return self.limit


class _RigidSheared:
    def __init__(self, contact: CattaneoMindlin, Q: float) -> None:
        self._contact, self._Q = contact, Q
        self.stick_radius = float(cattaneo_mindlin.stick_radius(Q, contact.limit, contact.radius))

    def radial(self, r: ArrayLike) -> tuple[F64, F64]:
        return cattaneo_mindlin.radial_displacement(r, self._Q, *self._contact._model)

    def traction(self, r: ArrayLike) -> F64:
        return cattaneo_mindlin.traction(r, self._Q, *self._contact._model[:3])


class ElastoPlastic:
    """Yields at each point by a law of the local slip; solved once for a run, then interpolated."""

    def __init__(self, scenario: Scenario) -> None:
        s = scenario
        self.limit = s.mu * s.normal_force
        is_table = s.sim.law == "table"
        law = TabulatedLaw(s.mu, *read_law(s.sim.law_table)) if is_table else None
        L = law.L if law else s.sim.slip_length
        sphere = _sphere(s, L)
        self.has_memory = law is None
        self._compliance = s.series_compliance
        first, last = _loaded(AxisymmetricLoading(sphere, law=law)) if law else _known(sphere)
        self._loading, self._reach = last.loading, last.D
        self._branches: dict[Turns, _Branch] = {(): _Branch(first, self._compliance)}
        # in steady sliding the centre moves like the block, behind it by the deformation under the
        # full traction; this line is extrapolated back to where the centre had not moved
        self.onset = float(last.displacement(0.0)[0]) + self._compliance * self.limit
        self._law = Law(s.sim.ageing, s.sim.ageing_time, s.sim.ageing_slip, s.mu * L)
        self._ages: dict[tuple[Turns, Rests], Aged | None] = {}
        if s.longest_hold:  # a hold that cannot be had is refused before anything moves
            Aged(self._law, s.longest_hold, 0.0, 0.0, self.onset, 1.0)

    def shear_force(self, driven: F64, past: Past = FRESH) -> F64:
        """See `Contact`."""
        aged = self._aged(past.turns, past.rests)
        if aged is None:
            return self._branch(past.turns).shear_force(driven)
        base, extra = aged.at(driven)
        return np.asarray((1 + extra) * self._branch(past.turns).shear_force(base))

    def sheared(self, driven: float, past: Past = FRESH) -> Sheared:
        """See `Contact`."""
        aged = self._aged(past.turns, past.rests)
        if aged is None:
            return SolvedContact(self._state(driven, past.turns))
        base, extra = aged.at(np.asarray(driven))
        return SolvedContact(self._state(float(base), past.turns), 1 + float(extra))

    def peak(self, turns: Turns, rests: Rests) -> float:
        """See `Contact`."""
        aged = self._aged(turns, rests)
        return self.limit * (1 + (aged.peak if aged else 0.0))

    def _aged(self, turns: Turns, rests: Rests) -> Aged | None:
        """The contact since it was last held while it slid; None where it never was."""
        if not (rests and self._law.rate):
            return None
        key = turns, rests
        if key not in self._ages:
            before, (driven, hold_s) = self._aged(turns, rests[:-1]), rests[-1]
            base, left = before.at(np.asarray(driven)) if before else (driven, 0.0)
            way = -1.0 if len(turns) % 2 else 1.0
            slides = way * self._branch(turns).shear_force(np.asarray(base)) >= SLIDING * self.limit
            self._ages[key] = (
                Aged(self._law, hold_s, float(base), float(left), self.onset, way)
                if slides
                else before
            )
        return self._ages[key]

    def _state(self, driven: float, turns: Turns) -> LoadingState:
        branch = self._branch(turns)
        D = driven - self._compliance * float(branch.shear_force(np.asarray(driven)))
        if not self.has_memory:
            return self._loading.at_block(D)
        return self._loading.advance(branch.before(D), D)

    def _branch(self, turns: Turns) -> _Branch:
        """The states from the last turn on, up to where everything slides the other way."""
        if turns not in self._branches:
            *before, here = turns
            states = [self._state(here, tuple(before))]
            way = -1.0 if len(turns) % 2 else 1.0
            steps = states[0].D + way * 2.2 * self._reach * np.linspace(0, 1, RETURNED)[1:] ** 1.5
            for D in steps.tolist():
                states.append(self._loading.advance(states[-1], D))
            self._branches[turns] = _Branch(tuple(states), self._compliance)
        return self._branches[turns]


def _sphere(s: Scenario, L: float) -> SphereContact:
    """The contact of the settings, with that elastic length (m)."""
    pressed = s.normal_force, *s.sample.bodies
    relaxation = Relaxation(s.sim.relaxation, s.sim.relaxation_time)
    return SphereContact(*pressed, s.mu, L, s.depth, s.roughness, tabulated_faces(s), relaxation)


def _loaded(loading: AxisymmetricLoading) -> tuple[tuple[LoadingState, ...], LoadingState]:
    """The states of a first loading, and the last of them: all but 1e-9 of mu P is carried."""
    last = loading.at_force(loading.contact.limit * (1 - 1e-9))
    return loading.table(STATES, last.D), last


@lru_cache(maxsize=4)  # one contact is looked at, driven and driven again
def _known(sphere: SphereContact) -> tuple[tuple[LoadingState, ...], LoadingState]:
    return _loaded(AxisymmetricLoading(sphere))


class _Branch:
    """The states of a drive in one direction, by how far the stage has gone."""

    def __init__(self, states: tuple[LoadingState, ...], compliance: float) -> None:
        self._states = states
        D, Q, stiffness = (
            np.array([getattr(state, name) for state in states]) for name in ("D", "Q", "stiffness")
        )
        driven = D + compliance * Q
        self._way = math.copysign(1.0, driven[-1] - driven[0])
        along = self._way * driven
        stiffness[0] = states[0].loading.rest.stiffness  # nothing slips yet in the new direction
        self._curve = scipy.interpolate.CubicHermiteSpline(
            along, Q, self._way * stiffness / (1 + compliance * stiffness)
        )
        self._ends = float(along[0]), float(along[-1])

    def shear_force(self, driven: F64) -> F64:
        low, high = self._ends
        return np.asarray(self._curve(np.clip(self._way * driven, low, high)))

    def before(self, D: float) -> LoadingState:
        """The last state that comes before a displacement of the block."""
        at = bisect.bisect_right(self._states, self._way * D, key=lambda s: self._way * s.D)
        return self._states[max(at - 1, 0)]


def read_law(path: str) -> tuple[F64, F64]:
    """Slip in metres and shear traction as a share of mu p, from a CSV file of slip (um) and share.

    Raises
    ------
    ValueError
        There is no such file, or it holds something else.
    """
    slip_um, share = _two_columns("sim.law", path, "slip (um) and share of mu p")
    return slip_um * 1e-6, share


def tabulated_faces(scenario: Scenario) -> TabulatedPressure | None:
    """The pressure under the whole normal force where the settings name its table, a CSV file of
    distance (mm) and pressure in any unit; None: they name another.

    Raises
    ------
    ValueError
        There is no such file, or it holds something else.
    """
    if scenario.sim.pressure != "table":
        return None
    columns = "distance from the centre (mm) and pressure"
    r_mm, p = _two_columns("sim.pressure", scenario.sim.pressure_table, columns)
    return tabulated_pressure(scenario.normal_force, r_mm * 1e-3, p)


def rough_faces(
    scenario: Scenario, table: TabulatedPressure | None, P: float
) -> RoughContact | TabulatedPressure | None:
    """The rough face, or the pressure of the table, under a normal force; None where it is smooth,
    or only just touches.
    """
    h, block = scenario.roughness, scenario.sample
    if table is not None:
        return table.at_load(P) if P > 0 else None
    a = hertz.contact_radius(P, *block.bodies)
    if not (h and a and h * block.lens_radius / a**2 < ROUGHEST):
        return None
    return rough_contact(P, *block.bodies, h)


def _two_columns(key: str, path: str, columns: str) -> tuple[F64, F64]:
    """The columns of the file that the setting `key`_table names."""
    if not path:
        raise ValueError(
            f"{key}_table: {key.removeprefix('sim.')} = 'table' needs a file of {columns}; none is"
            " named"
        )
    try:
        # a file that is open: numpy fetches names that are addresses
        with Path(path).open("rb") as file:
            text = file.read(LONGEST_TABLE + 1).decode("utf-8-sig")
        if len(text) > LONGEST_TABLE:
            raise ValueError(f"it has more than {LONGEST_TABLE} characters")
        with warnings.catch_warnings(action="error"):  # of a file without numbers
            rows = np.loadtxt(text.splitlines(), delimiter=",", comments="#", ndmin=2)
    except (OSError, ValueError, UserWarning) as error:
        raise ValueError(
            f"{key}_table: {path} cannot be read: {error}; write two columns of numbers, {columns}"
        ) from None
    if rows.shape[1] != 2:
        raise ValueError(f"{key}_table: {path} has {rows.shape[1]} columns; write two, {columns}")
    return rows[:, 0], rows[:, 1]


def sheared_contact(scenario: Scenario) -> Contact:
    """The contact under the law of the settings.

    Raises
    ------
    ValueError
        The law cannot be had with the other settings, or its table cannot be used.
    """
    if scenario.sim.ageing and scenario.sim.law != "elasto-plastic":
        raise ValueError(
            f"simulated world: the law '{scenario.sim.law}' has no memory and cannot age"
            f" (sim.ageing = {scenario.sim.ageing:g}); use 'elasto-plastic'"
        )
    s = scenario
    if s.sim.relaxation:
        if s.sim.law != "elasto-plastic" or s.sim.pressure == "jkr" or s.sim.ageing:
            raise ValueError(
                f"simulated world: a block that relaxes (sim.relaxation = {s.sim.relaxation:g}) was"
                " asked, which goes with the law 'elasto-plastic' alone, without adhesion (jkr) and"
                " without sim.ageing; change these, or use sim.relaxation = 0"
            )
        sphere, rate = _sphere(s, s.sim.slip_length), s.forces.sample_rate
        return RelaxingContact(sphere, s.series_compliance, rate, s.settled_sample)
    if scenario.sim.law != "cattaneo-mindlin" and scenario.sim.pressure != "jkr":
        return ElastoPlastic(scenario)
    for name, is_asked, otherwise in (
        ("block of finite thickness", scenario.sim.thickness, "sim.thickness = 0"),
        ("rough contact", scenario.roughness, "sim.pressure = 'hertz'"),
        ("pressure of a table", scenario.sim.pressure == "table", "sim.pressure = 'hertz'"),
    ):
        if is_asked:
            raise ValueError(
                f"simulated world: the law 'cattaneo-mindlin' has no {name}; use"
                f" 'elasto-plastic', or {otherwise}"
            )
    return CattaneoMindlin(scenario)
