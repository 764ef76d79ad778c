"""The stage of the simulated world, as an emulated controller drives it."""

from __future__ import annotations

from drivers.sim.devices import ENCODER_M, drive, place_m
from drivers.sim.world import World

POSITIVE_END, FOLLOWING_ERROR = 0x02, 0x20  # error bits
ENCODER_MM = ENCODER_M * 1e3


class WorldStage:
    """The stage of the simulated world, in the middle of its travel at sample 0, with the faults of
    the world; mm, mm/s.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._velocity = 0.0
        self._held_since: float | None = None

    def move(self, target: float, velocity: float, acceleration: float) -> None:
        """Drive the block; raises `OutOfLimits` if the world does not model the move."""
        self._velocity, self._held_since = velocity, None
        drive(self._world, target * 1e-3, velocity * 1e-3)

    def halt(self, acceleration: float) -> None:
        """Stand still from this sample on."""
        self._world.halt()

    def position(self) -> float:
        """Position by the encoder, in whole counts."""
        return place_m(self._world) * 1e3

    def is_moving(self) -> bool:
        """Whether the controller has not reached the end of the move yet."""
        return self._world.is_moving()

    def errors(self, following_limit: float) -> int:
        """Error bits of what holds the stage: that of an end switch at once, that of a stall once
        the profile is too far ahead; 0 if nothing does.
        """
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
