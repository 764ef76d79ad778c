"""Bias, scatter and coverage of the estimates of the local friction law and of Young's modulus, on
displacements whose truth is known, and the time of each estimate: fields of 158 x 118 points at a
pitch of 70.4 um, means over boxes of two pitches that share noise, force noise of 1 mN. Coverage is
the share of estimates within one and two stated standard uncertainties of the truth.

    python -m benchmarks estimators [law speed] [--runs 40] [--loads 0.1 0.5 1.4]

law    mu, L, E and the pressure p(r), of smooth contacts and of rough ones (h = 0.6 um)
speed  time of each estimate, that of c included

The truth is that of tests/friction/elasto_plastic_world.py and rough_world.py.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from functools import cache, partial
from typing import Annotated

import numpy as np

from analysis.contact.rings import Rings, ring_means
from analysis.friction.largest_stress import stress_peak
from analysis.friction.local_law import LocalLaw, fit_local_law
from analysis.friction.stick import fit_stick_radius
from analysis.inversion.axisymmetric import AxisymmetricInversion
from benchmarks.report import Report
from tests.friction import elasto_plastic_world as world, rough_world

SUBJECT = "Estimators of c, mu, L and E"
NOISES = (50e-9, 232e-9)
FRAMES = 60


@cache
def inversion(P: float) -> AxisymmetricInversion:
    """The live inversion at that normal force."""
    return world.inversion(world.hertz_radius(P))


def local_law(
    run: world.Run, ux: np.ndarray, error: np.ndarray, Q: np.ndarray, P: float, **options: int
) -> LocalLaw:
    """Estimate mu, L, E and p(r) as a run does."""
    rings = [Rings(run.radius, u, e, run.count) for u, e in zip(ux, error, strict=True)]
    return fit_local_law(rings, P, Q, inversion(P), **options)


def law(report: Report, loads: Sequence[float], runs: int) -> None:
    """The parameters of the local law and the pressure, from smooth and rough contacts."""
    report.table("mu, L, E and p: bias ± scatter (coverage by one, by two), in %; p of its peak")
    for P in loads:
        for h in (0.0, rough_world.H):
            run = rough_world.drive(P, FRAMES, h, end=1.5)
            for sd in NOISES:
                found = [local_law(run, *run.measured(sd, seed), P) for seed in range(runs)]
                raw = [local_law(run, *run.measured(sd, seed), P, draws=0) for seed in range(runs)]
                name = f"{P} N, {'rough' if h else 'smooth'}, {sd * 1e9:.0f} nm"
                error = np.array([one.L for one in raw]) / world.L - 1
                covered(report, name, "L uncorrected", error, np.zeros(runs))
                for column, true in (("mu", world.MU), ("L", world.L), ("E", world.E)):
                    value, stated = (
                        np.array([getattr(one, of) for one in found])
                        for of in (column, f"{column}_sd")
                    )
                    covered(report, name, column, value / true - 1, stated / true)
                p = run.world.pressure(found[0].radius)  # type: ignore[attr-defined]
                seen = p > 0.02 * p.max()
                off = np.array([(one.pressure - p)[seen] for one in found]) / p.max()
                stated = np.array([one.pressure_sd[seen] for one in found]) / p.max()
                covered(report, name, "p", off, stated)


def covered(report: Report, name: str, column: str, error: np.ndarray, stated: np.ndarray) -> None:
    """Report bias, scatter and coverage of one quantity."""
    one, two = (np.mean(np.abs(error) < n * stated) for n in (1, 2))
    text = f"{100 * error.mean():+.3f} ± {100 * error.std():.3f} ({one:.2f}, {two:.2f})"
    report.add(name, text, column=column)


def speed(report: Report, *_: object) -> None:
    """Time of each estimate at 0.5 N."""
    P, run, a = 0.5, world.drive(0.5, FRAMES), world.hertz_radius(0.5)
    ux, error, Q = run.measured(50e-9, 0)
    rings = Rings(run.radius, ux[20], error[20], run.count)
    solved, reach = inversion(P).solve(rings), 0.1 * a
    seen = rings.radius, rings.mean, rings.standard_error, a
    live = partial(fit_stick_radius, *seen, box=world.BOX, width=world.PITCH)
    report.table("Time of an estimate")
    profile = solved.radius, solved.sigma, solved.covariance
    field = run.states[20].field() + np.random.default_rng(0).normal(0, 50e-9, world.X.shape)
    r, theta = np.hypot(world.X, world.Y), np.arctan2(world.Y, world.X)

    def frame() -> None:
        means = ring_means(r, field, world.PITCH, theta=theta)
        found = inversion(P).solve(means)
        stress_peak(found.radius, found.sigma, found.covariance, reach=reach)

    for name, times, task in (
        ("rings, sigma and c of a frame", 300, frame),
        ("live c", 300, live),
        ("maximum of the traction", 300, partial(stress_peak, *profile, reach=reach)),
        (f"local law, {FRAMES} frames", 3, partial(local_law, run, ux, error, Q, P)),
    ):
        spent = []
        for _ in range(times):
            start = time.perf_counter()
            task()
            spent.append(time.perf_counter() - start)
        report.times(name, spent)


PARTS = {"law": law, "speed": speed}


def measure(
    report: Report,
    parts: Annotated[Sequence[str], PARTS] = tuple(PARTS),
    *,
    runs: int = 40,
    loads: Sequence[float] = (0.1, 0.5, 1.4),
) -> None:
    """Measure the parts that are named, or all."""
    for part in parts:
        PARTS[part](report, loads, runs)
