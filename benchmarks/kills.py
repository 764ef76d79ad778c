"""Kills at random moments. A run in its window (with a display, else in the terminal) is started as
a user starts it, and the window, its analysis, or both are killed (SIGKILL) at a random moment; the
run must go on to its end, and its session must replay to the bit. Then benches that drive a stage
on an emulated controller are killed, or frozen: the supervisor must stop the stage.

    xvfb-run -a python -m benchmarks kills [KILLS] [--bench-kills N] [--freezes N]
"""

from __future__ import annotations

import os
import random
import signal
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from app.processes.client import LaunchedRun
from app.records.record_types import RESTART
from app.settings import config
from benchmarks.outside_stage import OutsideStage
from benchmarks.report import ROOT, Report

sys.path.append(str(ROOT / "tests"))

from processes.launched import Program, bench_of, kill, wait_until, whole
from processes.test_processes import replayed
from short_run import SMALL

assert sys.platform != "win32", "it asks what a system of POSIX knows of a process"

SUBJECT = "Kills of windows, analyses and benches"
VICTIMS = ("window", "analysis", "window and analysis")
DRIVE_S = 12.0


def survive(path: Path, victim: str, share: float) -> bool:
    """Whether a run goes on to its end and replays to the bit."""
    program = Program(path, headless="DISPLAY" not in os.environ)
    run = program.run()
    wait_until(lambda: run.look().health.state == "running", "the run")
    time.sleep(share * DRIVE_S)
    if "analysis" in victim:
        kill(bench_of(path).analysis_pid)
    if "window" in victim:
        program.process.kill()
        program.process.wait()
    outcome = run.wait(120.0)
    program.process.kill()
    program.process.communicate()
    identical, frames, difference = replayed(path)
    counts, events = outcome.counts, whole(path)[1]
    restarts = len([event for event in events if event.kind == RESTART])
    print(f"{victim} after {share * DRIVE_S:.1f} s: {outcome.reason}; {difference or 'the same'}")
    return (
        outcome.state == "done"
        and counts.frames_recorded == counts.triggers
        and identical == frames == counts.frames_analysed
        and restarts <= int("analysis" in victim)
    )


def time_to_stop(path: Path, number: int) -> float:
    """Seconds from a signal to the bench until the stop arrives."""
    stage = OutsideStage()
    settings = config.load(None, [*SMALL, *stage.settings])
    run = LaunchedRun(settings, path, pace=1.0, overwrite=True)
    run.start()
    wait_until(lambda: run.look().health.phase == "drive", "the drive")
    time.sleep(random.uniform(0.2, 3.0))
    began = time.monotonic()
    os.kill(run.bench.pid, number)
    arrived = stage.first_after(began)
    kill(run.bench.pid)
    run.wait()
    stage.end()
    return (arrived or np.inf) - began


def measure(report: Report, kills: int = 50, *, bench_kills: int = 20, freezes: int = 5) -> int:
    """Kill; 1 if a session was not whole."""
    random.seed(0)
    broken = 0
    with tempfile.TemporaryDirectory() as folder:
        for n in range(kills):
            path = Path(folder) / f"{n}.h5"
            broken += not survive(path, VICTIMS[n % 3], random.random())
            for file in Path(folder).iterdir():
                file.unlink()
        report.add("runs of which window, analysis or both were killed", kills)
        report.add("of them not whole, or not replayed to the bit", broken, at_most=0)
        path = Path(folder) / "stage.h5"
        for name, number, count, bound in (
            ("bench killed (SIGKILL)", signal.SIGKILL, bench_kills, 200.0),
            ("bench frozen (SIGSTOP)", signal.SIGSTOP, freezes, 1000.0),
        ):
            waits = [1e3 * time_to_stop(path, number) for _ in range(count)]
            if waits:
                report.row(
                    f"{name}, to the stop on the line",
                    number=count,
                    median=(np.median(waits), "ms"),
                    longest=(max(waits), "ms", bound),
                )
    return int(broken > 0)
