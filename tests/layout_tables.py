"""The tables of docs/format.md and docs/results.md: every dataset of a session, and of a file of
results.

    python tests/layout_tables.py
"""

from __future__ import annotations

from collections.abc import Iterable

from app.records.schema import Column, columns_of
from app.records.snapshot_numbers import NUMBERS
from app.records.study_results import Joint
from app.session import layout, results_layout

HEAD = ["| dataset | shape | type | unit | meaning |", "|---|---|---|---|---|"]


def of_session() -> str:
    """The layout of a session as a Markdown table."""
    rows = []
    for held in layout.COLUMNS:
        since = f" (version {held.since} on)" if held.since > 1 else ""
        rows.append(_row(held.path, held.shape, held, since))
    return _table(rows)


def of_results() -> str:
    """The layout of a file of results as a Markdown table."""
    numbers, rows = {column.path for column in NUMBERS.values()}, []
    for run, columns in (
        ("/run_...", results_layout.run_columns()),
        ("", columns_of(Joint)),
    ):
        for held in columns:
            shape = ("frames",) if held.path in numbers else held.shape
            rows.append(_row(results_layout.place_of(held, run), shape, held))
    for place, meaning in zip(
        results_layout.MADE_WITH,
        ("what made the results", "its version, or what it is"),
        strict=True,
    ):
        rows.append(f"| `{place}` | made_with | text |  | {meaning} |")
    return _table(rows)


def _row(path: str, shape: Iterable[str | int], column: Column, since: str = "") -> str:
    sides = " x ".join(map(str, shape)) or "one value"
    return f"| `{path}` | {sides} | {column.dtype} | {column.unit} | {column.meaning}{since} |"


def _table(rows: list[str]) -> str:
    return "\n".join(HEAD + rows) + "\n"


if __name__ == "__main__":
    print(of_session())
    print(of_results())
