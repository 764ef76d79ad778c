"""CPU time of a simulated picture at 1600 x 1200, and how far the fast renderer is from the exact
one.

Run from the root of the tree: ``python -m benchmarks.render``. The difference is an apparent
displacement: least squares over boxes of 20 px, the gradient of the exact picture against the
difference of the two.
"""

from __future__ import annotations

import datetime
import os
import platform
import statistics
import time
from collections.abc import Callable

import numpy as np
from scipy import ndimage

from drivers.sim.images import Renderer
from drivers.sim.scenario import Scenario
from drivers.sim.settings import SimSettings
from drivers.sim.truth import State
from drivers.sim.world import World

SLOPE = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
"""Derivative by central differences of the eighth order: speckle this fine is 20 % too flat for the
second order.
"""


def apparent_shift_px(reference, picture, box=20):
    """Shift (x, y) of `picture` relative to `reference` in every whole box, pixels."""
    gy, gx = (ndimage.correlate1d(reference, SLOPE, axis) for axis in (0, 1))
    difference = picture - reference
    rows, columns = (n // box for n in reference.shape)

    def total(a):
        return a[: rows * box, : columns * box].reshape(rows, box, columns, box).sum((1, 3))

    xx, xy, yy = total(gx * gx), total(gx * gy), total(gy * gy)
    x, y = -total(gx * difference), -total(gy * difference)
    return np.stack([yy * x - xy * y, xx * y - xy * x]) / (xx * yy - xy * xy)


def states() -> dict[str, State]:
    """A drive: pressed, partial slip, full sliding."""
    world = World(Scenario(sim=SimSettings(press_time=0.0), press_samples=1), pace=None)
    world.start()
    world.advance(2)
    world.move(300e-6, 5e-6)
    world.advance(40_000)
    return {
        "pressed": world.state(2),
        "partial slip": world.state(15_000),
        "sliding": world.state(40_000),
    }


def cpu_ms(work: Callable[[], object], times: int) -> float:
    """Median CPU time of `work`, after one call that warms it."""
    work()
    spent = []
    for _ in range(times):
        began = time.process_time()
        work()
        spent.append(time.process_time() - began)
    return 1e3 * statistics.median(spent)


def main() -> None:
    """Print the table."""
    fast, exact = (Renderer(Scenario(sim=SimSettings(renderer=name))) for name in ("fast", "exact"))
    print(
        f"{datetime.date.today()}  {platform.processor() or platform.machine()}, {os.cpu_count()}"
        f" CPUs, Python {platform.python_version()}"
    )
    print(
        "state          fast ms  exact ms   apparent shift fast - exact, px: rms   worst box of 20"
    )
    for name, state in states().items():
        truth = exact.grey(state, exact=True)
        shift = apparent_shift_px(truth, fast.grey(state, exact=False))
        times = (
            cpu_ms(lambda s=state: fast.image(s, 0), 25),
            cpu_ms(lambda s=state: exact.image(s, 0), 3),
        )
        print(
            f"{name:14s} {times[0]:7.1f}  {times[1]:8.0f}   {np.sqrt(np.mean(shift**2)):38.5f}  "
            f" {np.abs(shift).max():.4f}"
        )


if __name__ == "__main__":
    main()
