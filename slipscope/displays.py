"""How a notebook shows a file."""

from __future__ import annotations

from collections.abc import Iterable
from html import escape

from app.report.summary_rows import Row


def as_html(title: str, rows: Iterable[Row]) -> str:
    """A table of three columns."""
    cells = (f"<td>{'</td><td>'.join(map(escape, row))}</td>" for row in rows)
    body = "".join(f"<tr>{row}</tr>" for row in cells)
    return f"<table><caption>{escape(title)}</caption><tbody>{body}</tbody></table>"
