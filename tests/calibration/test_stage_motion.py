"""Velocity, lost motion, periodic error and straightness of a stage, against motions made by
closed forms whose constants the fit does not know.
"""

import numpy as np
import pytest
from hidden_benches import serial
from hidden_samples import (
    ASKED,
    ENCODER_M,
    bow,
    cycles,
    lost_motion,
    screw,
    velocity,
    velocity_jitter,
)
from seeds import SEEDS, holds, pulls, seen_by

from analysis.calibration.stage_motion import (
    backlash,
    periodic_error,
    steady_velocity,
    straightness,
)


@pytest.mark.slow
@pytest.mark.parametrize("kind", [velocity, velocity_jitter])
def test_velocity_holds_its_uncertainty_and_a_thousandth(kind):
    (found,) = seen_by(kind).values()
    holds(pulls(found))
    assert np.abs(found[0] - found[2]).max() < 1e-3 * ASKED


def test_an_encoder_in_step_with_its_readings_has_an_uncertainty():
    off = []
    for seed in range(SEEDS):
        true = 4 * ENCODER_M / 0.1 * (1 + np.random.default_rng(seed).uniform(-2e-3, 2e-3))
        time = np.arange(0, 12, 0.1)
        found = steady_velocity(time, np.round(true * time / ENCODER_M) * ENCODER_M, 1.4e-6)
        off.append((found.value_m_s - true) / found.sd_m_s)
    assert np.mean(np.abs(off) < 1) >= 0.6
    assert np.abs(off).max() < 2.5


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
    (found,) = seen_by(lambda seed: lost_motion(seed, lost)).values()
    holds(pulls(found))
    found = backlash(*cycles(np.random.default_rng(SEEDS), lost))
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
    for one in seen_by(screw).values():
        holds(pulls(one))


@pytest.mark.parametrize("correlation", [0.0, 0.5])
def test_noise_alone_is_no_screw(correlation):
    at = np.linspace(0, 2e-3, 150)
    false = [
        periodic_error(at, serial(np.random.default_rng(seed), 150, correlation)).false_alarm
        for seed in range(45)
    ]
    assert np.mean(np.array(false) < 0.1) < 0.25
    assert min(false) > 1e-4


def test_direction_and_bow_of_a_travel():
    for one in seen_by(bow).values():
        holds(pulls(one))
    along = np.linspace(-100e-6, 100e-6, 200)
    across = np.tan(0.02) * along + 1e-8 * np.random.default_rng(0).standard_normal(200)
    with pytest.raises(ValueError, match="degrees from the rows"):
        straightness(across, along)


def test_single_outliers_move_a_periodic_error_no_more_than_its_uncertainty():
    off = []
    at = np.linspace(0, 2e-3, 400)
    for seed in range(SEEDS // 2):
        rng = np.random.default_rng(seed)
        noise = 5e-8 * rng.standard_normal(400) * np.where(rng.random(400) < 0.03, 15, 1)
        wave = 2e-7 * np.sin(2 * np.pi * (at / 3.7e-4 + rng.random()))
        found = periodic_error(at, wave + noise)
        off.append((found.amplitude_m - 2e-7) / found.amplitude_sd_m)
        off.append((found.period_m - 3.7e-4) / found.period_sd_m)
    assert np.std(off) < 1.3


def test_an_encoder_whose_zero_walks_tells_the_velocity_worse():
    """White noise hides the walk from one reading to the next."""
    off = []
    for seed in range(60):
        rng = np.random.default_rng(seed)
        time = np.arange(0, 200, 0.1)
        walk = np.cumsum(rng.standard_normal(2000)) / np.sqrt(2000)
        at = 4.9e-6 * time + 20e-9 * (walk + rng.standard_normal(2000))
        found = steady_velocity(time, at, ASKED)
        off.append((found.value_m_s - 4.9e-6) / found.sd_m_s)
    assert np.std(off) < 3.5


def test_errors_that_keep_most_of_the_one_before_tell_the_velocity_worse():
    off, time = [], np.arange(0, 40, 0.1)
    for seed in range(60):
        errors = 20e-9 * serial(np.random.default_rng(seed), 400, 0.98)
        found = steady_velocity(time, 4.9e-6 * time + errors, ASKED)
        off.append((found.value_m_s - 4.9e-6) / found.sd_m_s)
    assert np.std(off) < 1.3
