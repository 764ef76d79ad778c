"""What all figures of several runs share: the colours of the loads, axes in one style, the data as
a table beside each figure, and files that are the same every time.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter
from numpy.typing import ArrayLike

from app.report.figures import STYLE
from app.system.outputs import write_csv

Table = dict[str, Any]
"""Columns by name and unit: ``delta_um``, ``Q_N``; all of one length, numbers or texts."""

FORMATS = ("png", "pdf", "svg")
DPI = 160
WIDE, SINGLE = 7.2, 4.6  # inches
LAST = {"png": {}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}
"""Metadata without which the file would hold a time of day."""


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


def styled() -> Any:
    """The one style sheet, as a context."""
    # the pad keeps the two zeros at the corner of axes apart
    own = {"svg.hashsalt": "slipscope", "xtick.major.pad": 5.0}
    return matplotlib.rc_context({**STYLE, **own})


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


def load_colours(count: int) -> list[Any]:
    """One colour for each load, the lowest cyan and the highest pink (paper, Fig. 3)."""
    return list(matplotlib.colormaps["cool"](np.linspace(0, 1, max(count, 2)))[:count])


def plain_logs(axes: Any) -> None:
    """1, 2, 5 and their multiples by ten on logarithmic axes, as plain numbers."""
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
        axis.set_minor_formatter(NullFormatter())


def blue_to_red(share: ArrayLike) -> Any:
    """Colours of numbers from 0 to 1, dark blue to dark red (paper, Figs 13 and 15)."""
    return matplotlib.colormaps["jet"](np.asarray(share, dtype=np.float64))


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


def picture(figure: Figure, kind: str) -> bytes:
    """A figure as a file of that kind, one of `FORMATS`: the same bytes for the same results."""
    held = io.BytesIO()
    with styled():
        figure.savefig(held, format=kind, dpi=DPI, metadata=LAST[kind])
    return held.getvalue()
