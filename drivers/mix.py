"""What makes one bench of any mix of devices: the sample clock that all of them share, and a
simulated world that keeps up with the devices that are real.

Exactly one party lets the simulated world's time pass: the simulated forces, the emulated board,
or, beside real or stored forces, `ClockedForces`. If the actuator is real or stored and anything
else is not, the world's stage goes where that actuator goes (`FollowedActuator`).
"""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from drivers.clock import SampleClock
from drivers.protocols import Actuator, Camera, ForceSource, LostSamples, SampleBlock, TriggerTrain

if TYPE_CHECKING:
    from drivers.sim.world import World

MOVES_THE_WORLD = frozenset({"simulated", "emulated"})  # natures of drivers


def connected(
    forces: ForceSource,
    camera: Camera,
    actuator: Actuator,
    natures: dict[str, str],
    clock: SampleClock,
    world: World | None,
) -> tuple[ForceSource, Camera, Actuator]:
    """The three devices, wrapped where the clock or the world must be told what one of them does.

    Parameters
    ----------
    natures : dict
        Kind of device -> nature of its driver, see `drivers.bench.NEEDS`.
    """
    has_own_stage = natures["actuator"] in MOVES_THE_WORLD
    led = None if natures["forces"] in MOVES_THE_WORLD else world
    # where the stage is, is known for the last sample that was read, and for no later one
    in_read_time = natures["actuator"] == "stored" or (led is not None and has_own_stage)
    clocked: Any = ClockedForces(forces, clock, led, stage_in_read_time=in_read_time)
    followed: Any = actuator
    if world is not None and not has_own_stage:
        followed = FollowedActuator(actuator, world)
    return clocked, camera, followed


class _Wrapped:
    """A device of which some methods do more; all others are those of the device itself."""

    def __init__(self, device: Any) -> None:
        self.device = device

    def __getattr__(self, name: str) -> Any:
        return getattr(self.device, name)


class ClockedForces(_Wrapped):
    """A force source that advances the sample clock with every block that is read, and the time of
    a world as well if that has no other source.
    """

    def __init__(
        self,
        forces: ForceSource,
        clock: SampleClock,
        world: World | None = None,
        *,
        stage_in_read_time: bool = False,
    ) -> None:
        super().__init__(forces)
        self._clock = clock
        self._world = world
        self._stage_in_read_time = stage_in_read_time
        self._end_of_read = 0  # the sample after the last block or gap

    def start(self, train: TriggerTrain) -> None:
        """Start the device, and with it the clock."""
        self._end_of_read = 0
        self._clock.start(counts_exposures=self.device.counts_exposures)
        if self._world is not None:
            self._world.start(train)
        self.device.start(train)

    def read(self, timeout_s: float) -> SampleBlock | LostSamples:
        """The next block; the clock advances before it is handed over."""
        block: SampleBlock | LostSamples = self.device.read(timeout_s)
        self._end_of_read = block.end
        if self._world is not None:
            self._world.advance(block.end - self._world.now)
        if isinstance(block, SampleBlock):
            self._clock.advance(block.end, block.exposures)
        elif not self.device.counts_exposures:
            # with a counter, the next block says what was exposed in the gap
            self._clock.advance(block.end)
        return block

    def backlog(self) -> int:
        """Samples of the device that wait to be read; 0 if the position of the stage is not known
        beyond the last sample that was read.
        """
        asked_s = time.monotonic()
        waiting = int(self.device.backlog())
        self._clock.anchor(self._end_of_read + waiting, asked_s, time.monotonic())
        return 0 if self._stage_in_read_time else waiting

    def stop(self) -> None:
        """Stop the device, and with it the clock."""
        self.device.stop()
        self._end()

    def close(self) -> None:
        """Stop the clock, let go of the device."""
        try:
            self.device.close()
        finally:
            self._end()

    def _end(self) -> None:
        self._clock.stop()
        if self._world is not None and self._world.phase == "running":
            self._world.stop()


class FollowedActuator(_Wrapped):
    """An actuator beside a simulated world, whose stage goes where each reading of the actuator's
    position says.
    """

    def __init__(self, actuator: Actuator, world: World) -> None:
        super().__init__(actuator)
        self._world = world
        self._start_m: float | None = None

    def position_m(self) -> float:
        """Where the device is; the world's stage goes there too."""
        here = float(self.device.position_m())
        if self._start_m is None:
            self._start_m = here
        self._world.follow(here - self._start_m)
        return here
