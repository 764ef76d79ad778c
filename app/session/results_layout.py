"""The layout of a file of results: which records lie in which group.

A file of results is HDF5. Each run is a group ``/run_000001`` ..., by normal force, with the
records of `app.records.study_results.RunResult`; what the runs have in common is in ``/joint``,
what made the results in ``/made_with``. What a record holds says itself where it is stored
(`app.records.schema`).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from typing import Any

from app.records.record_types import ContactResult
from app.records.schema import Column, columns_of
from app.records.snapshot_numbers import NUMBERS
from app.records.study_results import (
    BoxNoise,
    BoxSearch,
    Instants,
    Joint,
    LawSeries,
    Origin,
    Pictures,
    RingSeries,
)
from app.records.summary import Summary
from app.session.layout import BY_PATH, COORDINATES, FORMAT_VERSION

RESULTS_VERSION = 3
RESULTS_ATTRIBUTE = "slipscope_results"
# of the format of a session, whose records a file of results holds too
RECORDS_ATTRIBUTE = "slipscope_records"
RECORDS_VERSION = FORMAT_VERSION
RUN = re.compile(r"run_\d{6}")
FRAMES = "frames"  # the group of the numbers of every frame
MADE_WITH = "/made_with/name", "/made_with/value"


def run_group(n: int) -> str:
    """The group of the n-th run, from 1."""
    return f"/run_{n:06d}"


RUN_PARTS: dict[str, type] = {
    "origin": Origin,
    "summary": Summary,
    "contact": ContactResult,
    "pictures": Pictures,
    "rings": RingSeries,
    "law": LawSeries,
    "instants": Instants,
    "noise": BoxNoise,
    "search": BoxSearch,
}


def place_of(column: Column, run: str = "") -> str:
    """The path of a column's dataset in the group of a run, or that of what is common."""
    inside = column.path.removeprefix("/entry/")
    if column.path in _NUMBERS:
        inside = f"{FRAMES}/{column.name}"
    return f"{run}/{inside}"


_NUMBERS = frozenset(column.path for column in NUMBERS.values())


def coordinates_of(run: str) -> dict[str, str]:
    """Side of the arrays in the group of a run -> where its coordinates are; of what is common, if
    `run` is empty.
    """
    if not run:
        return {"notes": "/joint/notes", "made_with": MADE_WITH[0]}
    own = {
        "instants": "instants/frame",
        "nx": "instants/x",
        "ny": "instants/y",
        "boxes": "noise/box",
        "law_radii": "summary/pressure_radius",
    }
    return {side: place_of(BY_PATH[path], run) for side, path in COORDINATES.items()} | {
        side: f"{run}/{place}" for side, place in own.items()
    }


def is_later(column: Column, version: int, records: int) -> bool:
    """Whether a column came after these versions of the layout, and of a session's records."""
    return column.since > (records if column.path.startswith("/entry/") else version)


def run_columns() -> Iterator[Column]:
    """The columns of a run."""
    yield from NUMBERS.values()
    for kind in RUN_PARTS.values():
        yield from columns_of(kind)


def datasets_of(names: Any) -> Iterator[str]:
    """The paths that a file with these groups at its root can have."""
    yield from (place_of(column) for column in columns_of(Joint))
    yield from MADE_WITH
    for name in sorted(filter(RUN.fullmatch, names)):
        yield from (place_of(column, f"/{name}") for column in run_columns())
