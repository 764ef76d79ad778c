"""Writes and reads the results of `slipscope analyze` (`app.records.study_results`); see
`app.session.results_layout` for what lies where.

The same results are the same bytes. A file may come from anywhere: what it says is checked, as that
of a session is.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import h5py
import numpy as np

from analysis.arrays import Rows
from app.records.record_types import Phase
from app.records.schema import TEXT, Column, build, values
from app.records.snapshot_numbers import NUMBERS, ROW
from app.records.study_results import Joint, RunResult, StudyResults
from app.session import trust
from app.session.checked import CheckedFile, Closable
from app.session.columns import LIBVER, label, new_hdf5, write
from app.session.results_layout import (
    FRAMES,
    MADE_WITH,
    RECORDS_ATTRIBUTE,
    RECORDS_VERSION,
    RESULTS_ATTRIBUTE,
    RESULTS_VERSION,
    RUN,
    RUN_PARTS,
    is_later,
    place_of,
    run_group,
)
from app.session.results_nexus import describe
from app.system.outputs import new_file

T = TypeVar("T")


def write_runs(
    path: Path,
    runs: Iterable[RunResult],
    joint: Joint,
    made_with: Mapping[str, str],
    *,
    overwrite: bool = False,
) -> None:
    """Write results as a file, which appears when it is complete; of runs that are taken one at a
    time.

    Raises
    ------
    UserError
        It cannot be written there, or a file of that name exists and may not be overwritten.
    """
    versions = {RESULTS_ATTRIBUTE: RESULTS_VERSION, RECORDS_ATTRIBUTE: RECORDS_VERSION}
    with (
        new_file(path, overwrite) as unfinished,
        new_hdf5(unfinished, libver=LIBVER, **versions) as (file, check),
    ):
        for n, run in enumerate(runs, 1):
            _write_run(file, run_group(n), run)
            check()
        _write_record(file, joint)
        for place, texts in zip(MADE_WITH, (made_with, made_with.values()), strict=True):
            write(file, place, texts, TEXT)
        describe(file)
    trust.remember(path, "")  # our own, which needs no second look


def _write_run(file: h5py.File, group: str, run: RunResult) -> None:
    for name in RUN_PARTS:
        if (part := getattr(run, name)) is not None:
            _write_record(file, part, group)
    for name, column in NUMBERS.items():
        held = run.frames[name]
        if column.kind is Phase:
            held = np.array([column.stored(Phase(phase)) for phase in held.tolist()])
        _write_column(file, column, held, group)


def _write_record(file: h5py.File, record: Any, group: str = "") -> None:
    for column, value in values(record):
        _write_column(file, column, value, group)


def _write_column(file: h5py.File, column: Column, value: Any, group: str) -> None:
    how: dict[str, Any] = {}
    if column.dtype != TEXT and np.ndim(value) and np.size(value):
        how = {"chunks": np.shape(value), "fletcher32": True}
    label(write(file, place_of(column, group), value, column.dtype, **how), column)


# ---------------------------------------------------------------------------------------- reading


class ResultsReader(Closable):
    """A file of results on disk, of which each run is read when it is asked for; use it in a
    ``with`` statement.

    Raises
    ------
    UserError
        From here and from every method: no such file, not results, damaged, or written by a newer
        SlipScope.
    """

    def __init__(self, path: Path) -> None:
        self.path = Path(path)
        self._file = CheckedFile(self.path, "file of results")
        try:
            self._version, self._records = map(
                self._file.checked_format, (RESULTS_ATTRIBUTE, RECORDS_ATTRIBUTE)
            )
        except BaseException:
            self._file.close()
            raise
        self._runs = sorted(
            group for group in self._file.groups if RUN.fullmatch(group.lstrip("/"))
        )

    def __len__(self) -> int:
        """Number of runs."""
        return len(self._runs)

    def close(self) -> None:
        """Let go of the file. May be called twice."""
        self._file.close()

    def run(self, n: int) -> RunResult:
        """The n-th run, counted from 0."""
        group = self._runs[n]
        parts: dict[str, Any] = {"contact": None, "search": None}  # those that may lack
        for name, kind in RUN_PARTS.items():
            if name not in parts or self._file.has(f"{group}/{name}"):
                parts[name] = self._record(kind, group)
        return RunResult(frames=self._frames(group), **parts)

    def part(self, kind: type[T], n: int) -> T:
        """A record of the n-th run by its type, without the rest of the run."""
        return self._record(kind, self._runs[n])

    @property
    def joint(self) -> Joint:
        """What the runs have in common."""
        return self._record(Joint, "")

    @property
    def made_with(self) -> dict[str, str]:
        """Name -> what made the results."""
        names, held = (
            self._file.read(self._file.dataset(place, ("made_with",), TEXT)).tolist()
            for place in MADE_WITH
        )
        if len(names) != len(held):
            raise self._file.damaged(MADE_WITH[1], f"{len(held)} values for {len(names)} names")
        return dict(zip(names, held, strict=True))

    def _record(self, kind: type[T], group: str) -> T:
        """A record of a group; an array that came after the file is NaN, as long as those before
        it in the record.
        """
        sides: dict[str, int] = {}

        def value_of(column: Column) -> Any:
            if is_later(column, self._version, self._records):
                lengths = [sides[side] for side in map(str, column.shape) if side in sides]
                return column.restored(np.full(lengths, np.nan)) if lengths else None
            place = place_of(column, group)
            values = self._file.values(column, place, column.shape)
            with self._file.reading(place):
                if isinstance(held := column.restored(values), np.ndarray):
                    for side, length in zip(column.shape, held.shape, strict=True):
                        if sides.setdefault(str(side), length) != length:
                            raise ValueError(f"its shape is {held.shape}, others of it differ")
                return held

        record = build(kind, value_of)
        if "results" in sides and sides["results"] != self._count(group):
            raise self._file.damaged(
                f"{group}/{FRAMES}", f"{self._count(group)} frames, other tables have more or less"
            )
        return record

    def _count(self, group: str) -> int:
        column = NUMBERS["frame"]
        place = place_of(column, group)
        return self._file.dataset(place, ("results",), column.dtype).shape[0]

    def _frames(self, group: str) -> Rows:
        rows = np.empty(self._count(group), ROW)
        for name, column in NUMBERS.items():
            if is_later(column, self._version, self._records):
                rows[name] = column.default
                continue
            place = place_of(column, group)
            held = self._file.values(column, place, (len(rows),))
            with self._file.reading(place):
                rows[name] = [column.restored(p) for p in held] if column.kind is Phase else held
        return rows


def read_results(path: Path) -> StudyResults:
    """All of a file of results.

    Raises
    ------
    UserError
        No such file, not results, damaged, or written by a newer SlipScope.
    """
    with ResultsReader(path) as file:
        return StudyResults(
            runs=tuple(file.run(n) for n in range(len(file))),
            joint=file.joint,
            made_with=file.made_with,
        )
