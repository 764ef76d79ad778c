from pathlib import Path

import pytest
from made_once import made_once
from short_run import SMALL, without_budget
from whole_runs import recorded

from app.records.record_types import Outcome


@pytest.fixture(scope="session")
def small_run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Outcome]:
    """The session of a run of `SMALL`, to be read only, and how it ended."""

    def make(folder: Path) -> tuple[Path, Outcome]:
        with without_budget():
            return folder / "a.h5", recorded(folder / "a.h5", *SMALL)

    made: tuple[Path, Outcome] = made_once(tmp_path_factory, "small-run", make)
    return made
