"""The solver of the elasto-plastic contact under load: its digits, its time per step, its limit for
a rigid interface, and what the second component of the traction changes. P = 0.5 N, nu = 0.5, mu =
0.93, L = 0.8 um. Times are processor times of one thread, so that a busy machine counts little.

    python -m benchmarks loading_solver [--cells 128]

Set OMP_NUM_THREADS=1.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

import numpy as np

from analysis.mechanics import cattaneo_mindlin
from analysis.mechanics.loading import AxisymmetricLoading, SphereContact
from benchmarks.report import Report
from tests.mechanics.loading_grid import GridLoading

SUBJECT = "Loading solver"
CONTACT = SphereContact(P=0.5, E=3.43e6, nu=0.5, R=128.8e-3, mu=0.93, L=0.8e-6)
LIMIT = CONTACT.mu * CONTACT.P
T = TypeVar("T")


def timed(step: Callable[..., T], *arguments: object) -> tuple[float, T]:
    """Seconds of a step, and its result."""
    start = time.process_time()
    result = step(*arguments)
    return time.process_time() - start, result


def digits(report: Report) -> None:
    """Solutions of fewer modes against that of 128."""
    report.table("Largest relative error against 128 modes, D/delta_max from 0.01 to 1.3")
    shifts = np.array([0.01, 0.1, 0.3, 0.6, 0.9, 1.0, 1.3]) * CONTACT.full_shift
    r = np.linspace(0, 3, 200) * CONTACT.a
    best = [AxisymmetricLoading(CONTACT, 128).at_block(D) for D in shifts]
    for modes in (16, 32, 64, 256):
        loading, errors = AxisymmetricLoading(CONTACT, modes), []
        for D, true in zip(shifts, best, strict=True):
            state = loading.at_block(D)
            pairs = zip(state.displacement(r), true.displacement(r), strict=True)
            moved = max(np.abs(g - h).max() for g, h in pairs) / D
            traction = np.abs(state.traction(r) - true.traction(r)).max() / true.sigma.max()
            errors.append([abs(state.Q / true.Q - 1), moved, traction])
        Q, displacement, traction = np.max(errors, axis=0)
        report.row(f"{modes} modes", digits=2, Q=Q, displacement=displacement, traction=traction)


def steps(report: Report) -> None:
    """Times of the axisymmetric solver."""
    loading = AxisymmetricLoading(CONTACT)
    shifts = [s.D for s in loading.table(201)[1:]]
    warm, back, state = [], [], loading.rest
    for times, way in ((warm, shifts), (back, shifts[::-1])):
        for D in way:
            seconds, state = timed(loading.advance, state, D)
            times.append(seconds)
    cold = [timed(loading.at_block, D)[0] for D in shifts]
    force = [timed(loading.at_force, part * LIMIT)[0] for part in np.linspace(0.01, 0.999, 100)]
    r = np.linspace(0, 12e-3, 4000)
    fields = [timed(loading.at_block(D).displacement, r)[0] for D in shifts[::10]]
    report.table("Time of an axisymmetric step, 64 modes")
    report.times("next of 200 steps", warm)
    report.times("step after a reversal", back)
    report.times("from rest to a given D", cold)
    report.times("from rest to a given Q", force)
    report.times("displacement at 4000 radii", fields)


def limit(report: Report) -> None:
    """The approach of Cattaneo and Mindlin's solution as L goes to 0."""
    report.table("L to 0: distance from Cattaneo and Mindlin's solution, by Q/(mu P)")
    for L in (1.6e-6, 0.8e-6, 0.4e-6, 0.2e-6, 0.1e-6):
        loading, name = AxisymmetricLoading(replace(CONTACT, L=L), 128), f"L = {L * 1e6:.1f} um"
        for part in (0.3, 0.6, 0.9):
            Q, c = part * LIMIT, CONTACT
            state = loading.at_force(Q)
            sharp = cattaneo_mindlin.traction(state.r, Q, c.mu, c.P, c.a)
            D = float(cattaneo_mindlin.shift(Q, c.mu, c.P, c.a, c.E, c.nu))
            error = np.abs(state.sigma - sharp).max() / sharp.max()
            report.add(name, (state.D - D) / L, "L", column=f"D at {part}")
            report.add(name, error, "of the peak", column=f"traction at {part}")


def grid(report: Report, cells: int) -> None:
    """Time and accuracy on a grid, with one and with both components of the traction."""
    exact = AxisymmetricLoading(CONTACT)
    parts = np.linspace(0.05, 1.2, 24)
    report.table(f"Grid of {cells} x {cells}")
    results = []
    for coupled, name in ((False, "one component"), (True, "both components")):
        loading = GridLoading.of_sphere(CONTACT, cells, coupled=coupled)
        loading.driven(1e-7)
        solved = [timed(loading.driven, part * CONTACT.full_shift) for part in parts]
        times, states = zip(*solved, strict=True)
        results.append(states)
        report.times(name, times)
        error = max((s.Q / exact.at_block(s.D).Q - 1 for s in states), key=abs)
        report.add(name, error, column="Q against axisymmetric", digits=2)
    report.table(f"Both components against one, grid of {cells} x {cells}, by D/delta_max")
    for part, one, both in list(zip(parts, *results, strict=True))[1::4]:
        name, x = f"{part:.2f}", one.sigma
        rms = np.sqrt(np.mean((both.sigma[0] - x) ** 2) / np.mean(x**2))
        across = np.abs(both.sigma[1]).max() / x.max()
        report.row(
            name,
            digits=2,
            change_of_Q=(100 * (both.Q / one.Q - 1), "%"),
            rms_change_of_sigma_x=(100 * rms, "%"),
            largest_sigma_y=(100 * across, "%"),
        )


def measure(report: Report, *, cells: int = 128) -> None:
    """Measure all four."""
    digits(report)
    steps(report)
    limit(report)
    grid(report, cells)
