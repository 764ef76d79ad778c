"""Accuracy and cost of the live inversion into shear traction, on synthetic fields whose traction
is known from another computation: the interface law of the paper (mu = 0.93, L = 0.80 um), E = 3.43
MPa, R = 128.8 mm, 158 x 118 points at a pitch of 70.4 um, boxes of two pitches, white noise of
0.033 px = 232 nm. Errors of the profile (ring means) and of the whole field are rms over the
contact, as a fraction of mu p0. Each value is the median of its magnitude over the seeds, at the
worst of Q/(mu P) = 0.3, 0.6, 0.9 and 1.

    python -m benchmarks inversion [--seeds N]

`benchmarks inversion_trade` compares it with the other inversions. Run with OMP_NUM_THREADS=1 for
the time on one core.
"""

from __future__ import annotations

import time

import numpy as np

from analysis.contact.rings import ring_means
from analysis.inversion.axisymmetric import AxisymmetricInversion
from analysis.inversion.problem import mask_radius
from benchmarks.report import Report
from tests.friction import elasto_plastic_world as world

SUBJECT = "Inversion into shear traction"
X, Y = world.points()
RADIUS, AZIMUTH = np.hypot(X, Y), np.arctan2(Y, X)
LOADS_N, SHARES = (0.1, 0.5, 1.4), (0.3, 0.6, 0.9, 1.0)
COLUMNS = {"profile": "mu p0", "whole field": "mu p0", "Q": "%", "stated for Q": "%", "D": "um"}
COLUMNS |= {"stated for D": "um", "chi2": "", "time": "ms"}
# promised for the live inversion: an error of the profile and of its integral as in a whole loading
# experiment (`loading_experiment`), and of the shift of the block as in one displacement of one box
BOUNDS = {"profile": 0.014, "Q": 0.2, "D": 0.05}


def errors(live: AxisymmetricInversion, contact: world.State, seeds: int) -> np.ndarray:
    """Median magnitudes in the order of `COLUMNS`."""
    clean, rows = contact.displacement(X, Y), []
    for seed in range(seeds):
        rings = ring_means(RADIUS, clean + world.noise(seed, 0.0), world.PITCH, theta=AZIMUTH)
        live.solve(rings)  # warms the caches
        began = time.perf_counter()
        found = live.solve(rings)
        ms = (time.perf_counter() - began) * 1e3
        error = (live.stress(RADIUS, found.coefficients) - contact.sigma(RADIUS)) / contact.full
        profile = ring_means(RADIUS, error, world.PITCH, contact.a).mean
        rows.append([
            np.sqrt(np.nanmean(profile**2)),
            np.sqrt(np.mean(error[contact.a > RADIUS] ** 2)),
            100 * (found.Q / contact.Q - 1),
            100 * found.Q_sd / contact.Q,
            1e6 * (found.D - contact.D),
            1e6 * found.D_sd,
            found.chi2,
            ms,
        ])  # fmt: skip
    return np.median(np.abs(rows), axis=0)


def measure(report: Report, *, seeds: int = 5) -> None:
    """Invert at three loads and compare."""
    for P in LOADS_N:
        limit = mask_radius(P, world.E, world.NU, world.R, world.H, world.PITCH)
        known = {"edge": world.hertz_radius(P), "box": world.BOX, "noise_box": 0.0}
        live = AxisymmetricInversion(X, Y, world.PITCH, limit, world.E, world.NU, **known)
        found = [errors(live, world.loaded(P, share), seeds) for share in SHARES]
        report.table(f"P = {P} N")
        for (column, unit), value in zip(COLUMNS.items(), np.max(found, axis=0), strict=True):
            bound = BOUNDS.get(column)
            report.add("axisymmetric", value, unit, bound, column=column, digits=2)
