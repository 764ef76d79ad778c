"""Processor time of a simulated picture of 1600 x 1200 pixels, and how far the fast renderer is
from the exact one. The difference is given as an apparent displacement: the least-squares fit, over
boxes of 20 px, of the gradient of the exact picture to the difference of the two pictures.

    python -m benchmarks render
"""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable

import numpy as np

from app.tradeoff.simulation import apparent_shift_px, states
from benchmarks.report import Report
from drivers.sim.images import Renderer
from drivers.sim.scenario import Scenario
from drivers.sim.settings import SimSettings

SUBJECT = "Simulated pictures"


def cpu_ms(work: Callable[[], object], times: int) -> float:
    """Median processor time of `work` in milliseconds, after one call that warms it up."""
    work()
    spent = []
    for _ in range(times):
        began = time.process_time()
        work()
        spent.append(time.process_time() - began)
    return 1e3 * statistics.median(spent)


def measure(report: Report) -> None:
    """Compare the two renderers."""
    fast, exact = (Renderer(Scenario(sim=SimSettings(renderer=name))) for name in ("fast", "exact"))
    for name, state in states().items():
        truth = exact.grey(state, exact=True)
        shift = apparent_shift_px(truth, fast.grey(state, exact=False))
        report.row(
            name,
            fast=(cpu_ms(lambda s=state: fast.image(s, 0), 25), "ms"),
            exact=(cpu_ms(lambda s=state: exact.image(s, 0), 3), "ms"),
            rms_difference=(np.sqrt(np.mean(shift**2)), "px"),
            largest_difference=(np.abs(shift).max(), "px"),
        )
