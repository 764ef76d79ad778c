"""Stages that an emulated controller can drive: a free one, with end switches and an obstacle, and
that of the simulated world.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Protocol

from drivers.sim.devices import ENCODER_M, TRAVEL_M
from drivers.sim.world import World

NEGATIVE_END, POSITIVE_END, FOLLOWING_ERROR = 0x01, 0x02, 0x20
ENCODER_MM = ENCODER_M * 1e3
_FIRST_COUNT = round(TRAVEL_M / 2 / ENCODER_M)


class EmulatedStage(Protocol):
    """A stage that a controller drives; mm, mm/s."""

    def move(self, target: float, velocity: float, acceleration: float) -> None: ...

    def halt(self, acceleration: float) -> None:
        """Decelerate and stand."""

    def position(self) -> float: ...

    def is_moving(self) -> bool:
        """Whether the controller has not reached the end of the move yet."""

    def errors(self, following_limit: float) -> int:
        """Error bits of what holds the stage; 0: nothing."""

    def time(self) -> float: ...


class FreeStage:
    """A free stage: trapezoidal velocity profile on a clock, end switches, and an obstacle if one
    is given.

    Parameters
    ----------
    clock : function
        Gives the time in seconds: the wall clock, or one that a test advances.
    start : float
        Initial position, mm.
    ends : (float, float)
        Positions of the end switches, mm.
    sticks_at : float, optional
        Position of an obstacle, mm.
    """

    def __init__(
        self,
        clock: Callable[[], float] = time.monotonic,
        start: float = 12.5,
        ends: tuple[float, float] = (-0.5, 25.5),
        sticks_at: float | None = None,
    ) -> None:
        self.time, self.ends, self.sticks_at = clock, ends, sticks_at
        # time from which on it moves so, position, velocity, acceleration
        self._legs = [(clock(), start, 0.0, 0.0)]

    def move(self, target: float, velocity: float, acceleration: float) -> None:
        """Accelerate, cruise, decelerate; from rest."""
        t, here = self.time(), self.position()
        way, sign = abs(target - here), 1.0 if target > here else -1.0
        top = min(velocity, (acceleration * way) ** 0.5)
        ramp, cruise = top / acceleration, (way - top**2 / acceleration) / top if way else 0.0
        ramped = sign * top**2 / acceleration / 2
        self._legs = [
            (t, here, 0.0, sign * acceleration),
            (t + ramp, here + ramped, sign * top, 0.0),
            (t + ramp + cruise, target - ramped, sign * top, -sign * acceleration),
            (t + 2 * ramp + cruise, target, 0.0, 0.0),
        ]

    def halt(self, acceleration: float) -> None:
        """Decelerate and stand."""
        t = self.time()
        place, velocity = self._aim(t)
        slowing = -acceleration if velocity > 0 else acceleration
        end = t + abs(velocity) / acceleration
        self._legs = [
            (t, place, velocity, slowing),
            (end, place + velocity * (end - t) / 2, 0.0, 0.0),
        ]

    def position(self) -> float:
        """True position, which is never beyond the ends or the obstacle."""
        low, high = self.ends
        return min(
            max(self._aim(self.time())[0], low),
            high if self.sticks_at is None else min(high, self.sticks_at),
        )

    def is_moving(self) -> bool:
        """Whether the profile has not ended yet."""
        return self.time() < self._legs[-1][0]

    def errors(self, following_limit: float) -> int:
        """Bits of the end switches, and of a stage that is behind its profile."""
        aim = self._aim(self.time())[0]
        if not self.ends[0] <= aim <= self.ends[1]:
            return NEGATIVE_END if aim < self.ends[0] else POSITIVE_END
        return FOLLOWING_ERROR if abs(aim - self.position()) > following_limit else 0

    def _aim(self, t: float) -> tuple[float, float]:
        t0, place, velocity, acceleration = next(
            (leg for leg in reversed(self._legs) if leg[0] <= t), self._legs[0]
        )
        dt = t - t0
        return place + velocity * dt + acceleration * dt**2 / 2, velocity + acceleration * dt


class WorldStage:
    """The stage of the simulated world, in the middle of its travel at sample 0, with the faults of
    the world.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._velocity = 0.0
        self._held_since: float | None = None

    def move(self, target: float, velocity: float, acceleration: float) -> None:
        """Drive the block; raises `OutOfLimits` if the world does not model the move."""
        self._velocity, self._held_since = velocity, None
        if abs(target - self.position()) < ENCODER_MM / 2:
            self._world.halt()
        else:
            self._world.move(target * 1e-3 - _FIRST_COUNT * ENCODER_M, velocity * 1e-3)

    def halt(self, acceleration: float) -> None:
        """Stand still from this sample on."""
        self._world.halt()

    def position(self) -> float:
        """Position by the encoder, in whole counts."""
        return (_FIRST_COUNT + round(self._world.stage_m() / ENCODER_M)) * ENCODER_MM

    def is_moving(self) -> bool:
        """Whether the world's stage has not reached its target yet."""
        return self._world.is_moving()

    def errors(self, following_limit: float) -> int:
        """The bit of an end switch at once, that of a stall once the profile is too far ahead."""
        obstacle = self._world.obstacle()
        if obstacle is None:
            return 0
        if obstacle.kind == "end-of-run":
            return POSITIVE_END
        self._held_since = self.time() if self._held_since is None else self._held_since
        behind = (self.time() - self._held_since) * self._velocity
        return FOLLOWING_ERROR if behind > following_limit else 0

    def time(self) -> float:
        """Time of the samples in seconds."""
        return self._world.now / self._world.scenario.forces.sample_rate
