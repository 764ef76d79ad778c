"""Weights and displacements on cantilevers whose constants the fit does not know: stiffness,
cross-talk, and what is refused.
"""

import numpy as np
import pytest
from hidden_benches import EVERY_S, THREE_TIMES, UP_AND_DOWN, readings, stiffness
from seeds import SEEDS, errors, holds, pulls, seen_by

from analysis.calibration.cross_talk import calibrate_loads
from analysis.calibration.sensor_response import sensor_response


def within(pulls, sigmas):
    return np.mean(np.abs(pulls) < sigmas)


@pytest.mark.parametrize(
    "world", [{}, {"drift": 0.1}, {"walk": 1e-3}, {"bend": 0.002}, {"rubbing": 0.003}]
)
def test_the_slope_is_within_its_uncertainty(world):
    off = []
    for seed in range(SEEDS):
        y = readings(np.random.default_rng(seed), THREE_TIMES, -4.838, **world)
        found = sensor_response(THREE_TIMES, y, EVERY_S * np.arange(len(y)))
        off.append((found.slope + 4.838) / found.slope_sd)
        assert found.slope == pytest.approx(-4.838, rel=0.002)
    assert within(off, 1) >= 0.55
    assert within(off, 2) >= 0.9


def test_stiffness_and_cross_talk_are_within_their_uncertainties():
    """The stiffness within 0.5 %, cross-talk within 0.1 % of full."""
    found = seen_by(stiffness, SEEDS // 2)
    k_N, k_T, *cross = (found[name] for name in (
        *("stiffness k_N", "stiffness k_T", "cross-talk Q in P", "cross-talk P in Q"),
    ))  # fmt: skip
    for one in (k_N, k_T):
        assert np.abs(errors(one)).max() < 5e-3
    for measured, _, true in cross:
        assert np.abs(measured - true).max() < 1e-3
    for both in ((k_N, k_T), cross):
        holds(pulls(np.hstack(both)))


def test_an_outlier_is_left_out_and_told():
    y = readings(np.random.default_rng(3), THREE_TIMES, 4.8)
    y[[7, 15]] += [0.05, -0.02]
    found = sensor_response(THREE_TIMES, y)
    assert np.flatnonzero(~found.is_used).tolist() == [7, 15]
    assert found.residual[7] == pytest.approx(0.05, abs=2e-3)
    assert found.slope == pytest.approx(4.8, rel=1e-3)


def test_bend_hysteresis_and_drift_are_what_they_are():
    y = readings(
        np.random.default_rng(5), THREE_TIMES, 4.0, drift=0.1, bend=0.004, rubbing=0.006
    )  # fmt: skip
    found = sensor_response(THREE_TIMES, y)
    for value, sd, true in (
        (found.bend, found.bend_sd, 0.016),
        (found.hysteresis, found.hysteresis_sd, 0.024),
        (found.drift, found.drift_sd, 0.1),
        (found.zero, found.zero_sd, 0.12),
    ):
        assert abs(value - true) < 3.5 * sd < 0.01
    # the bend and the hysteresis are part of what a force of any size is uncertain by
    assert found.relative_sd == pytest.approx(np.hypot(0.004, 0.006) / np.sqrt(3), rel=0.1)


@pytest.mark.parametrize(
    ("world", "keywords", "word"),
    [
        ({"drift": 0.6}, {}, "drift of the zero"),
        ({"bend": 0.03}, {}, "bend"),
        ({"rubbing": 0.03}, {}, "hysteresis"),
        ({"noise": 0.5}, {}, "slope"),
        ({}, {"sign": -1}, "sign"),
        ({}, {"end_of_range": 4.9}, "end of the range"),
    ],
)
def test_what_is_no_calibration_is_refused(world, keywords, word):
    y = readings(np.random.default_rng(7), THREE_TIMES, 4.8, **world)
    with pytest.raises(ValueError, match=word):
        sensor_response(THREE_TIMES, y, **keywords)


@pytest.mark.parametrize(
    ("loads", "word"),
    [
        ([0, 1, 0, 1, 0], "8 or more"),
        ([0, 1] * 5, "2 different loads"),
        (np.linspace(0, 1, 10), "second time"),
    ],
)
def test_too_few_loads_are_refused(loads, word):
    with pytest.raises(ValueError, match=word):
        sensor_response(loads, 4.8 * np.asarray(loads))


def test_unusable_arrays_are_refused():
    with pytest.raises(ValueError, match="shapes"):
        sensor_response([0, 1, 2], [0, 1])
    with pytest.raises(ValueError, match="finite"):
        sensor_response(UP_AND_DOWN, UP_AND_DOWN * np.nan)
    with pytest.raises(ValueError, match="shapes"):
        calibrate_loads(UP_AND_DOWN, np.zeros(9, int), np.zeros(9))
    with pytest.raises(ValueError, match="no load"):
        calibrate_loads([], np.zeros(0, int), np.zeros((0, 2)))


def test_one_axis_alone_leaves_the_other_unknown():
    volts = np.outer(THREE_TIMES, [4.8, 0.04])
    found = calibrate_loads(THREE_TIMES, np.zeros(len(THREE_TIMES), int), volts)
    assert found.newtons_per_volt[0] == pytest.approx(1 / 4.8)
    assert np.isnan(found.newtons_per_volt[1])
    assert np.isnan(found.coupling[1, 0])
    assert found.responses[1][0].slope == pytest.approx(0.04)


def test_axes_that_were_mixed_up_are_refused():
    volts = np.outer(THREE_TIMES, [4.8, 4.0])
    n = len(THREE_TIMES)
    both = np.concatenate([volts, volts])
    with pytest.raises(ValueError, match="which axis was loaded"):
        calibrate_loads(np.tile(THREE_TIMES, 2), np.repeat([0, 1], n), both)


@pytest.mark.parametrize(("noise", "decimals"), [(0.0, 3), (1e-4, 3), (1e-3, 2)])
def test_readings_written_to_a_millivolt_are_known_no_better(noise, decimals):
    """Three loads again and again, each reading rounded by the same."""
    off = []
    for seed in range(200):
        rng = np.random.default_rng(seed)
        slope = 4.8 + rng.uniform(-0.5, 0.5)
        load = np.tile([0, 0.5, 1, 0.5], 3)
        volts = rng.uniform(0.05, 0.2) + slope * load + noise * rng.standard_normal(12)
        found = sensor_response(load, np.round(volts, decimals))
        off.append([(found.slope - slope) / found.slope_sd, found.bend / found.bend_sd])
    assert np.std(off, axis=0).min() > 0.7
    assert np.std(off, axis=0).max() < 1.3
