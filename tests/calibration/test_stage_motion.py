"""Velocity, lost motion, periodic error and straightness of a stage, against motions made by
closed forms whose constants the fit does not know.
"""

import numpy as np
import pytest
from seeds import SEEDS, holds, serial

from analysis.calibration.stage_motion import (
    backlash,
    periodic_error,
    steady_velocity,
    straightness,
)

ENCODER_M = 35e-9
ASKED = 5e-6


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


@pytest.mark.parametrize("correlation", [0.0, 0.8])
def test_velocity_holds_its_uncertainty_and_a_thousandth(correlation):
    pulls, errors = [], []
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        true = ASKED * rng.uniform(0.95, 0.99)
        time = np.arange(0, 40, 0.1)
        at = true * time + 40e-9 * serial(rng, len(time), correlation)
        found = steady_velocity(time, np.round(at / ENCODER_M) * ENCODER_M, ASKED)
        pulls.append((found.value_m_s - true) / found.sd_m_s)
        errors.append(found.ratio - true / ASKED)
    holds(pulls)
    assert np.abs(errors).max() < 1e-3


def test_an_encoder_in_step_with_its_readings_has_an_uncertainty():
    pulls = []
    for seed in range(SEEDS):
        true = 4 * ENCODER_M / 0.1 * (1 + np.random.default_rng(seed).uniform(-2e-3, 2e-3))
        time = np.arange(0, 12, 0.1)
        found = steady_velocity(time, np.round(true * time / ENCODER_M) * ENCODER_M, 1.4e-6)
        pulls.append((found.value_m_s - true) / found.sd_m_s)
    assert np.mean(np.abs(pulls) < 1) >= 0.6
    assert np.abs(pulls).max() < 2.5


def test_garbled_readings_do_not_move_the_velocity():
    rng = np.random.default_rng(3)
    time = np.arange(0, 40, 0.1)
    at = 4.9e-6 * time + 20e-9 * rng.standard_normal(400)
    at[rng.integers(0, 400, 12)] += 5e-3
    at[100] = np.nan
    found = steady_velocity(time, at, ASKED)
    assert abs(found.value_m_s - 4.9e-6) < min(3 * found.sd_m_s, 5e-9)


def test_uncertainty_of_the_scale_is_that_of_a_velocity_from_pictures():
    time = np.arange(0, 40, 0.1)
    at = 4.9e-6 * time + 1e-9 * np.random.default_rng(0).standard_normal(len(time))
    found = steady_velocity(time, at, ASKED, scale_sd=2e-3)
    assert found.ratio_sd == pytest.approx(0.98 * 2e-3, rel=1e-3)


@pytest.mark.parametrize(
    ("position", "reason"),
    [
        (lambda t: -4.9e-6 * t, "the other way"),
        (lambda t: 1e-8 * np.sin(t), "stands"),
        (lambda t: 4.9e-6 * (t - t**2 / 800), "changes by"),
        (lambda t: 4.9e-6 * np.maximum(t - 5, 0), "changes by|further from the fit"),
        (lambda t: 4.9e-6 * t + 1e-5 * (np.arange(len(t)) % 9 == 0), "further from the fit"),
    ],
)
def test_a_motion_that_is_not_steady_is_refused(position, reason):
    time = np.arange(0, 40, 0.1)
    noise = 2e-8 * np.random.default_rng(0).standard_normal(len(time))
    with pytest.raises(ValueError, match=reason):
        steady_velocity(time, position(time) + noise, ASKED)


def test_few_readings_are_refused():
    with pytest.raises(ValueError, match="12 readings"):
        steady_velocity(np.arange(12.0), 5e-6 * np.arange(12), ASKED)


@pytest.mark.parametrize("lost", [0.0, 1.7e-6])
def test_backlash_beside_a_drift(lost):
    pulls = []
    for seed in range(SEEDS // 2):
        found = backlash(*cycles(np.random.default_rng(seed), lost))
        pulls.append((found.lost_m - 1.003 * lost) / found.sd_m)
    holds(pulls)
    assert found.turns == 3
    assert found.sd_m < 20e-9
    assert abs(found.scale - 1.003) < 4 * found.scale_sd < 1e-3
    assert found.drift_m_s == pytest.approx(2e-9, rel=0.1)


def test_backlash_needs_a_turn_a_travel_and_the_right_sign():
    rng = np.random.default_rng(0)
    time, stage, seen = cycles(rng, 1.7e-6, count=1)
    with pytest.raises(ValueError, match="one way only"):
        backlash(time[:180], stage[:180], seen[:180])
    with pytest.raises(ValueError, match="let the stage travel further"):
        backlash(*cycles(rng, 40e-6))
    with pytest.raises(ValueError, match="ahead of the stage"):
        backlash(time, seen, stage)


def test_period_and_amplitude_of_a_screw():
    amplitudes, periods = [], []
    for seed in range(SEEDS // 2):
        rng = np.random.default_rng(seed)
        at = np.sort(rng.uniform(0, 2e-3, 150))
        phase, period = rng.uniform(0, 6.28), rng.uniform(4.8e-4, 5.2e-4)
        noise = 60e-9 * serial(rng, 150, 0.3)
        off = 2e-7 * np.sin(2 * np.pi * at / period + phase) + 1e-3 * at + noise
        found = periodic_error(at, off)
        assert found.false_alarm < 1e-6
        line = 2e-7 * np.sin(2 * np.pi * at / period + phase)
        assert np.std(found.at(at) - line) < 3e-8
        amplitudes.append((found.amplitude_m - 2e-7) / found.amplitude_sd_m)
        periods.append((found.period_m - period) / found.period_sd_m)
    holds(amplitudes)
    holds(periods)


@pytest.mark.parametrize("correlation", [0.0, 0.5])
def test_noise_alone_is_no_screw(correlation):
    at = np.linspace(0, 2e-3, 150)
    false = [
        periodic_error(at, serial(np.random.default_rng(seed), 150, correlation)).false_alarm
        for seed in range(SEEDS // 4)
    ]
    assert np.mean(np.array(false) < 0.1) < 0.25
    assert min(false) > 1e-4


def test_direction_and_bow_of_a_travel():
    angles, bows = [], []
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        along = np.linspace(-100e-6, 100e-6, 200)
        bow = 3e-7 * (1 - (along / 100e-6) ** 2)
        across = np.tan(0.02) * along + bow + 3e-8 * serial(rng, 200, 0.4)
        found = straightness(along, across)
        angles.append((found.angle - 0.02) / found.angle_sd)
        bows.append((found.bow_m - 3e-7) / found.bow_sd_m)
    holds(angles)
    holds(bows)
    with pytest.raises(ValueError, match="degrees from the rows"):
        straightness(across, along)
