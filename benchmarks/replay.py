"""How long a jump to any recorded frame takes, and how fast a session is replayed: ``python
benchmarks/replay.py SESSION.h5 [JUMPS]``.
"""

from __future__ import annotations

import datetime
import platform
import random
import statistics
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from app.gui.source import setup_of
from app.gui.view_state import read, resolve
from app.replay import make_replay


def main(session: Path, jumps: int) -> None:
    """Measure, and print.

    A jump is all but the drawing: image, field and results from the file, and what the window makes
    of them.
    """
    replay = make_replay(session, pace=None)
    replay.playback.pause()
    replay.start()
    setup, view, took = setup_of(replay), None, []
    for _ in range(jumps):
        replay.browser.show(random.randrange(replay.frame_count))
        began = time.perf_counter()
        view = resolve(setup, read(replay, 0), view)
        took.append(time.perf_counter() - began)
    replay.browser.show(None)
    began = time.perf_counter()
    replay.playback.resume()
    outcome = replay.wait()
    wall = time.perf_counter() - began
    print(
        f"{platform.machine()}, {platform.system()}, {datetime.date.today()}; {session.name},"
        f" {replay.frame_count} frames"
    )
    print(
        f"jump to any frame: median {1e3 * statistics.median(took):.0f} ms, worst"
        f" {1e3 * max(took):.0f} ms of {jumps}"
    )
    print(
        f"replay: {replay.frame_count / wall:.1f} frames/s, {replay.comparison().identical} to the"
        f" bit ({outcome.state if outcome else ''})"
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 100)
