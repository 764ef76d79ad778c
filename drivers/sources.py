"""Which driver a `source` in the settings names: one that comes with the program, one that an
installed package offers under a name of its own, or any class as ``package.module:Class``.
"""

from __future__ import annotations

import difflib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property, partial
from importlib import import_module, metadata
from pathlib import Path
from typing import Any

from analysis.options import Section
from drivers.errors import DeviceNotFound, DeviceTimeout
from drivers.turns import done_beside

NEEDS = {
    "real": ("settings", "clock"),
    "emulated": ("settings", "clock", "world"),
    "simulated": ("world",),
    "stored": ("settings", "clock", "recording"),
}
"""Nature of a driver -> what it is made from: the settings of its device, the sample clock that all
devices of the bench share, and the simulated world or the recording that it shows.
"""


MAKE_S = 30.0  # a class of somebody else that makes no device within it is given up


class UnknownDevice(DeviceNotFound):
    """There is no driver of that name, or it cannot be imported."""


class NeverMade(DeviceTimeout):
    """The class of a driver, called for a device, does not return."""


@dataclass(frozen=True)
class Driver:
    """A driver of a kind of device by where it is, as ``module:Class``.

    Parameters
    ----------
    own_nature : str
        One of `NEEDS`; empty: what its class says as `nature`, "real" if it says nothing.
    """

    kind: str
    where: str
    own_nature: str = ""

    @cached_property
    def driver_class(self) -> Callable[..., Any]:
        """The class, imported now.

        Raises
        ------
        UnknownDevice
            It cannot be imported, whatever goes wrong in it, or it is no class.
        """
        module, _, name = self.where.partition(":")
        try:
            found = getattr(import_module(module), name)
        except Exception as error:  # a module of somebody else may fail in any way
            remedy = "correct the module, or the name of the class"
            if isinstance(error, ModuleNotFoundError):
                remedy = "install its package, or put its folder on PYTHONPATH"
                if error.name == module.partition(".")[0] and _lies_here(error.name):
                    remedy = "it lies in the current folder, which is looked in only if PYTHONPATH"
                    remedy += " says so: set PYTHONPATH=."
            raise UnknownDevice(
                f"{self.kind}: the driver '{self.where}' cannot be imported"
                f" ({type(error).__name__}: {error}); {remedy}"
            ) from error
        if not isinstance(found, type):
            raise UnknownDevice(
                f"{self.kind}: '{self.where}' is no class but a {type(found).__name__}; name the"
                " class of the driver"
            )
        return found

    def make(self, *needs: Any) -> Any:
        """The device, from what its nature needs.

        Raises
        ------
        UnknownDevice
            The class is no driver: nothing else that a settings file names is called.
        NeverMade
            The class, which did not come with the program, does not return.
        """
        if not (hasattr(self.driver_class, "open") and hasattr(self.driver_class, "close")):
            raise UnknownDevice(
                f"{self.kind}: the class '{self.where}' cannot be opened and closed as a driver;"
                " name the class of the driver"
            )
        if self.own_nature:
            return self.driver_class(*needs)
        call = done_beside(partial(self.driver_class, *needs), MAKE_S)
        if not call.done():
            raise NeverMade(
                f"{self.kind}: the driver '{self.where}' did not return within {MAKE_S:g} s as it"
                " was made; let its `open` wait for the device, not its `__init__`"
            )
        return call.result()

    @property
    def nature(self) -> str:
        """One of `NEEDS`; `UnknownDevice` if its class says another."""
        nature = self.own_nature or str(getattr(self.driver_class, "nature", "real"))
        if nature not in NEEDS:
            raise UnknownDevice(
                f"{self.kind}: the driver '{self.where}' says of itself that it is '{nature}';"
                f" its `nature` must be one of {', '.join(NEEDS)}"
            )
        return nature

    @property
    def options(self) -> type[Section]:
        """The section of its own settings, which its class names as `Options`.

        Raises
        ------
        UnknownDevice
            It cannot be imported, or its `Options` is no `Section`.
        """
        options = Section if self.own_nature else getattr(self.driver_class, "Options", Section)
        if not (isinstance(options, type) and issubclass(options, Section)):
            raise UnknownDevice(
                f"{self.kind}: `Options` of the driver '{self.where}' must be a frozen dataclass"
                " of `analysis.options.Section`"
            )
        return options


def _lies_here(module: str) -> bool:
    return Path(f"{module}.py").is_file() or Path(module).is_dir()


_OWN = {
    "forces": {
        "sim": ("drivers.sim.devices:SimForces", "simulated"),
        "nidaqmx": ("drivers.daq.ni_daq:NiForces", "real"),
        "nidaqmx-emulated": ("drivers.emulators.ni:EmulatedNiForces", "emulated"),
        "replay": ("drivers.recorded:StoredForces", "stored"),
    },
    "camera": {
        "sim": ("drivers.sim.devices:SimCamera", "simulated"),
        "pylon": ("drivers.cameras.pylon_camera:PylonCamera", "real"),
        "pylon-emulated": ("drivers.emulators.camera:EmulatedPylonCamera", "emulated"),
        "gentl": ("drivers.cameras.gentl_camera:GenTLCamera", "real"),
        "folder": ("drivers.cameras.image_folder:FolderCamera", "real"),
        "replay": ("drivers.recorded:StoredCamera", "stored"),
    },
    "actuator": {
        "sim": ("drivers.sim.devices:SimActuator", "simulated"),
        "smc100": ("drivers.stages.newport_stage:Smc100", "real"),
        "conex-cc": ("drivers.stages.newport_stage:ConexCc", "real"),
        "smc100-emulated": ("drivers.emulators.newport:EmulatedSmc100", "emulated"),
        "conex-cc-emulated": ("drivers.emulators.newport:EmulatedConexCc", "emulated"),
        "replay": ("drivers.recorded:StoredActuator", "stored"),
    },
}
DRIVERS = {
    kind: {name: Driver(kind, *found) for name, found in own.items()} for kind, own in _OWN.items()
}
"""Kind of device -> `source` in its settings -> driver that comes with the program. Its module is
imported when the driver is used, and loads no vendor library before `open`."""


def offered(kind: str) -> dict[str, Driver]:
    """Name -> driver of every one of a kind that installed packages offer, as entry points of the
    group ``slipscope.KIND``; the names of the program's own are not given away.
    """
    points = metadata.entry_points(group=f"slipscope.{kind}")
    return {
        point.name: Driver(kind, point.value) for point in points if point.name not in DRIVERS[kind]
    }


def driver(kind: str, source: str) -> Driver:
    """The driver of a kind of device that the settings name.

    Raises
    ------
    UnknownDevice
        There is no such driver.
    """
    if source in DRIVERS[kind]:
        return DRIVERS[kind][source]
    module, colon, name = source.partition(":")
    if colon and all(part.isidentifier() for part in (*module.split("."), name)):
        return Driver(kind, source)
    known = DRIVERS[kind] | offered(kind)
    if source not in known:
        nearest = difflib.get_close_matches(source, known, n=1, cutoff=0.0)[0]
        raise UnknownDevice(
            f"{kind}: no driver is called '{source}'; known: {', '.join(sorted(known))} (the"
            f" nearest is '{nearest}'), and any class as 'package.module:Class'"
        )
    return known[source]


def natures_of(sources: Iterable[str]) -> set[str]:
    """The natures of the devices of a bench, from the names of its drivers in the order of
    `DRIVERS`.
    """
    return {driver(*named).nature for named in zip(DRIVERS, sources, strict=True)}
