"""Noise of a free sensor whose parts the analysis does not know: white noise, lines, wander."""

from collections import defaultdict

import numpy as np
import pytest

from analysis.calibration.sensor_noise import sensor_noise

RATE = 1000.0
WHITE = 1e-3


def record(rng, seconds=8, *, lines=(), walk=0.0, drift=0.0):
    n = round(seconds * RATE)
    t = np.arange(n) / RATE
    y = WHITE * rng.standard_normal(n) + drift * t + walk * np.cumsum(rng.standard_normal(n))
    for hz, rms in lines:
        y += rms * np.sqrt(2) * np.sin(2 * np.pi * hz * t + rng.uniform(0, 2 * np.pi))
    return y


def test_each_part_is_within_its_uncertainty():
    pulls = defaultdict(list)
    for seed in range(60):
        rng = np.random.default_rng(seed)
        found = sensor_noise(
            record(rng, lines=((49.98, 4e-4), (37.3, 2e-4)), drift=1e-5, walk=1e-6 * (seed % 2)),
            RATE,
        )
        assert found.lines[0].name == "mains, 50 Hz"
        assert found.lines[1].name.startswith("37.")
        pulls["white"].append((found.white - WHITE) / found.white_sd)
        pulls["drift"].append((found.drift - 1e-5) / found.drift_sd)
        for line, hz, rms in zip(found.lines, (49.98, 37.3), (4e-4, 2e-4), strict=False):
            pulls["hz"].append((line.hz - hz) / line.hz_sd)
            pulls["rms"].append((line.rms - rms) / line.rms_sd)
        if not seed % 2:
            true = np.sqrt(WHITE**2 + 4e-4**2 + 2e-4**2)
            pulls["sd"].append((found.sd - true) / found.sd_sd)
    for name, values in pulls.items():
        assert np.mean(np.abs(values) < 1) >= 0.55, name
        assert np.mean(np.abs(values) < 1) <= 0.85, name
        assert np.mean(np.abs(values) < 2) >= 0.9, name


def test_hum_is_named_and_noise_alone_has_no_lines():
    rng = np.random.default_rng(4)
    american = record(rng, lines=((60, 3e-4), (120, 2e-4), (300, 2e-4)))
    names = {line.name for line in sensor_noise(american, RATE).lines}
    assert names == {"mains, 60 Hz", "2 x mains of 60 Hz", "5 x mains of 60 Hz"}
    alone = [sensor_noise(record(np.random.default_rng(s)), RATE).lines for s in range(20)]
    assert sum(map(len, alone)) <= 1


def test_the_density_and_the_allan_deviation_are_those_of_white_noise():
    found = sensor_noise(record(np.random.default_rng(1), 30), RATE)
    assert np.mean(found.density[5:-5]) == pytest.approx(2 * WHITE**2 / RATE, rel=0.03)
    expected = WHITE / np.sqrt(RATE * found.tau)
    assert np.all(np.abs(found.allan / expected - 1) < 4 * found.allan_sd / found.allan)
    walk = sensor_noise(record(np.random.default_rng(1), 30, walk=2e-5), RATE)
    # a walk of step s has the deviation s sqrt(rate tau / 3)
    assert walk.allan[-4] == pytest.approx(2e-5 * np.sqrt(RATE * walk.tau[-4] / 3), rel=0.5)
    assert walk.wander(5.0) > 10 * found.wander(5.0)
    assert found.wander(1.0) == pytest.approx(WHITE * np.sqrt(2 / RATE), rel=0.25)
    assert np.isnan(found.wander(20.0))


@pytest.mark.parametrize(
    ("y", "word"),
    [
        (np.zeros(10), "5 s or more"),
        (np.full(9000, np.nan), "without a gap"),
        (np.full(9000, 0.1), "connected"),
        (np.r_[np.zeros(4500), np.full(4500, 0.5)] + record(np.random.default_rng(1), 9), "free"),
    ],
)
def test_what_is_no_record_of_a_free_sensor_is_refused(y, word):
    with pytest.raises(ValueError, match=word):
        sensor_noise(y, RATE)
