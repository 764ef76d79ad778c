"""What kills and power cuts cost a session: ``python benchmarks/crash.py [KILLS] [CUTS] [FOLDER]``,
by default 50 and 200.

Kills (kill -9) of a program that records 1600 x 1200 images at 23.8 frames/s and 1 kHz of forces in
real time, each at a random instant of its first 6 s. Power cuts at random instants of a recorded
history of writes, half of them in a flush. Every session is repaired, and every frame and sample
compared with what was sent; a frame that was altered ends the program.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))
sys.path.insert(0, str(ROOT / "tests" / "session"))

from killed_recorder import lost_by_kill  # noqa: E402
from test_power_cut import Recorded  # noqa: E402

SHAPE, RATE_HZ, LONGEST_S = (1200, 1600), 23.8, 6.0


def kills(count: int, folder: Path) -> None:
    """Kill, repair, compare."""
    rng = np.random.default_rng(0)
    lost, seconds, frames = [], [], 0
    for _ in range(count):
        kill = lost_by_kill(folder / "killed.h5", RATE_HZ, SHAPE, rng.uniform(0.02, LONGEST_S))
        frames += kill.sent
        lost.append(kill.lost)
        seconds.append(kill.lost_s)
        for path in folder.iterdir():
            path.unlink()
    print(
        f"{count} kills, {frames} frames sent: {sum(lost)} lost, {max(seconds):.3f} s of one"
        " session at most; 0 altered"
    )


def cuts(count: int, folder: Path) -> None:
    """Cut, repair, compare."""
    recorded = Recorded(folder)
    lost = [
        recorded.check(recorded.instant(seed, flushing=seed % 2 == 0), seed, folder / str(seed))
        for seed in range(count)
    ]
    print(
        f"{count} power cuts: {max(lost)} frames ({max(lost) / RATE_HZ:.2f} s) lost at most,"
        f" {np.mean(lost):.1f} on average; 0 altered"
    )


if __name__ == "__main__":
    numbers = [int(text) for text in sys.argv[1:3]]
    with tempfile.TemporaryDirectory(dir=sys.argv[3] if len(sys.argv) > 3 else None) as temporary:
        for work, number in zip((kills, cuts), numbers + [50, 200][len(numbers) :], strict=True):
            (Path(temporary) / work.__name__).mkdir()
            work(number, Path(temporary) / work.__name__)
