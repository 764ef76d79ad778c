"""Small runs of the simulated bench that slide, under several loads: seconds each."""

from __future__ import annotations

from pathlib import Path

from short_run import SMALL, TRACTION, without_budget
from whole_runs import recorded

ROUGH = (*SMALL, TRACTION, "sim.law=elasto-plastic", "sim.pressure=greenwood-tripp")
# the same, seen and pressed well enough for notes on faults of the bench
WELL_SEEN = (
    *ROUGH,
    "camera.width=640",
    "camera.height=480",
    "camera.pixel=10",
    "run.background_time=1",
    "run.reference_time=1.5",
    "run.shear_tolerance=0.1",
    "run.settle_tolerance=0.1",
    "sim.press_time=1.2",
)
LOADS = 0.06, 0.09


def record(path: Path, *settings: str) -> Path:
    """A session of a rough contact that slides, with a traction, at `path`."""
    with without_budget():  # which an analysis computes
        recorded(path, *ROUGH, *settings)
    return path
