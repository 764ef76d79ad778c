"""How a notebook shows a file."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape
from typing import TYPE_CHECKING

from app.report.summary_rows import Row

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def as_html(title: str, rows: Iterable[Row]) -> str:
    """A table of three columns."""
    cells = (f"<td>{'</td><td>'.join(map(escape, row))}</td>" for row in rows)
    body = "".join(f"<tr>{row}</tr>" for row in cells)
    return f"<table><caption>{escape(title)}</caption><tbody>{body}</tbody></table>"


def axes_for(given: Axes | None) -> Axes:
    """The axes to draw into; new ones, in a figure that a notebook shows, where none are given."""
    from matplotlib import pyplot  # what chooses a window has no place in other programs

    return pyplot.subplots(layout="constrained")[1] if given is None else given
