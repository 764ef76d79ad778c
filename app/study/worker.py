"""The process that analyses sessions for another one: it is told which, one after the other, and
tells how far it is.
"""

from __future__ import annotations

import pickle
import sys
from pathlib import Path
from typing import Any, NamedTuple

from app.processes.starting import payload, report_ready, send
from app.study.analysis_plan import Task
from app.study.one import run_result
from app.study.parts import write_part
from app.study.sweep import simulated_result
from app.system.errors import UserError


class Failed(NamedTuple):
    """Why a session could not be analysed."""

    sentence: str


def analysed(task: Task, place: Path, on_progress: Any, threads: int | None) -> Failed | None:
    """Analyse a session into a part; why it could not be."""
    try:
        if task.world:
            run = simulated_result(task, on_progress, threads)
        else:
            run = run_result(Path(task.session), task.overrides, on_progress, threads)
        write_part(place, task, run)
    except (UserError, OSError) as error:
        return Failed(str(error))
    except Exception as error:
        return Failed(f"{task.session}: {type(error).__name__}: {error}")
    return None


def main() -> None:
    """Analyse until nobody asks any more."""
    payload()
    report_ready(None)

    def report(what: Any) -> None:
        try:
            send(what)
        except OSError:
            sys.exit(1)  # whoever asked is gone

    while True:
        try:
            task, place = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        report(analysed(task, place, report, threads=1))
