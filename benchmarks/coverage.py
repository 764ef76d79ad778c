"""Whether the truth lies within the stated uncertainties: drives on displacement fields of a world
whose constants differ from the settings by draws from the uncertainties of the settings, smooth and
rough, concluded as a run is. Boxes share noise, and all frames that of the reference.

    python -m benchmarks coverage [--seeds 60] [--loads 0.1 0.3 0.5 1.0 1.4] [--noise 45]
        [--exact] [--step 20]

within 1, within 2   share of the runs in which the truth lies within one and two standard
                     uncertainties (noise and inputs together); 68 and 95 % of a normal distribution
bias, rms            of the error, in % of the truth
stated               median of the stated standard uncertainty, in %

With --exact the constants are those of the settings, so that only noise and the estimators' own
errors are left; the uncertainty is then that by noise alone. --step is the pitch of the boxes in
pixels, if it is not that of the settings. c, D and sigma are those of the frame at half of the
greatest Q, of the last one and of sliding at r/a of 0, 0.5 and 0.9.
"""

from __future__ import annotations

import math
import multiprocessing
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from analysis.contact.rings import central_value, ring_means
from analysis.mechanics.loading import AxisymmetricLoading, LoadingState, SphereContact
from app.evaluation.conclusions import conclude
from app.evaluation.history import DriveForces
from app.evaluation.pipeline import CENTRE_SHARE
from app.evaluation.setup import grid_of, hertz_radius_m, sensor_chain
from app.evaluation.tractions import Tractions
from app.records.record_types import (
    Conditions,
    ContactResult,
    FrameMotion,
    Phase,
    RingProfile,
    Snapshot,
)
from app.settings.sections import Config
from benchmarks.onset import MU, L, onset_of
from benchmarks.report import Report

SUBJECT = "Coverage of the stated uncertainties"
MEASURES = ("analysis", "app.evaluation", "drivers.sim")
RATE, SPEED = 4.0, 4.85e-6  # frames per second, m/s
BEYOND, LEAST_S = 1.45, 6.0  # of the way to sliding, and seconds further
FORCE_NOISE = 0.3e-3  # newtons, of a mean over an exposure
SAMPLE_HZ, SAMPLE_NOISE = 1000.0, 1e-3
PLACES = (0.0, 0.5, 0.9)  # of sigma(r), in a
GAUSS, NODE = 3, 2e-6  # points of the quadrature over a box, and distance of nodes in r, metres


class Drawn(NamedTuple):
    """How the world differs from the settings: factors, and Poisson's ratio, the drift, and what
    each sensor reads too much (N) or of the other force (a share) themselves.
    """

    pixel: float = 1.0
    normal: float = 1.0
    shear: float = 1.0
    lens_radius: float = 1.0
    young_modulus: float = 1.0
    poisson: float = 0.5
    roughness: float = 1.0
    lens_compliance: float = 1.0
    averaging: float = 1.0
    drift: float = 0.0
    normal_zero: float = 0.0
    shear_zero: float = 0.0
    shear_in_normal: float = 0.0
    normal_in_shear: float = 0.0


def drawn(config: Config, rng: np.random.Generator) -> Drawn:
    """A world drawn from the uncertainties of the settings."""
    told = config.uncertainty
    normal, shear = (
        math.hypot(share, told.sensitivity) for share in sensor_chain(config).relative_uncertainty()
    )
    shares = (told.pixel, normal, shear, told.lens_radius, told.young_modulus)
    more = told.roughness, told.lens_compliance, told.averaging
    first, last = (1 + np.array(s) * rng.standard_normal(len(s)) for s in (shares, more))
    nu = min(config.sample.poisson + told.poisson * rng.standard_normal(), 0.5)
    read = (told.drift, told.zero, told.zero, told.coupling, told.coupling)
    added = np.array(read) * rng.standard_normal(len(read))
    return Drawn(*first, nu, *last, *added)  # type: ignore[call-arg]


class World:
    """A drive in a world, seen with the settings."""

    def __init__(self, config: Config, P: float, rough: bool, truth: Drawn) -> None:
        s = config.sample
        self.config, self.truth, self.P = config, truth, P * truth.normal
        h = s.roughness * truth.roughness if rough else 0.0
        E, R = s.young_modulus * truth.young_modulus, s.lens_radius * truth.lens_radius
        self.contact = SphereContact(self.P, E, truth.poisson, R, MU, L, h=h)
        self.holder = s.lens_compliance * truth.lens_compliance
        compliance = self.holder + 1 / config.forces.stiffness_shear
        loading = AxisymmetricLoading(self.contact)
        onset_m, self.static_force = onset_of(loading, compliance)
        self.onset_s = onset_m / SPEED
        last = max(BEYOND * self.onset_s, self.onset_s + LEAST_S)
        step, near = 1 / RATE, np.arange(self.onset_s - 1, self.onset_s + 1, 0.5 / RATE)
        self.time = np.unique(np.round(np.append(np.arange(step, last, step), near), 9))
        self.states: list[LoadingState] = []
        for stage in (SPEED * self.time).tolist():
            before = self.states[-1] if self.states else loading.rest
            self.states.append(loading.advance(before, stage, compliance=compliance))

    def snapshots(self, rng: np.random.Generator, noise_m: float) -> list[Snapshot]:
        """What a run would measure in each frame."""
        config, truth = self.config, self.truth
        grid, pixel = grid_of(config), config.camera.pixel
        x, y = np.meshgrid(grid.x_px - grid.x_px.mean(), grid.y_px - grid.y_px.mean())
        x, y = (x + 3.3) * pixel, (y - 2.1) * pixel  # as measured
        r, theta, width = np.hypot(x, y), np.arctan2(y, x), config.dic.step * pixel
        hertz_m = hertz_radius_m(config, self.P / truth.normal)
        tractions = Tractions(config, x, y, hertz_m)
        whole = float(min(x.max(), -x.min(), y.max(), -y.min()))
        inner, box = CENTRE_SHARE * hertz_m, config.dic.averaging_box_px * pixel
        near = r < 1.2 * inner
        seen = _SeenByBoxes(*(v * truth.pixel for v in (x, y, box * truth.averaging)))
        reference, shots = _noise(rng, x.shape), []
        for i, (t, state) in enumerate(zip(self.time, self.states, strict=True)):
            field = noise_m * (_noise(rng, x.shape) + reference) / math.sqrt(2)
            P, Q = self._read(state.Q)
            Q += FORCE_NOISE * rng.standard_normal()
            # of the change since the reference, at which Q reads P and its zero already
            lens = config.sample.lens_compliance * (
                Q - truth.shear_zero - truth.normal_in_shear * self.P / truth.normal
            )
            moved = (state.D + self.holder * state.Q) / truth.pixel + truth.drift * t - lens
            field += moved - seen.displacement(state) / truth.pixel
            rings = ring_means(r, field, width, whole, theta=theta)
            value, sd = central_value(r[near], theta[near], field[near], inner, box=box, shared=4.0)
            traction, stress = tractions.of(rings)
            P += FORCE_NOISE * rng.standard_normal()
            shots.append(
                Snapshot(
                    i,
                    i,
                    Conditions(Phase.DRIVE, float(t), P, Q, float(SPEED * t)),
                    FrameMotion(lens, value, sd, 0.0),
                    rings=RingProfile(rings.radius, rings.mean, rings.standard_error),
                    traction=traction,
                    stress=stress,
                )
            )
        return shots

    def forces(self, rng: np.random.Generator) -> DriveForces:
        """What the sensors would read in each sample."""
        time = np.arange(int(self.time[-1] * SAMPLE_HZ)) / SAMPLE_HZ
        Q = CubicSpline(self.time, [state.Q for state in self.states])(time)
        P, Q = np.array(self._read(Q)) + SAMPLE_NOISE * rng.standard_normal((2, len(time)))
        return DriveForces(time, Q, P)

    def _read(self, Q: Any) -> tuple[Any, Any]:
        """P and Q without noise as the sensors read them."""
        truth = self.truth
        P, Q = np.broadcast_arrays(self.P / truth.normal, Q / truth.shear)
        return (
            P + truth.normal_zero + truth.shear_in_normal * Q,
            Q + truth.shear_zero + truth.normal_in_shear * P,
        )


class _SeenByBoxes:
    """Displacements as boxes about the points of a grid see them: means over the box, by Gauss's
    quadrature; metres.
    """

    def __init__(self, x: np.ndarray, y: np.ndarray, box: float) -> None:
        t, weight = np.polynomial.legendre.leggauss(GAUSS)
        dx, dy = (v.reshape(-1, 1, 1) * box / 2 for v in np.meshgrid(t, t))
        self._weight = np.outer(weight, weight).ravel() / 4
        self._r, self._double = np.hypot(x + dx, y + dy), np.cos(2 * np.arctan2(y + dy, x + dx))
        self._nodes = np.arange(0.0, self._r.max() + NODE, NODE)

    def displacement(self, state: LoadingState) -> np.ndarray:
        """The elastic u_x of each point, shape (ny, nx)."""
        even, double = (np.interp(self._r, self._nodes, g) for g in state.displacement(self._nodes))
        return np.tensordot(self._weight, even + double * self._double, 1)


def _noise(rng: np.random.Generator, shape: tuple[int, int]) -> np.ndarray:
    """Noise of unit variance of boxes that overlap by half."""
    fine = rng.standard_normal((shape[0] + 1, shape[1] + 1))
    return (fine[1:, 1:] + fine[:-1, 1:] + fine[1:, :-1] + fine[:-1, :-1]) / 2


Scores = dict[str, tuple[float, float, float]]  # measured, stated uncertainty, truth


def scores(case: tuple[float, bool, int, float, bool, int]) -> Scores:
    """One run: each result with its uncertainty and the truth."""
    P, rough, seed, noise_m, exact, step = case
    config, rng = Config(), np.random.default_rng([seed, round(100 * P), rough])
    config = replace(config, dic=replace(config.dic, step=step or config.dic.step))
    truth = Drawn(poisson=config.sample.poisson) if exact else drawn(config, rng)
    world = World(config, P, rough, truth)
    grid = grid_of(config)
    centre = float(grid.x_px.mean()) - 3.3, float(grid.y_px.mean()) + 2.1
    nothing = np.empty(0)
    contact = ContactResult(centre, math.nan, math.nan, (0.0, 0.0), nothing, nothing)
    shots = world.snapshots(rng, noise_m)
    s = conclude(config, shots, contact, [], forces=world.forces(rng)).summary
    found: Scores = {}

    def add(name: str, value: float, sd: float, key: str, true: float) -> None:
        by_inputs = 0.0 if exact else abs(value) * s.systematic(key)
        found[name] = value, math.hypot(sd, by_inputs), true

    mu_s = world.static_force / world.P
    add("t_s", s.onset_time_s, s.onset_time_sd_s, "onset_time", world.onset_s)
    add("Q_s", s.static_force_n, s.static_force_sd_n, "static_force", world.static_force)
    add("mu_s", s.mu_s, s.mu_s_sd, "mu_s", mu_s)
    after = [
        state.Q for t, state in zip(world.time, world.states, strict=True) if t >= world.onset_s
    ]
    add("mu_d", s.mu_d, s.mu_d_sd, "mu_d", float(np.mean(after)) / world.P)
    add("mu", s.law_mu, s.law_mu_sd, "law_mu", MU)
    add("L", s.law_length_m, s.law_length_sd_m, "law_length", L)
    E = world.contact.E
    add("E", s.young_modulus_pa, s.young_modulus_sd_pa, "young_modulus", E)
    largest = max(state.Q for state in world.states)
    half = next(i for i, state in enumerate(world.states) if largest / 2 <= state.Q)
    traction, last = shots[half].traction, shots[-1]
    if traction is not None:
        peak = world.states[half].peak_radius
        add("c", traction.peak_radius_m, traction.peak_radius_sd_m, "peak_radius", peak)
    if last.traction is not None and last.stress is not None:
        D = last.traction.block_m, last.traction.block_sd_m
        add("D", *D, "block_displacement", world.states[-1].D)
        r, sigma, sd = last.stress.radius_m, last.stress.stress_pa, last.stress.sd_pa
        for share in PLACES:
            i = int(np.argmin(np.abs(r - share * world.contact.a)))
            true = float(world.states[-1].traction(r[i] * truth.pixel))
            add(f"sigma({share:g} a)", float(sigma[i]), float(sd[i]), "stress", true)
    if s.pressure_pa:
        r = np.array(s.pressure_radius_m)
        for share in PLACES:
            i = int(np.argmin(np.abs(r - share * world.contact.a)))
            true = float(world.contact.pressure(r[i] * truth.pixel))
            add(f"p({share:g} a)", s.pressure_pa[i], s.pressure_sd_pa[i], "pressure", true)
    return found


def measure(
    report: Report,
    *,
    seeds: int = 60,
    loads: Sequence[float] = (0.1, 0.3, 0.5, 1.0, 1.4),
    noise: float = 45.0,
    exact: bool = False,
    step: int = 0,
) -> int:
    """Measure coverage, bias and scatter; `noise` is that of a box, in nm, `step` the pitch of the
    boxes, in pixels (0: that of the settings).
    """
    with multiprocessing.get_context("spawn").Pool(2) as pool:
        for rough in (False, True):
            for P in loads:
                how = noise * 1e-9, exact, step
                cases = [(P, rough, seed, *how) for seed in range(seeds)]
                tell(
                    report, f"{'rough' if rough else 'smooth'}, {P:g} N", pool.map(scores, cases, 1)
                )
    return 0


def tell(report: Report, title: str, runs: list[Scores]) -> None:
    """Report what the runs of one load came to."""
    report.table(f"{title}: {len(runs)} runs")
    for name in dict.fromkeys(name for run in runs for name in run):
        value, sd, true = np.array([run[name] for run in runs if name in run]).T
        known = np.isfinite(value)
        size, error = np.abs(value - true) / sd, 100 * (value / true - 1)
        report.row(
            name,
            digits=3,
            found=int(known.sum()),
            within_1=np.mean(size[known] < 1),
            within_2=np.mean(size[known] < 2),
            bias=(np.mean(error[known]), "%"),
            rms=(math.sqrt(np.mean(error[known] ** 2)), "%"),
            stated=(100 * np.median(np.abs(sd / value)[known]), "%"),
        )
