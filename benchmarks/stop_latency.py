"""Milliseconds from a stop to the controller's stop command on the wire: ``python
benchmarks/stop_latency.py [STOPS]``.

The real driver of the SMC100 on an emulated controller whose line carries 57600 baud and which
thinks 10 ms about each answer, while another thread reads position and state every 50 ms. A stop
comes at a random moment of a move; its command has arrived with its last byte.
"""

from __future__ import annotations

import datetime
import platform
import random
import statistics
import sys
import threading
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from drivers.actuator_newport import Smc100
from drivers.clock import SampleClock
from drivers.emulators.newport import Controller
from drivers.emulators.serial_line import SerialLine
from drivers.emulators.stages import FreeStage
from drivers.errors import DeviceError
from drivers.settings import ActuatorSettings

POLL_S = 0.05


def measure(wire: str, stops: int) -> dict[str, list[float]]:
    """Seconds of each kind, one per stop; "dead line" once."""
    line = SerialLine(Controller(FreeStage()), wire, byte_s=10 / 57600, think_s=0.01)
    driver = Smc100(ActuatorSettings(port=line.start()), SampleClock(1000.0))
    driver.open()
    is_over, times = (
        threading.Event(),
        {name: [] for name in ("poll", "stop on the wire", "stop returns", "dead line is told")},
    )

    def poll() -> None:
        while not is_over.wait(POLL_S):
            began = time.monotonic()
            driver.position_m(), driver.is_moving()
            times["poll"].append(time.monotonic() - began)

    polling = threading.Thread(target=poll)
    polling.start()
    for n in range(stops):
        driver.move_to(13e-3 if n % 2 else 12e-3)
        time.sleep(random.uniform(0.0, 2 * POLL_S))
        began = time.monotonic()
        driver.stop()
        times["stop returns"].append(time.monotonic() - began)
        times["stop on the wire"].append(
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
        times["dead line is told"].append(time.monotonic() - began)
    try:
        driver.close()
    except DeviceError:  # it says that the stage may still move
        return times
    raise AssertionError("a dead line was closed without a word")


def main(stops: int) -> None:
    """Measure over each wire there is, and print."""
    print(f"{platform.machine()}, {platform.system()}, {datetime.date.today()}; {stops} stops, ms")
    for wire in ("pty", "tcp") if platform.system() != "Windows" else ("tcp",):
        for name, seconds in measure(wire, stops).items():
            print(
                f"{wire}  {name:20s} median {1e3 * statistics.median(seconds):6.2f}, worst"
                f" {1e3 * max(seconds):6.2f}"
            )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:2] or ["100"]))
