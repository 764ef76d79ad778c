"""What the NI driver and its emulated board cost: ``python benchmarks/ni_daq.py [SECONDS]``.

Driver, NI's package, gRPC, emulated board and simulated world in one process, 1 kHz in blocks of 50
samples, in real time. The share of one processor is that of all of them together; the last line is
the board and the world alone, with nobody reading.
"""

from __future__ import annotations

import datetime
import platform
import statistics
import sys
import threading
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from drivers.clock import SampleClock
from drivers.emulators.ni import EmulatedNiForces
from drivers.errors import DeviceError
from drivers.protocols import TriggerTrain
from drivers.settings import ForceSettings
from drivers.sim.scenario import Scenario
from drivers.sim.world import World


def opened(counter: str) -> EmulatedNiForces:
    """A driver that samples, eight triggers a second."""
    scenario = Scenario(forces=ForceSettings(exposure_counter=counter))
    forces = EmulatedNiForces(scenario.forces, SampleClock(1000.0), World(scenario))
    forces.open()
    forces.start(TriggerTrain(0, 125))
    return forces


def share_of_a_processor(seconds: float, work: object = None) -> float:
    """Processor time over wall time while `work` is done again and again, or nothing is."""
    wall, used = time.monotonic(), time.process_time()
    while time.monotonic() - wall < seconds:
        work() if callable(work) else time.sleep(seconds)
    return (time.process_time() - used) / (time.monotonic() - wall)


def read_times(forces: EmulatedNiForces, n: int) -> list[float]:
    """Seconds of reads whose samples are all there: what is between board and program."""
    while forces.backlog() < forces.block_samples * n:
        time.sleep(0.05)
    times = []
    for _ in range(n):
        began = time.perf_counter()
        forces.read(1.0)
        times.append(time.perf_counter() - began)
    return times


def seconds_until_told(forces: EmulatedNiForces) -> float:
    """From the death of the server to the error of a read that waits."""
    assert forces.server is not None
    threading.Timer(0.22, forces.server.kill).start()
    try:
        while True:
            began = time.monotonic()
            forces.read(10.0)
    except DeviceError:
        return time.monotonic() - began


def main(seconds: float) -> None:
    """Measure without and with a counter of exposures, and print."""
    print(f"{platform.machine()}, {platform.system()}, {datetime.date.today()}; {seconds:g} s each")
    for counter in ("", "ctr1"):
        forces = opened(counter)
        share = share_of_a_processor(seconds, lambda forces=forces: forces.read(1.0))
        times = read_times(forces, 50)
        median, worst = 1e3 * statistics.median(times), 1e3 * max(times)
        name = "with a counter" if counter else "two sensors"
        print(
            f"{name:14s}  {share:6.1%} of a processor, a read {median:.2f} ms, worst {worst:.2f} ms"
        )
        print(
            f"  server killed: told {1e3 * seconds_until_told(forces):.0f} ms after the read began"
            " (0 to 50 of them before the kill)"
        )
        forces.close()
    forces = opened("")
    print(f"board and world  {share_of_a_processor(seconds):6.1%} of a processor")
    forces.close()


if __name__ == "__main__":
    main(*map(float, sys.argv[1:2] or ["10"]))
