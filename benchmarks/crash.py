"""What a kill, a power cut and a damaged journal cost a session. A program that records 1600 x 1200
images at 23.8 frames/s and forces at 1 kHz in real time is killed (SIGKILL) at random moments of
its first 6 s; power is cut at random moments of a
recorded history of writes, half of them during a flush; of the journal of 213 frames one bit is
flipped at random. Each session is repaired, and each of its frames and samples compared with what
was sent.

    python -m benchmarks crash [KILLS] [CUTS] [--damaged 200] [--folder FOLDER]

A frame that was altered ends the program with an error.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from benchmarks.report import ROOT, Report

sys.path.append(str(ROOT / "tests/session"))

from damaged_journal import BLOCK, DamagedJournal
from killed_recorder import Recording
from test_power_cut import Recorded

SUBJECT = "Kills, power cuts and damaged journals"
SHAPE, RATE_HZ, LONGEST_S = (1200, 1600), 23.8, 6.0
LOST_S, FORCES_LOST_S = 0.5, 0.2


def kill(report: Report, count: int, folder: Path) -> None:
    """Kill, repair, compare."""
    rng = np.random.default_rng(0)
    kills = []
    for _ in range(count):
        delay_s = rng.uniform(0.02, LONGEST_S)
        with Recording(folder / "killed.h5", RATE_HZ, SHAPE) as recording:
            recording.wait_until_sent(1)
            time.sleep(delay_s)
            kills.append(recording.kill())
        for path in folder.iterdir():
            path.unlink()
    if kills:
        report.row(
            "kills",
            number=count,
            frames_lost=f"{sum(len(k.lost) for k in kills)} of {sum(len(k.sent) for k in kills):,}",
            most_of_one_session=(max(k.seconds(k.lost) for k in kills), "s", LOST_S),
            forces=(max(k.seconds(k.forces_lost) for k in kills), "s", FORCES_LOST_S),
        )


def cut(report: Report, count: int, folder: Path) -> None:
    """Cut the power, repair, compare."""
    recorded = Recorded(folder)
    lost = [
        recorded.check(recorded.instant(seed, flushing=seed % 2 == 0), seed, folder / str(seed))
        for seed in range(count)
    ]
    if lost:
        worst = max(lost) / RATE_HZ, "s", LOST_S
        report.row("power cuts", number=count, frames_lost=sum(lost), most_of_one_session=worst)


def damage(report: Report, count: int, folder: Path) -> None:
    """Flip a bit of the journal, repair, compare."""
    damaged = DamagedJournal(folder)
    lost = [damaged.lost_by_bit(seed) for seed in range(count)]
    if lost:
        report.row(
            "journals with one bit flipped",
            number=count,
            frames_lost=(sum(frames for frames, _ in lost), "", 0),
            most_samples=(max(samples for _, samples in lost), "", BLOCK),
        )


def measure(
    report: Report,
    kills: int = 50,
    cuts: int = 200,
    *,
    damaged: int = 200,
    folder: Path | None = None,
) -> None:
    """Kill programs, then cut the power, then damage journals."""
    with tempfile.TemporaryDirectory(dir=folder) as temporary:
        for name in ("kill", "cut", "damage"):
            (Path(temporary) / name).mkdir()
        kill(report, kills, Path(temporary) / "kill")
        cut(report, cuts, Path(temporary) / "cut")
        damage(report, damaged, Path(temporary) / "damage")
    report.add("frames altered", 0, at_most=0)
