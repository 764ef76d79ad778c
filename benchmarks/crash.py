"""What a kill and a power cut cost a session. A program that records 1600 x 1200 images at 23.8
frames/s and forces at 1 kHz in real time is killed (SIGKILL) at random moments of its first 6 s;
power is cut at random moments of a recorded history of writes, half of them during a flush. Each
session is repaired, and each of its frames and samples compared with what was sent.

    python -m benchmarks crash [KILLS] [CUTS] [--folder FOLDER]

A frame that was altered ends the program with an error.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

from benchmarks.report import ROOT, Report

sys.path.append(str(ROOT / "tests/session"))

from killed_recorder import lost_by_kill
from test_power_cut import Recorded

SUBJECT = "Kills and power cuts"
SHAPE, RATE_HZ, LONGEST_S = (1200, 1600), 23.8, 6.0
LOST_S = 0.5


def kill(report: Report, count: int, folder: Path) -> None:
    """Kill, repair, compare."""
    rng = np.random.default_rng(0)
    lost, seconds, sent = 0, [], 0
    for _ in range(count):
        killed = lost_by_kill(folder / "killed.h5", RATE_HZ, SHAPE, rng.uniform(0.02, LONGEST_S))
        sent += killed.sent
        lost += killed.lost
        seconds.append(killed.lost_s)
        for path in folder.iterdir():
            path.unlink()
    worst = max(seconds), "s", LOST_S
    report.row("kills", number=count, frames_lost=f"{lost} of {sent:,}", most_of_one_session=worst)


def cut(report: Report, count: int, folder: Path) -> None:
    """Cut the power, repair, compare."""
    recorded = Recorded(folder)
    lost = [
        recorded.check(recorded.instant(seed, flushing=seed % 2 == 0), seed, folder / str(seed))
        for seed in range(count)
    ]
    worst = max(lost) / RATE_HZ, "s", LOST_S
    report.row("power cuts", number=count, frames_lost=sum(lost), most_of_one_session=worst)


def measure(
    report: Report, kills: int = 50, cuts: int = 200, *, folder: Path | None = None
) -> None:
    """Kill programs, then cut the power."""
    with tempfile.TemporaryDirectory(dir=folder) as temporary:
        for part, count in ((kill, kills), (cut, cuts)):
            (Path(temporary) / part.__name__).mkdir()
            part(report, count, Path(temporary) / part.__name__)
    report.add("frames altered", 0, at_most=0)
