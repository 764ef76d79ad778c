"""A long run on the simulated bench at 1600 x 1200, recorded and analysed: does memory stay flat,
is anything lost? Memory is compared with that after the first minute of the bench's clock, when
everything that is made once has been made: by a line fitted to it from then on, and by its largest
value.

    python -m benchmarks soak virtual [--minutes 30] [--rate 8]           as fast as the machine
    python -m benchmarks soak live [--minutes 10] [--rate 23.8] [--window]        in real time
    python -m benchmarks soak live --minutes 1 --disk 20        on a disk that takes 20 MB/s

The stage is driven by 300 um at the velocity that takes so long. The exit code is 1 if a frame or a
sample was lost, if the session is not what was recorded, or if the run did not end as it should:
with its travel done, or, on a slow disk, with an error that names the disk. The session takes 19 MB
for each second at 8 frames/s and is removed unless --keep is given.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import psutil

from app.acquisition.run import Run
from app.records.record_types import Outcome
from app.system.errors import UserError
from benchmarks.report import Report
from benchmarks.simulated import account, experiment
from drivers.protocols import Frame

SUBJECT = "Long runs"
TRAVEL_UM = 300.0
EVERY_S = 2.0
FIRST_S = 60.0  # of the bench's clock: by then everything that is made once has been made
MIB = 2**20
MINUTES, RATE_HZ = {"virtual": 30.0, "live": 10.0}, {"virtual": 8.0, "live": 23.8}


def memory_bytes() -> tuple[int, int]:
    """Resident memory of this process, and the part of it that maps no file, as libraries do."""
    memory = psutil.Process().memory_info()
    return memory.rss, memory.rss - getattr(memory, "shared", 0)


@dataclass
class Watch:
    """The state of a run, noted every few seconds until it ends.

    Attributes
    ----------
    rows : list of tuple
        Bench's clock (s), resident and own memory (bytes), share of the recorder's queue in use.
    cpu_s : dict
        Processor time by the name of the thread.
    """

    run: Run
    rows: list[tuple[float, int, int, float]] = field(default_factory=list)
    cpu_s: dict[str, float] = field(default_factory=dict)

    def work(self) -> None:
        """Note the state until the run has ended."""
        while self.run.wait(EVERY_S) is None:
            self.note()

    def note(self) -> None:
        """Note the state now."""
        health = self.run.health()
        if health.state != "running":
            return
        names = {thread.native_id: thread.name for thread in threading.enumerate()}
        taken: dict[str, float] = {}
        for one in psutil.Process().threads():
            name = names.get(one.id, "threads of libraries")
            taken[name] = taken.get(name, 0.0) + one.user_time + one.system_time
        self.cpu_s |= taken
        seconds = health.sample / self.run.sample_rate_hz
        self.rows.append((seconds, *memory_bytes(), health.queue_fill))
        progress = (
            f"\r{seconds:6.0f} s  {self.rows[-1][1] / MIB:7.1f} MiB"
            f"  {health.counts.frames_recorded} frames, {health.counts.frames_skipped} skipped,"
            f" queue {health.queue_fill:4.0%} "
        )
        print(progress, end="", file=sys.stderr, flush=True)


def tell_growth(
    report: Report, name: str, seconds: np.ndarray, memory: np.ndarray, at_most: float | None
) -> None:
    """Report memory (MiB) after the first minute and its growth from then on: of a fitted line, and
    of the largest value. A run too short for that has none.
    """
    late = seconds >= FIRST_S
    if late.sum() < 3:
        return
    seconds, memory = seconds[late] - seconds[late][0], memory[late]
    slope, start = np.polyfit(seconds, memory, 1)
    largest = 100 * (memory.max() / memory[0] - 1)
    report.add(f"{name} after a minute", start, "MiB", digits=4)
    report.add(f"{name}: growth", 100 * slope * seconds[-1] / start, "%", at_most, digits=2)
    report.add(f"{name}: growth of the largest value", largest, "%", digits=2)


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


def outcome_of(run: Run, watch: Watch, screenshot: Path | None) -> Outcome:
    """Run to the end, in a window if it has a place for the screenshot."""
    watching = threading.Thread(target=watch.work, name="soak", daemon=True)
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


def tell(report: Report, run: Run, watch: Watch, outcome: Outcome, mb: float) -> None:
    """Report the account of frames and samples, the memory and the processor time."""
    account(report, outcome)
    rows, seconds = np.array(watch.rows), outcome.counts.samples / run.sample_rate_hz
    tell_growth(report, "memory", rows[:, 0], rows[:, 1] / MIB, at_most=1)
    tell_growth(report, "memory without mapped files", rows[:, 0], rows[:, 2] / MIB, at_most=None)
    report.add("fullest recorder queue", 100 * rows[:, 3].max(), "%")
    share = watch.cpu_s.get("slipscope-recorder", 0.0) / rows[-1, 0]
    report.add("recorder", 100 * share, "% of a core", at_most=20)
    for name, cpu in sorted(watch.cpu_s.items(), key=lambda item: -item[1]):
        report.add(f"processor time: {name}", cpu, "s", digits=2)
    report.add("session", mb / seconds, "MB/s of the bench's clock")
    report.add("duration on the bench's clock", seconds, "s", digits=4)


def measure(
    report: Report,
    mode: Annotated[str, MINUTES],
    *,
    minutes: float | None = None,
    rate: float | None = None,
    window: bool = False,
    disk: float | None = None,
    folder: Path | None = None,
    keep: bool = False,
    set_: Sequence[str] = (),
) -> int:
    """Run, watch, report; 1 where something was lost, 2 where the run could not be made."""
    minutes, rate = minutes or MINUTES[mode], rate or RATE_HZ[mode]
    drive = [f"run.travel={TRAVEL_UM}", f"run.velocity={TRAVEL_UM / (60 * minutes)}"]
    drive.append(f"camera.divisor={round(1000 / rate)}")
    temporary = Path(tempfile.mkdtemp(prefix="soak-", dir=folder))
    path = temporary / "soak.h5"
    try:
        pace = None if mode == "virtual" else 1.0
        run = experiment(path, [*drive, *set_], pace=pace).run
        if disk:
            slow_down(run, disk * 1e6)
        watch = Watch(run)
        outcome = outcome_of(run, watch, path.with_suffix(".png") if window else None)
        tell(report, run, watch, outcome, path.stat().st_size / 1e6)
    except UserError as error:
        print(error, file=sys.stderr)
        return 2
    finally:
        if not keep:
            shutil.rmtree(temporary)
    counts, names_disk = outcome.counts, "the disk is slower than the data" in outcome.reason
    is_whole = counts.triggers == counts.frames_recorded and not counts.samples_lost
    ended_well = names_disk if disk else outcome.state == "done"
    return int(not (is_whole and ended_well and "receipt" in outcome.resources))
