"""Results of two small runs, for the tests of this folder."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from loads import LOADS, record
from made_once import made_once
from study_plans import asked

from app.records.study_results import Joint, RunResult, StudyResults
from app.study import worker
from app.study.analyzing import analyze


@pytest.fixture(scope="session")
def sessions(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two sessions, to be read only."""

    def make(folder: Path) -> list[Path]:
        return [  # they slide after 20 um
            record(folder / f"load-{P:g}.h5", f"run.normal_force={P:g}", "run.travel=40")
            for P in LOADS
        ]

    return made_once(tmp_path_factory, "loads", make)


@pytest.fixture(scope="session")
def analysed(
    sessions: list[Path], tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, tuple[RunResult, ...]]:
    """Both analysed one after the other, in one process: the file, and the results of each."""
    run_result, runs = worker.run_result, []

    def kept(*given: Any) -> RunResult:
        runs.append(run_result(*given))
        return runs[-1]

    def make(folder: Path) -> tuple[Path, tuple[RunResult, ...]]:
        with pytest.MonkeyPatch.context() as patched:
            patched.setattr(worker, "run_result", kept)
            analyze(asked(sessions, folder / "results.h5"), jobs=1)
        return folder / "results.h5", tuple(runs)

    return made_once(tmp_path_factory, "analysed-loads", make)


@pytest.fixture(scope="session")
def once(analysed: tuple[Path, tuple[RunResult, ...]]) -> Path:
    """The file of results."""
    return analysed[0]


@pytest.fixture(scope="session")
def results(analysed: tuple[Path, tuple[RunResult, ...]]) -> StudyResults:
    """What is in them."""
    runs = analysed[1]
    return StudyResults(runs=runs, joint=Joint(notes=("none",)), made_with={"slipscope": "0.1.0"})
