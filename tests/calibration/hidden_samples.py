"""More benches whose constants a calibration does not know, see `hidden_benches`: the sample, the
stage, the lens holder and the clocks.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import scipy
from hidden_benches import RATE, serial

from analysis.calibration.adhesion import adhesion_test
from analysis.calibration.compliance import holder_compliance
from analysis.calibration.radius_law import radius_law
from analysis.calibration.roughness import roughness
from analysis.calibration.stage_motion import (
    backlash,
    periodic_error,
    steady_velocity,
    straightness,
)
from analysis.calibration.timing import channel_skew, clock_drift, exposure_lag, exposure_lags
from analysis.mechanics import jkr
from analysis.mechanics.greenwood_tripp import apparent_radius
from analysis.mechanics.hertz import contact_radius

# ------------------------------------------------------------------ JKR test

R, NU = 128.8e-3, 0.5
E, W, W_OPEN = 3.43e6, 0.05, 0.1
EACH = 15
RADIUS_SD, FORCE_SD, ZERO_SD, EDGE_SD = 3e-6, 5e-4, 1e-3, 1e-6
SCALES = (0.003, 5e-4, 3e-3)
FORCE = np.concatenate([np.linspace(0, 0.6, EACH), np.linspace(0.58, -0.008, EACH)])
FALLS = np.arange(2 * EACH) >= EACH


def adhering_radii(E=E, w=W, w_open=W_OPEN, R=R):
    closing, opening = (jkr.contact_radius(FORCE, each, E, NU, R) for each in (w, w_open))
    return np.where(FALLS, opening, closing)


def adhering(seed=0, **world):
    """Radii and forces with noise."""
    rng = np.random.default_rng(seed)
    a = adhering_radii(**world) + rng.normal(0, RADIUS_SD, FORCE.shape)
    return a, FORCE + rng.normal(0, FORCE_SD, FORCE.shape)


def adhesion(seed):
    """A JKR test whose lens, pixel, force, zero and edge are not quite those of the settings."""
    rng = np.random.default_rng(1000 + seed)
    E, w = rng.uniform(2e6, 5e6), rng.uniform(0.03, 0.08)
    w_open = w * rng.uniform(1.2, 3)
    lens, scale, newtons = 1 + np.array(SCALES) * rng.standard_normal(3)
    a, P = adhering(seed, E=E, w=w, w_open=w_open, R=R * lens)
    a = a * scale + rng.normal(0, EDGE_SD)
    P = P * newtons + rng.normal(0, ZERO_SD)
    found = adhesion_test(
        a, P, R, NU, a_sd=RADIUS_SD, P_sd=FORCE_SD, zero_sd=ZERO_SD, edge_sd=EDGE_SD,
        relative_sd=SCALES,
    )  # fmt: skip
    return {
        "E by JKR": (found.E, found.E_sd, E),
        "w of loading": (found.w, found.w_sd, w),
        "w of unloading": (found.w_unloading, found.w_unloading_sd, w_open),
        "hysteresis of w": (found.hysteresis, found.hysteresis_sd, w_open - w),
    }


# ------------------------------------------------------------------ rough faces

H, PITCH, LENGTH = 0.595e-6, 1e-6, 4e-6
SIDE = 384
LOADS = np.array([0.1, 0.3, 0.5, 0.7, 1.0, 1.4])
APPARENT_SD, LOAD_SD, LAW_SCALES = 2.5e-5, 1e-3, (0.003, 0.002, 0.005)


@lru_cache
def amplitudes(wide, length, hurst):
    q = np.fft.fftfreq(wide, PITCH) * 2 * np.pi
    q2 = (q[:, None] ** 2 + q[: wide // 2 + 1] ** 2) * length**2
    power = np.exp(-q2 / 4) if hurst is None else (1 + q2) ** -(1 + hurst)
    power[0, 0] = 0
    total = power.sum() * 2 - power[:, 0].sum() - power[:, -1].sum()
    return np.sqrt(power / total) * wide


def surface(seed=0, shape=(SIDE, SIDE), length=LENGTH, hurst=None, h=H):
    """A part of a periodic surface twice as wide, with a Gaussian autocorrelation
    exp(-(r/length)^2), or self-affine beyond a roll-off.
    """
    wide = 2 * max(shape)
    white = np.random.default_rng(seed).standard_normal((wide, wide))
    z = np.fft.irfft2(np.fft.rfft2(white) * amplitudes(wide, length, hurst), (wide, wide))
    return h * z[: shape[0], : shape[1]]


def form(shape):
    """Tilt and curvature of a mounted sample."""
    y, x = np.mgrid[: shape[0], : shape[1]] * PITCH
    return 0.02 * x - 0.01 * y + (x - 1e-4) ** 2 / 0.1 + 0.3 * x * y


def height_map(seed=0, **kind):
    """With form, holes and spikes."""
    z = surface(seed, **kind)
    z += form(z.shape)
    rng = np.random.default_rng([seed, 1])
    z[rng.random(z.shape) < 0.02] = np.nan
    z[100:112, 50:70] = np.nan
    z[rng.random(z.shape) < 2e-4] += 8e-6
    return z


def rough(seed, **kind):
    """A height map; rolling hills, or self-affine."""
    kind = kind or {"length": 3e-6}
    h = H * np.random.default_rng([seed, 2]).uniform(0.5, 2)
    found = roughness(height_map(seed, h=h, shape=(256, 256), **kind), PITCH)
    return {"h of hills" if "hurst" not in kind else "h, self-affine": (found.h, found.h_sd, h)}


def rough_affine(seed):
    return rough(seed, hurst=0.8, length=2e-6)


def apparent_radii(E=E, h=H, R=R, loads=LOADS):
    return np.array([apparent_radius(contact_radius(P, E, NU, R), R, h) for P in loads])


def law_of_radii(P, a, R=R, h=H, **given):
    return radius_law(P, a, R, h, NU, **{"P_sd": LOAD_SD, "a_sd": APPARENT_SD} | given)


def drawn_radii(seed):
    """Radii over loads of a rough face, fitted, and E and the extension of that face."""
    rng = np.random.default_rng(seed)
    E, h = rng.uniform(2e6, 5e6), rng.uniform(0.3e-6, 1e-6)
    lens, scale, newtons = 1 + np.array(LAW_SCALES) * rng.standard_normal(3)
    a = apparent_radii(E, h, R * lens) * scale + rng.normal(0, APPARENT_SD, len(LOADS))
    P = LOADS * newtons + rng.normal(0, LOAD_SD, len(LOADS))
    measured_h = h * (1 + 0.05 * rng.standard_normal())
    found = law_of_radii(P, a, h=measured_h, h_sd=0.05 * h, relative_sd=LAW_SCALES)
    return found, E, np.sqrt(R * h)


def radii_over_loads(seed):
    """E by Fig. 3."""
    found, E, extension = drawn_radii(seed)
    free, held = found.free, found.rough
    return {
        "E by apparent radii": (held.E, held.E_sd, E),
        "extension by h": (held.extension, held.extension_sd, extension),
        "E by radii, extension free": (free.E, free.E_sd, E),
        "extension, free": (free.extension, free.extension_sd, extension),
    }


# ------------------------------------------------------------------ stage

ENCODER_M = 35e-9
ASKED = 5e-6


def velocity(seed, correlation=0.0):
    """A slow stage that jitters, by its encoder."""
    rng = np.random.default_rng(seed)
    true = ASKED * rng.uniform(0.95, 0.99)
    time = np.arange(0, 40, 0.1)
    at = true * time + 40e-9 * serial(rng, len(time), correlation)
    found = steady_velocity(time, np.round(at / ENCODER_M) * ENCODER_M, ASKED)
    return {f"velocity, noise {correlation:g}": (found.value_m_s, found.sd_m_s, true)}


def velocity_jitter(seed):
    return velocity(seed, 0.8)


def cycles(rng, lost, *, noise=20e-9, drift=2e-9, n=200, count=2):
    """Time, encoder and picture of a stage that goes forth and back by 60 um."""
    time = (np.arange(2 * n * count) + rng.uniform(-0.3, 0.3, 2 * n * count)) * 0.3
    stage = 60e-6 * (1 - np.abs(time / (n * 0.3) % 2 - 1))
    block, place = np.empty_like(stage), 0.0
    for i, s in enumerate(stage):
        place = min(max(place, s), s + lost)
        block[i] = place
    seen = 1.003 * block + drift * time + noise * serial(rng, len(time), 0.5)
    return time, np.round(stage / ENCODER_M) * ENCODER_M, seen


def lost_motion(seed, lost=1.7e-6):
    found = backlash(*cycles(np.random.default_rng(seed), lost))
    return {"backlash": (found.lost_m, found.sd_m, 1.003 * lost)}


def screw(seed):
    """A periodic error."""
    rng = np.random.default_rng(seed)
    at = np.sort(rng.uniform(0, 2e-3, 150))
    phase, period = rng.uniform(0, 6.28), rng.uniform(4.8e-4, 5.2e-4)
    line = 2e-7 * np.sin(2 * np.pi * at / period + phase)
    found = periodic_error(at, line + 1e-3 * at + 60e-9 * serial(rng, 150, 0.3))
    assert found.false_alarm < 1e-6
    assert np.std(found.at(at) - line) < 3e-8
    return {
        "amplitude of the screw": (found.amplitude_m, found.amplitude_sd_m, 2e-7),
        "period of the screw": (found.period_m, found.period_sd_m, period),
    }


def bow(seed):
    """A travel that is not straight."""
    rng = np.random.default_rng(seed)
    along = np.linspace(-100e-6, 100e-6, 200)
    across = np.tan(0.02) * along + 3e-7 * (1 - (along / 100e-6) ** 2)
    found = straightness(along, across + 3e-8 * serial(rng, 200, 0.4))
    return {
        "angle by the stage": (found.angle, found.angle_sd, 0.02),
        "bow": (found.bow_m, found.bow_sd_m, 3e-7),
    }


# ------------------------------------------------------------------ lens holder

C, DRIFT, PER_DEGREE = 0.68e-6, 1e-9, 60e-9


def loading(rng, n=160, noise=10e-9):
    """Two loadings and unloadings to 0.9 N in 160 s, in a room that warms up and cools."""
    time = np.arange(n) * 1.0
    Q = 0.9 * np.clip(1.3 * (1 - np.abs(time / 40 % 2 - 1)), 0, 1)
    degrees = 21 + 0.4 * np.sin(time / 55 + rng.uniform(0, 6))
    moved = C * Q + DRIFT * time + PER_DEGREE * degrees + noise * serial(rng, n, 0.5)
    return time, Q + 1e-3 * rng.standard_normal(n), moved, degrees


def compliance(seed):
    found = holder_compliance(*loading(np.random.default_rng(seed)))
    return {
        "compliance": (found.value_m_n, found.sd_m_n, C),
        "drift of the holder": (found.drift_m_s, found.drift_sd_m_s, DRIFT),
        "motion per degree": (found.per_unit_m, found.per_unit_sd_m, PER_DEGREE),
    }


# ------------------------------------------------------------------ clocks


def exposures(rng, lag, jitter, n=60, divisor=25):
    """Exposures counted by each sample, of triggers on every 25th."""
    began = np.arange(n) * divisor + lag + jitter * rng.standard_normal(n)
    return np.searchsorted(began, np.arange(n * divisor), side="right")


def lag(seed):
    """In samples; every other bench has a jitter that is far below one."""
    rng = np.random.default_rng(seed)
    true, jitter = rng.uniform(0, 8), rng.uniform(0, 0.6) if seed % 2 else 0.01
    found = exposure_lag(exposure_lags(exposures(rng, true, jitter), 0, 25), RATE)
    return {"exposure lag": (found.lag_s * RATE, found.sd_s * RATE, true)}


def pair(rng, skew_s, noise=0.3, n=8000, is_filtered=False):
    """A band of noise on two channels of which the second is read later."""
    common = scipy.signal.lfilter(*scipy.signal.butter(2, 200, fs=RATE), rng.standard_normal(n))
    turn = np.exp(2j * np.pi * np.fft.rfftfreq(n, 1 / RATE) * skew_s)
    late = np.fft.irfft(np.fft.rfft(common) * turn, n)
    if is_filtered:
        late = scipy.signal.lfilter(*scipy.signal.butter(1, 60, fs=RATE), late)
    size = noise * common.std()
    return common + size * rng.standard_normal(n), 2 * late + size * rng.standard_normal(n)


def skew(seed, skew_s=2e-5):
    """The second channel, read later, has what the first one has next."""
    found = channel_skew(*pair(np.random.default_rng(seed), skew_s), RATE)
    assert found.sd_s < 2e-5
    return {"skew of the channels": (found.skew_s, found.sd_s, skew_s)}


def clocks(seed, correlation=0.0):
    """Stamps of a camera over an hour."""
    rng = np.random.default_rng(seed)
    drift, sample = rng.uniform(-50e-6, 50e-6), np.arange(0, 3_600_000, 8000)
    stamp = 17.0 + (1 + drift) * sample / RATE + 2e-4 * serial(rng, len(sample), correlation)
    stamp[rng.integers(0, len(sample), 6)] += 0.3  # a busy computer
    stamp[5] = np.nan
    found = clock_drift(sample, stamp, RATE)
    assert found.sd < 1e-7
    return {"drift of the camera's clock": (found.drift, found.sd, drift)}
