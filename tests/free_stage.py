"""A stage for an emulated controller without a simulated world."""

from __future__ import annotations

import time
from collections.abc import Callable

from drivers.emulators.stages import FOLLOWING_ERROR, POSITIVE_END

NEGATIVE_END = 0x01


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
