"""A plot as plain values: what is drawn, in which units, and how a file of it calls the columns."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.gui.scales import Range, round_range
from app.records.record_types import F64
from app.system.outputs import csv_text

NOTHING: F64 = np.empty(0)
SAME = 0.5  # px: what has moved by less is not drawn again
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
    is_downward: bool = False
    hint: str = ""

    @property
    def is_empty(self) -> bool:
        """Whether no line has a point."""
        return not any(len(line.x) for line in self.lines)

    def ranges(self, held: tuple[Range | None, Range | None] = (None, None)) -> tuple[Range, Range]:
        """Ranges of x and y that hold all lines; `held` are those shown so far."""
        x, y = self.extents
        return self.x_range or round_range(*x, held[0]), round_range(*y, held[1])

    @cached_property
    def extents(self) -> tuple[Range, Range]:
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


# ------------------------------------------------------------------ places on the screen


@dataclass(frozen=True, slots=True)
class AxesFrame:
    """A plot's axes on the screen: their rectangle in logical pixels, and their ranges."""

    left: float
    top: float
    width: float
    height: float
    x: Range
    y: Range
    is_downward: bool = False

    @property
    def scale(self) -> tuple[float, float]:
        """Pixels for a unit of x and of y; that of y is negative where y points upwards."""
        sign = 1.0 if self.is_downward else -1.0
        return self.width / (self.x[1] - self.x[0]), sign * self.height / (self.y[1] - self.y[0])

    def place(self, x: Any, y: Any) -> tuple[Any, Any]:
        """Where points are on the screen."""
        along, down = self.scale
        origin = self.y[0] if self.is_downward else self.y[1]
        return self.left + (x - self.x[0]) * along, self.top + (y - origin) * down

    def point(self, left: float, top: float) -> tuple[float, float]:
        """The x and y of a place on the screen."""
        along, down = self.scale
        origin = self.y[0] if self.is_downward else self.y[1]
        return self.x[0] + (left - self.left) / along, origin + (top - self.top) / down

    def holds(self, left: float, top: float) -> bool:
        """Whether a place on the screen is inside the axes."""
        return 0 <= left - self.left <= self.width and 0 <= top - self.top <= self.height

    def zoomed(
        self, about: tuple[float, float], factors: tuple[float, float]
    ) -> tuple[Range, Range]:
        """Ranges that are so many times as wide, with the point `about` where it is."""
        return tuple(  # type: ignore[return-value]
            (at + (low - at) * factor, at + (high - at) * factor)
            for (low, high), at, factor in zip((self.x, self.y), about, factors, strict=True)
        )

    def moved(self, right: float, down: float) -> tuple[Range, Range]:
        """Ranges after the content was moved by so many pixels."""
        along, downwards = self.scale
        x, y = right / along, down / downwards
        return (self.x[0] - x, self.x[1] - x), (self.y[0] - y, self.y[1] - y)


def paths(x: F64, y: F64, frame: AxesFrame) -> Iterator[F64]:
    """The pieces of a curve on the screen, shape (n, 2), without what no pixel shows.

    A piece ends at a NaN. Of more points than two for each column of pixels the least and the
    greatest of each column are kept.
    """
    left, top = frame.place(x, y)
    there = np.isfinite(left) & np.isfinite(top)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], there.view(np.int8), [0]])))
    for first, last in edges.reshape(-1, 2):
        yield _thinned(np.column_stack([left[first:last], top[first:last]]))


def _thinned(points: F64) -> F64:
    column = np.floor(points[:, 0])
    starts = np.flatnonzero(np.diff(column, prepend=-np.inf))
    if len(points) <= 4 * len(starts) or np.any(np.diff(column) < 0):
        return points
    middle = column[starts] + 0.5
    low, high = (reduce.reduceat(points[:, 1], starts) for reduce in (np.minimum, np.maximum))
    thin = np.column_stack([np.repeat(middle, 2), np.column_stack([low, high]).ravel()])
    thin[[0, -1]] = points[[0, -1]]
    return thin


def spots(x: F64, y: F64, frame: AxesFrame, size: float = 2.0) -> F64:
    """Where the points of a curve are on the screen, one of those closer together than `size`."""
    left, top = frame.place(x, y)
    points = np.column_stack([left, top])
    points = points[np.isfinite(points).all(axis=1)]
    _, first = np.unique(np.rint(points / size), axis=0, return_index=True)
    return np.asarray(points[np.sort(first)])


def are_same(now: tuple[Any, ...], before: tuple[Any, ...]) -> bool:
    """Whether two drawings are the same to half a pixel."""
    if not before or now[0] != before[0] or now[2:] != before[2:] or len(now[1]) != len(before[1]):
        return False
    return all(
        a[:2] == b[:2] and _are_near(a[2], b[2]) and _are_near(a[3], b[3])
        for a, b in zip(now[1], before[1], strict=True)
    )


def _are_near(now: list[F64], before: list[F64]) -> bool:
    return len(now) == len(before) and all(
        a.shape == b.shape and (not a.size or bool(np.abs(a - b).max() < SAME))
        for a, b in zip(now, before, strict=True)
    )
