from pathlib import Path

import pytest
from made_once import made_once
from short_run import SMALL, without_budget

from app.records.record_types import Outcome
from app.runs import live
from app.settings import config


@pytest.fixture(scope="session")
def small_run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Outcome]:
    """The session of a run of `SMALL`, to be read only, and how it ended."""

    def make(folder: Path) -> tuple[Path, Outcome]:
        run = live.make_run(config.load(None, SMALL), folder / "a.h5", pace=None)
        with without_budget():
            run.start()
            outcome = run.wait(400)
        assert outcome is not None, "the run did not end"
        return folder / "a.h5", outcome

    made: tuple[Path, Outcome] = made_once(tmp_path_factory, "small-run", make)
    return made
