"""What each inversion into a shear traction costs and reaches: errors of the profile of sigma, of
the whole field, of Q and of c, the worst of Q/(mu P) = 0.3, 0.6 and 0.9, for grids of several steps
(P = 0.5 N, boxes of 20 px, noise of 0.0057 px). "live field" is what a run does for each frame:
five iterations from the result of the frame before. Processor time on one core.

    python -m benchmarks inversion_trade

Run with OMP_NUM_THREADS=1.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import cache, cached_property
from typing import Any

import numpy as np

from analysis.contact.rings import ring_means
from analysis.friction.largest_stress import stress_peak
from analysis.inversion.axisymmetric import AxisymmetricInversion
from analysis.inversion.iterative import conjugate_gradient, van_cittert
from analysis.inversion.problem import InversionProblem
from analysis.inversion.regularised import RegularisedInversion
from analysis.mechanics.loading import AxisymmetricLoading, LoadingState, SphereContact
from app.tradeoff.study import Figures, Study, Variant
from benchmarks.report import Report
from benchmarks.trade import report_study

SUBJECT = "Inversion into shear traction: speed against accuracy"

COLUMNS = {
    "sigma_percent": "error of sigma (% of mu p0)",
    "field_percent": "of the whole field (% of mu p0)",
    "force_percent": "error of Q (%)",
    "stick_percent": "error of c (% of a)",
    "chi2": "chi2",
    "cpu_ms": "CPU (ms)",
}
CONTACT = SphereContact(P=0.5, E=3.43e6, nu=0.5, R=128.8e-3, mu=0.93, L=0.8e-6)
SHARES = 0.3, 0.6, 0.9  # of mu P
PIXEL_M, SIZE, BOX_PX, NOISE_PX = 7.04e-6, (1200, 1600), 20, 0.0057
RIM, EDGE = 1.15, 0.12  # of a: the mask, and half the cubic through the largest traction
STEPS_PX = 5, 10, 20, 40
SUBPOINTS = 6  # of a box, across and down, over which the exact u_x is averaged
BEFORE, APART = 4, 0.02  # earlier frames of a run, and how much of mu P they are apart
METHODS = ("axisymmetric", "live field", "cgls", "van-cittert", "regularised")


@cache
def loaded(share: float) -> LoadingState:
    """The contact under this share of mu P, with twice the modes of the simulation."""
    return AxisymmetricLoading(CONTACT, 128).at_force(share * CONTACT.limit)


class Field:
    """Exact displacements on a grid of one step, with noise as boxes that overlap share it."""

    def __init__(self, step_px: int) -> None:
        self.pitch = step_px * PIXEL_M
        ny, nx = (round((size - BOX_PX) / step_px) for size in SIZE)
        self.x, self.y = np.meshgrid(*(self.pitch * (np.arange(n) - (n - 1) / 2) for n in (nx, ny)))
        self.radius = np.hypot(self.x, self.y)
        self._side = max(1, round(BOX_PX / step_px))

    @cache  # noqa: B019 - fields live as long as the program
    def displacement(self, share: float) -> np.ndarray:
        """Exact u_x seen from the sphere at this share of mu P, averaged over each box, metres."""
        state = loaded(share)
        r = np.linspace(0, self.radius.max() + BOX_PX * PIXEL_M, 6000)
        g0, g2 = state.displacement(r)
        box, total = BOX_PX * PIXEL_M, np.zeros_like(self.x)
        for dy in (np.arange(SUBPOINTS) + 0.5) / SUBPOINTS - 0.5:
            for dx in (np.arange(SUBPOINTS) + 0.5) / SUBPOINTS - 0.5:
                x, y = self.x + dx * box, self.y + dy * box
                s = np.hypot(x, y)
                cos = np.divide(x * x - y * y, s * s, out=np.zeros_like(s), where=s > 0)
                total += np.interp(s, r, g0) + np.interp(s, r, g2) * cos
        return np.asarray(state.D - total / SUBPOINTS**2)

    def noisy(self, u: np.ndarray, seed: int) -> np.ndarray:
        """With the noise of one frame."""
        k, (ny, nx) = self._side, u.shape
        white = np.random.default_rng(seed).normal(size=(ny + k - 1, nx + k - 1))
        windows = np.lib.stride_tricks.sliding_window_view(white, (k, k))
        return np.asarray(u + NOISE_PX * PIXEL_M * windows.sum(axis=(2, 3)) / k)

    @cached_property
    def problem(self) -> InversionProblem:
        """That of the methods which give the whole field."""
        inside = self.radius < RIM * CONTACT.a
        box = BOX_PX * PIXEL_M
        return InversionProblem(inside, self.pitch, CONTACT.E, CONTACT.nu, box=box)


class Inverting:
    """Measures inversions."""

    def __init__(self, seeds: int) -> None:
        self._seeds, self._fields = seeds, dict[int, Field]()

    def measure(self, variant: Variant) -> Figures:
        """The figures of a variant: medians over the noise, of the worst load."""
        step = variant.settings["step"]
        field = self._fields.setdefault(step, Field(step))
        solve = self._solver(variant.settings["method"], field)
        worst = np.zeros(len(COLUMNS))
        for share in SHARES:
            before = BEFORE if variant.settings["method"] == "live field" else 0
            fields = [field.displacement(share - APART * n) for n in range(before, -1, -1)]
            rows = []
            for seed in range(self._seeds):
                frames = [field.noisy(u, 100 * seed + n) for n, u in enumerate(fields)]
                rows.append(solve(frames, loaded(share)))
            worst = np.fmax(worst, np.median(np.abs(rows), axis=0))
        return dict(zip(COLUMNS, worst.tolist(), strict=True))

    def _solver(
        self, method: str, field: Field
    ) -> Callable[[list[np.ndarray], LoadingState], list[float]]:
        box, noise = BOX_PX * PIXEL_M, NOISE_PX * PIXEL_M
        place = (field.x, field.y)
        known = {"edge": CONTACT.a, "box": box}
        mask = RIM * CONTACT.a + 2 * field.pitch
        azimuth = np.arctan2(field.y, field.x)
        started: Any = None
        if method == "axisymmetric":
            live = AxisymmetricInversion(*place, field.pitch, mask, CONTACT.E, CONTACT.nu, **known)
        elif method == "regularised":
            best = RegularisedInversion(*place, mask, CONTACT.E, CONTACT.nu, **known)

        def invert(u: np.ndarray) -> Any:
            if method == "axisymmetric":
                return live.solve(ring_means(field.radius, u, field.pitch, theta=azimuth))
            if method == "regularised":
                return best.solve(u, noise)
            if method == "van-cittert":
                return van_cittert(field.problem, u, noise)
            if method == "cgls":
                return conjugate_gradient(field.problem, u, noise)
            return conjugate_gradient(field.problem, u, noise, start=started, iterations=5)

        def solve(frames: list[np.ndarray], state: LoadingState) -> list[float]:
            nonlocal started
            started = None
            if method == "live field":
                started = conjugate_gradient(field.problem, frames[0], noise).sigma
                for u in frames[1:-1]:
                    started = invert(u).sigma
            else:
                invert(frames[-1])  # fills the caches
            began = time.process_time()
            found = invert(frames[-1])
            spent = time.process_time() - began
            radial = method == "axisymmetric"
            sigma = live.stress(field.radius, found.coefficients) if radial else found.sigma
            return [*_errors(field, sigma, found, state), 1e3 * spent]

        return solve


def _errors(field: Field, sigma: np.ndarray, found: Any, state: LoadingState) -> list[float]:
    """Errors in the order of `COLUMNS`, but for the time."""
    a, peak = CONTACT.a, CONTACT.mu * CONTACT.peak_pressure
    error = (sigma - state.traction(field.radius)) / peak
    rings = ring_means(field.radius, sigma, field.pitch, a)
    exact = ring_means(field.radius, state.traction(field.radius), field.pitch, a)
    scatter = np.full(rings.mean.shape, 0.01 * peak)
    top = stress_peak(rings.radius, rings.mean, scatter, reach=EDGE * a)
    profile = (rings.mean - exact.mean) / peak
    return [
        100 * math.sqrt(np.nanmean(profile**2)),
        100 * math.sqrt(np.mean(error[field.radius < a] ** 2)),
        100 * (found.Q / state.Q - 1),
        100 * (top.radius - state.peak_radius) / a,
        found.chi2,
    ]


def study(seeds: int = 3) -> Study:
    """The study of all inversions, on grids of several steps."""
    variants = tuple(
        Variant(f"{method}, step {step}", method, {"method": method, "step": step}, step**-2.0)
        for method in METHODS
        for step in STEPS_PX
    )
    about = {"noise_px": NOISE_PX, "box_px": BOX_PX, "seeds": seeds}
    errors = "sigma_percent", "force_percent", "stick_percent"
    return Study("inversion", about, COLUMNS, "cpu_ms", errors, variants, Inverting(seeds).measure)


def measure(report: Report) -> None:
    """Measure all methods on all grids."""
    report_study(report, study())
