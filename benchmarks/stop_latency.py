"""Time from a call of `stop` to the stop command on the controller's line, in the real driver of
the SMC100. Its emulated controller takes 10 ms over each answer on a line of 57600 baud, while
another thread asks for position and state every 50 ms. The stops come at random moments of a move;
a command has arrived with its last byte.

A strict controller ignores what follows the end of a command in the same transfer, for 4 ms.

    python -m benchmarks stop_latency [STOPS]
"""

from __future__ import annotations

import random
import sys
import threading
import time
from collections import defaultdict

from benchmarks.report import Report
from drivers.clock import SampleClock
from drivers.emulators.newport import Controller
from drivers.emulators.serial_line import SerialLine
from drivers.errors import DeviceError
from drivers.settings import ActuatorSettings
from drivers.stages.newport_stage import Smc100
from tests.free_stage import FreeStage

SUBJECT = "Stopping the actuator"
POLL_S = 0.05
COMMAND = "stop command on the line"
STOP_MS = 50.0  # the longest time that is promised for it


def stop_often(wire: str, stops: int, deaf_s: float) -> dict[str, list[float]]:
    """Seconds of each step, one value per stop; the failure of the line happens once."""
    line = SerialLine(Controller(FreeStage()), wire, byte_s=10 / 57600, think_s=0.01, deaf_s=deaf_s)
    driver = Smc100(ActuatorSettings(port=line.start()), SampleClock(1000.0))
    driver.open()
    is_over, times = threading.Event(), defaultdict(list)

    def poll() -> None:
        while not is_over.wait(POLL_S):
            began = time.monotonic()
            driver.position_m(), driver.is_moving()
            times["position and state"].append(time.monotonic() - began)

    polling = threading.Thread(target=poll)
    polling.start()
    for n in range(stops):
        driver.move_to(13e-3 if n % 2 else 12e-3)
        time.sleep(random.uniform(0.0, 2 * POLL_S))
        began = time.monotonic()
        driver.stop()
        times["return of stop()"].append(time.monotonic() - began)
        times[COMMAND].append(
            next(when for when, what in line.arrivals if when > began and what == b"1ST") - began
        )
        while driver.is_moving():
            time.sleep(0.01)
    is_over.set()
    polling.join()
    driver.move_to(20e-3)
    line.cut()
    began = time.monotonic()
    try:
        driver.is_moving()
    except DeviceError:
        times["error on a cut line"].append(time.monotonic() - began)
    try:
        driver.close()
    except DeviceError:  # its message says that the stage may still move
        return times
    raise AssertionError("closing the driver on a cut line raised no error")


def measure(report: Report, stops: int = 100) -> None:
    """Measure over a pseudo-terminal, where there is one, and over a network port."""
    for wire in ("tcp",) if sys.platform == "win32" else ("pty", "tcp"):
        for kind, deaf_s in ("", 0.0), (", strict", 0.004):
            for name, seconds in stop_often(wire, stops, deaf_s).items():
                bound = STOP_MS if name == COMMAND else None
                report.times(f"{name} ({wire}{kind})", seconds, bound)
