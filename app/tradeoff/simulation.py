"""What the simulated bench costs, and how far it is from the exact solution: the mechanics of the
contact, and the pictures of it.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import cached_property
from typing import Any

import numpy as np
from scipy import ndimage

from analysis.mechanics.loading import AxisymmetricLoading, LoadingState
from analysis.mechanics.loading_grid import GridLoading, GridState
from app.tradeoff.inversion import CONTACT, PIXEL_M
from app.tradeoff.speckle import Array
from app.tradeoff.study import Figures, Study, Variant
from drivers.sim.images import Renderer
from drivers.sim.scenario import Scenario
from drivers.sim.settings import SimSettings
from drivers.sim.truth import State
from drivers.sim.world import World

COLUMNS = {
    "displacement_px": "u_x (px)",
    "force_percent": "Q (%)",
    "traction_percent": "sigma (% of mu p0)",
    "cpu_ms": "CPU (ms)",
}
SHIFTS = 0.1, 0.3, 0.6, 0.9, 1.0, 1.2  # of the block, over that of full sliding for L = 0
FINEST = 512  # cells across the contact, of the solution that counts as exact
WITHIN = 0.9  # of a: beyond, the traction falls too steeply for any grid
MODES, CELLS = (4, 8, 16, 32, 64, 128), (16, 32, 64, 128, 256)
SLOPE = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
"""Derivative by central differences of the eighth order: those of the second order make the slope
of such fine speckle 20 % too small.
"""


def apparent_shift_px(reference: Array, picture: Array, box: int = 20) -> Array:
    """Shift (x, y) of `picture` relative to `reference` in every whole box, pixels: the
    least-squares fit of the gradient to the difference of the two.
    """
    gy, gx = (ndimage.correlate1d(reference, SLOPE, axis) for axis in (0, 1))
    difference = picture - reference
    rows, columns = (n // box for n in reference.shape)

    def total(a: Array) -> Array:
        whole = a[: rows * box, : columns * box].reshape(rows, box, columns, box)
        return np.asarray(whole.sum((1, 3)))

    xx, xy, yy = total(gx * gx), total(gx * gy), total(gy * gy)
    x, y = -total(gx * difference), -total(gy * difference)
    return np.stack([yy * x - xy * y, xx * y - xy * x]) / (xx * yy - xy * xy)


def states() -> dict[str, State]:
    """Three moments of a drive."""
    world = World(Scenario(sim=SimSettings(press_time=0.0), press_samples=1), pace=None)
    world.start()
    world.advance(2)
    world.move(300e-6, 5e-6)
    world.advance(40_000)
    samples = {"pressed": 2, "partial slip": 15_000, "full sliding": 40_000}
    return {name: world.state(sample) for name, sample in samples.items()}


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
    """Measures the parts of the simulation, against both components of the traction on a grid of
    `finest` cells.
    """

    def __init__(self, finest: int) -> None:
        self._finest = finest

    def measure(self, variant: Variant) -> Figures:
        """The figures of a variant, in the order of `COLUMNS`."""
        given = variant.settings
        if "renderer" in given:
            return self._pictures(given["renderer"])
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

    def _pictures(self, name: str) -> Figures:
        renderer = Renderer(Scenario(sim=SimSettings(renderer=name)))
        squares, spent = [], []
        for state in states().values():
            if name != "exact":
                found = renderer.grey(state, exact=False)
                shift = apparent_shift_px(renderer.grey(state, exact=True), found)
                squares.append(float(np.mean(shift**2)))
            for _ in range(3):
                began = time.process_time()
                renderer.image(state, 0)
                spent.append(time.process_time() - began)
        error = math.sqrt(np.mean(squares)) if squares else 0.0
        cpu = 1e3 * float(np.median(spent))
        return dict(zip(COLUMNS, (error, math.nan, math.nan, cpu), strict=True))


def _timed(solve: Callable[[float], Any]) -> tuple[list[Any], float]:
    """The states at all `SHIFTS`, and the median processor time of one in milliseconds."""
    solve(1e-7)
    solved, spent = [], []
    for share in SHIFTS:
        began = time.process_time()
        solved.append(solve(share * CONTACT.full_shift))
        spent.append(time.process_time() - began)
    return solved, 1e3 * float(np.median(spent))


def study(quick: bool = False) -> Study:
    """The study of solvers and renderers."""
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
        if not (quick and n > 64)
    ]
    variants += [
        Variant(f"renderer {name}", "renderer", {"renderer": name}, 5.0)
        for name in ("fast", "exact")
    ]
    about: dict[str, Any] = {
        "contact": "P = 0.5 N, mu = 0.93, L = 0.8 um",
        "pixel_um": 1e6 * PIXEL_M,
    }
    errors = "displacement_px", "force_percent", "traction_percent"
    about["exact"] = f"both components, {FINEST // (2 if quick else 1)} cells across"
    measure = Simulating(FINEST // (2 if quick else 1)).measure
    return Study("simulation", about, COLUMNS, "cpu_ms", errors, tuple(variants), measure)
