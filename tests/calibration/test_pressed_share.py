"""Cross-talk from records of a contact that was pressed: what the shear sensor reads of P."""

import numpy as np
import pytest

from analysis.calibration.cross_talk import common_share, pressed_share

RATE = 1000
SEEDS = 1000  # of 60, the share within one sigma scatters by 6 %: one set in four is out


def pressing(rng, share, *, load=0.5, noise=1e-3, shear=lambda P: 0 * P, rise_s=1.0):
    """Free for a second, pressed within `rise_s`, steady for a second."""
    t = np.arange(round((2 + rise_s) * RATE)) / RATE
    x = np.clip((t - 1) / rise_s, 0, 1)
    P = load * x * x * (3 - 2 * x)
    forces = np.column_stack([P, share * P + shear(P) - 0.004])
    return forces + noise * rng.standard_normal(forces.shape)


def test_the_share_is_within_its_uncertainty():
    pulls, single_pulls, errors = [], [], []
    for seed in range(SEEDS):
        rng = np.random.default_rng(seed)
        share = rng.uniform(-0.02, 0.02)
        found = [pressed_share(pressing(rng, share, load=P), RATE) for P in (0.2, 0.5, 1.0)]
        value, sd = common_share(found)
        single_pulls += [(one.value - share) / one.sd for one in found]
        errors.append(value - share)
        pulls.append(errors[-1] / sd)
    assert np.max(np.abs(errors)) < 1e-3
    for of in (pulls, single_pulls):
        assert 0.6 <= np.mean(np.abs(of) < 1) <= 0.76
        assert np.mean(np.abs(of) < 2) >= 0.9


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
