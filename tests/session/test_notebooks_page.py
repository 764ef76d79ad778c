"""docs/notebooks.md lists what `Session`, `Results` and their parts have, all of it and no more."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path

import pytest
from session_material import Session as Written

from app.records.study_results import RingSeries, RunResult
from app.session.result_tables import COMMON, OF_RUNS
from app.session.tables import SESSION
from app.system.errors import UserError
from slipscope import Results, Session
from slipscope.frames_and_fields import FieldInMetres, Fields, Frames

PAGE = (Path(__file__).parents[2] / "docs/notebooks.md").read_text(encoding="utf-8")
CLASSES = (Session, Frames, Fields, FieldInMetres, RingSeries, Results, RunResult)


def first_cells(head: str) -> dict[str, str]:
    """First and second cell of each row of the table with this first cell in its head."""
    (table,) = re.findall(rf"^\| {re.escape(head)} \|.*\n\|[-|]+\n((?:\|.*\n)+)", PAGE, re.M)
    rows = (line.strip("|\n ").split(" | ", 1) for line in table.splitlines())
    return dict(rows)


@pytest.mark.parametrize("kind", CLASSES, ids=lambda kind: kind.__name__)
def test_the_page_lists_every_attribute(kind: type) -> None:
    listed = {
        name
        for cell in first_cells(f"`{kind.__name__}`")
        for name in re.findall(r"`(\w+)(?:\([\w, ]*\))?`", cell)
    }
    held = {name for name in dir(kind) if not name.startswith("_")}
    if issubclass(kind, tuple):
        held = {*kind._fields, "table", "plot"}  # without what every tuple has
    if dataclasses.is_dataclass(kind):
        held = {field.name for field in dataclasses.fields(kind)}
    # set when one is made
    held |= {Frames: {"received", "shape", "dtype"}}.get(kind, set())
    held |= {Fields: {"shape", "x_m", "y_m", "measured"}}.get(kind, set())
    assert listed == held


def tables_below(heading: str) -> dict[str, str]:
    part = PAGE.partition(f"## {heading}\n")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| (`.*`) \| (.*) \|$", part, re.M)
    return {name: columns for names, columns in rows for name in re.findall(r"`(\w+)`", names)}


def test_the_page_lists_the_tables_of_a_session_and_their_columns(session: Written) -> None:
    listed = tables_below("The tables of a session")
    assert set(listed) == set(SESSION) - {"law"}
    with Session(session.path) as s:
        for what, columns in listed.items():
            named = columns.removesuffix(", and the further channels").split(", ")
            try:
                assert named == list(s.table(what))
            except UserError:
                assert what in ("cycles", "slides")


def test_the_page_lists_the_tables_of_results() -> None:
    assert set(tables_below("The tables of results")) == {*OF_RUNS, *COMMON}
