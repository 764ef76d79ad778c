"""A long run on the simulated bench at 1600 x 1200, recorded and analysed: does memory stay flat,
is anything lost? Memory is compared with that after the first minute of the bench's clock, when
everything that is made once has been made, by a line fitted to it from then on.

    python -m benchmarks soak virtual [--minutes 30]           as fast as the machine, 8 frames/s
    python -m benchmarks soak live [--minutes 10] [--window]   in real time, 23.8 frames/s
    python -m benchmarks soak live --minutes 1 --disk 20       on a disk that takes 20 MB/s

The stage is driven by 300 um at the velocity that takes so long. The exit code is 1 if a frame or a
sample was lost, if the session is not what was recorded, or if the run did not end as it should:
with its travel done, or, on a slow disk, with an error that names the disk. The session takes 19 MB
for each second at 8 frames/s.
"""

from __future__ import annotations

import os
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import psutil

from app.acquisition.run import Run
from app.records.record_types import Outcome
from benchmarks.report import Report
from benchmarks.simulated import account, experiment
from drivers.protocols import Frame

SUBJECT = "Long runs"
TRAVEL_UM = 300.0
EVERY_S, RECORDER = 2.0, "slipscope-recorder"  # between two looks; a thread
FIRST_S = 60.0  # of the bench's clock: by then everything that is made once has been made
MODES = {"virtual": (30.0, 125, None), "live": (10.0, 42, 1.0)}  # minutes, divisor, pace


class Watch:
    """The state of a run every few seconds: bench's clock (s), memory of this process (MiB) and
    processor time of the recorder (s).
    """

    def __init__(self, run: Run) -> None:
        self.run = run
        self.rows: list[tuple[float, float, float]] = []

    def work(self) -> None:
        """Note the state until the run has ended."""
        while self.run.wait(EVERY_S) is None:
            health, me = self.run.health(), psutil.Process()
            if health.state != "running":
                continue
            recorder = [t.native_id for t in threading.enumerate() if t.name == RECORDER]
            times = [t.user_time + t.system_time for t in me.threads() if t.id in recorder]
            seconds, memory = health.sample / self.run.sample_rate_hz, me.memory_info().rss / 2**20
            self.rows.append((seconds, memory, sum(times)))
            told = f"{seconds:6.0f} s  {memory:7.1f} MiB  {health.counts.frames_recorded} frames"
            print(f"\r{told}, queue {health.queue_fill:4.0%} ", end="", file=sys.stderr, flush=True)


def slow_down(run: Run, bytes_per_s: float) -> None:
    """Let the disk take no more than that: each image is written when those before it would have
    been.
    """
    create = run._create_sink

    def slowed() -> Any:
        sink = create()
        append, free_at = sink.append, time.monotonic()

        def slowly(record: Any) -> None:
            nonlocal free_at
            if isinstance(record, Frame):
                free_at = max(free_at, time.monotonic()) + record.image.nbytes / bytes_per_s
                time.sleep(max(0.0, free_at - time.monotonic()))
            append(record)

        sink.append = slowly
        return sink

    run._create_sink = slowed


def outcome_of(run: Run, watching: threading.Thread, screenshot: Path | None) -> Outcome:
    """Run to the end, in a window if it has a place for the screenshot."""
    if screenshot:
        if sys.platform == "linux" and not os.environ.get("DISPLAY"):
            os.environ["QT_QPA_PLATFORM"] = "offscreen"
        from app.gui.start import run_window
        from app.gui.window import MainWindow

        shown: list[MainWindow] = []

        def is_over() -> bool:
            if not (shown and shown[0].outcome()):
                return False
            shown[0].grab().save(str(screenshot))
            return True

        watching.start()
        run_window(run, autostart=True, on_ready=shown.append, close_when=is_over)
    else:
        run.start()
        watching.start()
    outcome = run.wait()
    watching.join()
    print(file=sys.stderr)
    assert outcome is not None
    return outcome


def tell(report: Report, watch: Watch, outcome: Outcome) -> None:
    """Report the account of frames and samples, the processor time of the recorder, and the memory
    after the first minute with its growth from then on; a run too short for that has none.
    """
    account(report, outcome)
    seconds, memory, recorder = np.array(watch.rows).T
    report.add("recorder", 100 * recorder[-1] / seconds[-1], "% of a core", at_most=20)
    late = seconds >= FIRST_S
    if late.sum() >= 3:
        since = seconds[late] - seconds[late][0]
        slope, start = np.polyfit(since, memory[late], 1)
        report.add("memory after a minute", start, "MiB", digits=4)
        report.add("memory: growth", 100 * slope * since[-1] / start, "%", 1, digits=2)


def measure(
    report: Report,
    mode: Annotated[str, MODES],
    *,
    minutes: float | None = None,
    window: bool = False,
    disk: float | None = None,
) -> int:
    """Run, watch, report; 1 where something was lost."""
    by_default, divisor, pace = MODES[mode]
    velocity = TRAVEL_UM / (60 * (minutes or by_default))
    drive = [f"run.travel={TRAVEL_UM}", f"run.velocity={velocity}", f"camera.divisor={divisor}"]
    with tempfile.TemporaryDirectory(prefix="soak-") as folder:
        path = Path(folder) / "soak.h5"
        run = experiment(path, drive, pace=pace).run
        if disk:
            slow_down(run, disk * 1e6)
        watch = Watch(run)
        watching = threading.Thread(target=watch.work, daemon=True)
        outcome = outcome_of(run, watching, path.with_suffix(".png") if window else None)
    tell(report, watch, outcome)
    counts, names_disk = outcome.counts, "the disk is slower than the data" in outcome.reason
    is_whole = counts.triggers == counts.frames_recorded and not counts.samples_lost
    ended_well = names_disk if disk else outcome.state == "done"
    return int(not (is_whole and ended_well and "receipt" in outcome.resources))
