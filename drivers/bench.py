"""Opens the three devices of a bench, any mix of real, emulated, simulated and stored ones, and
closes them in reverse.
"""

from __future__ import annotations

import logging
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from drivers.clock import SampleClock
from drivers.errors import DeviceError, DeviceNotFound
from drivers.mix import connected
from drivers.protocols import Actuator, Camera, ForceSource
from drivers.settings import ActuatorSettings, CameraSettings, ForceSettings
from drivers.sources import NEEDS, driver

if TYPE_CHECKING:
    from drivers.recorded import Recording
    from drivers.sim.scenario import Scenario
    from drivers.sim.world import World

LOG = logging.getLogger(__name__)


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
            A device is not there, or can not be used.
        """
        opened: list[ForceSource | Camera | Actuator] = []
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
        """Close forces, camera, actuator, each of them even if another fails.

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

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Close whatever happened."""
        self.close()


def _close(devices: Iterable[ForceSource | Camera | Actuator]) -> list[Exception]:
    problems: list[Exception] = []
    for device in devices:
        try:
            device.close()
        except Exception as error:  # the next device must be closed all the same
            problems.append(error)
    return problems


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
        The scenario can not be simulated.
    """
    if scenario is None:
        from drivers.sim.scenario import Scenario

        scenario = Scenario(forces=forces, camera=camera)
    clock = SampleClock(float(forces.sample_rate), pace)
    shared = _Shared(clock, scenario, recording, pace)
    sections: dict[str, Any] = {"forces": forces, "camera": camera, "actuator": actuator}
    drivers = {kind: driver(kind, section.source) for kind, section in sections.items()}
    made: dict[str, Any] = {}
    for kind, found in drivers.items():
        made[kind] = found.make(
            *(
                sections[kind] if need == "settings" else getattr(shared, need)
                for need in NEEDS[found.nature]
            )
        )
    natures = {kind: found.nature for kind, found in drivers.items()}
    shows_world = not {"simulated", "emulated"}.isdisjoint(natures.values())
    world = shared.world if shows_world else None
    return Bench(*connected(**made, natures=natures, clock=clock, world=world), world)
