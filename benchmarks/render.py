"""Processor time of a simulated picture of 1600 x 1200 pixels, and how far the fast renderer is
from the exact one. The difference is given as an apparent displacement: the least-squares fit, over
boxes of 20 px, of the gradient of the exact picture to the difference of the two pictures.

    python -m benchmarks render
"""

from __future__ import annotations

import statistics
import time

import numpy as np
from scipy import ndimage

from benchmarks.report import Report
from drivers.sim.images import Renderer
from drivers.sim.scenario import Scenario
from drivers.sim.settings import SimSettings
from drivers.sim.truth import TrueState
from drivers.sim.world import World

SUBJECT = "Simulated pictures"
SLOPE = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
"""Derivative by central differences of the eighth order: those of the second order make the slope
of such fine speckle 20 % too small.
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


def states() -> dict[str, TrueState]:
    """Three moments of a drive."""
    world = World(Scenario(sim=SimSettings(press_time=0.0), press_samples=1), pace=None)
    world.start()
    world.advance(2)
    world.move(300e-6, 5e-6)
    world.advance(40_000)
    samples = {"pressed": 2, "partial slip": 15_000, "full sliding": 40_000}
    return {name: world.state(sample) for name, sample in samples.items()}


def picture_ms(renderer: Renderer, state: TrueState, other: TrueState, times: int) -> float:
    """Median processor time of a picture in milliseconds, each after one of another state: what has
    not moved is not drawn again.
    """
    spent = []
    for _ in range(times + 1):  # the first one warms up
        renderer.image(other, 0)
        began = time.process_time()
        renderer.image(state, 0)
        spent.append(time.process_time() - began)
    return 1e3 * statistics.median(spent[1:])


def measure(report: Report) -> None:
    """Compare the two renderers."""
    fast, exact = (Renderer(Scenario(sim=SimSettings(renderer=name))) for name in ("fast", "exact"))
    moments = states()
    other = moments["full sliding"]
    for name, state in moments.items():
        truth = exact.grey(state, exact=True)
        shift = apparent_shift_px(truth, fast.grey(state, exact=False))
        report.row(
            name,
            fast=(picture_ms(fast, state, other, 25), "ms"),
            exact=(picture_ms(exact, state, other, 3), "ms"),
            rms_difference=(np.sqrt(np.mean(shift**2)), "px"),
            largest_difference=(np.abs(shift).max(), "px"),
        )
        other = state
