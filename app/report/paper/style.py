"""What all figures of several runs share: the widths of a journal, the colours, axes in one style,
the data as a table beside each figure, and files that are the same every time.
"""

from __future__ import annotations

import io
import math
import os
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib
import matplotlib.style
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import ArrayLike

from analysis.arrays import floats
from app.report.figures import DPI, STYLE, lay_out
from app.report.grey import LIGHTNESS, in_grey
from app.system.outputs import write_csv

Table = dict[str, Any]
"""Columns by name and unit: ``delta_um``, ``Q_N``; all of one length, numbers or texts."""

FORMATS = ("png", "pdf", "svg", "eps")
MM = 1 / 25.4  # inches
SINGLE, WIDE = 88.0, 180.0  # mm: a column of a journal, and a page of two
GROWS = 0.5  # of the height of a panel with its width
LAST = {"png": {}, "pdf": {"CreationDate": None}, "svg": {"Date": None}, "eps": {}}
"""Metadata without which the file would hold a time of day."""
_EPOCH = "SOURCE_DATE_EPOCH"
_EPS_DATE = re.compile(rb"^%%CreationDate: .*\n", re.MULTILINE)


class ColourMaps(NamedTuple):
    """Colour maps: of the loads, of what rises from dark blue to dark red in the paper, of a field,
    of one of either sign, and of what is much or little on white paper; `end`: how much of those of
    lines is dark enough for it.
    """

    loads: str
    rising: str
    field: str
    signed: str
    amount: str
    end: float


PALETTES = {
    "paper": ColourMaps("cool", "jet", "viridis", "RdBu_r", "YlOrRd", 1.0),
    # alike for the colour-blind
    "even": ColourMaps("plasma", "viridis", "cividis", "PuOr", "YlOrRd", 0.85),
    "grey": ColourMaps("gray", "gray", "gray", "gray", "gray_r", 0.7),
}
DARK = 0.72  # lightness above which a line is darkened, as it could not be seen on white


@dataclass(frozen=True)
class FigureStyle:
    """How figures look.

    Attributes
    ----------
    width_mm : float
        Of every figure, millimetres; 0: a column for those of one panel, a page for the others.
    colours : str
        One of `PALETTES`.
    style : str
        A style sheet of matplotlib beside ours: its name or its file.
    """

    width_mm: float = 0.0
    colours: str = "paper"
    style: str = ""


_PLAIN = FigureStyle()
_LOOK = ContextVar("look", default=_PLAIN)


class NotDrawn(Exception):
    """The results do not hold what a figure shows; the message says what is missing."""


@dataclass(frozen=True)
class Drawn:
    """A figure, its data, and what it shows in plain words.

    Attributes
    ----------
    tables : dict of str to Table
        By the letter of the panel, "" for the whole figure.
    """

    figure: Figure
    tables: Mapping[str, Table]
    caption: str


def new_figure(width: float, height: float) -> Figure:
    """An empty figure, inches; to be called, and drawn into, within `styled`."""
    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def new_panels(
    count: int,
    height: float,
    columns: int = 1,
    *,
    aspect: float = 0.0,
    wide: bool = False,
    **how: Any,
) -> tuple[Figure, list[Any]]:
    """A figure with so many panels: as wide as a column of a journal where one panel stands in a
    row that is not `wide`, else as a page; in the width of a column, fewer panels stand side by
    side.

    Parameters
    ----------
    height : float
        Of a row of panels with its axes, millimetres.
    aspect : float
        Times the width of a column of panels is added to that height.
    """
    own = WIDE if columns > 1 or wide else SINGLE
    width = _LOOK.get().width_mm or own
    taller = (width / own) ** GROWS if own == SINGLE else 1.0
    if columns > 1 and width < (SINGLE + WIDE) / 2:
        columns = math.ceil(columns / 2)
    columns = min(columns, count)
    rows = math.ceil(count / columns)
    figure = new_figure(width * MM, rows * (height * taller + aspect * width / columns) * MM)
    panels = figure.subplots(rows, columns, squeeze=False, **how).ravel()
    for panel in panels[count:]:
        panel.set_visible(False)
    return figure, list(panels[:count])


def draw_letters(panels: Iterable[Any]) -> None:
    """Draw (a) and so on above panels, in their order."""
    for panel, letter in zip(panels, "abcdef", strict=False):
        panel.set_title(f"({letter})", loc="left")


@contextmanager
def styled(look: FigureStyle | None = None) -> Iterator[None]:
    """The one style sheet, and a look if one is given, as a context.

    Raises
    ------
    OSError
        There is no such style sheet.
    """
    # the pad keeps the two zeros at the corner of axes apart
    own = {"svg.hashsalt": "slipscope", "xtick.major.pad": 5.0}
    own |= dict.fromkeys(("figure.autolayout", "figure.constrained_layout.use"), False)
    token = _LOOK.set(look or _LOOK.get())
    try:
        with matplotlib.rc_context({**STYLE, **own}):
            if sheet := _LOOK.get().style:
                matplotlib.style.use(sheet)
            yield
    finally:
        _LOOK.reset(token)


# what an axis calls a quantity, by the name of its column without the unit
NAMES = {
    "E": "$E$",
    "I": "$I(r)$",
    "P": "normal load $P$",
    "Q": "shear force $Q$",
    "Q_s": "$Q_s$",
    "c": "stick radius $c$",
    "delta": r"$\delta$",
    "dux_0": r"$\Delta u_x$",
    "k": "$k$",
    "p": "pressure $p$",
    "r": "$r$",
    "sigma": r"$\sigma_{xz}$",
    "time": "time $t$",
    "ux": "$u_x$",
    "ux_0": "$u_x(r)$",
    "work": "work per area at $t_s$",
    "work_of_traction": "work of friction",
}
UNITS = {"um": "µm", "uJ": "µJ", "GPa_per_m": "kPa/µm", "J_per_m2": "J/m²", "counts": "grey levels"}


def draw_columns(axes: Any, table: Table, x: str, y: str, *how: Any, **style: Any) -> None:
    """Draw one column of a table against another, and name both axes and their units after them."""
    axes.plot(table[x], table[y], *how, **style)
    name_axes(axes, x, y)


def draw_bars(axes: Any, table: Table, x: str, y: str, **style: Any) -> None:
    """The same with the standard uncertainty of each point."""
    quantity, unit = _parts(y)
    axes.errorbar(table[x], table[y], np.nan_to_num(table[f"{quantity}_sd_{unit}"]), **style)
    name_axes(axes, x, y)


def name_axes(axes: Any, x: str, y: str) -> None:
    """Name axes and their units after columns."""
    for name, label in ((x, axes.set_xlabel), (y, axes.set_ylabel)):
        quantity, unit = _parts(name)
        label(f"{NAMES[quantity]} ({UNITS.get(unit, unit)})")


def _parts(column: str) -> tuple[str, str]:
    """Quantity and unit of a column."""
    quantity = max((name for name in NAMES if column.startswith(f"{name}_")), key=len)
    return quantity, column.removeprefix(f"{quantity}_")


def palette() -> ColourMaps:
    """The colour maps of the look within which it is called."""
    return PALETTES[_LOOK.get().colours]


def load_colours(count: int) -> list[Any]:
    """One colour for each load, in the paper the lowest cyan and the highest pink (Fig. 3)."""
    return list(_of_map(palette().loads, np.linspace(0, 1, max(count, 2)))[:count])


def blue_to_red(share: ArrayLike) -> Any:
    """Colours of lines for numbers from 0 to 1, in the paper dark blue to dark red (Figs 13 and
    15), those that are too light for white paper darkened.
    """
    colours = np.array(_of_map(palette().rising, share))
    light = colours[..., :3] @ LIGHTNESS
    colours[..., :3] *= np.minimum(1, DARK / np.maximum(light, DARK))[..., None]
    return colours


def _of_map(name: str, share: ArrayLike) -> Any:
    return matplotlib.colormaps[name](floats(share) * palette().end)


def plain_logs(*sides: Any, subs: Sequence[float] = (1.0, 2.0, 5.0)) -> None:
    """1, 2, 5, or other `subs`, and their multiples by ten on logarithmic axes, as plain
    numbers.
    """
    for axis in sides:
        axis.set_major_locator(LogLocator(subs=subs))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())


def stacked(tables: Sequence[Table]) -> Table:
    """Tables with the same columns one below the other; single numbers fill their column."""
    filled = []
    for table in tables:
        rows = max((len(v) for v in table.values() if np.ndim(v)), default=1)
        filled.append({k: v if np.ndim(v) else [v] * rows for k, v in table.items()})
    return {name: np.concatenate([np.asarray(t[name]) for t in filled]) for name in filled[0]}


def write_table(table: Table, path: Path) -> None:
    """Write a table as CSV: a header, then numbers with nine digits, nothing where there is
    none.
    """
    columns = (np.asarray(column).tolist() for column in table.values())
    with path.open("x", encoding="utf-8", newline="\n") as file:
        write_csv(file, [table, *zip(*columns, strict=True)], missing="nan")


def picture(figure: Figure, kind: str, look: FigureStyle | None = None) -> bytes:
    """A figure as a file of that kind, one of `FORMATS`: the same bytes for the same results."""
    held = io.BytesIO()
    with styled(look), _undated():
        if _LOOK.get().colours == "grey":
            in_grey(figure)
        lay_out(figure)
        figure.savefig(held, format=kind, dpi=DPI, metadata=LAST[kind])
    return _EPS_DATE.sub(b"", held.getvalue()) if kind == "eps" else held.getvalue()


@contextmanager
def _undated() -> Iterator[None]:
    """Fonts that are written into a file have no time of day, by the agreed variable for it."""
    before = os.environ.get(_EPOCH)
    os.environ[_EPOCH] = before or "0"
    try:
        yield
    finally:
        if before is None:
            del os.environ[_EPOCH]
