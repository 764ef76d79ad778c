"""The solver of the elasto-plastic contact under load: its digits, its time per step, and what the
second component of the traction changes on a grid. P = 0.5 N, nu = 0.5, mu = 0.93, L = 0.8 um.
Times are processor times of one thread, so that a busy machine counts little.

    python -m benchmarks loading_solver [--cells 128]

Set OMP_NUM_THREADS=1. `benchmarks simulation_trade` weighs the errors of all grids against their
times.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from analysis.mechanics.loading import AxisymmetricLoading
from benchmarks.inversion_trade import CONTACT
from benchmarks.report import Report
from tests.mechanics.loading_grid import GridLoading

SUBJECT = "Loading solver"
SHIFTS = np.array([0.01, 0.1, 0.3, 0.6, 0.9, 1.0, 1.3]) * CONTACT.full_shift


def timed(step: Callable[..., Any], *arguments: object) -> tuple[float, Any]:
    """Seconds of a step, and its result."""
    start = time.process_time()
    result = step(*arguments)
    return time.process_time() - start, result


def measure(report: Report, *, cells: int = 128) -> None:
    """Digits, then times, and the forces on the grid."""
    exact = AxisymmetricLoading(CONTACT)
    report.table("Largest relative error of Q against 128 modes, D/delta_max from 0.01 to 1.3")
    best = [AxisymmetricLoading(CONTACT, 128).at_block(D).Q for D in SHIFTS]
    for modes in (16, 32, 64, 256):
        found = [AxisymmetricLoading(CONTACT, modes).at_block(D).Q for D in SHIFTS]
        report.add(f"{modes} modes", np.abs(np.divide(found, best) - 1).max(), digits=2)
    report.table("Time of a step")
    times, state = [], exact.rest
    for step in exact.table(201)[1:]:
        seconds, state = timed(exact.advance, state, step.D)
        times.append(seconds)
    report.times("axisymmetric, 64 modes, next of 200 steps", times)
    for coupled, components in ((False, "one component"), (True, "both components")):
        name = f"grid of {cells} x {cells}, {components}"
        loading = GridLoading.of_sphere(CONTACT, cells, coupled=coupled)
        loading.driven(1e-7)
        shifts = np.linspace(0.05, 1.2, 24) * CONTACT.full_shift
        spent, states = zip(*(timed(loading.driven, D) for D in shifts), strict=True)
        report.times(name, spent)
        error = max((s.Q / exact.at_block(s.D).Q - 1 for s in states), key=abs)
        report.add(name, error, column="Q against axisymmetric", digits=2)
