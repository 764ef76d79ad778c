"""The shear force Q_s at the onset of sliding, read between frames and from the samples before it,
on drives of a rough contact whose Q_s is known: u_x at the centre with noise of 20 nm in each
frame, of which the reference shares, forces with white noise of 1 mN in samples of 1 kHz.

    python -m benchmarks onset [WORLD...] [--runs 100] [--loads 0.1 0.5 1.4] [--rates 1 5 23.8]
        [--speed 4.85]

plain       no other errors
hum         1 mN rms of 50 Hz
slow        errors of 0.3 mN rms that last for a second
lost        a tenth of a second of samples is lost 0.1 s before t_s
drop        Q falls by 8 % within 50 ms after t_s
stick-slip  from t_s on Q falls by 5 % twice a second
rows        a table of 10 rows a second, as imported: the samples lie on lines between them

Speed is in um/s; within 1 and 2 are the shares of the runs whose error is within one and two of the
stated standard uncertainties.
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
from app.settings.sections import Config
from benchmarks.report import Report

SUBJECT = "Onset of sliding: Q_s"
MU, L = 0.93, 0.8e-6
SAMPLE_HZ, EXPOSURE = 1000.0, 11  # samples
NOISE_M, NOISE_N = 20e-9, 1e-3
PAST = 0.45  # of the way to sliding; and as many seconds and frames further
MORE_S, MORE_FRAMES = 4.0, 16
STEPS = 300  # of the solved contact, around the onset
MOST_BIAS, UNBIASED = 0.15, ("plain", "hum", "slow", "lost")  # mN
Change = Callable[[F64, F64, float, np.random.Generator], F64]


class Loaded(NamedTuple):
    """Q over the way of the stage, at the onset, and there."""

    way_m: F64
    shear_n: F64
    onset_m: float
    static_n: float


@cache
def loaded(P: float) -> Loaded:
    """A rough contact under P, driven beyond its onset."""
    config = Config()
    s = config.sample
    contact = SphereContact(P, s.young_modulus, s.poisson, s.lens_radius, MU, L, h=s.roughness)
    compliance = s.lens_compliance + 1 / config.forces.stiffness_shear
    loading = AxisymmetricLoading(contact)
    sliding = loading.at_force(contact.limit * (1 - 1e-9))
    onset = float(sliding.displacement(0.0)[0]) + compliance * contact.limit
    near = np.linspace(0.8 * onset, onset + 10 * MU * L, STEPS)
    way = np.unique(np.concatenate([np.linspace(0, 0.8 * onset, 60), near]))
    states = [loading.rest]
    for stage in way[1:].tolist():
        states.append(loading.advance(states[-1], stage, compliance=compliance))
    static = loading.driven(onset, compliance).Q
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


def found(
    world: str, P: float, rate_hz: float, speed_m_s: float, seed: int, *, has_samples: bool
) -> Onset:
    """The onset of one drive, measured."""
    rng, contact = np.random.default_rng([seed, round(100 * P)]), loaded(P)
    ts = contact.onset_m / speed_m_s
    end_s = max((1 + PAST) * ts, ts + MORE_S + MORE_FRAMES / rate_hz)
    t = np.arange(int(end_s * SAMPLE_HZ)) / SAMPLE_HZ
    acts, is_read = WORLDS[world]
    q = acts(t, np.interp(speed_m_s * t, contact.way_m, contact.shear_n), ts, rng)
    q = is_read(t, q + NOISE_N * rng.normal(size=len(t)), ts, rng)
    p = np.where(np.isfinite(q), P + NOISE_N * rng.normal(size=len(t)), np.nan)
    at = ((np.arange(int(end_s * rate_hz) - 1) + rng.random()) / rate_hz * SAMPLE_HZ).astype(int)
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


def measure(
    report: Report,
    worlds: Annotated[Sequence[str], WORLDS] = tuple(WORLDS),
    *,
    runs: int = 100,
    loads: Sequence[float] = (0.1, 0.5, 1.4),
    rates: Sequence[float] = (1.0, 5.0, 23.8),
    speed: float = 4.85,
) -> None:
    """Measure bias, scatter and coverage of Q_s in the worlds that are named, or in all."""
    for world in worlds:
        report.table(f"Q_s, {world}: {runs} runs each")
        for P in loads:
            true = loaded(P).static_n
            for rate in rates:
                for has_samples in (False, True):
                    seen = [
                        found(world, P, rate, speed * 1e-6, seed, has_samples=has_samples)
                        for seed in range(runs)
                    ]
                    error = np.array([one.static_force for one in seen]) - true
                    size = np.abs(error) / [one.static_force_sd for one in seen]
                    how = "samples" if has_samples else "frames"
                    bound = MOST_BIAS if has_samples and world in UNBIASED else None
                    report.row(
                        f"{P:g} N, {rate:g} frames/s, {how}",
                        digits=2,
                        bias=(1e3 * np.mean(error), "mN", bound),
                        rms=(1e3 * math.sqrt(np.mean(error**2)), "mN"),
                        stated=(1e3 * np.median([one.static_force_sd for one in seen]), "mN"),
                        within_1=np.mean(size < 1),
                        within_2=np.mean(size < 2),
                    )
