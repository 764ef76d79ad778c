"""Tables of forces and of images from other benches and programs: text with a header that names
quantity and unit.
"""

from __future__ import annotations

import csv
import math
from array import array
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.errors import UserError

F64 = NDArray[np.float64]

TEXT = 0.0
_TIMES = {"sample": ("sample", 1.0), "time_s": ("time_s", 1.0), "time_ms": ("time_s", 1e-3)}
_STAGE = {"stage_m": ("stage_m", 1.0), "stage_mm": ("stage_m", 1e-3), "stage_um": ("stage_m", 1e-6)}
FORCES = {  # name in the header, small letters -> quantity and factor to its unit
    **_TIMES,
    **_STAGE,
    "p_n": ("P_N", 1.0),
    "q_n": ("Q_N", 1.0),
    "p_mn": ("P_N", 1e-3),
    "q_mn": ("Q_N", 1e-3),
    "normal_v": ("normal_V", 1.0),
    "shear_v": ("shear_V", 1.0),
}
FRAMES = {
    **_TIMES,
    **_STAGE,
    "frame": ("frame", 1.0),
    "phase_sample": ("phase_sample", 1.0),
    **{name: (name, TEXT) for name in ("phase", "file", "reason")},
}
ON_THE_CLOCK = 0.01  # of a sample: a time this near to one is its
HOLE = 1.9  # between rows further apart than this many usual distances nothing was measured
LONGEST_S = 3600.0  # without a row
# samples for each row, and beyond: a table of few rows must not take all memory
SPARSEST, SPARE = 1000, 1 << 22


@dataclass(frozen=True, slots=True)
class Table:
    """The columns of a table that are known, by quantity: numbers with NaN for empty cells, or
    texts.
    """

    path: Path
    numbers: dict[str, F64]
    texts: dict[str, list[str]]
    rows: int

    def has(self, *names: str) -> bool:
        """Whether these columns of numbers are all there."""
        return all(name in self.numbers for name in names)


def read_table(path: Path, known: Mapping[str, tuple[str, float]]) -> Table:
    """The columns of a text file whose header names are in `known`; lines that begin with # are
    left out.

    Commas, semicolons or tabulators part the cells; except with commas, a number may have a decimal
    comma.

    Raises
    ------
    UserError
        It can not be read, or a cell is no number where one must be.
    """
    numbers: dict[str, array[float]] = {}
    texts: dict[str, list[str]] = {}
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            lines = (line for line in file if line.strip() and not line.lstrip().startswith("#"))
            head = next(lines, "")
            parting = max(",;\t", key=head.count)
            header = [name.strip() for name in head.split(parting)]
            columns = [
                (i, *known[name.lower()]) for i, name in enumerate(header) if name.lower() in known
            ]
            if len({name for _, name, _ in columns}) < len(columns):
                raise UserError(
                    f"{path}: the header names a quantity twice: {', '.join(header)}; leave one out"
                )
            for _, name, factor in columns:
                if factor == TEXT:
                    texts[name] = []
                else:
                    numbers[name] = array("d")
            count = 0
            for count, row in enumerate(csv.reader(lines, delimiter=parting), start=1):
                if len(row) != len(header):
                    raise UserError(
                        f"{path}: row {count} has {len(row)} cells, the header {len(header)}; mend"
                        " the table"
                    )
                for i, name, factor in columns:
                    if factor == TEXT:
                        texts[name].append(row[i].strip())
                    else:
                        numbers[name].append(
                            _number(path, count, header[i], row[i].strip(), parting) * factor
                        )
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise UserError(f"{path}: can not be read: {error}; give a table in UTF-8 text") from None
    if not count:
        raise UserError(f"{path}: no rows found; give a table with a header")
    return Table(path, {name: np.array(column) for name, column in numbers.items()}, texts, count)


def _number(path: Path, row: int, name: str, cell: str, parting: str) -> float:
    try:
        value = float(cell.replace(",", ".") if parting != "," else cell) if cell else math.nan
    except ValueError:
        value = math.inf
    if math.isinf(value):
        raise UserError(
            f"{path}: '{cell[:40]}' in column {name}, row {row}, is no number; write numbers,"
            " nothing where there is none"
        )
    return value


def clock_samples(table: Table, rate_hz: float) -> F64 | None:
    """Place of each row on the sample clock, from its sample or its time; None where the table has
    neither.

    Raises
    ------
    UserError
        The rows are not in order, or far from sample 0 or from each other.
    """
    if table.has("sample"):
        name, at = "sample", table.numbers["sample"]
    elif table.has("time_s"):
        name, at = "time_s", table.numbers["time_s"] * rate_hz
    else:
        return None
    steps = np.diff(at, prepend=-1e-9)
    bad = np.flatnonzero(~(steps > 0))
    if len(bad):
        raise UserError(
            f"{table.path}: {name} of row {bad[0] + 1} is missing, negative or not after the one"
            " before; put the rows in order"
        )
    if steps.max() > LONGEST_S * rate_hz:
        row = int(np.argmax(steps))
        raise UserError(
            f"{table.path}: {name} of row {row + 1} comes {steps[row] / rate_hz:.4g} s after the"
            " one before (or the start);"
            f" count from the start of the recording, with pauses of {LONGEST_S:g} s at most"
        )
    if at[-1] > SPARSEST * table.rows + SPARE:
        raise UserError(
            f"{table.path}: {table.rows} rows over {at[-1]:.4g} samples at {rate_hz:g} Hz found;"
            " give a lower --rate, or fewer hours"
        )
    near = np.rint(at)
    return np.where(np.abs(at - near) < ON_THE_CLOCK, near, at)


def by_sample(table: Table, columns: tuple[str, ...], rate_hz: float) -> F64:
    """Columns of a table as one row per sample from 0 on, shape (n, columns), linear between its
    rows; NaN where there are none.

    Raises
    ------
    UserError
        The table has no time, or more rows than there are samples.
    """
    at = clock_samples(table, rate_hz)
    if at is None:
        raise UserError(
            f"{table.path}: the header has neither sample nor time_s; say when each row was"
            " measured"
        )
    usual = float(np.median(np.diff(at))) if len(at) > 1 else 1.0
    if usual < 1 - ON_THE_CLOCK:
        raise UserError(
            f"{table.path}: {rate_hz / usual:.6g} rows a second found, the sample clock has"
            f" {rate_hz:g}; give --rate {rate_hz / usual:.6g}"
        )
    samples = np.arange(int(at[-1]) + 1, dtype=np.float64)
    before = np.clip(np.searchsorted(at, samples, "right") - 1, 0, len(at) - 1)
    after = np.minimum(before + 1, len(at) - 1)
    measured = (samples >= at[0]) & (
        (samples == at[before]) | (at[after] - at[before] <= HOLE * usual)
    )
    values = [
        np.where(measured, np.interp(samples, at, table.numbers[name]), np.nan) for name in columns
    ]
    return np.column_stack(values)
