"""Time from a press of Escape in the window to the stop command on the actuator's line, during a
run at the camera's full rate: simulated forces and camera at 23.8 frames/s, 1600 x 1200, recorded
and analysed with the traction of every frame, and the real driver of the SMC100 on an emulated
controller, in a process of its own, with a line of 57600 baud. The key is pressed at random moments
through the X server; a command has arrived with the last byte of `ST`. Blocked: the window's thread
sleeps, and SIGINT or `stop_motion` of another process takes the place of the key.

    xvfb-run -a -s "-screen 0 1700x1000x24" python -m benchmarks stop_key [PRESSES] [--blocked]

It needs an X display and xdotool. So that one run can be stopped many times, its end is not called:
the actuator is stopped as always, then sent on.
"""

from __future__ import annotations

import os
import random
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from PySide6.QtCore import QTimer

from app.processes.client import LaunchedRun
from app.processes.launch import attached
from app.processes.signals import acting_on_signals
from app.settings import config
from benchmarks.outside_stage import OutsideStage
from benchmarks.report import Report
from benchmarks.simulated import account
from benchmarks.window_run import in_window

SUBJECT = "Stop from the keyboard"
SETTINGS = ["camera.divisor=42", "run.travel=2000", "limits.travel=5000"]
SETTINGS += ["run.background_time=1"]
BLOCKED_S = 10.0


class Presses:
    """Stops a run again and again, and notes how long each took to reach the line."""

    def __init__(self, run: LaunchedRun, stage: OutsideStage) -> None:
        self.run, self.stage = run, stage
        self.waits: dict[str, list[float]] = {}

    def repeat(self, name: str, press: Callable[[], object], number: int) -> None:
        """Press at random moments."""
        waits = self.waits.setdefault(name, [])
        for _ in range(number):
            time.sleep(random.uniform(0.25, 0.6))
            began = time.monotonic()
            press()
            arrived = self.stage.first_after(began)
            if arrived is None:
                print(f"{name}: no stop came: does the window have the keyboard?")
                return
            waits.append(arrived - began)

    def tell(self, report: Report, name: str, longest_ms: float) -> None:
        """Report the times."""
        waits = 1e3 * np.array(self.waits[name])
        report.row(
            name,
            presses=len(waits),
            median=(np.median(waits), "ms", 5.0),
            below_90=(np.percentile(waits, 90), "ms"),
            longest=(waits.max(), "ms", longest_ms),
        )


def work(presses: Presses, window: Any, block: Blocking | None, number: int) -> None:
    """Wait for the drive, then press."""
    run = presses.run
    while run.look().health.phase != "drive":
        time.sleep(0.1)
    time.sleep(3.0)
    if block:
        other = attached(run.bench.name)
        while len(presses.waits.get("stop from another process", ())) < number:
            block.asked.set()
            time.sleep(0.3)
            presses.repeat("SIGINT", lambda: os.kill(os.getpid(), signal.SIGINT), 8)
            presses.repeat("stop from another process", other.stop_motion, 8)
            time.sleep(BLOCKED_S / 5)
    else:
        keyboard = subprocess.Popen(["xdotool", "-"], stdin=subprocess.PIPE, text=True)
        assert keyboard.stdin is not None
        keyboard.stdin.write(f"windowfocus {int(window.winId())}\n")

        def press() -> None:
            assert keyboard.stdin is not None
            keyboard.stdin.write("key --delay 0 Escape\n")
            keyboard.stdin.flush()

        presses.repeat("Escape", press, number)
        keyboard.stdin.close()
    run.request_stop("measured")
    run.wait()


def measure(report: Report, presses: int = 100, *, blocked: bool = False) -> int:
    """Measure in a run with its window; 1 if a press had no effect."""
    stage = OutsideStage(10 / 57600, 0.01)
    with tempfile.TemporaryDirectory() as folder:
        settings = config.load(None, [*SETTINGS, *stage.settings])
        run = LaunchedRun(
            settings,
            Path(folder) / "stop.h5",
            pace=1.0,
            overwrite=False,
            module="benchmarks.kept_bench",
        )
        made = Presses(run, stage)

        def ready(window: Any) -> Callable[[], object]:
            return partial(work, made, window, Blocking(window) if blocked else None, presses)

        with acting_on_signals(run.request_stop):
            outcome = in_window(run, ready)
    stage.end()
    for name in made.waits:
        made.tell(report, name, 40.0 if blocked else 50.0)
    account(report, outcome)
    return int(any(len(waits) < presses for waits in made.waits.values()))


class Blocking:
    """Blocks the window's thread for ten seconds, once each time that it is asked."""

    def __init__(self, window: Any) -> None:
        self.asked = threading.Event()  # may be set by any thread
        self._timer = QTimer(window)
        self._timer.timeout.connect(self._look)
        self._timer.start(50)

    def _look(self) -> None:
        if self.asked.is_set():
            self.asked.clear()
            time.sleep(BLOCKED_S)
