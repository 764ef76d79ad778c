"""A plot as plain values: what is drawn, in which units, and how a file of it calls the columns."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.gui.scales import Range, Ranges, round_range
from app.records.record_types import F64
from app.system.outputs import csv_text

NOTHING: F64 = np.empty(0)
Held = tuple[Range | None, Range | None]  # ranges of x and y that are shown so far
UNKNOWN: Range = (math.nan, math.nan)


@dataclass(frozen=True, slots=True, eq=False)
class Line:
    """A curve y(x).

    Attributes
    ----------
    name : str
        In the legend; without one it is not there.
    role : str
        Names its colour in the palette.
    columns : (str, str)
        What a file calls x and y.
    sd : ndarray or None
        Standard uncertainty of y, drawn as a band.
    style : str
        "line", "dashed", "dots" or "squares".
    is_faint : bool
        Behind the others, and the axes do not care for it.
    """

    name: str
    x: F64
    y: F64
    role: str
    columns: tuple[str, str]
    sd: F64 | None = None
    style: str = "line"
    width: float = 1.6
    is_faint: bool = False


@dataclass(frozen=True, slots=True)
class Guide:
    """A dashed line across the plot with its name, at an x where it is upright, else at a y. It is
    seen where the axes reach it.
    """

    value: float
    text: str
    is_upright: bool = False
    role: str = "apparent"


@dataclass(frozen=True, slots=True)
class Span:
    """A range of y that is tinted."""

    low: float
    high: float
    role: str


@dataclass(frozen=True, slots=True)
class ChartMark:
    """A point with a text beside it."""

    x: float
    y: float
    text: str


@dataclass(frozen=True, eq=False)
class Chart:
    """A plot. Its axes follow the lines, but for `x_range`, which holds where it is given;
    `y_least` is a range that the axis always shows, and `hint` is said where there is no point.
    """

    title: str
    x_label: str
    y_label: str
    lines: tuple[Line, ...] = ()
    guides: tuple[Guide, ...] = ()
    spans: tuple[Span, ...] = ()
    marks: tuple[ChartMark, ...] = ()
    caption: str = ""
    x_range: Range | None = None
    y_least: Range = UNKNOWN
    hint: str = ""

    @property
    def is_empty(self) -> bool:
        """Whether no line has a point."""
        return not any(len(line.x) for line in self.lines)

    def ranges(self, held: Held = (None, None)) -> Ranges:
        """Ranges of x and y that hold all lines; `held` are those shown so far."""
        x, y = self.extents
        return self.x_range or round_range(*x, held[0]), round_range(*y, held[1])

    @cached_property
    def extents(self) -> Ranges:
        """What the lines take of x and y."""
        followed = [line for line in self.lines if not line.is_faint and len(line.x)]
        if not followed:  # an earlier run shows more than empty axes
            followed = [line for line in self.lines if len(line.x)]
        y = [line.y for line in followed] + [np.array(self.y_least)]
        bands = [(line.y, np.nan_to_num(line.sd)) for line in followed if line.sd is not None]
        y += [middle + k * sd for middle, sd in bands for k in (-1, 1)]
        return _extent(*(line.x for line in followed)), _extent(*y)

    def table(self) -> str:
        """The lines as CSV: a row for each point, with the name of its curve."""
        columns = dict.fromkeys(name for line in self.lines for name in _columns(line))
        rows: list[list[str | float]] = [["curve", *columns]]
        for line in self.lines:
            values = _columns(line)
            for row in range(len(line.x)):
                cells = (values[c][row] if c in values else math.nan for c in columns)
                rows.append([line.name or self.title, *cells])
        return csv_text(rows)


def _columns(line: Line) -> dict[str, F64]:
    columns = dict(zip(line.columns, (line.x, line.y), strict=True))
    if line.sd is not None:
        quantity, _, unit = line.columns[1].rpartition("_")
        columns[f"{quantity}_sd_{unit}"] = line.sd
    return columns


def _extent(*arrays: NDArray[Any]) -> Range:
    """Least and greatest finite value; NaN where there is none."""
    ends = [(a.min(), a.max()) for a in (a[np.isfinite(a)] for a in arrays) if a.size]
    if not ends:
        return UNKNOWN
    return float(min(low for low, _ in ends)), float(max(high for _, high in ends))
