"""Cross-talk from records of a contact that was pressed: what the shear sensor reads of P."""

from dataclasses import replace

import numpy as np
import pytest
from hidden_benches import RATE, pressed, pressing
from seeds import holds, pulls, seen_by

from analysis.calibration.cross_talk import common_share, pressed_share


def test_the_share_is_within_its_uncertainty():
    found = seen_by(pressed, 200)
    value, _, true = found["cross-talk by pressings"]
    assert np.max(np.abs(value - true)) < 1e-3
    for one in found.values():
        holds(pulls(one))


def test_a_zero_that_drifts_is_no_cross_talk():
    rng, off = np.random.default_rng(3), []
    for _ in range(20):
        record = pressing(rng, 0.01)
        record[:, 1] += np.linspace(0, 2e-3, len(record))
        found = pressed_share(record, RATE)
        off.append((found.value - 0.01) / found.sd)
    assert abs(np.mean(off)) < 1
    assert np.std(off) < 1.5


def test_a_shear_that_is_not_in_proportion_to_the_load_is_refused():
    with pytest.raises(ValueError, match="sheared while it was pressed"):
        pressed_share(pressing(np.random.default_rng(1), 0.008, shear=lambda P: 0.05 * P**2), RATE)


def test_shares_that_differ_from_one_to_the_next_are_refused_or_uncertain():
    rng = np.random.default_rng(2)
    found = [pressed_share(pressing(rng, s), RATE) for s in (0.0, 0.02, 0.05)]
    with pytest.raises(ValueError, match="not the same each time"):
        common_share(found)
    found = [pressed_share(pressing(rng, s), RATE) for s in (0.007, 0.009, 0.011)]
    value, sd = common_share(found)
    assert value == pytest.approx(0.009, abs=1e-3)
    assert 0.8e-3 < sd < 1.6e-3  # of their scatter, ten times that of the noise


@pytest.mark.parametrize(
    ("record", "word"),
    [
        ({"load": 0.0}, "times its noise"),
        ({"rise_s": 0.1}, "more slowly"),
        ({"load": np.nan}, "times its noise"),
    ],
)
def test_records_without_a_pressing_are_refused(record, word):
    with pytest.raises(ValueError, match=word):
        pressed_share(pressing(np.random.default_rng(1), 0.0, **record), RATE)


def test_few_or_short_records_are_refused():
    with pytest.raises(ValueError, match="readings of shape"):
        pressed_share(np.zeros((10, 2)), RATE)
    with pytest.raises(ValueError, match="3 or more"):
        common_share([])


def test_three_shares_that_differ_tell_badly_how_far_they_do():
    """Two degrees of freedom: within three stated uncertainties lie 94 % of Student's."""
    rng, off = np.random.default_rng(4), []
    one = pressed_share(pressing(rng, 0.01), RATE)
    for _ in range(400):
        values = 0.01 + 10 * one.sd * rng.standard_normal(3)
        value, sd = common_share([replace(one, value=float(v)) for v in values])
        off.append((value - 0.01) / sd)
    assert np.mean(np.abs(off) < 1) > 0.62
    assert np.mean(np.abs(off) < 3) > 0.92


def test_noise_that_lasts_is_in_the_uncertainty():
    """As much 1/f noise as white noise, with powers down to a fourth of the record's frequency:
    a record of this length tells the slowest only in part, and neighbours nearly nothing.
    """
    off, n = [], 15000
    for seed in range(60):
        rng = np.random.default_rng(seed)
        low = np.arange(1, 2 * n + 1)
        waves = (rng.standard_normal((2, 2 * n)) + 1j * rng.standard_normal((2, 2 * n))) / low**0.5
        flicker = np.fft.irfft(np.pad(waves, ((0, 0), (1, 0))))
        noise = (flicker / flicker.std() + rng.standard_normal((2, 4 * n)))[:, n : 2 * n]
        P = 0.5 * np.clip(np.linspace(-1, 2, n), 0, 1)
        try:
            found = pressed_share((np.stack([P, 0.01 * P]) + 1e-3 * noise).T, RATE)
        except ValueError:
            continue
        off.append((found.value - 0.01) / found.sd)
    assert len(off) > 50
    assert np.std(off) < 2.6
