"""The results of several sessions for a notebook: each run as arrays in SI units, read from the
file when it is first used, and everything as tables.

>>> from slipscope import Results
>>> with Results("results.h5") as r:
...     loads = [run.summary.normal_force_n for run in r.runs]
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import overload

from app.records.quantities import counted, joint_quantities
from app.records.study_results import Joint, RunResult
from app.report.summary_rows import Row
from app.session.checked import Closable
from app.session.result_tables import results_table
from app.session.results import ResultsReader
from app.session.tables import Columns, counted_from_0
from slipscope.displays import as_html


class Runs(Sequence[RunResult]):
    """The runs by normal force, each read when it is used: ``runs[0]``."""

    def __init__(self, reader: ResultsReader) -> None:
        self._reader = reader
        self._read: dict[int, RunResult] = {}

    def __len__(self) -> int:
        return len(self._reader)

    def __repr__(self) -> str:
        return f"<{counted(len(self), 'run')} of {self._reader.path.name}>"

    @overload
    def __getitem__(self, index: int, /) -> RunResult: ...
    @overload
    def __getitem__(self, index: slice, /) -> list[RunResult]: ...
    def __getitem__(self, index: int | slice, /) -> RunResult | list[RunResult]:
        if isinstance(index, slice):
            return [self[n] for n in range(*index.indices(len(self)))]
        n = counted_from_0(self._reader.path, "run", index, len(self))
        if n not in self._read:
            self._read[n] = self._reader.run(n)
        return self._read[n]


class Results(Closable):
    """The results of ``slipscope analyze``. Units are SI and in the names; use it in a
    ``with`` statement, or `close` it.

    Parameters
    ----------
    path : str or Path
        The file of results; it is only read.

    Raises
    ------
    FileNotFoundError
        There is no such file; it is a UserError too.
    UserError
        From here and from every attribute: the file cannot be read, holds no results or is
        damaged; the message says what to do.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self._reader = ResultsReader(Path(path))

    def __repr__(self) -> str:
        return f"<Results {self._reader.path.name}: {counted(len(self.runs), 'run')}>"

    def _repr_html_(self) -> str:
        together = [Row(one.name, one.symbol, str(one)) for one in joint_quantities(self.joint)]
        return as_html(f"{self._reader.path.name}: {counted(len(self.runs), 'run')}", together)

    def close(self) -> None:
        """Close the file; arrays stay. May be called twice."""
        self._reader.close()

    @cached_property
    def runs(self) -> Runs:
        """The runs by normal force, each an `app.records.study_results.RunResult`."""
        return Runs(self._reader)

    @cached_property
    def joint(self) -> Joint:
        """The common results of the runs: E, L, mu, each with its standard uncertainty."""
        return self._reader.joint

    @cached_property
    def made_with(self) -> dict[str, str]:
        """Name -> what made the results: versions, settings that were changed, the preset."""
        return self._reader.made_with

    def table(self, what: str, frames: range | None = None) -> Columns:
        """A table as ``slipscope export --what`` writes it: column -> array, all of one length, for
        ``pandas.DataFrame(...)``. Each row says its run, from 1, and that run's normal force.

        Parameters
        ----------
        what : str
            ``"summary"``, ``"results"``, ``"rings"``, ``"law"``, ``"joint"``, ...;
            ``slipscope export --help`` lists them.
        frames : range, optional
            Only rows of frames with these numbers.

        Raises
        ------
        UserError
            There is no such table, or the file has nothing for it.
        """
        return results_table(self._reader, what, frames)
