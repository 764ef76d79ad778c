"""Time to show any recorded frame of a session, all but the drawing: its image, field and results
from the file, and what the window makes of them. Then the rate of a replay, and whether it agrees
with the session to the bit.

    python -m benchmarks replay SESSION.h5 [JUMPS]
"""

from __future__ import annotations

import random
import time
from pathlib import Path

from app.gui.source import setup_of
from app.gui.view_state import read, resolve
from app.replay.replay import Replay
from benchmarks.report import Report

SUBJECT = "Replay"


def measure(report: Report, session: Path, jumps: int = 100) -> None:
    """Measure both on one session."""
    replay = Replay(session, pace=None)
    replay.playback.pause()
    replay.start()
    setup, view, took = setup_of(replay), None, []
    for _ in range(jumps):
        replay.browser.show(int(random.choice(replay.timeline.frames)))
        began = time.perf_counter()
        view = resolve(setup, read(replay, 0), view)
        took.append(time.perf_counter() - began)
    report.times("jump to a frame", took)
    replay.browser.show(None)
    began = time.perf_counter()
    replay.playback.resume()
    replay.wait()
    wall, compared = time.perf_counter() - began, replay.comparison()
    report.add("replay", replay.frame_count / wall, "frames/s")
    report.add("frames replayed", compared.frames)
    report.add("frames that differ by a bit", compared.frames - compared.identical, at_most=0)
