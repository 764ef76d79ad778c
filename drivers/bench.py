"""Opens the three devices of a bench, any mix of real, emulated, simulated and stored ones, and
closes them in reverse.

All of them share one sample clock, and a simulated world keeps up with those that are real. Exactly
one party lets its time pass: the simulated forces, the emulated board, or, beside real or stored
forces, `ClockedForces`. If the actuator is real or stored and anything else is not, the world's
stage goes where that actuator goes (`FollowedActuator`).
"""

from __future__ import annotations

import logging
import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from drivers.answers import check_backlog, check_samples
from drivers.clock import SampleClock
from drivers.errors import DeviceError, DeviceNotFound, DeviceTimeout
from drivers.protocols import (
    Actuator,
    AnyDevice,
    Camera,
    ForceSource,
    LostSamples,
    SampleBlock,
    TriggerTrain,
)
from drivers.settings import ActuatorSettings, CameraSettings, ForceSettings
from drivers.sources import NEEDS, driver
from drivers.turns import done_beside

if TYPE_CHECKING:
    from drivers.recorded import Recording
    from drivers.sim.scenario import Scenario
    from drivers.sim.world import World

LOG = logging.getLogger(__name__)
CLOSE_S = 3.0  # a device that does not close within it is given up
MOVES_THE_WORLD = frozenset({"simulated", "emulated"})  # natures of drivers


@dataclass(frozen=True, slots=True)
class Bench:
    """Force source, camera and actuator, opened and closed together; a context manager.

    `world` is what the simulated and emulated devices look at, if there are any. It knows the
    truth, and the analysis never sees it.
    """

    forces: ForceSource
    camera: Camera
    actuator: Actuator
    world: World | None = None

    def open(self) -> None:
        """Open actuator, camera, forces; if one fails, those that were open are closed again.

        Raises
        ------
        DeviceError
            A device is not there, or cannot be used.
        """
        opened: list[AnyDevice] = []
        try:
            for device in (self.actuator, self.camera, self.forces):
                opened.append(device)
                device.open()
                LOG.info("%s: %s", device.name, device.describe())
        except BaseException as error:
            for note in _close(reversed(opened)):
                error.add_note(str(note))
            raise

    def close(self) -> None:
        """Close forces, camera, actuator, each of them even if another fails or does not return.

        Raises
        ------
        DeviceError
            Some did not close; the message holds the reason of each.
        """
        problems = _close((self.forces, self.camera, self.actuator))
        if problems:
            reasons = "; ".join(str(problem) for problem in problems)
            raise DeviceError(f"bench: {reasons}") from problems[0]

    def __enter__(self) -> Self:
        """The bench, open."""
        self.open()
        return self

    def __exit__(self, *error: object) -> None:
        """Close whatever happened."""
        self.close()


def block_s(bench: Bench) -> float:
    """Seconds that a block of samples lasts."""
    return bench.forces.block_samples / bench.forces.sample_rate_hz


def _close(devices: Iterable[AnyDevice]) -> list[BaseException]:
    """Close one device after the other, also where one fails or does not return."""
    return [problem for device in devices if (problem := _unclosed(device)) is not None]


def _unclosed(device: AnyDevice) -> BaseException | None:
    """Why a device did not close; None if it did."""
    call = done_beside(device.close, CLOSE_S)
    if not call.done():
        return DeviceTimeout(
            f"{device.name}: it did not close within {CLOSE_S:g} s and was given up; check the"
            " device, its connection and its driver"
        )
    return call.exception()


@dataclass(frozen=True)
class _Shared:
    """What drivers may need, made when the first of them does."""

    clock: SampleClock
    scenario: Scenario
    given_recording: Recording | None
    pace: float | None

    @cached_property
    def world(self) -> World:
        from drivers.sim.world import World

        return World(self.scenario, self.pace)

    @property
    def recording(self) -> Recording:
        if self.given_recording is None:
            raise DeviceNotFound(
                "stored devices: no recorded experiment is named; set replay.session to its file"
            )
        return self.given_recording


def make_bench(
    forces: ForceSettings,
    camera: CameraSettings,
    actuator: ActuatorSettings,
    *,
    scenario: Scenario | None = None,
    recording: Recording | None = None,
    pace: float | None = 1.0,
) -> Bench:
    """The bench of the three drivers that the settings name; its `open`, or a ``with`` block,
    claims the hardware.

    Parameters
    ----------
    forces, camera, actuator : ForceSettings, CameraSettings, ActuatorSettings
        Settings of the devices, each with the name of its driver as `source`.
    scenario : Scenario, optional
        What the simulated and emulated devices look at.
    recording : Recording, optional
        What the stored devices play.
    pace : float or None
        Simulated seconds per second; None: as fast as possible.

    Raises
    ------
    UnknownDevice
        There is no driver of that name.
    DeviceNotFound
        A stored device has no recording.
    ValueError
        The scenario cannot be simulated.
    """
    if scenario is None:
        from drivers.sim.scenario import Scenario

        scenario = Scenario(forces=forces, camera=camera)
    clock = SampleClock(float(forces.sample_rate), pace)
    shared = _Shared(clock, scenario, recording, pace)
    sections: dict[str, Any] = {"forces": forces, "camera": camera, "actuator": actuator}
    drivers = {kind: driver(kind, section.source) for kind, section in sections.items()}
    made: dict[str, Any] = {
        kind: found.make(
            *(
                sections[kind] if need == "settings" else getattr(shared, need)
                for need in NEEDS[found.nature]
            )
        )
        for kind, found in drivers.items()
    }
    natures = {kind: found.nature for kind, found in drivers.items()}
    shows_world = not MOVES_THE_WORLD.isdisjoint(natures.values())
    world = shared.world if shows_world else None
    return Bench(*_connected(**made, natures=natures, clock=clock, world=world), world)


def _connected(
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
        Kind of device -> nature of its driver, see `drivers.sources.NEEDS`.
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


class WrappedDevice:
    """A device of which some methods do more; all others are those of the device itself."""

    def __init__(self, device: Any) -> None:
        self.device = device

    def __getattr__(self, name: str) -> Any:
        return getattr(self.device, name)


class ClockedForces(WrappedDevice):
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
        self._counted: int | None = None  # exposures up to there, where the device counts them

    def start(self, train: TriggerTrain) -> None:
        """Start the device, and with it the clock."""
        self._end_of_read = 0
        self._counted = 0 if self.device.counts_exposures else None
        self._clock.start(counts_exposures=self.device.counts_exposures)
        if self._world is not None:
            self._world.start(train)
        self.device.start(train)

    def read(self, timeout_s: float) -> SampleBlock | LostSamples:
        """The next block, if it is the one that was due, in arrays of its own; the clock advances
        before it is handed over.
        """
        block: SampleBlock | LostSamples = self.device.read(timeout_s)
        check_samples(self.device.name, block, self._end_of_read, self._counted)
        self._end_of_read = block.end
        if self._world is not None:
            self._world.advance(block.end - self._world.now)
        if isinstance(block, SampleBlock):
            block = _own(block)
            if block.exposures is not None:
                self._counted = int(block.exposures[-1])
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
        waiting = check_backlog(self.device.name, self.device.backlog())
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


def _own(block: SampleBlock) -> SampleBlock:
    """A block that stays as it is, whatever its driver does with its arrays afterwards."""
    further = block.auxiliary
    return replace(
        block,
        volts=np.array(block.volts, np.float64),
        auxiliary=None if further is None else np.array(further, np.float64),
    )


class FollowedActuator(WrappedDevice):
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
