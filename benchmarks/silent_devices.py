"""What happens when one device of the emulated bench falls silent, or its driver does not return
from a call, 1 s into a drive of 60 um: the time until the stop is on the controller's line, until
the run has ended, how far the stage went beyond what was asked, and how many samples and frames
were lost, but for those of a camera that gives none.

    python -m benchmarks silent_devices
"""

from __future__ import annotations

import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from app.records.record_types import Phase
from app.runs import live
from app.settings import config
from benchmarks.report import Report

SUBJECT = "Devices that fall silent"
SETTINGS = (
    "camera.width=480", "camera.height=360", "camera.pixel=16", "run.normal_force=0.1",
    "run.background_time=0.2", "sim.press_time=0.3", "run.settle_time=0.2",
    "run.reference_time=0.4", "run.travel=60", "stress.method=none",
)  # fmt: skip
LONG_S = 30.0


def measure(report: Report) -> None:
    """Measure each device, the way to it and its driver."""
    gate = threading.Event()

    def stuck(*_: Any, **__: Any) -> None:
        gate.wait(LONG_S)

    parts: dict[str, Callable[[Any], None]] = {
        "server of the board": lambda b: setattr(b.forces.device.server.board, "check", stuck),
        "driver of the board": lambda b: setattr(b.forces.device, "read", stuck),
        "controller": lambda b: setattr(b.actuator._far_end, "is_mute", True),
        "driver of the controller": lambda b: setattr(b.actuator, "position_m", stuck),
        "camera": lambda b: setattr(b.camera, "_follows", False),
        "driver of the camera": lambda b: setattr(b.camera, "read", stuck),
    }
    for name, silence in parts.items():
        gate.clear()
        with tempfile.TemporaryDirectory() as folder:
            one(report, name, silence, Path(folder) / "x.h5")
        gate.set()


def one(report: Report, name: str, silence: Callable[[Any], None], path: Path) -> None:
    """One run in which one part falls silent."""
    run = live.make_run(config.load(Path("hil-emulated"), SETTINGS), path, pace=1.0)
    bench: Any = run._bench
    run.start()
    while run.health().phase != Phase.DRIVE and run.outcome() is None:
        time.sleep(0.005)
    time.sleep(1.0)
    line, began = bench.actuator._far_end, time.monotonic()
    silence(bench)
    outcome = run.wait(LONG_S)
    ended = time.monotonic() - began
    assert outcome is not None
    stopped = next(when for when, what in line.arrivals if when > began and what == b"1ST") - began
    lost = outcome.counts.frames_lost * ("camera" not in name) + outcome.counts.samples_lost
    report.row(
        name,
        stop_on_the_line=(stopped, "s", 1.0),
        run_ended=(ended, "s"),
        travel_beyond=(max(0.0, bench.world.stage_m() - 60e-6) * 1e6, "um", 0.0),
        lost=lost,
    )
    report.add(name, outcome.reason, column="told")
