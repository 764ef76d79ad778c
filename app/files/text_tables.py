"""Tables in text files, written, and read from other benches and programs: the names in their
headers say which quantity a column holds, and in which unit.
"""

from __future__ import annotations

import csv
import math
from array import array
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TextIO

import numpy as np

from analysis.arrays import F64, Array
from app.files.forms import (
    EITHER_ORDER,
    TableForm,
    TableLayout,
    clock_s,
    has_day_first,
    layout_of,
    name_and_unit,
    quoted,
)
from app.system.errors import UserError
from app.system.inputs import check_ends
from app.system.outputs import text_of, write_csv
from app.system.progress import ShareDone

GRAVITY = 9.80665  # m/s2, the standard value: what a balance that shows grams is adjusted to
# unit in small letters -> what a number in this unit is multiplied by
TIME = {"s": 1.0, "sec": 1.0, "ms": 1e-3, "us": 1e-6, "min": 60.0, "h": 3600.0}
LENGTH = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "nm": 1e-9}
FORCE = {"n": 1.0, "mn": 1e-3, "un": 1e-6, "kn": 1e3} | {
    unit + sign: factor * GRAVITY
    for unit, factor in (("mg", 1e-6), ("g", 1e-3), ("kg", 1.0))
    for sign in ("", "f")
}
VOLTAGE = {"v": 1.0, "mv": 1e-3}
NUMBER = {"": 1.0}
TEXT: dict[str, float] = {}
Quantities = Mapping[str, Mapping[str, float]]
"""Quantity in small letters -> unit in small letters -> factor to SI."""
ANY_FORM = TableForm()

_ON_THE_CLOCK = {"sample": NUMBER, "time": TIME, "stage": LENGTH}
FORCES = _ON_THE_CLOCK | {"p": FORCE, "q": FORCE, "normal": VOLTAGE, "shear": VOLTAGE}
FRAMES = _ON_THE_CLOCK | {
    "frame": NUMBER,
    "phase_sample": NUMBER,
    "step": NUMBER,
    "step_sample": NUMBER,
    "first": NUMBER,
    "last": NUMBER,
    "camera": TIME,
    "phase": TEXT,
    "file": TEXT,
    "reason": TEXT,
}

_NORMAL = ("normal", "normal force", "fn", "f n", "fz", "load", "normalkraft", "force normale")
_SHEAR = (
    *("shear", "shear force", "ft", "f t", "fx", "tangential force", "friction force"),
    *("tangentialkraft", "querkraft", "scherkraft", "reibkraft", "force tangentielle"),
)
# quantity -> what other programs call it, in small letters; its unit must stand beside
WORDS = {
    "time": (
        *("t", "time", "elapsed time", "timestamp", "time stamp", "date", "date time", "datetime"),
        *("zeit", "uhrzeit", "datum", "zeitstempel", "datum uhrzeit", "temps", "tiempo"),
    ),
    "stage": ("position", "stage position"),
    "a": ("radius",),
    "p": _NORMAL,
    "q": _SHEAR,
    "normal": _NORMAL,
    "shear": _SHEAR,
    "frame": ("image", "image number", "frame number", "bild", "bildnummer"),
    "file": ("filename", "file name", "image file", "datei", "dateiname"),
}

# what other programs write into a cell where nothing was measured, in small letters
NOTHING = {"na", "n/a", "#na", "#n/a", "#nv", "null", "none"}
NOTHING |= {"-", "--", "---", "\u2013", "\u2014", "."}
ROUNDING = 0.01  # a time within this share of a sample of one is that sample's
HOLE = 1.9  # rows further apart than this many usual distances have a gap between them
LONGEST_S = 3600.0  # without a row
DAY_S = 86400.0
# samples for each row, and samples beyond: a table of few rows must not take all memory
SPARSEST, SPARE = 1000, 1 << 22


BLOCK = 8192  # rows that are made at a time


def write_table(file: TextIO, columns: Mapping[str, Array], tell: ShareDone) -> int:
    """Write columns of one length below their names; the number of rows.

    Numbers have all their digits, so that reading them gives the same bits; a cell is empty for
    NaN. `tell` is called with the share done.
    """
    count = len(next(iter(columns.values())))

    def rows() -> Iterator[Iterable[Any]]:
        yield columns
        for start in range(0, count, BLOCK):
            tell(start / count)
            block = (values[start : start + BLOCK].tolist() for values in columns.values())
            yield from zip(*block, strict=True)

    write_csv(file, rows(), digits=0)
    return count


@dataclass(frozen=True, slots=True)
class TextTable:
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
    columns : dict of str to str
        The name in the header of each quantity.
    layout : str
        How it is written.
    """

    path: Path
    numbers: dict[str, F64]
    texts: dict[str, list[str]]
    units: dict[str, str]
    header: tuple[str, ...]
    rows: int
    columns: dict[str, str]
    layout: str

    def has(self, *names: str) -> bool:
        """Whether these columns of numbers are all there."""
        return all(name in self.numbers for name in names)

    def shifted(self, seconds: float, rate_hz: float) -> TextTable:
        """The same with its clock moved."""
        by = {"time": seconds, "sample": seconds * rate_hz}
        moved = {name: values + by.get(name, 0.0) for name, values in self.numbers.items()}
        return replace(self, numbers=moved)

    def places(self, rate_hz: float) -> F64 | None:
        """Place of each row on the sample clock, counted from where the table counts; None where
        it has neither samples nor times.

        Raises
        ------
        UserError
            A row has none.
        """
        name = "sample" if self.has("sample") else "time"
        if not self.has(name):
            return None
        values = self.numbers[name]
        if not np.isfinite(values).all():
            row = int(np.flatnonzero(~np.isfinite(values))[0]) + 1
            raise UserError(
                f"{self.path}, row {row}: {self.columns[name]} is empty or no number; give each row"
                " its place on the clock, or take the row out"
            )
        return values * (rate_hz if name == "time" else 1.0)

    def timed(self, rate_hz: float, remarks: list[str]) -> TextTable:
        """The same, with a time for each of its evenly spaced rows if it has none; a remark says
        so.
        """
        if self.has("time") or self.has("sample"):
            return self
        remarks.append(f"{self.path}: its rows have no times; they are taken at {rate_hz:g} Hz")
        numbers = self.numbers | {"time": np.arange(self.rows) / rate_hz}
        return replace(self, numbers=numbers, units=self.units | {"time": "s"})

    def from_its_start(self, rate_hz: float, remarks: list[str]) -> TextTable:
        """The same, counted from its first row where its clock began long before, as times of day
        do; a remark says so.
        """
        at = self.places(rate_hz)
        if at is None or 0 <= at[0] <= LONGEST_S * rate_hz:
            return self
        first_s = float(at[0]) / rate_hz
        remarks.append(
            f"sample 0 is at {first_s:.12g} s of the clock of {self.path}, in its first row"
        )
        return self.shifted(-first_s, rate_hz)

    @property
    def description(self) -> str:
        """What was read, for people."""
        named = ", ".join(
            f"{quantity}{f'_{unit}' if (unit := self.units[quantity]) else ''} from '{name[:60]}'"
            for quantity, name in self.columns.items()
        )
        rest = [name for name in self.header if name not in self.columns.values()]
        beside = f"; not used: {quoted(rest)}" if rest else ""
        return f"{self.path}: {self.rows} rows, {self.layout}: {named or 'no column'}{beside}"


def read_table(path: Path, quantities: Quantities, form: TableForm = ANY_FORM) -> TextTable:
    """The columns of a text file whose names are a quantity and its unit, such as ``P_mN``, or what
    other programs call it, such as ``Normal force [mN]`` (`WORDS`).

    Encoding, separator and decimal sign are found unless the form gives them. Lines that begin with
    # are comments. Columns with other names are left out. Times in seconds may be times of day,
    with or without a date, see `clock_s`; those without may pass midnight.

    Parameters
    ----------
    quantities : mapping
        Quantity in small letters -> unit in small letters -> factor to SI; `NUMBER` for a quantity
        without unit, `TEXT` for words.
    form : TableForm, optional
        What the user knows of it. Columns that it names and this table lacks are left out.

    Raises
    ------
    UserError
        The table cannot be read, or a cell is no number where one must be.
    """
    known = {
        f"{quantity}_{unit}" if unit else quantity: (quantity, unit, factor)
        for quantity, units in quantities.items()
        for unit, factor in (units or {"": 1.0}).items()
    }
    numbers: dict[str, array[float]]
    texts: dict[str, list[str]]
    try:
        check_ends(path)
        layout = layout_of(path, form, lambda name: name.lower() in known)
        header = layout.header
        top = next(layout.rows(path), [])
        found = _columns(path, header, quantities, known, form, top)
        numbers = {name: array("d") for name, *_ in found.values() if quantities[name]}
        texts = {name: [] for name, *_ in found.values() if not quantities[name]}
        is_day_first = form.is_day_first
        day_s, last_s = 0.0, -np.inf
        count = 0
        for count, row in enumerate(layout.rows(path), start=1):
            while len(row) > len(header) and not row[-1].strip():  # separators at the end
                row.pop()
            if len(row) != len(header):
                raise UserError(
                    f"{path}: row {count} has {len(row)} cells, the header {len(header)}; correct"
                    f" the table, or give --delimiter (read with {layout})"
                )
            for i, (quantity, _, factor) in found.items():
                cell = row[i].strip()
                if quantity in texts:
                    texts[quantity].append(text_of(cell))
                    continue
                value, is_clock = np.nan, quantity == "time" and factor == 1.0
                if cell and cell.lower() not in NOTHING:
                    value = layout.number(cell)
                    if value == np.inf and is_clock:
                        if is_day_first is None and EITHER_ORDER.match(cell):
                            is_day_first = _is_day_first(path, layout, i)
                        value = clock_s(cell, is_day_first=is_day_first is not False)
                        if value < min(last_s - DAY_S / 2, DAY_S):  # midnight, without a date
                            day_s += DAY_S
                        last_s, value = value, value + day_s
                if math.isinf(value):
                    where = f"{path}: '{cell[:40]}' in column {header[i]}, row {count},"
                    if is_clock and clock_s(cell, is_day_first=not is_day_first) < np.inf:
                        first, other = ("day", "month") if is_day_first else ("month", "day")
                        raise UserError(
                            f"{where} is no date that begins with the {first}; give"
                            f" --{other}-first, or correct the table"
                        )
                    raise UserError(
                        f"{where} is no number (read with {layout}); write numbers, nothing where"
                        " there is none, or give --decimal"
                    )
                numbers[quantity].append(value * factor)
    except UnicodeError:
        raise UserError(
            f"{path}: cannot be read as text; give a table in UTF-8 text, or its --encoding, such"
            " as latin-1"
        ) from None
    except (OSError, csv.Error) as error:
        why = getattr(error, "strerror", None) or error
        raise UserError(f"{path}: cannot be read: {why}; give a table in UTF-8 text") from None
    if not count:
        raise UserError(f"{path}: it has no rows; give a table with a header")
    return TextTable(
        path,
        {quantity: np.array(column) for quantity, column in numbers.items()},
        texts,
        {quantity: unit for quantity, unit, _ in found.values()},
        header,
        count,
        {quantity: header[i] for i, (quantity, *_) in found.items()},
        str(layout),
    )


_Column = tuple[str, str, float]  # quantity, unit, factor to SI


def _is_day_first(path: Path, layout: TableLayout, i: int) -> bool:
    """Whether dates in a column begin with the day."""
    is_day_first, ambiguous = has_day_first(
        row[i].strip() for row in layout.rows(path) if len(row) > i
    )
    if ambiguous:
        raise UserError(
            f"{path}: '{ambiguous[:40]}' in column {layout.header[i]} may begin with the day or"
            " with the month; give --day-first or --month-first"
        )
    return is_day_first


def _columns(
    path: Path,
    header: tuple[str, ...],
    quantities: Quantities,
    known: Mapping[str, _Column],
    form: TableForm,
    top: Sequence[str],
) -> dict[int, _Column]:
    """What the columns hold that the form names, else those of a known name, else those that are
    called so by other programs; times of day in the first row, `top`, need no unit.
    """
    found: dict[int, _Column] = {}
    lower = [name.lower() for name in header]
    for given, name in form.columns.items():
        quantity, place, sign = given.lower(), _place(name, header), 1.0
        if place is None and name.startswith("-"):
            place, sign = _place(name[1:].strip(), header), -1.0
        column = known.get(quantity)
        if column is None and quantity in quantities and place is not None:
            column = known.get(f"{quantity}_{name_and_unit(header[place])[1]}")
            if column is None:
                raise UserError(
                    f"--columns: '{given}={name}' names no unit that is known; write"
                    f" {quantity}_{next(iter(quantities[quantity]))}={name}, for example"
                )
        if column is not None and place is not None:
            found[place] = (*column[:2], sign * column[2])
    taken = {quantity for quantity, *_ in found.values()}
    exact = {
        i: known[name]
        for i, name in enumerate(lower)
        if i not in found and name in known and known[name][0] not in taken
    }
    found |= exact
    taken = {quantity for quantity, *_ in found.values()}
    if len(taken) < len(found):
        raise UserError(
            f"{path}: the header names a quantity twice: {', '.join(header)}; leave one out"
        )
    called: dict[int, _Column] = {}
    for i, name in enumerate(header):
        word, unit = name_and_unit(name)
        for quantity, units in quantities.items():
            if quantity in taken or i in found or word not in (quantity, *WORDS.get(quantity, ())):
                continue
            if unit in units or (not units and not unit):
                called[i] = (quantity, unit, units.get(unit, 1.0))
            elif quantity == "time" and any(
                clock_s(cell.strip(), is_day_first=either) < np.inf
                for cell in top[i : i + 1]
                for either in (True, False)
            ):
                called[i] = (quantity, "s", 1.0)
    times = Counter(quantity for quantity, *_ in called.values())
    found |= {i: column for i, column in called.items() if times[column[0]] == 1}
    return dict(sorted(found.items()))


def _place(name: str, header: tuple[str, ...]) -> int | None:
    """The column of a name, or of a number from 1 on; None if the header has neither."""
    for alike in (str, str.lower):
        for i, one in enumerate(header):
            if alike(one) == alike(name):
                return i
    if name.isdecimal() and 0 < int(name) <= len(header):
        return int(name) - 1
    return None


def clock_samples(table: TextTable, rate_hz: float) -> F64 | None:
    """The `places` of the rows, in order and from the start of the recording.

    Raises
    ------
    UserError
        The rows are not in order, or far from sample 0 or from each other.
    """
    at = table.places(rate_hz)
    if at is None:
        return None
    quantity, unit = ("sample", "") if table.has("sample") else ("time", " s")
    name, values = table.columns.get(quantity, quantity), table.numbers[quantity].tolist()
    steps = np.diff(at, prepend=-1e-9)
    if not (steps > 0).all():
        row = int(np.argmin(steps > 0))
        why = "before the start of the recording; count from 0"
        if row:
            why = f"not after {values[row - 1]:.12g}{unit} of the row before; put the rows in order"
            why += ", or write more digits, or take the column out and give --rate"
        raise UserError(f"{table.path}: {name} of row {row + 1} is {values[row]:.12g}{unit}, {why}")
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


def by_sample(table: TextTable, columns: tuple[str, ...], rate_hz: float) -> F64:
    """Columns of a table as one row per sample from 0 on, shape (n, columns).

    Values are linear between the rows of the table; NaN where it has a hole.

    Raises
    ------
    UserError
        The table has more rows than there are samples.
    """
    at = clock_samples(table, rate_hz)
    assert at is not None  # of forces, whose rows have times or a rate
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
