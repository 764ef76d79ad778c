"""Lag, skew and drift of clocks, against records made with delays that the fit does not know."""

import numpy as np
import pytest
from hidden_benches import RATE
from hidden_samples import clocks, exposures, lag, pair, skew
from seeds import SEEDS, holds, pulls, seen_by

from analysis.calibration.timing import channel_skew, clock_drift, exposure_lag, exposure_lags


def test_lag_to_a_sample_within_its_uncertainty():
    (one,) = seen_by(lag).values()
    assert np.abs(one[0] - one[2]).max() < 1
    holds(pulls(one))


@pytest.mark.parametrize("jitter", [0.01, 0.1, 0.3, 0.6, 0.9])
def test_a_lag_is_as_certain_as_its_jitter_lets_it_be(jitter):
    rng, off = np.random.default_rng(0), []
    for true in rng.uniform(0, 8, SEEDS):
        found = exposure_lag(exposure_lags(exposures(rng, true, jitter), 0, 25), RATE)
        off.append((found.lag_s * RATE - true) / (found.sd_s * RATE))
    assert np.mean(np.abs(off) < 2) >= 0.88
    many = exposure_lag(exposure_lags(exposures(rng, 4.2, jitter, 20_000), 0, 25), RATE)
    known = np.hypot(jitter, 12**-0.5) / 20_000**0.5 if jitter > 0.5 else 0.3
    assert abs(many.lag_s * RATE - 4.2) < 2.5 * many.sd_s * RATE < 4 * known


def test_jitter_and_odd_exposures():
    rng = np.random.default_rng(0)
    lags = exposure_lags(exposures(rng, 4.5, 1.0, 2000), 0, 25).astype(float)
    found = exposure_lag(lags, RATE)
    assert found.jitter_s == pytest.approx(np.hypot(1.0, 1 / 12**0.5) / RATE, rel=0.1)
    lags[::40] += 9
    held = exposure_lag(lags, RATE)
    assert held.odd >= 50
    assert held.lag_s == pytest.approx(found.lag_s, abs=1e-4)
    assert held.range_s > 8e-3
    lags[::5] += 9
    with pytest.raises(ValueError, match="began 3 samples or more from the others"):
        exposure_lag(lags, RATE)
    with pytest.raises(ValueError, match="0 exposures were counted"):
        exposure_lag(np.full(50, np.nan), RATE)


@pytest.mark.slow
@pytest.mark.parametrize("skew_s", [2e-5, -5e-4])
def test_skew_of_two_channels(skew_s):
    (found,) = seen_by(lambda seed: skew(seed, skew_s), SEEDS // 2).values()
    holds(pulls(found))
    first, second = pair(np.random.default_rng(0), skew_s)
    inverted = channel_skew(first, -second, RATE)
    assert inverted.is_inverted
    assert inverted.skew_s == pytest.approx(found[0, 0])


def test_two_channels_without_a_common_delay_are_refused():
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match="wire one source of noise to both"):
        channel_skew(*rng.standard_normal((2, 40000)), RATE)
    with pytest.raises(ValueError, match="no delay"):
        channel_skew(*pair(rng, 1e-4, noise=0.02, is_filtered=True), RATE)
    with pytest.raises(ValueError, match="500 and 500 readings"):
        channel_skew(*rng.standard_normal((2, 500)), RATE)


@pytest.mark.slow
@pytest.mark.parametrize("correlation", [0.0, 0.8])
def test_drift_of_a_clock_over_an_hour(correlation):
    (found,) = seen_by(lambda seed: clocks(seed, correlation)).values()
    holds(pulls(found))


def rates(rng, time, kind):
    """By which share a camera's clock runs fast at these times of an hour, as it warms up or as it
    wanders.
    """
    drift = rng.uniform(-50e-6, 50e-6)
    if kind == "warming":
        return drift + 2e-6 * np.exp(-time / 900)
    return drift + np.cumsum(rng.normal(0, 2e-9, len(time)))


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["warming", "wandering"])
def test_a_clock_that_changes_within_an_hour_is_as_uncertain_as_its_rate(kind):
    """The drift of any five minutes, as of a run, is within the stated uncertainty."""
    off = []
    for seed in range(SEEDS):
        rng = np.random.default_rng([40, seed])
        sample = np.arange(0, 3_600_000, 1000)
        rate = rates(rng, sample / RATE, kind)
        stamp = sample / RATE + np.cumsum(rate) * 1000 / RATE + rng.normal(0, 5e-6, len(sample))
        found = clock_drift(sample, stamp, RATE)
        assert found.drift == pytest.approx(rate.mean(), abs=found.sd)
        begins = rng.integers(0, len(sample) - 300)
        off.append(abs(rate[begins : begins + 300].mean() - found.drift) / found.sd)
    assert 0.5 < np.mean(np.array(off) < 1) < 0.9
    assert np.mean(np.array(off) < 2) > 0.9


def test_what_are_no_two_clocks_is_refused():
    sample = np.arange(0, 100_000, 1000)
    with pytest.raises(ValueError, match="check the unit"):
        clock_drift(sample, sample * 1.0, RATE)
    with pytest.raises(ValueError, match="12 readings"):
        clock_drift(sample[:12], sample[:12] / RATE, RATE)
    with pytest.raises(ValueError, match="of one sample"):
        clock_drift(np.zeros(50), np.zeros(50), RATE)


@pytest.mark.parametrize("step", [1e-4, 1e-3, 1 / 64])
def test_stamps_of_a_coarse_step_tell_a_drift_no_better_than_that_step(step):
    off = []
    for seed in range(SEEDS // 2):
        rng = np.random.default_rng(seed)
        drift, sample = rng.uniform(-4e-6, 4e-6), np.arange(0, 100_000, 250)
        stamp = 17.0 + rng.uniform(0, 1) + (1 + drift) * sample / RATE
        found = clock_drift(sample, np.round(stamp / step) * step, RATE)
        assert found.sd < max(1e-4, 0.02 * step)
        off.append((found.drift - drift) / found.sd)
    assert np.abs(off).max() < 3
