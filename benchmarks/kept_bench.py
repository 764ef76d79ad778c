"""A bench of which one run can be stopped many times: the process that `benchmarks.stop_key`
measures. A stop stops the actuator as always; then the stage is sent on.
"""

from __future__ import annotations

import threading
import time
from typing import Any

from app.acquisition.run import Run
from app.experiment.decisions import Experiment
from app.processes import bench

AHEAD_M = 1.5e-3
STANDS_S = 0.08
KEPT = "STOP MOTION was pressed"


def main() -> None:
    """As of a bench."""
    whole: Any = Run.request_stop
    Experiment._move = lambda self, now: False  # type: ignore[method-assign]

    def send_on(run: Any) -> None:
        time.sleep(STANDS_S)
        run._bench.actuator.move_to(run._bench.actuator.position_m() + AHEAD_M)

    def request_stop(run: Any, reason: str) -> None:
        if reason == "measured":
            whole(run, reason)
            return
        run._stage.stop()
        threading.Thread(target=send_on, args=(run,), daemon=True).start()

    Run.request_stop = request_stop  # type: ignore[method-assign]
    bench.main()
