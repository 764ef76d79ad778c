"""A long run, and whether memory stays flat and nothing is lost.

    python benchmarks/soak.py virtual [--minutes 30] [--rate 8]      # as fast as the machine, on
    the clock of the samples python benchmarks/soak.py live [--minutes 10] [--rate 23.8] [--window]
    # in real time python benchmarks/soak.py live --minutes 1 --disk 20     # to a disk that takes
    20 MB/s and no more

The simulated bench at 1600 x 1200, recorded and analysed, driven by 300 um at the velocity that
takes so long. Every few seconds it notes memory, processor time by thread, and the account of
frames. At the end it prints how memory grew after the first minute of the bench's clock, what each
thread took, and what became of every frame and sample; exits with 1 if one was lost, if the session
is not what was recorded, or if the run did not end as it should: done, or by the name of a disk
that is too slow. The last line is the same as JSON. The session, 19 MB for each second at 8
frames/s, is removed; --keep leaves it.
"""

from __future__ import annotations

import argparse
import datetime
import json
import os
import platform
import shutil
import sys
import tempfile
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import psutil

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from app import config as settings
from app import live
from app.engine.run import Run
from app.errors import UserError
from app.records import Outcome, ReceivedFrame, Record

TRAVEL_UM = 300.0
EVERY_S = 2.0
FIRST_S = 60.0  # of the bench's clock: what is made once is made by then
MIB = 2**20


def memory_bytes() -> tuple[int, int]:
    """Resident memory of this process, and how much of that is its own data (not files that are
    mapped, as libraries are).
    """
    resident = psutil.Process().memory_info().rss
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return resident, resident
    return resident, 1024 * next(
        int(line.split()[1]) for line in lines if line.startswith("RssAnon")
    )


@dataclass
class Watch:
    """Notes the state of a run until it has ended.

    Attributes
    ----------
    rows : list of tuple
        Bench's clock (s), resident and own memory (bytes), queue fill.
    cpu_s : dict
        Processor time by the name of the thread.
    """

    run: Run
    rows: list[tuple[float, int, int, float]] = field(default_factory=list)
    cpu_s: dict[str, float] = field(default_factory=dict)

    def work(self) -> None:
        """Look every few seconds."""
        while self.run.wait(EVERY_S) is None:
            self.look()

    def look(self) -> None:
        """Note the state now."""
        health = self.run.health()
        if health.state != "running":
            return
        names = {thread.native_id: thread.name for thread in threading.enumerate()}
        taken: dict[str, float] = {}
        for one in psutil.Process().threads():
            name = names.get(one.id, "without a name: the libraries'")
            taken[name] = taken.get(name, 0.0) + one.user_time + one.system_time
        self.cpu_s |= taken
        self.rows.append(
            (health.sample / self.run.sample_rate_hz, *memory_bytes(), health.queue_fill)
        )
        done = health.counts
        print(
            f"\r{self.rows[-1][0]:6.0f} s  {self.rows[-1][1] / MIB:7.1f} MiB "
            f" {done.frames_recorded} frames, {done.frames_skipped} skipped,"
            f" queue {health.queue_fill:4.0%} ",
            end="",
            file=sys.stderr,
            flush=True,
        )


def growth(rows: np.ndarray, column: int) -> tuple[float, float, float]:
    """Memory after the first minute (MiB), and its growth from there to the end in %: of the fitted
    line, and of the largest value.
    """
    after = rows[rows[:, 0] >= FIRST_S] if (rows[:, 0] >= FIRST_S).sum() > 2 else rows
    if len(after) < 2:
        return float(after[0, column] / MIB), np.nan, np.nan  # too short to tell
    slope, start = np.polyfit(after[:, 0] - after[0, 0], after[:, column] / MIB, 1)
    return (
        start,
        100 * slope * (after[-1, 0] - after[0, 0]) / start,
        100 * (after[:, column].max() / MIB / after[0, column] * MIB - 1),
    )


def report(
    asked: argparse.Namespace, run: Run, watch: Watch, outcome: Outcome, path: Path, wall_s: float
) -> dict[str, Any]:
    """What is printed, by name."""
    counts, rows = outcome.counts, np.array(watch.rows)
    seconds = counts.samples / run.sample_rate_hz
    found: dict[str, Any] = {
        "mode": asked.mode,
        "window": asked.window,
        "bench_s": round(seconds, 1),
        "wall_s": round(wall_s, 1),
    }
    for name, column in (("memory", 1), ("own_memory", 2)):
        start, fitted, largest = growth(rows, column)
        found |= {
            f"{name}_minute_1_mib": round(start, 1),
            f"{name}_end_mib": round(rows[-1, column] / MIB, 1),
        }
        found |= {
            f"{name}_growth_percent": round(fitted, 2),
            f"{name}_largest_over_minute_1_percent": round(largest, 2),
        }
    found |= {
        "frames": counts.frames_recorded,
        "frames_lost": counts.triggers - counts.frames_recorded,
    }
    found |= {
        "samples": counts.samples,
        "samples_lost": counts.samples_lost,
        "fullest_queue": round(float(rows[:, 3].max()), 3),
    }
    found |= {"analysed_share": round(counts.frames_analysed / counts.triggers, 4)}
    found |= {
        "mb_per_s": round(path.stat().st_size / seconds / 1e6, 2),
        "mb_per_wall_s": round(path.stat().st_size / wall_s / 1e6, 2),
    }
    found |= {
        f"cpu of {name}": round(cpu, 2)
        for name, cpu in sorted(watch.cpu_s.items(), key=lambda item: -item[1])
    }
    found |= {
        "recorder_share_of_a_core": round(
            watch.cpu_s.get("slipscope-recorder", 0.0) / rows[-1, 0], 4
        )
    }
    return found | {
        "state": outcome.state,
        "reason": outcome.reason,
        "receipt": outcome.resources.get("receipt", "none"),
    }


def main(argv: list[str] | None = None) -> int:
    """Run, watch, print; 1 where something was lost."""
    ask = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    ask.add_argument("mode", choices=("virtual", "live"))
    ask.add_argument("--minutes", type=float)
    ask.add_argument("--rate", type=float)
    ask.add_argument(
        "--window", action="store_true", help="with the window, offscreen where there is no screen"
    )
    ask.add_argument("--disk", type=float, metavar="MB/s", help="what the disk takes at most")
    ask.add_argument("--folder", type=Path, help="for the session")
    ask.add_argument("--keep", action="store_true")
    ask.add_argument("--set", action="append", default=[])
    asked = ask.parse_args(argv)
    minutes = asked.minutes or {"virtual": 30.0, "live": 10.0}[asked.mode]
    rate = asked.rate or {"virtual": 8.0, "live": 23.8}[asked.mode]
    drive = (
        f"run.travel={TRAVEL_UM}",
        f"run.velocity={TRAVEL_UM / (60 * minutes)}",
        f"camera.divisor={round(1000 / rate)}",
    )
    config = settings.load(None, [*drive, *asked.set])
    folder = Path(tempfile.mkdtemp(prefix="soak-", dir=asked.folder))
    try:
        return soak(asked, config, folder / "soak.h5")
    except UserError as error:
        print(error, file=sys.stderr)
        return 2
    finally:
        if not asked.keep:
            shutil.rmtree(folder)


def soak(asked: argparse.Namespace, config: settings.Config, path: Path) -> int:
    """Make the run, tell what came of it; 1 where something was lost."""
    run = live.make_run(config, path, pace=None if asked.mode == "virtual" else 1.0)
    if asked.disk:
        slow_down(run, asked.disk * 1e6)
    watch = Watch(run)
    watching = threading.Thread(target=watch.work, name="soak", daemon=True)
    began = time.monotonic()
    outcome = with_window(run, watching, path) if asked.window else alone(run, watching)
    found = report(asked, run, watch, outcome, path, time.monotonic() - began)
    print(
        f"\n{platform.platform()}, {platform.machine()}, {datetime.date.today()};"
        f" {' '.join(sys.argv[1:])}; {path}"
    )
    for name, value in found.items():
        print(f"{name:44s} {value}")
    print(json.dumps(found))
    whole = not (found["frames_lost"] or found["samples_lost"]) and found["receipt"] != "none"
    as_it_should = (
        outcome.reason.startswith("recorder: the disk is slower than the data")
        if asked.disk
        else outcome.state == "done"
    )
    return 0 if whole and as_it_should else 1


def slow_down(run: Run, bytes_per_s: float) -> None:
    """Let the disk take no more than that: each image is written when those before it would have
    been.
    """
    create = run._create_sink

    def slowed() -> Any:
        sink = create()
        append, free_at = sink.append, time.monotonic()

        def slowly(record: Record) -> None:
            nonlocal free_at
            if isinstance(record, ReceivedFrame):
                free_at = max(free_at, time.monotonic()) + record.image.nbytes / bytes_per_s
                time.sleep(max(0.0, free_at - time.monotonic()))
            append(record)

        sink.append = slowly  # type: ignore[method-assign]
        return sink

    run._create_sink = slowed


def alone(run: Run, watching: threading.Thread) -> Outcome:
    """How the run ended."""
    run.start()
    watching.start()
    outcome = run.wait()
    watching.join()
    assert outcome is not None
    return outcome


def with_window(run: Run, watching: threading.Thread, path: Path) -> Outcome:
    """How the run in a window ended."""
    if sys.platform == "linux" and not os.environ.get("DISPLAY"):
        os.environ["QT_QPA_PLATFORM"] = "offscreen"
    from app.gui.start import run_window

    watching.start()
    run_window(lambda: run, autostart=True, screenshot=path.with_suffix(".png"))
    watching.join()
    outcome = run.wait()
    assert outcome is not None
    return outcome


if __name__ == "__main__":
    sys.exit(main())
