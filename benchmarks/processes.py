"""The whole live chain at the camera's full rate, 1600 x 1200 at 23.8 frames/s, simulated bench,
with its window on the screen: what is recorded, what is analysed, and the memory of all processes.

    xvfb-run -a -s "-screen 0 1700x1000x24" python -m benchmarks processes [--seconds N]

Memory is the proportional share (PSS): what several processes share is counted once.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

import psutil

from app.processes.client import LaunchedRun
from app.processes.folder import running
from app.settings import config
from benchmarks.report import Report
from benchmarks.simulated import account
from benchmarks.window_run import in_window

SUBJECT = "Processes of a live run"
SETTINGS = ("camera.divisor=42",)


def memory_mib(pids: Sequence[int]) -> float:
    """Memory of some processes together."""
    return sum(psutil.Process(pid).memory_full_info().pss for pid in pids) / 2**20


def measure(report: Report, *, seconds: float = 60.0) -> int:
    """Run in a window; 1 if a frame or a sample was lost."""
    memory: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        settings = config.load(None, [*SETTINGS, f"run.travel={5 * seconds:g}"])
        run = LaunchedRun(settings, Path(folder) / "a.h5", pace=1.0, overwrite=False)

        def watch() -> None:
            while run.look().health.phase != "drive":
                time.sleep(0.1)
            bench = next(b for b in running() if b.pid == run.bench.pid)
            pids = psutil.Process().pid, bench.pid, bench.analysis_pid
            while run.look().health.progress < 0.97 and run.look().outcome is None:
                time.sleep(0.5)
                memory.append(memory_mib(pids))
            run.wait()
            time.sleep(1.0)

        outcome = in_window(run, lambda _: watch)
    account(report, outcome)
    counts = outcome.counts
    share = 100 * counts.frames_skipped / counts.frames_recorded
    report.add("share not analysed live", share, "%", 1.0)
    report.add("largest memory of all processes", max(memory), "MiB", 1024)
    return int(counts.frames_lost + counts.samples_lost > 0)
