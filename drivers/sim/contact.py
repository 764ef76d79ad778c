"""The sheared contact of the simulated world: how its force and its surface follow the drive, under
one of three laws of friction.

The normal force is constant and the drive has one direction, so that the state follows from the
driven distance alone.
"""

from __future__ import annotations

import bisect
import warnings
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.interpolate import CubicHermiteSpline

from analysis.mechanics import cattaneo_mindlin, hertz
from analysis.mechanics.interface import TabulatedLaw
from analysis.mechanics.loading import AxisymmetricLoading, LoadingState, SphereContact
from drivers.sim.scenario import Scenario

F64 = NDArray[np.float64]

STATES = 400
LONGEST_TABLE = 1 << 20


class Sheared(Protocol):
    """The contact at one shear force."""

    @property
    def stick_radius(self) -> float:
        """Radius in metres inside which nothing slips or, under a law without such a radius, at
        which the shear traction is largest.
        """
        ...

    def radial(self, r: ArrayLike) -> tuple[F64, F64]:
        """Surface displacement (g0, g2) in metres at distances r: ``g0 + g2 cos 2 theta`` along the
        drive, ``g2 sin 2 theta`` across.
        """
        ...

    def traction(self, r: ArrayLike) -> F64:
        """Shear traction along the drive at distances r, pascals."""
        ...


class Contact(Protocol):
    """A contact under its normal force, in series with the tangential cantilever and the lens
    holder.

    Attributes
    ----------
    limit : float
        Greatest shear force mu P, newtons.
    onset : float
        Driven distance in metres at which the contact slides as a whole: where the line of steady
        sliding begins.
    """

    limit: float
    onset: float

    def shear_force(self, driven: F64) -> F64:
        """Q in newtons after a drive by `driven` metres; 0 for a distance below 0."""
        ...

    def sheared(self, driven: float) -> Sheared:
        """The contact after that drive."""
        ...


class CattaneoMindlin:
    """Sticks inside c and slips under mu p outside, in closed form."""

    def __init__(self, scenario: Scenario) -> None:
        s, block = scenario, scenario.sample
        self.limit = s.mu * s.normal_force
        self.radius = hertz.contact_radius(
            s.normal_force, block.young_modulus, block.poisson, block.lens_radius
        )
        self._compliance = s.series_compliance
        self._model = s.mu, s.normal_force, self.radius, block.young_modulus, block.poisson
        self.onset = cattaneo_mindlin.full_shift(*self._model) + self._compliance * self.limit

    def shear_force(self, driven: F64) -> F64:
        """See `Contact`."""
        return cattaneo_mindlin.driven_shear_force(driven, self._compliance, *self._model)

    def sheared(self, driven: float) -> Sheared:
        """See `Contact`."""
        return _Sheared(self, float(self.shear_force(np.asarray(driven))))


class _Sheared:
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
        s, block = scenario, scenario.sample
        self.limit = s.mu * s.normal_force
        is_table = s.sim.law == "table"
        law = TabulatedLaw(s.mu, *read_law(s.sim.law_table)) if is_table else None
        L = law.L if law else s.sim.slip_length
        sphere = SphereContact(
            s.normal_force,
            block.young_modulus,
            block.poisson,
            block.lens_radius,
            s.mu,
            L,
            s.depth,
            s.roughness,
        )
        self._loading = AxisymmetricLoading(sphere, law=law)
        self._has_memory = law is None
        self._compliance = s.series_compliance
        last = self._loading.at_force(self.limit * (1 - 1e-9))
        self._states = self._loading.table(STATES, last.D)
        D, Q, stiffness = (
            np.array([getattr(state, name) for state in self._states])
            for name in ("D", "Q", "stiffness")
        )
        driven = D + self._compliance * Q
        self._curve = CubicHermiteSpline(driven, Q, stiffness / (1 + self._compliance * stiffness))
        self._end = float(driven[-1])
        # in steady sliding the centre moves like the block, behind it by the deformation under the
        # full traction; this line is extrapolated back to where the centre had not moved
        self.onset = float(last.displacement(0.0)[0]) + self._compliance * self.limit

    def shear_force(self, driven: F64) -> F64:
        """See `Contact`."""
        return np.asarray(self._curve(np.clip(driven, 0.0, self._end)))

    def sheared(self, driven: float) -> Sheared:
        """See `Contact`."""
        D = driven - self._compliance * float(self.shear_force(np.asarray(driven)))
        if not self._has_memory:
            return _Yielding(self._loading.at_block(D))
        below = max(bisect.bisect_right(self._states, D, key=lambda state: state.D) - 1, 0)
        return _Yielding(self._loading.advance(self._states[below], D))


class _Yielding:
    def __init__(self, state: LoadingState) -> None:
        self._state = state

    @property
    def stick_radius(self) -> float:
        return self._state.peak_radius

    def radial(self, r: ArrayLike) -> tuple[F64, F64]:
        return self._state.displacement(r)

    def traction(self, r: ArrayLike) -> F64:
        return self._state.traction(r)


def read_law(path: str) -> tuple[F64, F64]:
    """Slip in metres and shear traction as a share of mu p, from a CSV file of slip (um) and share.

    Raises
    ------
    ValueError
        There is no such file, or it holds something else.
    """
    if not path:
        raise ValueError(
            "sim.law_table: law = 'table' needs a file of slip (um) and share of mu p; none is"
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
            f"sim.law_table: {path} can not be read: {error}; write two columns of numbers, slip"
            " (um) and share of mu p"
        ) from None
    if rows.shape[1] != 2:
        raise ValueError(
            f"sim.law_table: {path} has {rows.shape[1]} columns; write two, slip (um) and share of"
            " mu p"
        )
    return rows[:, 0] * 1e-6, rows[:, 1]


def sheared_contact(scenario: Scenario) -> Contact:
    """The contact under the law of the settings.

    Raises
    ------
    ValueError
        The law can not be had with the other settings, or its table can not be used.
    """
    if scenario.sim.law != "cattaneo-mindlin":
        return ElastoPlastic(scenario)
    for name, is_asked in (
        ("block of finite thickness", scenario.sim.thickness),
        ("rough contact", scenario.roughness),
    ):
        if is_asked:
            raise ValueError(
                f"simulated world: the law 'cattaneo-mindlin' has no {name}; use 'elasto-plastic'"
            )
    return CattaneoMindlin(scenario)
