"""Accuracy and cost of the inversions into shear traction, on synthetic fields whose traction is
known from another computation: the interface law of the paper (mu = 0.93, L = 0.80 um), E = 3.43
MPa, R = 128.8 mm, 158 x 118 points at a pitch of 70.4 um, boxes of two pitches, noise of 0.033 px =
232 nm. Errors of the profile (ring means) and of the whole field are rms over the contact, as a
fraction of mu p0. Each value is the median of its magnitude over the seeds, at the worst of Q/(mu
P) = 0.3, 0.6, 0.9 and 1.

    python -m benchmarks inversion [--seeds N] [--shared-noise] [--edge FACTOR]

The noise is white, or with --shared-noise that of overlapping boxes. The edge of the contact is
given as this factor times its true radius, 0 for unknown. Run with OMP_NUM_THREADS=1 for the time
on one core.
"""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from analysis.contact.rings import ring_means
from analysis.inversion.axisymmetric import AxisymmetricInversion
from analysis.inversion.iterative import conjugate_gradient, van_cittert
from analysis.inversion.problem import InversionProblem, mask_radius
from analysis.inversion.regularised import RegularisedInversion
from benchmarks.report import Report
from tests.friction import elasto_plastic_world as world

SUBJECT = "Inversion into shear traction"
X, Y = world.points()
RADIUS, AZIMUTH = np.hypot(X, Y), np.arctan2(Y, X)
LOADS_N, SHARES = (0.1, 0.5, 1.4), (0.3, 0.6, 0.9, 1.0)
COLUMNS = {"profile": "mu p0", "whole field": "mu p0", "Q": "%", "stated for Q": "%", "D": "um"}
COLUMNS |= {"stated for D": "um", "chi2": "", "iterations": "", "time": "ms"}
# promised for the live inversion: an error of the profile and of its integral as in a whole loading
# experiment (`loading_experiment`), and of the shift of the block as in one displacement of one box
BOUNDS = {"profile": 0.014, "Q": 0.2, "D": 0.05}


class Bench:
    """All inversions, prepared for one normal force."""

    def __init__(self, P: float, edge: float, noise_box: float) -> None:
        self.P, self.noise_box = P, noise_box
        limit = mask_radius(P, world.E, world.NU, world.R, world.H, world.PITCH)
        options = {"edge": edge * world.hertz_radius(P) or None, "box": world.BOX}
        options["noise_box"] = noise_box
        inside, everywhere = limit > RADIUS, np.ones(world.SHAPE, np.bool_)
        elastic = world.PITCH, world.E, world.NU
        self.live = AxisymmetricInversion(X, Y, world.PITCH, limit, world.E, world.NU, **options)
        self.problem = InversionProblem(inside, *elastic, box=world.BOX)
        self.whole = InversionProblem(everywhere, *elastic, box=world.BOX)
        self.best = RegularisedInversion(X, Y, limit, world.E, world.NU, **options)

    def measure(self, share: float, seeds: int) -> dict[str, np.ndarray]:
        """Median magnitudes in the order of `COLUMNS`, by the name of the method."""
        contact = world.loaded(self.P, share)
        clean, rows = contact.displacement(X, Y), defaultdict(list)
        for seed in range(seeds):
            u = clean + world.noise(seed, self.noise_box)
            for name, method in self._methods(u, contact, share, 1000 * (seed + 1)).items():
                method()  # warms the caches
                began = time.perf_counter()
                found = method()
                ms = (time.perf_counter() - began) * 1e3
                rows[name].append([*self._errors(name, found, contact), ms])
        return {name: np.median(np.abs(row), axis=0) for name, row in rows.items()}

    def _methods(
        self, u: np.ndarray, contact: world.State, share: float, seed: int
    ) -> dict[str, Callable[[], Any]]:
        """The inversions of one field, by name."""
        rings, noise = ring_means(RADIUS, u, world.PITCH, theta=AZIMUTH), world.NOISE
        gradient = partial(conjugate_gradient, self.problem, u, noise)
        before = self._previous_frames(share, seed)
        return {
            "axisymmetric": partial(self.live.solve, rings),
            "cgls, cold": gradient,
            "cgls, from the last frame": partial(gradient, start=before, iterations=5),
            "van-cittert, D known": partial(van_cittert, self.problem, u, noise, D=contact.D),
            "van-cittert, D fitted": partial(van_cittert, self.problem, u, noise),
            "van-cittert, D known, no mask": partial(
                van_cittert, self.whole, u, noise, D=contact.D
            ),
            "regularised": partial(self.best.solve, u, noise),
        }

    def _previous_frames(self, share: float, seed: int) -> np.ndarray | None:
        """Traction of the frame before, inverted as in a run: six frames, each two per cent of mu P
        further, each started from the last.
        """
        sigma = None
        for n in range(6, 0, -1):
            contact = world.loaded(self.P, share if share == 1 else share - 0.02 * n)
            u = contact.displacement(X, Y) + world.noise(seed + n, self.noise_box)
            how = {"start": sigma, "iterations": 50 if sigma is None else 5}
            sigma = conjugate_gradient(self.problem, u, world.NOISE, **how).sigma
        return sigma

    def _errors(self, name: str, found: Any, contact: world.State) -> list[float]:
        """Errors and uncertainties in the order of `COLUMNS`, but for the time."""
        sigma = (
            self.live.stress(RADIUS, found.coefficients) if name == "axisymmetric" else found.sigma
        )
        error = (sigma - contact.sigma(RADIUS)) / contact.full
        profile = ring_means(RADIUS, error, world.PITCH, contact.a).mean
        return [
            float(np.sqrt(np.nanmean(profile**2))),
            float(np.sqrt(np.mean(error[contact.a > RADIUS] ** 2))),
            100 * (found.Q / contact.Q - 1),
            100 * found.Q_sd / contact.Q,
            1e6 * (found.D - contact.D),
            1e6 * found.D_sd,
            found.chi2,
            found.iterations,
        ]


def measure(
    report: Report, *, seeds: int = 5, shared_noise: bool = False, edge: float = 1.0
) -> None:
    """Invert at three loads and compare."""
    for P in LOADS_N:
        bench = Bench(P, edge, world.BOX if shared_noise else 0.0)
        found = [bench.measure(share, seeds) for share in SHARES]
        report.table(f"P = {P} N")
        for name in found[0]:
            worst = np.max([row[name] for row in found], axis=0)
            for (column, unit), value in zip(COLUMNS.items(), worst, strict=True):
                if np.isfinite(value):  # not every method states an uncertainty
                    bound = BOUNDS.get(column) if name == "axisymmetric" else None
                    report.add(name, value, unit, bound, column=column, digits=2)
