"""What the simulated bench costs, and how far it is from the exact solution: the mechanics of the
elasto-plastic contact, against both components of the traction on a grid of 512 x 512 cells (P =
0.5 N, mu = 0.93, L = 0.8 um, up to 0.9 a). The axisymmetric solutions, and those of one component,
leave out what varies with the angle: that is what is left of their errors with many modes or cells.

    python -m benchmarks simulation_trade

Run with OMP_NUM_THREADS=1. `benchmarks render` does the same for the pictures.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
from scipy import ndimage

from analysis.mechanics.loading import AxisymmetricLoading, LoadingState
from app.tradeoff.study import Figures, Study, Variant
from benchmarks.inversion_trade import CONTACT, PIXEL_M
from benchmarks.report import Report
from benchmarks.trade import report_study
from tests.mechanics.loading_grid import GridLoading, GridState

SUBJECT = "Simulation: speed against accuracy"
Array = np.ndarray

COLUMNS = {
    "displacement_px": "error of u_x (px)",
    "force_percent": "error of Q (%)",
    "traction_percent": "error of sigma (% of mu p0)",
    "cpu_ms": "CPU (ms)",
}
SHIFTS = 0.1, 0.3, 0.6, 0.9, 1.0, 1.2  # of the block, over that of full sliding for L = 0
FINEST = 512  # cells across the contact, of the solution that counts as exact
WITHIN = 0.9  # of a: beyond, the traction falls too steeply for any grid
MODES, CELLS = (4, 8, 16, 32, 64, 128), (16, 32, 64, 128, 256)
Sampled = tuple[Array, Array, float]
"""u_x (m) and traction (Pa) at the sample points of the contact, and Q (N)."""


def _points() -> tuple[Array, Array]:
    """Distances from the centre and angles of the sample points, shape (25, 9)."""
    r, angle = np.linspace(0, WITHIN * CONTACT.a, 25), np.linspace(0, np.pi / 2, 9)
    return r[:, None] + 0 * angle, 0 * r[:, None] + angle


def _round(state: LoadingState) -> Sampled:
    r, angle = _points()
    g0, g2 = state.displacement(r)
    return state.D - g0 - g2 * np.cos(2 * angle), state.traction(r), state.Q


def _on_grid(state: GridState, cells: int) -> Sampled:
    r, angle = _points()
    pitch = 2 * CONTACT.reach / (cells - 2)
    place = np.stack([r * np.sin(angle), r * np.cos(angle)]) / pitch + (cells - 1) / 2
    planes = (a if a.ndim == 2 else a[0] for a in (state.s, state.sigma))
    s, sigma = (ndimage.map_coordinates(a, place, order=3) for a in planes)
    return s, sigma, state.Q


class Simulating:
    """Measures solvers, against both components of the traction on a grid of
    `finest` cells.
    """

    def __init__(self, finest: int) -> None:
        self._finest = finest

    def measure(self, variant: Variant) -> Figures:
        """The figures of a variant, in the order of `COLUMNS`."""
        given = variant.settings
        if "modes" in given:
            return self._solver(AxisymmetricLoading(CONTACT, given["modes"]), _round)
        cells, coupled = given["cells"], given["components"] == 2
        loading = GridLoading.of_sphere(CONTACT, cells, coupled=coupled)
        return self._solver(loading, lambda state: _on_grid(state, cells))

    @cached_property
    def _exact(self) -> list[Sampled]:
        loading = GridLoading.of_sphere(CONTACT, self._finest, coupled=True)
        return [_on_grid(s, self._finest) for s in _timed(loading.driven)[0]]

    def _solver(self, loading: Any, sampled: Callable[[Any], Sampled]) -> Figures:
        solved, spent = _timed(loading.driven)
        errors = np.zeros(3)
        for state, (s, sigma, Q) in zip(solved, self._exact, strict=True):
            mine = sampled(state)
            away = np.abs(mine[0] - s).max(), abs(mine[2] / Q - 1), np.abs(mine[1] - sigma).max()
            errors = np.fmax(errors, away)
        peak = CONTACT.mu * CONTACT.peak_pressure
        values = errors / (PIXEL_M, 1e-2, peak / 100)
        return dict(zip(COLUMNS, [*values.tolist(), spent], strict=True))


def _timed(solve: Callable[[float], Any]) -> tuple[list[Any], float]:
    """The states at all `SHIFTS`, and the median processor time of one in milliseconds."""
    solve(1e-7)
    solved, spent = [], []
    for share in SHIFTS:
        began = time.process_time()
        solved.append(solve(share * CONTACT.full_shift))
        spent.append(time.process_time() - began)
    return solved, 1e3 * float(np.median(spent))


def study() -> Study:
    """The study of the solvers."""
    variants = [Variant(f"modes {n}", "axisymmetric", {"modes": n}) for n in MODES]
    variants += [
        Variant(
            f"grid {n}, {components} component{'s' * (components > 1)}",
            f"grid, {components} component{'s' * (components > 1)}",
            {"cells": n, "components": components},
            (n / 64) ** 2,
        )
        for components in (1, 2)
        for n in CELLS
    ]
    about = {"pixel_um": 1e6 * PIXEL_M, "exact": f"both components, {FINEST} cells across"}
    errors = "displacement_px", "force_percent", "traction_percent"
    measure = Simulating(FINEST).measure
    return Study("simulation", about, COLUMNS, "cpu_ms", errors, tuple(variants), measure)


def measure(report: Report) -> None:
    """Measure the solvers."""
    report_study(report, study())
