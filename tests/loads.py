"""Small runs of the simulated bench that slide, under several loads, and their results: seconds
each.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from short_run import SMALL, TRACTION

from app.records.study_results import Joint, StudyResults
from app.runs import live
from app.settings import config
from app.study.one import run_result

ROUGH = (*SMALL, TRACTION, "sim.law=elasto-plastic", "sim.pressure=greenwood-tripp")
LOADS = 0.06, 0.09
PATIENCE_S = 300.0


def record(path: Path, *settings: str) -> Path:
    """A session of a rough contact that slides, with a traction, at `path`."""
    run = live.make_run(config.load(None, (*ROUGH, *settings)), path, pace=None)
    run.start()
    outcome = run.wait(PATIENCE_S)
    assert outcome is not None
    assert outcome.state == "done", outcome.reason
    return path


def small_sessions(folder: Path, loads: Sequence[float] = LOADS) -> list[Path]:
    """A session for each load, in newtons."""
    return [record(folder / f"load-{P:g}.h5", f"run.normal_force={P:g}") for P in loads]


def small_results(folder: Path, loads: Sequence[float] = LOADS) -> StudyResults:
    """The results of such sessions, which are made in `folder`."""
    runs = tuple(run_result(path) for path in small_sessions(folder, loads))
    return StudyResults(runs=runs, joint=Joint(), made_with={"slipscope": "0.1.0"})
