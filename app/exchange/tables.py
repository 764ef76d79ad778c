"""Tables in text files, written, and read from other benches and programs: the names in their
headers say which quantity a column holds, and in which unit.
"""

from __future__ import annotations

import csv
import math
from array import array
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from app.errors import UserError
from app.outputs import cell_of, text_of

F64 = NDArray[np.float64]

# unit in small letters -> what a number in this unit is multiplied by
TIME = {"s": 1.0, "ms": 1e-3}
LENGTH = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "nm": 1e-9}
FORCE = {"n": 1.0, "mn": 1e-3}
VOLTAGE = {"v": 1.0}
NUMBER = {"": 1.0}
TEXT: dict[str, float] = {}

_ON_THE_CLOCK = {"sample": NUMBER, "time": TIME, "stage": LENGTH}
FORCES = _ON_THE_CLOCK | {"p": FORCE, "q": FORCE, "normal": VOLTAGE, "shear": VOLTAGE}
FRAMES = _ON_THE_CLOCK | {
    "frame": NUMBER,
    "phase_sample": NUMBER,
    "step": NUMBER,
    "step_sample": NUMBER,
    "phase": TEXT,
    "file": TEXT,
    "reason": TEXT,
}

ROUNDING = 0.01  # of a sample: a time that is this close to a sample is that sample's
HOLE = 1.9  # between rows further apart than this many usual distances nothing was measured
LONGEST_S = 3600.0  # without a row
# samples for each row, and samples beyond: a table of few rows must not take all memory
SPARSEST, SPARE = 1000, 1 << 22


BLOCK = 8192  # rows that are made at a time


def write_table(
    file: TextIO, columns: Mapping[str, NDArray[Any]], tell: Callable[[float], None]
) -> int:
    """Write columns of one length below their names; the number of rows.

    Numbers have all their digits, so that reading them gives the same bits; a cell is empty for
    NaN. `tell` is called with the share done.
    """
    cells = csv.writer(file, lineterminator="\n")
    cells.writerow(map(cell_of, columns))
    rows = len(next(iter(columns.values())))
    for start in range(0, rows, BLOCK):
        tell(start / rows)
        block = (_cells(values[start : start + BLOCK]) for values in columns.values())
        cells.writerows(zip(*block, strict=True))
    return rows


def _cells(values: NDArray[Any]) -> list[str]:
    if values.dtype.kind == "f":
        return [number_cell(value) for value in values.tolist()]
    if values.dtype.kind == "b":
        values = values.astype(int)
    return [cell_of(str(value)) if values.dtype.kind == "U" else str(value) for value in values]


def number_cell(value: float) -> str:
    """The number with all its digits; nothing for NaN."""
    return "" if math.isnan(value) else repr(value)


@dataclass(frozen=True, slots=True)
class Table:
    """The columns of a table that have a known name, by quantity.

    Attributes
    ----------
    numbers : dict of str to ndarray
        In SI units, or in pixels; NaN for empty cells.
    texts : dict of str to list of str
    units : dict of str to str
        Unit that the header names for each quantity.
    header : tuple of str
        All names in the header.
    rows : int
    """

    path: Path
    numbers: dict[str, F64]
    texts: dict[str, list[str]]
    units: dict[str, str]
    header: tuple[str, ...]
    rows: int

    def has(self, *names: str) -> bool:
        """Whether these columns of numbers are all there."""
        return all(name in self.numbers for name in names)


def read_table(path: Path, quantities: Mapping[str, Mapping[str, float]]) -> Table:
    """The columns of a text file whose names are a quantity and its unit, such as ``P_mN``.

    Commas, semicolons or tabs separate the cells; unless commas do, numbers may have a decimal
    comma. Lines that begin with # are comments. Columns with other names are left out.

    Parameters
    ----------
    quantities : mapping
        Quantity in small letters -> unit in small letters -> factor to SI; `NUMBER` for a quantity
        without unit, `TEXT` for words.

    Raises
    ------
    UserError
        The table can not be read, or a cell is no number where one must be.
    """
    known = {
        f"{quantity}_{unit}" if unit else quantity: (quantity, unit, factor)
        for quantity, units in quantities.items()
        for unit, factor in (units or {"": 1.0}).items()
    }
    texts: dict[str, list[str]] = {}
    numbers: dict[str, array[float]] = {}
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            lines = (line for line in file if line.strip() and not line.lstrip().startswith("#"))
            head = next(lines, "")
            separator = max(",;\t", key=head.count)
            header = tuple(name.strip() for name in head.split(separator))
            found = {
                i: known[name.lower()] for i, name in enumerate(header) if name.lower() in known
            }
            if len({quantity for quantity, *_ in found.values()}) < len(found):
                raise UserError(
                    f"{path}: the header names a quantity twice: {', '.join(header)}; leave one out"
                )
            for quantity, *_ in found.values():
                if quantities[quantity]:
                    numbers[quantity] = array("d")
                else:
                    texts[quantity] = []
            count = 0
            for count, row in enumerate(csv.reader(lines, delimiter=separator), start=1):
                if len(row) != len(header):
                    raise UserError(
                        f"{path}: row {count} has {len(row)} cells, the header {len(header)};"
                        " correct the table"
                    )
                for i, (quantity, _, factor) in found.items():
                    if quantity in texts:
                        texts[quantity].append(text_of(row[i].strip()))
                        continue
                    cell = row[i].strip()
                    try:
                        value = float(cell) if cell else np.nan
                    except ValueError:
                        value = _with_decimal_comma(cell, separator)
                    if value in (np.inf, -np.inf):
                        raise UserError(
                            f"{path}: '{cell[:40]}' in column {header[i]}, row {count}, is no"
                            " number; write numbers, nothing where there is none"
                        )
                    numbers[quantity].append(value * factor)
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise UserError(f"{path}: can not be read: {error}; give a table in UTF-8 text") from None
    if not count:
        raise UserError(f"{path}: it has no rows; give a table with a header")
    return Table(
        path,
        {quantity: np.array(column) for quantity, column in numbers.items()},
        texts,
        {quantity: unit for quantity, unit, _ in found.values()},
        header,
        count,
    )


def _with_decimal_comma(cell: str, separator: str) -> float:
    """The number in a cell; infinity where there is none."""
    try:
        return float(cell.replace(",", ".")) if separator != "," else np.inf
    except ValueError:
        return np.inf


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
    elif table.has("time"):
        name, at = f"time_{table.units['time']}", table.numbers["time"] * rate_hz
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
            " one before (or the start); count from the start of the recording, with pauses of"
            f" {LONGEST_S:g} s at most"
        )
    if at[-1] > SPARSEST * table.rows + SPARE:
        raise UserError(
            f"{table.path}: {table.rows} rows cover {at[-1]:.4g} samples at {rate_hz:g} Hz; give a"
            " lower --rate, or fewer hours"
        )
    near = np.rint(at)
    return np.where(np.abs(at - near) < ROUNDING, near, at)


def by_sample(table: Table, columns: tuple[str, ...], rate_hz: float) -> F64:
    """Columns of a table as one row per sample from 0 on, shape (n, columns).

    Values are linear between the rows of the table; NaN where it has a hole.

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
    if usual < 1 - ROUNDING:
        raise UserError(
            f"{table.path}: it has {rate_hz / usual:.6g} rows a second, the sample clock"
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
