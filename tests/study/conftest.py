"""Results of two small runs, for the tests of this folder."""

from __future__ import annotations

from pathlib import Path

import pytest
from loads import small_sessions
from study_plans import asked

from app.records.study_results import Joint, StudyResults
from app.study.analyzing import analyze
from app.study.one import run_result


@pytest.fixture(scope="session")
def sessions(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two sessions, to be read only."""
    return small_sessions(tmp_path_factory.mktemp("loads"))


@pytest.fixture(scope="session")
def once(sessions: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of one after the other, in this process."""
    output = tmp_path_factory.mktemp("once") / "results.h5"
    analyze(asked(sessions, output), jobs=1)
    return output


@pytest.fixture(scope="session")
def results(sessions: list[Path]) -> StudyResults:
    """What is in them."""
    runs = tuple(run_result(path) for path in sessions)
    return StudyResults(runs=runs, joint=Joint(notes=("none",)), made_with={"slipscope": "0.1.0"})
