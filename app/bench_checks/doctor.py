"""What SlipScope needs of this computer: packages, devices, display, disk, processor."""

from __future__ import annotations

import os
import platform
import shutil
from dataclasses import dataclass
from importlib import import_module, metadata
from importlib.util import find_spec
from pathlib import Path
from pkgutil import walk_packages
from typing import Any

from packaging.requirements import Requirement

import analysis
import app
from app.system.display import WINDOW_PACKAGES, display_problem
from app.system.manual import manual_folder
from drivers import installation

DISTRIBUTION = "slipscope"
VENDORS = {  # distribution -> what it drives, and what to install for it
    "grpcio": ("boards behind NI's gRPC device server, and emulated ones", "nidaqmx[grpc]"),
    "pypylon": ("Basler cameras", "pypylon"),
    "harvesters": ("cameras of other vendors, through their GenTL producers", "harvesters"),
}
MODULES = {"grpcio": "grpc"}  # where the module has another name
FINDERS = {
    "boards": "drivers.daq.ni_daq",
    "cameras": "drivers.cameras.pylon_camera",
    "serial ports": "drivers.stages.newport_stage",
}
ROOM_FOR_A_RUN = 2 * 1000**3  # bytes; the default experiment takes 0.7 GB


@dataclass(frozen=True, slots=True)
class Checked:
    """One thing that was checked.

    Attributes
    ----------
    label, found : str
    is_fine : bool
    needed : bool
        Whether a run is impossible without it.
    advice : str
        What to do if it is not fine.
    symbol : str
    """

    label: str
    found: str
    is_fine: bool = True
    needed: bool = False
    advice: str = ""
    symbol: str = ""

    @property
    def value(self) -> str:
        """The finding as one line."""
        return f"{self.found}; {self.advice}" if self.advice else self.found

    @property
    def mark(self) -> str:
        """Whether it is fine, at the head of a line."""
        return "ok    " if self.is_fine else "FAILS " if self.needed else "look  "


def problem(label: str, found: str, advice: str = "", *, needed: bool = False) -> Checked:
    """A finding that is not fine."""
    return Checked(label, found, False, needed, advice)


def packages() -> list[Checked]:
    """Every package that SlipScope is installed with, and its version."""
    try:
        requirements = metadata.requires(DISTRIBUTION) or []
    except metadata.PackageNotFoundError:
        advice = "in its folder, run: pip install -e ."
        return [problem(DISTRIBUTION, "not installed", advice, needed=True)]
    found = [Checked(DISTRIBUTION, metadata.version(DISTRIBUTION))]
    for needed in map(Requirement, requirements):
        if needed.marker and not needed.marker.evaluate({"extra": ""}):
            continue  # of an extra, or of another Python
        is_of_window = needed.name in WINDOW_PACKAGES
        try:
            version = metadata.version(needed.name)
        except metadata.PackageNotFoundError:
            version = "missing" + (", needed only for the window" if is_of_window else "")
        else:
            if needed.specifier.contains(version, prereleases=True):
                found.append(Checked(needed.name, version))
                continue
            version += f", which is not {needed.specifier}"
        advice = installation.add(needed.name, needed=True)
        found.append(problem(needed.name, version, advice, needed=not is_of_window))
    return found


def modules() -> Checked:
    """Whether what a run, a replay and an analysis consist of can be imported with these packages;
    the window is another matter, see `display`.
    """
    parts = [
        module.name
        for package in (app, analysis)
        for module in walk_packages(package.__path__, f"{package.__name__}.")
        if not module.name.startswith("app.gui") and not module.name.endswith("__main__")
    ]
    for name in parts:
        try:
            import_module(name)
        except Exception as error:  # whatever another package's release brings
            kind = type(error).__name__
            return problem(
                "modules",
                f"{name} cannot be imported: {kind}: {error}",
                "reinstall SlipScope with the packages that it names",
                needed=True,
            )
    return Checked("modules", f"{len(parts)} can be imported")


def manual() -> Checked:
    """Where the pages of the manual are."""
    folder = manual_folder()
    if folder.is_dir():
        return Checked("manual", f"{folder}")
    return problem("manual", "its pages are not installed", "reinstall SlipScope")


def vendor_packages() -> list[Checked]:
    """The vendors' own packages; none is needed for the simulated bench."""
    findings = []
    for name, (what, package) in VENDORS.items():
        if find_spec(MODULES.get(name, name)) is not None:
            findings.append(Checked(name, f"{metadata.version(name)}, for {what}"))
        else:
            advice = f"to install it: {installation.add(package)}; and the vendor's driver"
            findings.append(problem(name, f"not installed, needed only for {what}", advice))
    return findings


def display() -> Checked:
    """Whether a window can be opened, checked without Qt."""
    reason = display_problem()
    if reason is None:
        return Checked("display", "a window can be opened")
    return problem("display", reason)


def devices() -> list[Checked]:
    """The possible values of `source` in the settings, by kind of device."""
    from drivers.sources import DRIVERS, offered

    return [Checked(kind, ", ".join([*own, *offered(kind)])) for kind, own in DRIVERS.items()]


def found_by(module: str, *arguments: Any) -> list[Checked]:
    """The devices that a driver finds on this computer, each with the name to write in the
    settings; or why it cannot search.
    """
    from drivers.errors import DeviceError

    try:
        found = import_module(module).find(*arguments)
    except DeviceError as error:
        return [problem("none", str(error))]
    return [Checked(device.device, device.description) for device in found] or [
        Checked("none", "no device was found")
    ]


def connected() -> list[Checked]:
    """The devices that are connected to this computer; nothing is opened for longer than it takes
    to read a name, and nothing moves.
    """
    return [
        Checked(kind, f"{f.label}: {f.value}", f.is_fine)
        for kind, module in FINDERS.items()
        for f in found_by(module)
    ]


def computer() -> list[Checked]:
    """Processor, memory, and disk."""
    import psutil

    cores = (
        len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    )
    memory = Checked("memory", f"{psutil.virtual_memory().total / 2**30:.1f} GiB")
    return [
        Checked("cores", f"{cores}")
        if cores >= 2
        else problem("cores", "1", "a run at pace 1 needs two"),
        memory,
        disk(),
    ]


def disk() -> Checked:
    """Room on the disk of the current folder."""
    try:
        free = shutil.disk_usage(Path.cwd()).free
    except OSError as error:
        found, advice = f"not readable: {error.strerror}", "change to a folder that exists"
        return problem("disk", found, advice, needed=True)
    found = f"{free / 1e9:.1f} GB free in {Path.cwd()}"
    if free >= ROOM_FOR_A_RUN:
        return Checked("disk", found)
    return problem("disk", found, "the default experiment takes about 0.7 GB")


def kernel_cache() -> Checked:
    """Where compiled code is kept between starts, and whether it can be kept there."""
    from analysis import kernels

    folder = kernels.place()
    if not folder or kernels.cache_warnings:
        found = f"kept in {folder} for now" if folder else "can be kept nowhere"
        return problem(
            "compiled code", found, "set NUMBA_CACHE_DIR to a folder that can be written"
        )
    functions = sum(1 for _ in Path(folder).rglob("*.nbi"))
    if not functions:
        return Checked("compiled code", f"none yet in {folder}; the first start compiles")
    return Checked("compiled code", f"{functions} functions kept in {folder}")


def examine() -> dict[str, list[Checked]]:
    """All findings, by heading."""
    build = f"({platform.python_implementation()}, {platform.machine()})"
    python = Checked("python", f"{platform.python_version()} {build}")
    system = Checked("platform", platform.platform())
    return {
        "program": [python, system, *packages(), modules(), manual()],
        "sources of devices": devices(),
        "vendors' packages": vendor_packages(),
        "connected devices": connected(),
        "computer": [*computer(), display(), kernel_cache()],
    }


def as_data(finding: Checked) -> dict[str, Any]:
    """A finding as plain data, for JSON."""
    return {
        "name": finding.label,
        "found": finding.found,
        "is_fine": finding.is_fine,
        "needed": finding.needed,
        "advice": finding.advice,
    }
