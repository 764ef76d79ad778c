"""From a key on the keyboard to the stop command on the actuator's wire, in the real window, during
a run at the camera's full rate.

``xvfb-run -a python benchmarks/stop_key.py [PRESSES]`` needs an X display and xdotool. The bench:
simulated forces and camera at 23.8 frames/s, 1600 x 1200, recorded and analysed with the traction
of every frame, and the real driver of the SMC100 on an emulated controller, whose line carries
57600 baud. Escape is pressed at random moments through the X server; the time is taken when the
last byte of ``ST`` arrives. So that one run is stopped again and again, its end is not called: the
actuator is stopped as ever, then sent on.
"""

from __future__ import annotations

import datetime
import platform
import random
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from app import config, live
from app.gui.start import run_window
from app.records import Phase

SETTINGS = (
    "camera.divisor=42",
    "actuator.source=smc100-emulated",
    "run.travel=2000",
    "limits.travel=3000",
    "run.background_time=1",
)


def press(run: Any, window: Any, presses: int, waits: list[float]) -> None:
    """Wait for the drive, then press, time, and send the stage on."""
    while run.health().phase != "drive":
        time.sleep(0.1)
    stage = run._bench.actuator
    run._experiment._drive = lambda now: Phase.DRIVE
    call = run._ending.call
    run._ending.call = lambda reason, failed: run._stop_actuator()
    line, target = stage._far_end, stage.position_m() + 1.5e-3
    line.byte_s, line.think_s = 10 / 57600, 0.01
    keyboard = subprocess.Popen(["xdotool", "-"], stdin=subprocess.PIPE, text=True)
    keyboard.stdin.write(f"windowfocus {int(window.winId())}\n")
    time.sleep(3.0)
    for _ in range(presses):
        time.sleep(random.uniform(0.2, 0.6))
        known = len(line.arrivals)
        began = time.monotonic()
        keyboard.stdin.write("key --delay 0 Escape\n")
        keyboard.stdin.flush()
        while not any(what == b"1ST" for _, what in line.arrivals[known:]):
            if time.monotonic() - began > 5:
                print("no stop came within 5 s: does the window have the keyboard?")
                window.close_after_run()
                return
            time.sleep(0.001)
        waits.append(next(when for when, what in line.arrivals[known:] if what == b"1ST") - began)
        time.sleep(0.05)
        stage.move_to(target)
    keyboard.stdin.close()
    run._ending.call = call
    run.request_stop("measured")
    run.wait()
    counts = run.outcome().counts
    print(
        f"meanwhile {counts.frames_analysed} of {counts.frames_received} frames were analysed,"
        f" {counts.frames_lost} lost"
    )
    window.close_after_run()


def main(presses: int) -> None:
    """Measure, and print."""
    waits: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        run = live.make_run(config.load(None, SETTINGS), Path(folder) / "stop.h5", pace=1.0)

        def ready(window: Any) -> None:
            threading.Thread(target=press, args=(run, window, presses, waits), daemon=True).start()

        run_window(lambda: run, autostart=True, on_ready=ready)
    waits.sort()
    print(
        f"{platform.machine()}, {platform.system()}, {datetime.date.today()}; {len(waits)} presses"
        " of Escape to ST on the wire, ms:"
    )
    nine = waits[int(0.9 * len(waits))]
    print(
        f"median {1e3 * statistics.median(waits):.1f}, 90 % below {1e3 * nine:.1f}, worst"
        f" {1e3 * waits[-1]:.1f}"
    )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2] or ["100"]))
