"""Accuracy and cost of the stress inversions on synthetic fields whose stress is known from another
computation.

    python benchmarks/inversion.py [--seeds N] [--shared-noise] [--edge FACTOR]

Interface law of the paper (mu = 0.93, L = 0.80 um), E = 3.43 MPa, R = 128.8 mm, 158 x 118 points at
70.4 um, boxes of two pitches, noise 0.033 px = 232 nm: white, or shared by overlapping boxes.
Errors are rms over the contact, as a fraction of mu p0; medians over seeds of their sizes. Run with
OMP_NUM_THREADS=1 for the time of one core.
"""

from __future__ import annotations

import argparse
import datetime
import platform
import sys
import time
from functools import partial
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from analysis.contact.rings import ring_means
from analysis.inversion.axisymmetric import AxisymmetricInversion
from analysis.inversion.conjugate import conjugate_gradient
from analysis.inversion.problem import InversionProblem, mask_radius
from analysis.inversion.regularised import RegularisedInversion
from analysis.inversion.van_cittert import van_cittert
from tests.inversion import sheared_contact as world

X, Y = world.points()
RADIUS, AZIMUTH = np.hypot(X, Y), np.arctan2(Y, X)
SHARES = (0.3, 0.6, 0.9, 1.0)


def main() -> None:
    """Invert, compare, print."""
    ask = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    ask.add_argument("--seeds", type=int, default=5)
    ask.add_argument("--shared-noise", action="store_true")
    ask.add_argument("--edge", type=float, default=1.0, help="times the true radius; 0: unknown")
    asked = ask.parse_args()
    box = world.BOX if asked.shared_noise else 0.0
    print(
        f"{platform.machine()}, {platform.system()}, {datetime.date.today()}, {asked.seeds} seeds,"
        f" noise shared over {box * 1e6:g} um"
    )
    print(
        "P/N  Q/muP  method           profile  worst   field   Q error/%  stated  D error/um "
        " stated  chi2   iterations  ms"
    )
    for P in (0.1, 0.5, 1.4):
        limit = mask_radius(P, world.E, world.NU, world.R, world.H, world.PITCH)
        settings = {
            "edge": asked.edge * world.hertz_radius(P) or None,
            "box": world.BOX,
            "noise_box": box,
        }
        live = AxisymmetricInversion(X, Y, world.PITCH, limit, world.E, world.NU, **settings)
        problem = InversionProblem(limit > RADIUS, world.PITCH, world.E, world.NU, box=world.BOX)
        whole = InversionProblem(
            np.ones(world.SHAPE, np.bool_), world.PITCH, world.E, world.NU, box=world.BOX
        )
        best = RegularisedInversion(X, Y, limit, world.E, world.NU, **settings)
        for share in SHARES:
            compare(P, share, asked.seeds, box, live, problem, whole, best)


def compare(
    P: float,
    share: float,
    seeds: int,
    box: float,
    live: AxisymmetricInversion,
    problem: InversionProblem,
    whole: InversionProblem,
    best: RegularisedInversion,
) -> None:
    """Invert noisy fields of one contact by every method, and print a line for each."""
    contact = world.loaded(P, share)
    clean, rows = contact.displacement(X, Y), {}
    for seed in range(seeds):
        u = clean + world.noise(seed, box)
        rings = ring_means(RADIUS, u, world.PITCH, theta=AZIMUTH)
        before = previous_frames(problem, P, share, 1000 * (seed + 1), box)
        noise = world.NOISE
        calls = {
            "axisymmetric": partial(live.solve, rings),
            "CGLS, cold": partial(conjugate_gradient, problem, u, noise),
            "CGLS, warm": partial(
                conjugate_gradient, problem, u, noise, start=before, iterations=5
            ),
            "Van-Cittert": partial(van_cittert, problem, u, noise, D=contact.D),
            "  D fitted": partial(van_cittert, problem, u, noise),
            "  whole field": partial(van_cittert, whole, u, noise, D=contact.D),
            "regularised": partial(best.solve, u, noise),
        }
        for name, method in calls.items():
            method()  # warms the caches
            began = time.perf_counter()
            found = method()
            ms = (time.perf_counter() - began) * 1e3
            field = (
                live.stress(RADIUS, found.coefficients) if name == "axisymmetric" else found.sigma
            )
            rows.setdefault(name, []).append(
                [*errors(field, contact), *numbers(found, contact), ms]
            )
    for name, row in rows.items():
        worst = np.max(np.array(row)[:, 0])
        profile, field, Q, Q_sd, D, D_sd, chi2, iterations, ms = np.median(np.abs(row), axis=0)
        print(
            f"{P:3.1f}  {share:4.2f}   {name:15s}  {profile:.4f}   {worst:.4f}  {field:.4f} "
            f" {Q:8.3f}  {Q_sd:6.3f}  "
            f"{D:9.3f}  {D_sd:6.3f}  {chi2:5.3f}  {iterations:9.0f}  {ms:7.2f}"
        )


def previous_frames(
    problem: InversionProblem, P: float, share: float, seed: int, box: float
) -> np.ndarray:
    """Stress of the frame before, inverted warm as in a run: six frames, each two percent of mu P
    further.
    """
    sigma = None
    for n in range(6, 0, -1):
        contact = world.loaded(P, share if share == 1 else share - 0.02 * n)
        u = contact.displacement(X, Y) + world.noise(seed + n, box)
        sigma = conjugate_gradient(
            problem, u, world.NOISE, start=sigma, iterations=50 if sigma is None else 5
        ).sigma
    return sigma


def errors(sigma: np.ndarray, contact: world.Contact) -> tuple[float, float]:
    """Rms error over the contact of the ring profile and of the field, as a fraction of mu p0."""
    error = (sigma - contact.stress(RADIUS)) / contact.peak
    profile = ring_means(RADIUS, error, world.PITCH, contact.a).mean
    return float(np.sqrt(np.nanmean(profile**2))), float(
        np.sqrt(np.mean(error[contact.a > RADIUS] ** 2))
    )


def numbers(found, contact: world.Contact) -> list[float]:
    """Errors of Q (percent) and D (micrometres) with their stated uncertainty; chi2 and iterations."""
    return [
        100 * (found.Q / contact.Q - 1),
        100 * found.Q_sd / contact.Q,
        1e6 * (found.D - contact.D),
        1e6 * found.D_sd,
        found.chi2,
        found.iterations,
    ]


if __name__ == "__main__":
    main()
