"""Lag, skew and drift of clocks, against records made with delays that the fit does not know."""

import numpy as np
import pytest
from scipy.signal import butter, lfilter
from seeds import SEEDS, holds, serial

from analysis.calibration.timing import channel_skew, clock_drift, exposure_lag, exposure_lags

RATE = 1000.0


def exposures(rng, lag, jitter, n=60, divisor=25):
    """Exposures counted by each sample, of triggers on every 25th."""
    began = np.arange(n) * divisor + lag + jitter * rng.standard_normal(n)
    return np.searchsorted(began, np.arange(n * divisor), side="right")


def pair(rng, skew_s, noise=0.3, n=8000, is_filtered=False):
    """A band of noise on two channels of which the second is read later."""
    common = lfilter(*butter(2, 200, fs=RATE), rng.standard_normal(n))
    turn = np.exp(2j * np.pi * np.fft.rfftfreq(n, 1 / RATE) * skew_s)
    late = np.fft.irfft(np.fft.rfft(common) * turn, n)
    if is_filtered:
        late = lfilter(*butter(1, 60, fs=RATE), late)
    size = noise * common.std()
    return common + size * rng.standard_normal(n), 2 * late + size * rng.standard_normal(n)


def test_lag_to_a_sample_within_its_uncertainty():
    pulls, errors = [], []
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        lag = rng.uniform(0, 8)
        found = exposure_lag(exposure_lags(exposures(rng, lag, 0.3), 0, 25), RATE)
        errors.append(found.lag_s * RATE - lag)
        pulls.append(errors[-1] / found.sd_s / RATE)
    assert np.abs(errors).max() < 1
    # where the jitter is below a sample the mean is better than stated: never worse
    assert np.mean(np.abs(pulls) < 1) >= 0.60
    assert np.mean(np.abs(pulls) < 2) >= 0.90


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


@pytest.mark.parametrize("skew_s", [2e-5, -5e-4])
def test_skew_of_two_channels(skew_s):
    found = [channel_skew(*pair(np.random.default_rng(s), skew_s), RATE) for s in range(SEEDS // 2)]
    # the second channel, read later, has what the first one has next
    holds([(one.skew_s - skew_s) / one.sd_s for one in found])
    assert max(one.sd_s for one in found) < 2e-5
    first, second = pair(np.random.default_rng(0), skew_s)
    inverted = channel_skew(first, -second, RATE)
    assert inverted.is_inverted
    assert inverted.skew_s == pytest.approx(found[0].skew_s)


def test_two_channels_without_a_common_delay_are_refused():
    rng = np.random.default_rng(0)
    with pytest.raises(ValueError, match="wire one source of noise to both"):
        channel_skew(*rng.standard_normal((2, 40000)), RATE)
    with pytest.raises(ValueError, match="no delay"):
        channel_skew(*pair(rng, 1e-4, noise=0.02, is_filtered=True), RATE)
    with pytest.raises(ValueError, match="500 and 500 readings"):
        channel_skew(*rng.standard_normal((2, 500)), RATE)


@pytest.mark.parametrize("correlation", [0.0, 0.8])
def test_drift_of_a_clock_over_an_hour(correlation):
    pulls = []
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        drift, sample = rng.uniform(-50e-6, 50e-6), np.arange(0, 3_600_000, 8000)
        stamp = 17.0 + (1 + drift) * sample / RATE + 2e-4 * serial(rng, len(sample), correlation)
        stamp[rng.integers(0, len(sample), 6)] += 0.3  # a busy computer
        stamp[5] = np.nan
        found = clock_drift(sample, stamp, RATE)
        pulls.append((found.drift - drift) / found.sd)
    holds(pulls)
    assert found.sd < 1e-7


def test_what_are_no_two_clocks_is_refused():
    sample = np.arange(0, 100_000, 1000)
    with pytest.raises(ValueError, match="check the unit"):
        clock_drift(sample, sample * 1.0, RATE)
    with pytest.raises(ValueError, match="12 readings"):
        clock_drift(sample[:12], sample[:12] / RATE, RATE)
    with pytest.raises(ValueError, match="of one sample"):
        clock_drift(np.zeros(50), np.zeros(50), RATE)
