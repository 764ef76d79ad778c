"""Opens the three devices of a bench, any mix of drivers, and closes them in reverse."""

from __future__ import annotations

import difflib
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from types import TracebackType
from typing import Any, Self

from drivers.errors import DeviceError, DeviceNotFound
from drivers.protocols import Actuator, Camera, ForceSource
from drivers.sim.world import World, WorldSettings

DRIVERS: dict[str, dict[str, str]] = {
    "forces": {"sim": "drivers.sim.devices:SimForces"},
    "camera": {"sim": "drivers.sim.devices:SimCamera"},
    "actuator": {"sim": "drivers.sim.devices:SimActuator"},
}
"""Kind of device -> name in the settings -> what makes it, called with the world. A new driver is one line, imported when it is used."""


class UnknownDevice(DeviceNotFound):
    """No driver of that name is known."""


@dataclass(frozen=True, slots=True)
class Bench:
    """Force source, camera and actuator, opened and closed together; a context manager.

    `world` is what the simulated ones among them look at; it knows the truth, and the analysis never sees it.
    """

    forces: ForceSource
    camera: Camera
    actuator: Actuator
    world: World

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
            raise DeviceError("bench: " + "; ".join(str(problem) for problem in problems)) from problems[0]

    def __enter__(self) -> Self:
        """The bench, open."""
        self.open()
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
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
    forces: str = "sim", camera: str = "sim", actuator: str = "sim", *, world: WorldSettings | None = None, pace: float | None = 1.0
) -> Bench:
    """A bench of three drivers given by name; its `open`, or a ``with`` block, claims the hardware.

    Parameters
    ----------
    forces, camera, actuator : str
        Names of drivers; ``DRIVERS`` lists them.
    world : WorldSettings, optional
        What the simulated devices look at.
    pace : float or None
        Simulated seconds per second; None: as fast as possible.

    Raises
    ------
    UnknownDevice
        There is no driver of that name.
    """
    makers = _maker("forces", forces), _maker("camera", camera), _maker("actuator", actuator)
    seen = World(world or WorldSettings(), pace)
    return Bench(makers[0](seen), makers[1](seen), makers[2](seen), seen)


def _maker(kind: str, name: str) -> Callable[[World], Any]:
    known = DRIVERS[kind]
    if name not in known:
        nearest = difflib.get_close_matches(name, known, n=1, cutoff=0.0)[0]
        raise UnknownDevice(f"{kind}: no driver is called '{name}'; known: {', '.join(sorted(known))} (the nearest is '{nearest}')")
    module, _, attribute = known[name].partition(":")
    maker: Callable[[World], Any] = getattr(import_module(module), attribute)
    return maker
