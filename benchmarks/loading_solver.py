"""The loading solver: digits, time per step, the limit of a rigid interface, one against both
components of the traction.

    python benchmarks/loading_solver.py [--cells 128]

Times are medians of the processor time of one thread (set OMP_NUM_THREADS=1), so that a busy
machine counts little.
"""

from __future__ import annotations

import argparse
import datetime
import platform
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from analysis.mechanics import cattaneo_mindlin as cm
from analysis.mechanics.loading import AxisymmetricLoading, SphereContact
from analysis.mechanics.loading_grid import GridLoading

CONTACT = SphereContact(P=0.5, E=3.43e6, nu=0.5, R=128.8e-3, mu=0.93, L=0.8e-6)
LIMIT = CONTACT.mu * CONTACT.P
T = TypeVar("T")


def timed(step: Callable[..., T], *args: object) -> tuple[float, T]:
    """Milliseconds, and what the step gives."""
    start = time.process_time()
    result = step(*args)
    return (time.process_time() - start) * 1e3, result


def digits() -> None:
    print(
        "\nmodes against 128: largest error of Q, of the displacement over D, of the traction over"
        " its peak; D/delta_max = 0.01 to 1.3"
    )
    shifts = np.array([0.01, 0.1, 0.3, 0.6, 0.9, 1.0, 1.3]) * CONTACT.full_shift
    r = np.linspace(0, 3, 200) * CONTACT.a
    best = [AxisymmetricLoading(CONTACT, 128).at_block(D) for D in shifts]
    for modes in (16, 32, 64, 256):
        loading = AxisymmetricLoading(CONTACT, modes)
        errors = []
        for D, true in zip(shifts, best, strict=True):
            state = loading.at_block(D)
            moved = max(
                np.abs(g - h).max()
                for g, h in zip(state.displacement(r), true.displacement(r), strict=True)
            )
            errors.append(
                [
                    abs(state.Q / true.Q - 1),
                    moved / D,
                    np.abs(state.traction(r) - true.traction(r)).max() / true.sigma.max(),
                ]
            )
        print(f"  {modes:4d}  " + "  ".join(f"{e:.1e}" for e in np.max(errors, axis=0)))


def steps() -> None:
    loading = AxisymmetricLoading(CONTACT)
    shifts = [s.D for s in loading.table(201)[1:]]
    warm, back, state = [], [], loading.rest
    for times, way in ((warm, shifts), (back, shifts[::-1])):
        for D in way:
            ms, state = timed(loading.advance, state, D)
            times.append(ms)
    cold = [timed(loading.at_block, D)[0] for D in shifts]
    force = [timed(loading.at_force, part * LIMIT)[0] for part in np.linspace(0.01, 0.999, 100)]
    r = np.linspace(0, 12e-3, 4000)
    fields = [timed(loading.at_block(D).displacement, r)[0] for D in shifts[::10]]
    print("\naxisymmetric, 64 modes, ms (median, 95 %)")
    for name, times in (
        ("next of 200 steps", warm),
        ("after a reversal", back),
        ("from rest to D", cold),
        ("from rest to Q", force),
        ("displacement at 4000 radii", fields),
    ):
        print(f"  {name:28s}{np.median(times):7.2f}{np.percentile(times, 95):7.2f}")


def limit() -> None:
    print(
        "\nL -> 0: (D - D of Cattaneo-Mindlin)/L, and the largest difference of traction (of its"
        " peak), at Q/(mu P) = 0.3, 0.6, 0.9"
    )
    for L in (1.6e-6, 0.8e-6, 0.4e-6, 0.2e-6, 0.1e-6):
        loading, row = AxisymmetricLoading(replace(CONTACT, L=L), 128), []
        for part in (0.3, 0.6, 0.9):
            state = loading.at_force(part * LIMIT)
            sharp = cm.traction(state.r, part * LIMIT, CONTACT.mu, CONTACT.P, CONTACT.a)
            D = float(
                cm.shift(part * LIMIT, CONTACT.mu, CONTACT.P, CONTACT.a, CONTACT.E, CONTACT.nu)
            )
            row.append(
                f"{(state.D - D) / L:.4f} {np.abs(state.sigma - sharp).max() / sharp.max():.3f}"
            )
        print(f"  L {L * 1e6:.1f} um   " + "   ".join(row))


def grid(cells: int) -> None:
    exact = AxisymmetricLoading(CONTACT)
    parts = np.linspace(0.05, 1.2, 24)
    results = {}
    for coupled in (False, True):
        loading = GridLoading.of_sphere(CONTACT, cells, coupled=coupled)
        loading.driven(1e-7)
        times, states = zip(
            *(timed(loading.driven, part * CONTACT.full_shift) for part in parts), strict=True
        )
        results[coupled] = states
        name = "both components" if coupled else "one component"
        print(
            f"\ngrid {cells} x {cells}, {name}: {np.median(times):.0f} ms per step (95 %:"
            f" {np.percentile(times, 95):.0f})"
        )
        error = [s.Q / exact.at_block(s.D).Q - 1 for s in states]
        print(f"  Q against axisymmetric: {min(error):+.1e} to {max(error):+.1e}")
    one, both = results[False], results[True]
    print(
        f"\nboth against one component ({cells} x {cells}): D/delta_max, change of Q, rms change of"
        " sigma_x, largest |sigma_y|"
    )
    for i in range(1, len(parts), 4):
        change, x = both[i].Q / one[i].Q - 1, one[i].sigma
        rms = np.sqrt(np.mean((both[i].sigma[0] - x) ** 2) / np.mean(x**2))
        print(
            f"  {parts[i]:.2f}  {change * 100:+.3f} %  {rms * 100:.2f} % "
            f" {np.abs(both[i].sigma[1]).max() / x.max() * 100:.2f} %"
        )


def main() -> None:
    """Measure and print."""
    ask = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    ask.add_argument("--cells", type=int, default=128)
    asked = ask.parse_args()
    print(
        f"{platform.machine()}, {platform.system()}, {datetime.date.today()}; P = 0.5 N, nu = 0.5,"
        " mu = 0.93, L = 0.8 um"
    )
    digits()
    steps()
    limit()
    grid(asked.cells)


if __name__ == "__main__":
    main()
