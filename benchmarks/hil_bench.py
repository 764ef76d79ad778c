"""The emulated bench at full size for a minute: is every trigger, every sample and every injected
loss where it was?

``python benchmarks/hil_bench.py [SECONDS] [DIVISOR...]``: by default 60 s at 8 and at 23.8
frames/s. Real nidaqmx over gRPC, real pypylon fired by the emulated board's pulses, real serial
driver; 1600 x 1200, recorded and analysed, without a window. Each rate is run as it is and with
losses injected at random triggers. Afterwards each recorded picture is compared, to the bit, with
the simulated world at the sample that the file gives it: a frame that was given another trigger's
number can not agree.
"""

from __future__ import annotations

import datetime
import platform
import random
import sys
import tempfile
from pathlib import Path
from typing import Any

import h5py
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from app import config, live
from drivers.sim.images import Renderer

BEFORE_DRIVE_S = 7.5
LOSSES = 12


def injected(seconds: float, divisor: int) -> list[str]:
    """Faults at random triggers, far enough apart to be told apart: the half of them triggers lost,
    the others images lost.
    """
    draw, triggers = random.Random(divisor), int(seconds * 1000 / divisor)
    places = draw.sample(range(20, triggers - 20, 4), LOSSES)
    return [
        f"{'lost-trigger' if n % 2 else 'lost-frame'} {place} {draw.choice((1, 1, 2, 3))}"
        for n, place in enumerate(sorted(places))
    ]


def run(path: Path, seconds: float, divisor: int, faults: list[str]) -> Any:
    """The bench after one run."""
    travel = (seconds - BEFORE_DRIVE_S) * 4.9
    overrides = [f"camera.divisor={divisor}", f"run.travel={travel:.0f}", f"sim.faults={faults}"]
    overrides += [f"limits.travel={max(500, travel + 10):.0f}"]
    made = live.make_run(config.load(Path("hil-emulated"), overrides), path, pace=1.0)
    made.start()
    outcome = made.wait()
    assert outcome is not None
    return made, outcome


def tell(path: Path, made: Any, outcome: Any, faults: list[str]) -> None:
    """Compare the file with the world."""
    world, counts = made._bench.world, outcome.counts
    with h5py.File(path) as f:
        group, data = f["/entry/triggers"], f["/entry/instrument/camera/data"]
        index, sample, row = (group[name][:] for name in ("index", "sample", "image"))
        renderer, half = Renderer(world.scenario), world.scenario.exposure_samples // 2
        wrong = [
            int(n)
            for n, s, r in zip(index, sample, row, strict=True)
            if r >= 0
            and not np.array_equal(data[r], renderer.image(world.state(int(s) + half), int(n)))
        ]
        lost = set(index[row < 0].tolist())
        samples = len(f["/entry/forces/shear_force"])
    asked: set[int] = set()
    for fault in faults:
        _, first, count = fault.split()
        asked |= set(range(int(first), int(first) + int(count)))
    asked &= set(range(counts.triggers))
    print(
        f"  {outcome.state}: {outcome.reason}; {outcome.resources['cpu_s']:.0f} s of CPU in"
        f" {outcome.resources['wall_s']:.0f} s"
    )
    print(f"  samples: {counts.samples} read, {counts.samples_lost} lost, {samples} in the file")
    print(
        f"  triggers: {counts.triggers}; {counts.frames_received} frames, {counts.frames_lost}"
        f" lost; analysed {counts.frames_analysed}"
    )
    print(
        f"  losses: {len(asked)} injected, {len(asked & lost)} found at their index,"
        f" {len(lost - asked)} that were not injected"
    )
    print(
        f"  frames that do not show the world at their sample: {len(wrong)} of"
        f" {counts.frames_recorded}",
        flush=True,
    )


def main(seconds: float, divisors: list[int]) -> None:
    """Run and tell."""
    print(f"{platform.machine()}, {platform.system()}, {datetime.date.today()}; {seconds:g} s each")
    for divisor in divisors:
        for faults in ([], injected(seconds, divisor)):
            print(
                f"{1000 / divisor:.1f} frames/s,"
                f" {'losses injected' if faults else 'nothing injected'}:",
                flush=True,
            )
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "hil.h5"
                made, outcome = run(path, seconds, divisor, faults)
                tell(path, made, outcome, faults)


if __name__ == "__main__":
    main(
        float(sys.argv[1]) if len(sys.argv) > 1 else 60.0,
        [int(n) for n in sys.argv[2:]] or [125, 42],
    )
