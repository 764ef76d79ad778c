"""A process that sends a stage off and is killed while it moves, by which `slipscope check-driver`
sees whether the move ends by itself.
"""

from __future__ import annotations

import time
from typing import Any

from app.processes.starting import end_with_parent, payload, report_ready
from app.settings.sections import Config
from app.system.errors import in_full
from drivers.clock import SampleClock
from drivers.errors import DeviceError
from drivers.sources import driver

MOVES = "it moves"


def new_device(kind: str, config: Config) -> Any:
    """A device of a kind by itself, with a clock of its own."""
    settings = getattr(config, kind)
    clock = SampleClock(float(config.forces.sample_rate))
    return driver(kind, settings.source).make(settings, clock)


def main() -> None:
    """Begin the move, say so, and wait for the end."""
    config, target_m, velocity_m_s = payload()
    try:
        stage = new_device("actuator", config)
        stage.open()
        stage.set_velocity(velocity_m_s)
        stage.move_to(target_m)
    except Exception as error:
        wrong = f"{in_full(error)}; a driver raises DeviceError only"
        report_ready(error if isinstance(error, DeviceError) else wrong)
        return
    report_ready(MOVES)
    end_with_parent()
    while True:
        time.sleep(1.0)
