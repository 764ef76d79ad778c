"""The shear force Q_s at the onset of sliding, the friction mu_d in sliding and the peak of Q/P
after a hold, by frames and by samples of the sensors, on drives whose truth is known: u_x at the
centre of a rough contact with noise of 20 nm in each frame, of which the reference shares, forces
with white noise of 1 mN in samples of 1 kHz.

    python -m benchmarks onset [WORLD...] [--runs 100] [--loads 0.1 0.5 1.4] [--rates 1 5 23.8]
        [--speed 4.85] [--decay 1 3]

plain       no other errors
hum         1 mN rms of 50 Hz
slow        errors of 0.3 mN rms that last for a second
lost        a tenth of a second of samples is lost 0.1 s before t_s
drop        Q falls by 8 % within 50 ms after t_s
stick-slip  from t_s on Q falls by 5 % twice a second
rows        a table of 10 rows a second, as imported: the samples lie on lines between them

The true mu_d is the mean of Q/P without errors from the true t_s to the end of the drive. The peak
is 4 % above the friction before a hold of 20 s at 0.5 N, and falls over each of the lengths of
decay (um). Speed is in um/s; within 1 and 2 are the shares of the runs whose error is within one
and two of the stated standard uncertainties.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from functools import cache
from typing import Annotated, NamedTuple

import numpy as np

from analysis.arrays import F64
from analysis.friction.onset import Onset, sliding_onset
from analysis.mechanics.loading import AxisymmetricLoading, SphereContact
from app.evaluation.budget import Measured
from app.evaluation.history import DriveForces
from app.evaluation.slides import slide_results
from app.records.record_types import Conditions, Phase, Snapshot
from app.settings.config import load
from app.settings.sections import Config
from benchmarks.report import Report

SUBJECT = "Onset of sliding: Q_s, mu_d and the peak after a hold"
MU, L = 0.93, 0.8e-6
SAMPLE_HZ, EXPOSURE = 1000.0, 11  # samples
NOISE_M, NOISE_N = 20e-9, 1e-3
PAST = 0.45  # of the way to sliding; and as many seconds and frames further
MORE_S, MORE_FRAMES = 4.0, 16
STEPS = 300  # of the solved contact, around the onset
WAY_M, HOLD_S, PEAK = 40e-6, 20.0, 0.04  # of a slide, of the hold before it, and the peak after it
MOST_BIAS, UNBIASED = 0.15, ("plain", "hum", "slow", "lost")  # mN
Change = Callable[[F64, F64, float, np.random.Generator], F64]


class Loaded(NamedTuple):
    """Q over the way of the stage, at the onset, and there."""

    way_m: F64
    shear_n: F64
    onset_m: float
    static_n: float


def onset_of(loading: AxisymmetricLoading, compliance: float) -> tuple[float, float]:
    """Way of the stage (m) at which the line of steady sliding begins, and Q there (N)."""
    end = loading.at_force(loading.contact.limit * (1 - 1e-9))
    way = float(end.displacement(0.0)[0]) + compliance * loading.contact.limit
    return way, loading.driven(way, compliance).Q


@cache
def loaded(P: float) -> Loaded:
    """A rough contact under P, driven beyond its onset."""
    config = Config()
    s = config.sample
    contact = SphereContact(P, s.young_modulus, s.poisson, s.lens_radius, MU, L, h=s.roughness)
    compliance = s.lens_compliance + 1 / config.forces.stiffness_shear
    loading = AxisymmetricLoading(contact)
    onset, static = onset_of(loading, compliance)
    near = np.linspace(0.8 * onset, onset + 10 * MU * L, STEPS)
    way = np.unique(np.concatenate([np.linspace(0, 0.8 * onset, 60), near]))
    states = [loading.rest]
    for stage in way[1:].tolist():
        states.append(loading.advance(states[-1], stage, compliance=compliance))
    return Loaded(way, np.array([state.Q for state in states]), onset, static)


def _drops(t: F64, q: F64, ts: float, _: np.random.Generator) -> F64:
    return np.where(t > ts, q * (1 - 0.08 * -np.expm1(-np.maximum(t - ts, 0) / 0.05)), q)


def _sticks(t: F64, q: F64, ts: float, _: np.random.Generator) -> F64:
    return np.where(t > ts, q * (0.95 + 0.05 * (2 * (t - ts) % 1.0)), q)


def _hums(t: F64, q: F64, _: float, rng: np.random.Generator) -> F64:
    return q + math.sqrt(2) * 1e-3 * np.sin(2 * math.pi * (50 * t + rng.random()))


def _is_slow(t: F64, q: F64, _: float, rng: np.random.Generator) -> F64:
    # a hundred errors that begin and end at other times make one of a second
    each = rng.normal(size=(100, len(t) // 1000 + 3))
    begin = rng.random(100)
    seen = [values[(t + b).astype(int)] for values, b in zip(each, begin, strict=True)]
    return np.asarray(q + 0.03e-3 * np.sum(seen, axis=0))


def _is_lost(t: F64, q: F64, ts: float, _: np.random.Generator) -> F64:
    return np.where((t > ts - 0.1) & (t < ts), np.nan, q)


def _in_rows(t: F64, q: F64, *_: object) -> F64:
    return np.interp(t, t[::100], q[::100])


def _is_plain(_: F64, q: F64, *__: object) -> F64:
    return q


# of what the contact does, and of what is read
WORLDS: dict[str, tuple[Change, Change]] = {
    "plain": (_is_plain, _is_plain),
    "hum": (_is_plain, _hums),
    "slow": (_is_plain, _is_slow),
    "lost": (_is_plain, _is_lost),
    "drop": (_drops, _is_plain),
    "stick-slip": (_sticks, _is_plain),
    "rows": (_is_plain, _in_rows),
}


PEAKS = tuple(name for name, (does, _) in WORLDS.items() if does is _is_plain and name != "lost")


def driven(
    world: str, P: float, rate_hz: float, speed_m_s: float, seed: int
) -> tuple[F64, F64, float, np.random.Generator]:
    """Time and Q of every sample of one drive, without errors, t_s, and what draws the rest."""
    rng, contact = np.random.default_rng([seed, round(100 * P)]), loaded(P)
    ts = contact.onset_m / speed_m_s
    end_s = max((1 + PAST) * ts, ts + MORE_S + MORE_FRAMES / rate_hz)
    t = np.arange(int(end_s * SAMPLE_HZ)) / SAMPLE_HZ
    q = np.interp(speed_m_s * t, contact.way_m, contact.shear_n)
    return t, WORLDS[world][0](t, q, ts, rng), ts, rng


def sliding_friction(world: str, P: float, rate_hz: float, speed_m_s: float, seed: int) -> float:
    """The true mu_d of that drive."""
    t, q, ts, _ = driven(world, P, rate_hz, speed_m_s, seed)
    return float(q[t >= ts].mean()) / P


def found(
    world: str, P: float, rate_hz: float, speed_m_s: float, seed: int, *, has_samples: bool
) -> Onset:
    """The onset of one drive, measured."""
    t, q, ts, rng = driven(world, P, rate_hz, speed_m_s, seed)
    q = WORLDS[world][1](t, q + NOISE_N * rng.normal(size=len(t)), ts, rng)
    p = np.where(np.isfinite(q), P + NOISE_N * rng.normal(size=len(t)), np.nan)
    at = (
        (np.arange(int(len(t) / SAMPLE_HZ * rate_hz) - 1) + rng.random()) / rate_hz * SAMPLE_HZ
    ).astype(int)
    exposed = at[:, None] + np.arange(EXPOSURE)
    time, scale = (at + EXPOSURE / 2) / SAMPLE_HZ, MU * L
    u = scale * np.logaddexp(0, speed_m_s * (time - ts) / scale)
    u += NOISE_M * (rng.normal(size=len(u)) + rng.normal())
    return sliding_onset(
        time,
        u,
        q[exposed].mean(axis=1),
        p[exposed].mean(axis=1),
        shared_sd=NOISE_M,
        settled=8 * scale,
        samples=(t, q, p) if has_samples else None,
    )


def rise(
    world: str, decay_m: float, rate_hz: float, speed_m_s: float, seed: int, *, has_samples: bool
) -> tuple[float, float]:
    """By how much the peak after a hold is measured to be above the friction before it, less the
    truth, and the stated uncertainty.
    """
    moves = f"do='drive', travel={1e6 * WAY_M}, velocity={1e6 * speed_m_s}"
    before = "{do='approach'}, {do='reference'}"
    steps = f"{before}, {{{moves}}}, {{do='hold', time={HOLD_S}}}, {{{moves}}}"
    config = load(None, [f"run.steps=[{steps}]"])
    rng, P, lasts = np.random.default_rng(seed), 0.5, WAY_M / speed_m_s
    t = np.arange(int((2 * lasts + HOLD_S) * SAMPLE_HZ)) / SAMPLE_HZ
    again = lasts + HOLD_S
    s = speed_m_s * np.maximum(t - again, 0)
    shape = -np.expm1(-s / (MU * L)) * np.exp(-s / decay_m)
    slip = MU * L * math.log1p(decay_m / (MU * L))
    top = -math.expm1(-slip / (MU * L)) * math.exp(-slip / decay_m)
    q = MU * P * (1 + PEAK * shape / top)
    q = WORLDS[world][1](t, q + NOISE_N * rng.normal(size=len(t)), again, rng)
    p = np.where(np.isfinite(q), P + NOISE_N * rng.normal(size=len(t)), np.nan)
    at = ((np.arange(int(t[-1] * rate_hz)) + rng.random()) / rate_hz * SAMPLE_HZ).astype(int)
    shots = []
    for n, i in enumerate(at[at < len(t) - EXPOSURE].tolist()):
        now = t[i] + EXPOSURE / 2 / SAMPLE_HZ
        step, began = max((3, 0.0), (4, lasts), (5, again), key=lambda one: (one[1] <= now, one[1]))
        travel = speed_m_s * (min(now, lasts) + max(now - again, 0.0))
        P_read, Q_read = (float(y[i : i + EXPOSURE].mean()) for y in (p, q))
        of = Conditions(Phase.DRIVE, now, P_read, Q_read, travel, step, now - began)
        shots.append(Snapshot(n, i, of))
    forces = DriveForces(t, q, p) if has_samples else None
    seen = slide_results(Measured(config, shots, None, forces=forces), [], MU * L)
    return seen["slide_rise"][-1] - MU * PEAK, seen["slide_rise_sd"][-1]


def measure(
    report: Report,
    worlds: Annotated[Sequence[str], WORLDS] = tuple(WORLDS),
    *,
    runs: int = 100,
    loads: Sequence[float] = (0.1, 0.5, 1.4),
    rates: Sequence[float] = (1.0, 5.0, 23.8),
    speed: float = 4.85,
    decay: Sequence[float] = (1.0, 3.0),
) -> None:
    """Measure bias, scatter and coverage in the worlds that are named, or in all."""
    way = speed * 1e-6
    for world in worlds:
        report.table(f"Q_s and mu_d, {world}: {runs} runs each")
        for P in loads:
            for rate in rates:
                name = f"{P:g} N, {rate:g} frames/s"
                true = [sliding_friction(world, P, rate, way, seed) for seed in range(runs)]
                for how in ("frames", "samples"):
                    seen = [
                        found(world, P, rate, way, seed, has_samples=how == "samples")
                        for seed in range(runs)
                    ]
                    bound = MOST_BIAS if how == "samples" and world in UNBIASED else None
                    force = [1e3 * (one.static_force - loaded(P).static_n) for one in seen]
                    force_sd = [1e3 * one.static_force_sd for one in seen]
                    tell(report, f"Q_s, {name}, {how}", force, force_sd, bound)
                    error = [1e3 * (one.mu_d - mu) for one, mu in zip(seen, true, strict=True)]
                    ratio_sd = [1e3 * one.mu_d_sd for one in seen]
                    tell(report, f"mu_d, {name}, {how}", error, ratio_sd)
        if world not in PEAKS:
            continue
        report.table(f"Peak after a hold, {world}: {runs} runs each")
        for length in decay:
            for rate in rates:
                for how in ("frames", "samples"):
                    each = [
                        rise(world, length * 1e-6, rate, way, seed, has_samples=how == "samples")
                        for seed in range(runs)
                    ]
                    title = f"peak, {length:g} um, {rate:g} frames/s, {how}"
                    tell(report, title, *(1e3 * np.array(each).T))


def tell(
    report: Report,
    title: str,
    errors: Sequence[float] | F64,
    stated: Sequence[float] | F64,
    bound: float | None = None,
) -> None:
    """Report errors and stated uncertainties, in mN or thousandths."""
    error, sd = np.asarray(errors), np.asarray(stated)
    unit = "mN" if title.startswith("Q_s") else "e-3"
    known = np.isfinite(error)
    report.row(title, digits=2, missing=(int(np.sum(~known)), "", None if bound is None else 0))
    if not known.any():
        return
    error, sd = error[known], sd[known]
    report.row(
        title,
        digits=2,
        bias=(np.mean(error), unit, bound),
        rms=(math.sqrt(np.mean(error**2)), unit),
        stated=(np.median(sd), unit),
        within_1=np.mean(np.abs(error) < sd),
        within_2=np.mean(np.abs(error) < 2 * sd),
    )
