"""Opens the three devices of a bench, any mix of real, emulated, simulated and stored ones, and
closes them in reverse.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from types import TracebackType
from typing import TYPE_CHECKING, Any, Self

from drivers.errors import DeviceError, DeviceNotFound
from drivers.mix import connected
from drivers.protocols import Actuator, Camera, ForceSource
from drivers.scene import Scene
from drivers.settings import ActuatorSettings, CameraSettings, ForceSettings

if TYPE_CHECKING:
    from drivers.sim.world import World, WorldSettings
    from drivers.stored import Recording

DRIVERS: dict[str, dict[str, str]] = {
    "forces": {
        "sim": "drivers.sim.devices:sim_forces",
        "nidaqmx": "drivers.ni_daq:NiForces",
        "nidaqmx-emulated": "drivers.emulators.ni:EmulatedNiForces",
        "replay": "drivers.stored:StoredForces",
    },
    "camera": {
        "sim": "drivers.sim.devices:sim_camera",
        "pylon": "drivers.camera_pylon:PylonCamera",
        "pylon-emulated": "drivers.emulators.camera:EmulatedPylonCamera",
        "gentl": "drivers.camera_gentl:GenTLCamera",
        "folder": "drivers.camera_folder:FolderCamera",
        "replay": "drivers.stored:StoredCamera",
    },
    "actuator": {
        "sim": "drivers.sim.devices:sim_actuator",
        "smc100": "drivers.actuator_newport:Smc100",
        "conex-cc": "drivers.actuator_newport:ConexCc",
        "smc100-emulated": "drivers.emulators.newport:EmulatedSmc100",
        "conex-cc-emulated": "drivers.emulators.newport:EmulatedConexCc",
        "replay": "drivers.stored:StoredActuator",
    },
}
"""Kind of device -> name in the settings -> what makes it, called with its settings and the scene.
A new driver is one line; its module is imported when it is used, and loads no vendor library before
`open`."""


class UnknownDevice(DeviceNotFound):
    """No driver of that name is known."""


@dataclass(frozen=True, slots=True)
class Bench:
    """Force source, camera and actuator, opened and closed together; a context manager.

    `scene` holds what they share; its world, if some of them are not real, knows the truth, and the
    analysis never sees it.
    """

    forces: ForceSource
    camera: Camera
    actuator: Actuator
    scene: Scene

    @property
    def world(self) -> World:
        """What the simulated and emulated devices look at."""
        return self.scene.world

    def open(self) -> None:
        """Open actuator, camera, forces; where one fails, those that were open are closed again.

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
        except BaseException as error:
            for note in _close(reversed(opened)):
                error.add_note(str(note))
            raise

    def close(self) -> None:
        """Close forces, camera, actuator, each of them even where another fails.

        Raises
        ------
        DeviceError
            Some did not close; the message holds the reason of each.
        """
        problems = _close((self.forces, self.camera, self.actuator))
        if problems:
            raise DeviceError(
                "bench: " + "; ".join(str(problem) for problem in problems)
            ) from problems[0]

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


def _close(devices: Any) -> list[Exception]:
    problems: list[Exception] = []
    for device in devices:
        try:
            device.close()
        except Exception as error:  # the next device must be closed all the same
            problems.append(error)
    return problems


def open_bench(
    forces: str = "sim",
    camera: str = "sim",
    actuator: str = "sim",
    *,
    force_settings: ForceSettings | None = None,
    camera_settings: CameraSettings | None = None,
    actuator_settings: ActuatorSettings | None = None,
    world: WorldSettings | None = None,
    recording: Recording | None = None,
    pace: float | None = 1.0,
) -> Bench:
    """A bench of three drivers given by name; its `open`, or a ``with`` block, claims the hardware.

    Parameters
    ----------
    forces, camera, actuator : str
        Names of drivers; ``DRIVERS`` lists them.
    force_settings, camera_settings, actuator_settings : optional
        What the drivers are told about their devices.
    world : WorldSettings, optional
        What the simulated and emulated devices look at.
    recording : Recording, optional
        What the stored devices play.
    pace : float or None
        Simulated seconds per second; None: as fast as possible.

    Raises
    ------
    UnknownDevice
        There is no driver of that name.
    """
    scene = Scene(world, pace, recording)
    names = forces, camera, actuator
    told = (
        force_settings or ForceSettings(),
        camera_settings or CameraSettings(),
        actuator_settings or ActuatorSettings(),
    )
    makers = [_driver(kind, name) for kind, name in zip(DRIVERS, names, strict=True)]
    made = tuple(make(settings, scene) for make, settings in zip(makers, told, strict=True))
    return Bench(*connected(made, names, scene), scene)


def _driver(kind: str, name: str) -> Callable[[Any, Scene], Any]:
    known = DRIVERS[kind]
    if name not in known:
        nearest = difflib.get_close_matches(name, known, n=1, cutoff=0.0)[0]
        raise UnknownDevice(
            f"{kind}: no driver is called '{name}'; known: {', '.join(sorted(known))} (the nearest"
            f" is '{nearest}')"
        )
    module, _, attribute = known[name].partition(":")
    maker: Callable[[Any, Scene], Any] = getattr(import_module(module), attribute)
    return maker
