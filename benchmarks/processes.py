"""The whole live chain at the camera's full rate, 1600 x 1200 at 23.8 frames/s, simulated bench,
with its window on the screen: what is recorded, what is analysed, and what each process and thread
takes of the processor. The simulated camera draws its images in the bench's process, which a real
camera does not.

    xvfb-run -a -s "-screen 0 1700x1000x24" python -m benchmarks processes [--seconds N]

Memory is the proportional share (PSS): what several processes share is counted once.
"""

from __future__ import annotations

import tempfile
import threading
import time
from pathlib import Path

import psutil

from app.gui.start import run_window
from app.processes.client import LaunchedRun
from app.processes.folder import running
from app.settings import config
from benchmarks.report import Report
from benchmarks.simulated import account

SUBJECT = "Processes of a live run"
SETTINGS = ("camera.divisor=42",)
RATE_HZ = 1000 / 42
WORKERS = {
    "slipscope-camera": "bench: camera (simulated: it draws the image)",
    "slipscope-recorder": "bench: recorder",
    "slipscope-control": "bench: decisions",
    "slipscope-devices": "bench: forces and stage",
    "slipscope-analysis": "bench: images to the analysis, results back",
    "slipscope-caller": "bench: answers to the window",
}


def threads_of(pid: int) -> dict[int, float]:
    """Processor time of each thread of a process, by its number."""
    return {t.id: t.user_time + t.system_time for t in psutil.Process(pid).threads()}


class Look:
    """The processor time of all processes at one moment, and the frames so far."""

    def __init__(self, run: LaunchedRun) -> None:
        bench = next(b for b in running() if b.pid == run.bench.pid)
        pids = {"window": psutil.Process().pid, "bench": bench.pid, "analysis": bench.analysis_pid}
        self.pids, self.at = pids, time.monotonic()
        self.used = {name: sum(threads_of(pid).values()) for name, pid in pids.items()}
        self.threads, self.names = threads_of(bench.pid), run.looks("threads")
        self.counts = run.look().health.counts

    def memory_mib(self) -> float:
        """Memory of all processes together."""
        total = sum(psutil.Process(pid).memory_full_info().pss for pid in self.pids.values())
        return total / 2**20


def report_costs(report: Report, first: Look, last: Look) -> None:
    """Processor time per frame between two looks."""
    frames = last.counts.frames_received - first.counts.frames_received
    analysed = last.counts.frames_analysed - first.counts.frames_analysed
    report.table("Processor time of a frame during the drive")
    for name in first.pids:
        ms = 1e3 * (last.used[name] - first.used[name]) / frames
        report.add(name, ms, "ms")
        if name == "analysis" and analysed:
            report.add("analysis, of an analysed frame", ms * frames / analysed, "ms")
    spent: dict[str, float] = {}
    for number, used in last.threads.items():
        who = WORKERS.get(last.names.get(number, ""), "bench: everything else")
        spent[who] = spent.get(who, 0.0) + used - first.threads.get(number, 0.0)
    for who in (*WORKERS.values(), "bench: everything else"):
        report.add(who, 1e3 * spent.get(who, 0.0) / frames, "ms")


def measure(report: Report, *, seconds: float = 60.0) -> int:
    """Run in a window; 1 if a frame or a sample was lost."""
    looks: list[Look] = []
    memory: list[float] = []
    is_over = threading.Event()
    with tempfile.TemporaryDirectory() as folder:
        settings = config.load(None, [*SETTINGS, f"run.travel={5 * seconds:g}"])
        made = LaunchedRun(settings, Path(folder) / "a.h5", pace=1.0, overwrite=False)

        def watch() -> None:
            while made.look().health.phase != "drive":
                time.sleep(0.1)
            time.sleep(2.0)
            looks.append(Look(made))
            while made.look().health.progress < 0.97 and made.look().outcome is None:
                time.sleep(0.5)
                memory.append(looks[0].memory_mib())
            looks.append(Look(made))
            made.wait()
            time.sleep(1.0)
            is_over.set()

        threading.Thread(target=watch, daemon=True).start()
        run_window(made, autostart=True, close_when=is_over.is_set)
        outcome = made.wait()
    assert outcome is not None
    account(report, outcome)
    counts = outcome.counts
    share = 100 * counts.frames_skipped / counts.frames_recorded
    report.add("share not analysed live", share, "%", 1.0)
    report.add("largest memory of all processes", max(memory), "MiB", 1024)
    report_costs(report, *looks)
    return int(counts.frames_lost + counts.samples_lost > 0)
