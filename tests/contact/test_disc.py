"""Centre and radius of a disc of points against discs that the test draws: bias, scatter and the
stated uncertainty.
"""

import numpy as np
import pytest
from friction import rough_world

from analysis.contact.disc import micro_contact_disc

SHAPE = (1200, 1600)


def _many(scatter, radius, law, centre, seeds, density=0.003, strays=1):
    """(x, y, a) errors and stated uncertainties of one disc per seed, shapes (n, 3)."""
    errors, sds = [], []
    for seed in range(seeds):
        rng = np.random.default_rng(seed)
        x, y = scatter(rng, radius, density, law)
        x, y = x + centre[0], y + centre[1]
        seen = (x > -0.5) & (x < SHAPE[1] - 0.5) & (y > -0.5) & (y < SHAPE[0] - 0.5)
        x = np.concatenate([x[seen], rng.uniform(0, SHAPE[1], strays)])
        y = np.concatenate([y[seen], rng.uniform(0, SHAPE[0], strays)])
        disc = micro_contact_disc(x, y, SHAPE)
        errors.append(np.subtract((*disc.centre_px, disc.radius_px), (*centre, radius)))
        sds.append((*disc.centre_sd_px, disc.radius_sd_px))
    return np.array(errors), np.array(sds)


@pytest.mark.parametrize(("radius", "seeds"), [(220, 8), (480, 4)])
def test_hertz_like_density(micro_contact_scatter, radius, seeds):
    errors, sds = _many(micro_contact_scatter, radius, 0.5, (810, 590), seeds)
    assert abs(errors[:, 2].mean()) < 3
    assert errors[:, 2].std() < 4.5
    assert errors[:, :2].std() < 4
    assert 0.5 < (errors / sds).std() < 1.4


@pytest.mark.parametrize(("law", "bias", "spread"), [(0.0, 1, 1), (1.0, 8, 12)])
def test_other_densities_are_not_mistaken(micro_contact_scatter, law, bias, spread):
    errors, _ = _many(micro_contact_scatter, 220, law, (800, 600), 8)
    assert abs(errors[:, 2].mean()) < bias
    assert errors[:, 2].std() < spread


def test_a_disc_cut_by_the_border(micro_contact_scatter):
    errors, _ = _many(micro_contact_scatter, 350, 0.5, (800, 250), 8)
    assert abs(errors[:, 2].mean()) < 3
    assert np.abs(errors.mean(axis=0)[:2]).max() < 3


def test_strays_do_not_stretch_the_disc(micro_contact_scatter):
    errors, _ = _many(micro_contact_scatter, 220, 0.5, (800, 600), 12, strays=8)
    assert abs(errors[:, 2].mean()) < 4


def rough_scatter(rng, P, h, density=0.004, pixel=7.04e-6):
    """Micro-contacts that thin out with the tests' own Greenwood and Tripp pressure, pixels, and
    the apparent radius a_H + sqrt(R h) of Hertz's contact.
    """
    pressure, reach = rough_world.greenwood_tripp(P, h)
    n = rng.poisson(density * 4 * (reach / pixel) ** 2)
    x, y = rng.uniform(-reach, reach, (2, n))
    kept = rng.random(n) < pressure(np.hypot(x, y)) / pressure(np.zeros(1))[0]
    _, a = rough_world.hertz_pressure(P)
    return x[kept] / pixel, y[kept] / pixel, (a + np.sqrt(rough_world.R * h)) / pixel


@pytest.mark.slow
@pytest.mark.parametrize(("P", "seeds"), [(0.1, 12), (0.5, 6), (1.4, 4)])
def test_a_soft_edge_is_seen_as_one(P, seeds):
    errors, sds, shares = [], [], []
    for seed in range(seeds):
        x, y, a = rough_scatter(np.random.default_rng(seed), P, 0.6e-6)
        disc = micro_contact_disc(x + 805, y + 595, SHAPE)
        errors.append(disc.radius_px - a)
        sds.append(disc.radius_sd_px)
        shares.append(disc.rough_share)
    assert abs(np.mean(errors)) < 6  # 42 um; it was up to 63 um
    assert np.sqrt(np.mean(np.square(errors))) < 9
    assert np.mean(np.abs(errors) < 2 * np.array(sds)) >= 0.65
    assert np.mean(shares) > 0.5


def test_the_same_points_give_the_same_bits(micro_contact_scatter):
    x, y = micro_contact_scatter(np.random.default_rng(0), 350, 0.003, 0.5)
    one, other = (micro_contact_disc(x + 800, y + 600, SHAPE) for _ in range(2))
    assert repr(one) == repr(other)  # NaN is not NaN


def test_only_a_disc_is_better_than_chance(micro_contact_scatter):
    rng = np.random.default_rng(1)
    x, y = micro_contact_scatter(rng, 350, 0.003, 0.5)
    assert micro_contact_disc(x + 800, y + 600, SHAPE).gain > 100
    for n in (12, 100):
        assert (
            micro_contact_disc(rng.uniform(0, SHAPE[1], n), rng.uniform(0, SHAPE[0], n), SHAPE).gain
            < 15
        )
