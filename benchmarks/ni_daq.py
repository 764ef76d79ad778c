"""Processor time of the NI driver and its emulated board, and the time of one read. The driver,
NI's package, gRPC, the emulated board and the simulated world share one process, which samples at 1
kHz in blocks of 50 in real time; the share of a core is that of all of them together.

    python -m benchmarks ni_daq [SECONDS]
"""

from __future__ import annotations

import time

import numpy as np

from benchmarks.report import Report
from drivers.clock import SampleClock
from drivers.emulators.ni import EmulatedNiForces
from drivers.protocols import TriggerTrain
from drivers.settings import CameraSettings, ForceSettings
from drivers.sim.scenario import Scenario
from drivers.sim.world import World

SUBJECT = "NI driver"
READS = 50


def opened(counter: str) -> EmulatedNiForces:
    """A driver that samples and sends eight triggers a second."""
    settings = ForceSettings(exposure_counter=counter)
    scenario = Scenario(forces=settings, camera=CameraSettings(width=64, height=64))
    clock = SampleClock(float(settings.sample_rate))
    forces = EmulatedNiForces(settings, clock, World(scenario, pace=1.0))
    forces.open()
    forces.start(TriggerTrain(0, 125))
    return forces


def share_of_a_core(seconds: float, forces: EmulatedNiForces) -> float:
    """Processor time over wall time, in %, while the samples are read."""
    wall, used = time.monotonic(), time.process_time()
    while time.monotonic() - wall < seconds:
        forces.read(1.0)
    return 100 * (time.process_time() - used) / (time.monotonic() - wall)


def read_times(forces: EmulatedNiForces) -> list[float]:
    """Seconds of reads whose samples have all been taken before: the transfer alone."""
    while forces.backlog() < forces.block_samples * READS:
        time.sleep(0.05)
    times = []
    for _ in range(READS):
        began = time.perf_counter()
        forces.read(1.0)
        times.append(time.perf_counter() - began)
    return times


def measure(report: Report, seconds: float = 10.0) -> None:
    """Measure without and with a counter of exposures."""
    for counter, name in (("", "two sensors"), ("ctr1", "two sensors and the exposure counter")):
        forces = opened(counter)
        share = share_of_a_core(seconds, forces)
        report.row(
            name,
            share_of_a_core=(share, "%"),
            read_of_50_samples=(1e3 * np.median(read_times(forces)), "ms"),
        )
        forces.close()
