"""Time from a press of Escape in the window to the stop command on the actuator's line, during a
run at the camera's full rate. The bench has simulated forces and camera at 23.8 frames/s, 1600 x
1200, recorded and analysed with the traction of every frame, and the real driver of the SMC100 on
an emulated controller with a line of 57600 baud. The key is pressed at random moments through the X
server; a command has arrived with the last byte of `ST`.

    xvfb-run -a python -m benchmarks stop_key [PRESSES]

It needs an X display and xdotool. So that one run can be stopped many times, its end is not called:
the actuator is stopped as always, then sent on.
"""

from __future__ import annotations

import random
import subprocess
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import numpy as np

from app.gui.start import run_window
from app.records import Phase
from benchmarks.report import Report
from benchmarks.simulated import Experiment, account, experiment

SUBJECT = "Stop from the keyboard"
SETTINGS = ["camera.divisor=42", "actuator.source=smc100-emulated", "run.travel=2000"]
SETTINGS += ["limits.travel=3000", "run.background_time=1"]
LONGEST_S = 5.0


def keep_running(run: Any) -> Any:
    """Let the run only stop its actuator when something asks for its end; a function that lets it
    end again.
    """
    run._experiment._drive = lambda now: Phase.DRIVE
    ending, call = run._ending, run._ending.call
    ending.call = lambda reason, failed: run._stop_actuator()

    def restore() -> None:
        ending.call = call

    return restore


def press(made: Experiment, window: Any, presses: int, waits: list[float]) -> None:
    """Wait for the drive, then press the key, note the time and send the stage on."""
    run, stage = made.run, made.bench.actuator
    while run.health().phase != "drive":
        time.sleep(0.1)
    restore = keep_running(run)
    line, target = stage._far_end, stage.position_m() + 1.5e-3
    line.byte_s, line.think_s = 10 / 57600, 0.01
    keyboard = subprocess.Popen(["xdotool", "-"], stdin=subprocess.PIPE, text=True)
    keyboard.stdin.write(f"windowfocus {int(window.winId())}\n")
    time.sleep(3.0)
    for _ in range(presses):
        time.sleep(random.uniform(0.2, 0.6))
        before, began = len(line.arrivals), time.monotonic()
        keyboard.stdin.write("key --delay 0 Escape\n")
        keyboard.stdin.flush()
        stops: list[float] = []
        while not stops and time.monotonic() - began < LONGEST_S:
            time.sleep(0.001)
            stops = [when for when, what in line.arrivals[before:] if what == b"1ST"]
        if not stops:
            print(f"no stop came within {LONGEST_S:g} s: does the window have the keyboard?")
            break
        waits.append(stops[0] - began)
        time.sleep(0.05)
        stage.move_to(target)
    keyboard.stdin.close()
    restore()
    run.request_stop("measured")
    run.wait()
    window.close_after_run()


def measure(report: Report, presses: int = 100) -> int:
    """Measure in a run with its window; 1 if a press had no effect."""
    waits: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        made = experiment(Path(folder) / "stop.h5", SETTINGS)

        def ready(window: Any) -> None:
            threading.Thread(target=press, args=(made, window, presses, waits), daemon=True).start()

        run_window(lambda: made.run, autostart=True, on_ready=ready)
    outcome = made.run.outcome()
    assert outcome is not None
    report.add("presses", len(waits))
    if waits:
        report.add("median", 1e3 * np.median(waits), "ms")
        report.add("90 % below", 1e3 * np.percentile(waits, 90), "ms")
        report.add("longest", 1e3 * max(waits), "ms", at_most=50)
    account(report, outcome)
    return int(len(waits) < presses)
