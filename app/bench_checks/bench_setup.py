"""`slipscope setup`: the settings of a new bench, from the devices that are connected and from what
only its owner knows.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from analysis.options import Option, options
from app.bench_checks.doctor import FINDERS, Checked, found_by
from app.settings.config import keyed, load, tables, to_toml
from app.settings.plain_values import toml_text
from app.settings.sections import Config
from app.system.errors import ConfigError


class DeviceChoice(NamedTuple):
    """A device that a bench may have: the settings that name it, and what it is."""

    settings: tuple[str, ...]
    about: str


# kind of device -> where it is searched, the drivers that may fit, the key that names what is found
SEARCHED = {
    "forces": ("boards", ("nidaqmx",), "device"),
    "camera": ("cameras", ("pylon",), "device"),
    "actuator": ("serial ports", ("smc100", "conex-cc"), "port"),
}
SIMULATED = "simulated"
ABOUT_DEVICES = {  # asked of a device that is not simulated
    "forces": (
        "channels",
        "wiring",
        "range",
        "exposure_counter",
        "sensitivity_normal",
        "sensitivity_shear",
        "stiffness_normal",
        "stiffness_shear",
        "stiffness_uncertainty",
        "sign",
    ),
    "camera": ("trigger_line", "exposure_line", "max_rate", "width", "height", "pixel"),
    "actuator": ("travel", "max_velocity"),
}
ABOUT_SAMPLE = (
    "sample.young_modulus",
    "sample.poisson",
    "sample.lens_radius",
    "sample.roughness",
    "sample.thickness",
    "about.sample",
    "about.operator",
    "limits.normal_force",
    "limits.shear_force",
)

Ask = Callable[[str, str], str]


def choices(
    finders: Callable[[str], list[Checked]] = found_by,
) -> dict[str, list[DeviceChoice]]:
    """Kind of device -> what the bench may have: each device found, then the simulated one."""
    found: dict[str, list[DeviceChoice]] = {}
    for kind, (where, drivers, key) in SEARCHED.items():
        held = [one for one in finders(FINDERS[where]) if one.is_fine and one.label != "none"]
        found[kind] = [
            DeviceChoice(
                (f'{kind}.source="{driver}"', f"{kind}.{key}={toml_text(one.label)}"),
                f"{one.label}: {one.found} ({driver})",
            )
            for one in held
            for driver in drivers
        ]
        found[kind].append(DeviceChoice((f'{kind}.source="sim"',), SIMULATED))
    return found


def questions(devices: Mapping[str, DeviceChoice]) -> list[str]:
    """``table.key`` of each setting that is asked for, given the devices."""
    asked = [
        f"{kind}.{key}"
        for kind, keys in ABOUT_DEVICES.items()
        if devices[kind].about != SIMULATED
        for key in keys
    ]
    return [*asked, *ABOUT_SAMPLE]


def declared(key: str) -> Option:
    """The declaration of a setting ``table.key``."""
    table, _, name = key.partition(".")
    return options(tables()[table])[name]


def answered(
    devices: Mapping[str, DeviceChoice], ask: Ask, refuse: Callable[[str], None]
) -> list[str]:
    """The settings of a bench as texts ``table.key=value``, those of its devices and each that was
    asked for.

    Parameters
    ----------
    ask : callable
        Given a question and what holds without an answer, gives the answer.
    refuse : callable
        Given why an answer cannot be used; it is asked again.
    """
    settings = [text for choice in devices.values() for text in choice.settings]
    for key in questions(devices):
        about, now = declared(key), keyed(load(None, settings))[key]
        unit = f" ({about.unit})" if about.unit else ""
        while True:
            answer = ask(f"{key}: {about.meaning}{unit}", toml_text(now))
            try:
                load(None, [*settings, f"{key}={answer}"])
            except ConfigError as error:
                refuse(str(error))
                continue
            settings.append(f"{key}={answer}")
            break
    return settings


def bench_file_of(settings: Sequence[str]) -> tuple[Config, str]:
    """The settings of a bench, and the commented file that says them."""
    config = load(None, settings)
    named = dict.fromkeys(text.partition("=")[0] for text in settings)
    head = (
        "# A bench, by `slipscope setup`; `slipscope config` prints every setting that is not"
        " here.\n\n"
    )
    return config, head + to_toml(config, only=list(named))
