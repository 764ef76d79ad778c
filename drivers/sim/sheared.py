"""What a law of the sheared contact is asked: of which drive, and what it answers."""

from __future__ import annotations

from typing import NamedTuple, Protocol

from numpy.typing import ArrayLike

from analysis.arrays import F64, I64
from analysis.mechanics.loading import LoadingState
from drivers.sim.aged_contact import Rest

Turns = tuple[float, ...]  # driven distances, metres
Rests = tuple[Rest, ...]  # since the last turn


class DriveInTime(Protocol):
    """The drive of a contact in time."""

    def command_after(self, sample: int) -> int | None:
        """Sample of the first command to the stage after a sample."""
        ...

    def driven_from(self, begin: int, sample: int) -> float:
        """Driven distance (m) at a sample, by the last command until `begin`."""
        ...


class Past(NamedTuple):
    """What a contact has met: where the drive turned back, and was held since; and, of laws that
    depend on time, the samples asked of and the way there.
    """

    turns: Turns = ()
    rests: Rests = ()
    samples: I64 | None = None
    path: DriveInTime | None = None


FRESH = Past()


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


class SolvedContact:
    """A solved state of the contact, and of one whose traction is `scale` times its own."""

    def __init__(self, state: LoadingState, scale: float = 1.0) -> None:
        self._state, self._scale = state, scale

    @property
    def stick_radius(self) -> float:
        """See `Sheared`."""
        return self._state.peak_radius

    def radial(self, r: ArrayLike) -> tuple[F64, F64]:
        """See `Sheared`."""
        g0, g2 = self._state.displacement(r)
        return self._scale * g0, self._scale * g2

    def traction(self, r: ArrayLike) -> F64:
        """See `Sheared`."""
        return self._scale * self._state.traction(r)
