"""What this computer has and lacks for SlipScope: packages, devices, display, disk, processor."""

from __future__ import annotations

import os
import platform
import re
import shutil
from dataclasses import dataclass
from importlib import import_module, metadata
from importlib.util import find_spec
from pathlib import Path
from typing import Any

DISTRIBUTION = "slipscope"
VENDORS = {  # distribution -> what it drives, and our extra that installs it
    "nidaqmx": ("National Instruments boards", "ni"),
    "pypylon": ("Basler cameras", "basler"),
    "harvesters": ("cameras of other vendors, through their GenTL producers", "gentl"),
    "pyserial": ("Newport actuators", "serial"),
}
MODULES = {"pyserial": "serial"}  # where the module has another name
FINDERS = {
    "boards": "drivers.ni_daq",
    "cameras": "drivers.camera_pylon",
    "serial ports": "drivers.actuator_newport",
}
ROOM_FOR_A_RUN = 2 * 1000**3  # bytes; the default experiment takes 0.7 GB


@dataclass(frozen=True, slots=True)
class Finding:
    """One thing that was looked at.

    `needed` tells whether a run is impossible without it; `advice` how to get it, empty where all
    is well.
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


def packages() -> list[Finding]:
    """Every package that SlipScope is installed with, and its version."""
    try:
        requirements = metadata.requires(DISTRIBUTION) or []
    except metadata.PackageNotFoundError:
        return [
            Finding(
                DISTRIBUTION, "not installed", False, True, "in its folder, run: pip install -e ."
            )
        ]
    found = [Finding(DISTRIBUTION, metadata.version(DISTRIBUTION))]
    needed = {
        re.split(r"[^\w.-]", text, maxsplit=1)[0]: text
        for text in requirements
        if "extra ==" not in text
    }
    for name, requirement in needed.items():
        try:
            found.append(Finding(name, metadata.version(name)))
        except metadata.PackageNotFoundError:
            found.append(Finding(name, "missing", False, True, f'pip install "{requirement}"'))
    return found


def vendor_packages() -> list[Finding]:
    """The vendors' own packages; none is needed for the simulated bench."""
    findings = []
    for name, (what, extra) in VENDORS.items():
        if find_spec(MODULES.get(name, name)) is not None:
            findings.append(Finding(name, f"{metadata.version(name)}, for {what}"))
        else:
            advice = (
                f"in the folder of SlipScope: pip install '.[{extra}]', and the vendor's driver"
            )
            findings.append(
                Finding(name, f"not installed, needed only for {what}", False, False, advice)
            )
    return findings


def display() -> Finding:
    """Whether a window can be opened, found out without Qt."""
    from app.gui.display import display_problem

    problem = display_problem()
    return (
        Finding("display", "a window can be opened")
        if problem is None
        else Finding("display", problem, False)
    )


def devices() -> list[Finding]:
    """The names that a settings file may give as `source`, by kind of device."""
    from drivers.bench import DRIVERS

    return [Finding(kind, ", ".join(names)) for kind, names in DRIVERS.items()]


def found_by(module: str, *arguments: Any) -> list[Finding]:
    """The devices that a driver finds on this computer, each with the name to write in the
    settings; or why it can not look.
    """
    from drivers.errors import DeviceError

    try:
        found = import_module(module).find(*arguments)
    except DeviceError as error:
        return [Finding("none", str(error), False)]
    return [Finding(device.device, device.description) for device in found] or [
        Finding("none", "no device was found")
    ]


def connected() -> list[Finding]:
    """What is connected to this computer; nothing is opened for longer than it takes to read a
    name, nothing moves.
    """
    return [
        Finding(kind, f"{f.label}: {f.value}", f.is_fine)
        for kind, module in FINDERS.items()
        for f in found_by(module)
    ]


def computer() -> list[Finding]:
    """Processor, memory, and room on the disk of the current folder."""
    import psutil

    cores = (
        len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    )
    findings = [
        Finding("cores", f"{cores}")
        if cores >= 2
        else Finding("cores", "1", False, False, "a run at pace 1 wants two")
    ]
    findings.append(Finding("memory", f"{psutil.virtual_memory().total / 2**30:.1f} GiB"))
    try:
        free = shutil.disk_usage(Path.cwd()).free
    except OSError as error:
        return [
            *findings,
            Finding(
                "disk",
                f"not readable: {error.strerror}",
                False,
                True,
                "change to a folder that exists",
            ),
        ]
    room = free >= ROOM_FOR_A_RUN
    found = f"{free / 1e9:.1f} GB free in {Path.cwd()}"
    return [
        *findings,
        Finding(
            "disk", found, room, False, "" if room else "the default experiment takes about 0.7 GB"
        ),
    ]


def kernel_cache() -> Finding:
    """Where compiled code is kept between starts, and whether it can be."""
    import analysis

    override = os.environ.get("NUMBA_CACHE_DIR")
    folder = Path(override) if override else Path(analysis.__file__).parent
    compiled = sum(1 for _ in folder.rglob("*.nbi"))
    if not os.access(folder, os.W_OK):
        return Finding(
            "compiled code",
            f"{folder} can not be written",
            False,
            False,
            "set NUMBA_CACHE_DIR to a folder that can",
        )
    return Finding(
        "compiled code",
        f"{compiled} functions kept in {folder}"
        if compiled
        else f"none yet in {folder}; the first start compiles",
    )


def examine() -> dict[str, list[Finding]]:
    """All findings, by heading."""
    python = Finding(
        "python",
        f"{platform.python_version()} ({platform.python_implementation()}, {platform.machine()})",
    )
    return {
        "program": [python, Finding("platform", platform.platform()), *packages()],
        "sources of devices": devices(),
        "vendors' packages": vendor_packages(),
        "connected devices": connected(),
        "computer": [*computer(), display(), kernel_cache()],
    }


def as_data(finding: Finding) -> dict[str, Any]:
    """A finding for machines."""
    return {
        "name": finding.label,
        "found": finding.found,
        "is_fine": finding.is_fine,
        "needed": finding.needed,
        "advice": finding.advice,
    }
