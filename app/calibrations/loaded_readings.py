"""What the two force sensors read at each known load or displacement: from the sessions of a
protocol that asks for weights, and from tables.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import numpy as np

from app.calibrations.calibration import Data
from app.calibrations.given_files import is_session, table_of
from app.calibrations.session_readings import recorded_readings
from app.files.text_tables import FORCE, LENGTH, TEXT, TIME, VOLTAGE
from app.records.record_types import STEP
from app.settings.hung_weights import AXES, asked_weight
from app.settings.protocol_steps import Hold
from app.system.errors import UserError

COME_TO_REST = 0.2  # share of a hold that is not used
ALIKE = "range", "sign", "sensitivity"  # of sensors whose readings can be put together
TABLE = {
    "load": ("load", FORCE, ""), "displacement": ("displacement", LENGTH, ""),
    "normal_v": ("normal", VOLTAGE, "normal_V"), "shear_v": ("shear", VOLTAGE, "shear_V"),
    "time": ("time", TIME, ""), "axis": ("axis", TEXT, "axis"),
}  # fmt: skip


class LoadedReading(NamedTuple):
    """Mean readings while a weight hangs, or a displacement is given (NaN: the other is), on the
    normal axis (0) or the shear axis (1).
    """

    load: float
    displacement: float
    axis: int
    normal_v: float
    shear_v: float
    time: float


def loaded_readings(sources: Sequence[Path]) -> Data:
    """A column for each field of `LoadedReading`, in the order in which they were made; of sessions
    also what the settings of the last say of each sensor: `range`, `sign`, `sensitivity`,
    `stiffness` and its standard uncertainty `stiffness_sd`, and that of all sensitivities,
    `sensitivity_sd`, relative.

    Raises
    ------
    UserError
        A file cannot be used, or sessions are of different sensors.
    """
    rows: list[LoadedReading] = []
    constants: dict[str, float | tuple[float, ...]] = {}
    for path in sources:
        later = rows[-1].time + 1 if rows else 0.0
        if is_session(path):
            found, of_file = _of_session(path)
            if constants and any(constants[name] != of_file[name] for name in ALIKE):
                raise UserError(
                    f"{path}: its settings of the sensors are others than those of the session"
                    " before; calibrate from sessions of the same settings"
                )
            constants = of_file
        else:
            found = list(_of_table(path))
        rows += [one._replace(time=one.time + later) for one in found]
    columns = np.array(rows, dtype=np.float64).reshape(-1, len(LoadedReading._fields)).T
    return {**dict(zip(LoadedReading._fields, columns, strict=True)), **constants}


def _of_session(path: Path) -> tuple[list[LoadedReading], dict[str, float | tuple[float, ...]]]:
    config, volts, events = recorded_readings(path)
    begins = {event.number: event.sample for event in events if event.kind == STEP}
    steps, rate = config.run.protocol, config.forces.sample_rate
    rows = []
    for number, (asked, step) in enumerate(pairwise(steps), 2):
        weight = asked_weight(asked)
        if weight is None or not isinstance(step, Hold) or number not in begins:
            continue
        end = begins.get(number + 1, begins[number] + round(step.time * rate))
        start = begins[number] + round(COME_TO_REST * step.time * rate)
        normal, shear = np.nanmean(volts[start:end], axis=0).tolist()
        axis, newtons = weight
        middle = (start + end) / 2 / rate
        rows.append(LoadedReading(newtons, math.nan, AXES.index(axis), normal, shear, middle))
    if not rows:
        raise UserError(
            f"{path}: none of its steps asks for a weight; give a session of `slipscope calibrate"
            " forces`, or a table"
        )
    forces = config.forces
    return rows, {
        "range": forces.range,
        "sign": forces.sign,
        "sensitivity": (forces.sensitivity_normal, forces.sensitivity_shear),
        "stiffness": forces.stiffness,
        "stiffness_sd": forces.stiffness_uncertainty,
        "sensitivity_sd": config.uncertainty.sensitivity,
    }


def _of_table(path: Path) -> Iterator[LoadedReading]:
    found = table_of(path, TABLE, "readings, load_N or displacement_um, and time_s if you like")
    axes = found["axis"]
    usual = dict.fromkeys(("load", "displacement"), np.full(len(axes), math.nan))
    found = usual | {"time": np.arange(float(len(axes)))} | found
    numbers = [found[name] for name in ("load", "displacement", "normal_v", "shear_v", "time")]
    rows = zip(axes, np.transpose(numbers).tolist(), strict=True)
    for row, (name, (newtons, metres, *read)) in enumerate(rows, 1):
        axis = name.strip().lower()
        if axis not in AXES or math.isnan(newtons) == math.isnan(metres):
            raise UserError(
                f"{path}: row {row} needs the axis normal or shear, found '{name[:40]}', and"
                " either a load or a displacement"
            )
        yield LoadedReading(newtons, metres, AXES.index(axis), *read)
