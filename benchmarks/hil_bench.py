"""The emulated bench at full size: the real drivers of NI DAQ, Basler and SMC100 against emulators
that see one simulated world, 1600 x 1200 pixels, recorded and analysed without a window. Each rate
is run as it is and with losses injected at random triggers. Afterwards every recorded picture is
compared, to the bit, with the simulated world at the sample that the file gives it, so that a frame
under another trigger's number cannot go unnoticed.

    python -m benchmarks hil_bench [SECONDS] [DIVISOR...]

By default 60 s at 8 and at 23.8 frames/s (a trigger every 125 and every 42 samples).
"""

from __future__ import annotations

import random
import tempfile
from collections.abc import Sequence
from pathlib import Path

import h5py
import numpy as np

from app.records.record_types import Outcome
from benchmarks.report import Report
from benchmarks.simulated import account, experiment, middle_of_exposure
from drivers.sim.images import Renderer
from drivers.sim.world import World

SUBJECT = "Emulated bench"
BEFORE_DRIVE_S = 7.5
LOSSES = 12


def injected(seconds: float, divisor: int) -> list[str]:
    """Faults at random triggers that are far enough apart to be told from each other: half of them
    lost triggers, half lost images.
    """
    draw, triggers = random.Random(divisor), int(seconds * 1000 / divisor)
    places = draw.sample(range(20, triggers - 20, 4), LOSSES)
    return [
        f"{'lost-trigger' if n % 2 else 'lost-frame'} {place} {draw.choice((1, 1, 2, 3))}"
        for n, place in enumerate(sorted(places))
    ]


def compare(
    report: Report, column: str, path: Path, world: World, outcome: Outcome, faults: list[str]
) -> None:
    """Report the account of the run, and how far the file is from the world."""
    account(report, outcome, {"samples lost": 0}, column)
    renderer, wrong = Renderer(world.scenario), 0
    with h5py.File(path) as file:
        triggers, images = file["/entry/triggers"], file["/entry/instrument/camera/data"]
        index, sample, row = (triggers[name][:] for name in ("index", "sample", "image"))
        for n, s, r in zip(index.tolist(), sample.tolist(), row.tolist(), strict=True):
            if r >= 0:
                shown = renderer.image(world.state(middle_of_exposure(world, s)), n)
                wrong += not np.array_equal(images[r], shown)
    lost = set(index[row < 0].tolist())
    places = [map(int, fault.split()[1:]) for fault in faults]
    expected = {n for first, count in places for n in range(first, first + count)}
    expected &= set(index.tolist())
    for name, value, at_most in (
        ("losses injected", len(expected), None),
        ("losses injected and not recorded at their trigger", len(expected - lost), 0),
        ("losses that were not injected", len(lost - expected), 0),
        ("frames that do not show the world at their sample", wrong, 0),
    ):
        report.add(name, value, at_most=at_most, column=column)


def measure(report: Report, seconds: float = 60.0, divisors: Sequence[int] = (125, 42)) -> None:
    """Run each rate twice and compare."""
    travel = (seconds - BEFORE_DRIVE_S) * 4.9
    for divisor in divisors:
        for faults in ([], injected(seconds, divisor)):
            column = f"{1000 / divisor:.1f} frames/s{', with losses' if faults else ''}"
            overrides = [f"run.travel={travel:.0f}", f"limits.travel={max(500, travel + 10):.0f}"]
            overrides += [f"camera.divisor={divisor}", f"sim.faults={faults}"]
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "hil.h5"
                made = experiment(path, overrides, bench="hil-emulated")
                outcome = made.outcome()
                compare(report, column, path, made.bench.world, outcome, faults)
