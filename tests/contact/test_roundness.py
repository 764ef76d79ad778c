"""Contacts that are not round, or whose friction is uneven, against a round one: what the
displacement of a block that slides, and the micro-contacts, tell of it.
"""

from __future__ import annotations

import numpy as np
import pytest
from extremes.uneven_world import ROUND, Uneven, ellipse
from friction.elasto_plastic_world import DENSE, World

from analysis.contact.disc import micro_contact_disc
from analysis.contact.rings import ring_means
from analysis.contact.roundness import Departure, departure_from_round, implied_second
from app.evaluation.roundness import CERTAIN, LEAST

A = 1.1225e-3  # m, of a disc of the area of each contact
PITCH = 0.1e-3


def departure(world: Uneven, sd: float = 0.03e-6, off: tuple = (0.0, 0.0), seed: int = 0):
    """Of u_x while all of the contact slides, with noise (m) and rings about a centre that is off
    by some metres.
    """
    at, ux = world.sliding(4.8e-3)
    x, y = np.meshgrid(at[::2] - off[0], at[::2] - off[1])
    u = ux[::2, ::2] + sd * np.random.default_rng(seed).normal(size=x.shape)
    rings = ring_means(np.hypot(x, y), u, PITCH, 1.9e-3, theta=np.arctan2(y, x))
    found = departure_from_round(rings, A, 0.5, centre_sd=10e-6)
    assert isinstance(found, Departure)
    return found


def test_the_second_harmonic_of_a_round_contact_follows_from_its_mean():
    """Against the displacement of a partial slip, whose parts the tests' own world has."""
    world = World(0.5)
    (state,) = world.run(np.array([0.6 * world.full]))
    r = (np.arange(60) + 0.5) * 70e-6
    g0, g2 = (np.interp(r, DENSE, g) for g in (state.g0, state.g2))
    found = implied_second(r, state.D - g0, 0.5)
    np.testing.assert_allclose(found[:-1], -g2[:-1], atol=5e-3 * g0.max())


UNEVEN = {
    "long along the drive": (Uneven(pressure=ellipse(1.2e-3, 1.05e-3)), "second"),
    "long across it": (Uneven(pressure=ellipse(1.05e-3, 1.2e-3)), "second"),
    "long at 45 degrees": (Uneven(pressure=ellipse(1.2e-3, 1.05e-3, 45)), "second"),
    "more friction on one half": (
        Uneven(friction=lambda x, y: np.where(x > 0, 1.2, 0.8)),
        "first",
    ),
    "a drop of oil": (
        Uneven(friction=lambda x, y: np.where(np.hypot(x - 5e-4, y - 2e-4) < 3e-4, 0.4, 1)),
        "second",
    ),
    "a bubble": (
        Uneven(pressure=lambda x, y: ROUND(x, y) * (np.hypot(x - 45e-5, y - 3e-4) > 15e-5)),
        "second",
    ),
    "tilted": (Uneven(pressure=lambda x, y: ROUND(x, y) * np.clip(1 + 500 * x, 0, 2)), "first"),
}


@pytest.mark.parametrize(("world", "part"), UNEVEN.values(), ids=UNEVEN)
def test_an_uneven_contact_departs_from_a_round_one(world, part):
    found = departure(world)
    assert found.is_seen(CERTAIN, LEAST)
    assert getattr(found, part) > max(CERTAIN * getattr(found, f"{part}_noise"), LEAST * found.slip)


def test_a_round_contact_departs_by_its_noise_only():
    """Also about a centre that is known as badly as is stated, turned, and stretched."""
    for seed in range(30):
        off = 10e-6 * np.random.default_rng(seed).normal(size=2)
        found = departure(Uneven(), sd=0.1e-6, off=tuple(off), seed=seed)
        assert not found.is_seen(CERTAIN, 0.0), seed
        assert 0.3 < found.second / found.second_noise < 2


def test_a_turn_of_the_picture_is_no_uneven_contact():
    at, ux = Uneven().sliding(4.8e-3)
    x, y = np.meshgrid(at[::2], at[::2])
    turned = ux[::2, ::2] - 1e-3 * y + 5e-4 * x
    rings = ring_means(np.hypot(x, y), turned, PITCH, 1.9e-3, theta=np.arctan2(y, x))
    found = departure_from_round(rings, A, 0.5)
    assert found.first < 3e-3 * found.slip


def drawn(n: int, long: float, short: float, turned: float, seed: int):
    """Places of micro-contacts whose density is Hertz's pressure on an ellipse."""
    rng = np.random.default_rng(seed)
    r, angle = np.sqrt(1 - rng.uniform(0, 1, n) ** (2 / 3)), rng.uniform(0, 2 * np.pi, n)
    z = (long * r * np.cos(angle) + 1j * short * r * np.sin(angle)) * np.exp(1j * turned)
    return 800 + z.real, 600 + z.imag


def test_micro_contacts_fill_an_ellipse():
    """Its axes, its angle, and as a the radius of a disc of its area, within their scatter."""
    off = []
    for seed, turned in enumerate((-1.2, -0.4, 0.5, 1.4)):
        disc = micro_contact_disc(*drawn(600, 330, 270, turned, seed), (1200, 1600))
        assert disc.axes_px == pytest.approx((330, 270), rel=0.06)
        assert abs(np.sin(disc.angle - turned)) < 0.2
        off.append((disc.radius_px - np.sqrt(330 * 270)) / disc.radius_sd_px)
    assert np.abs(off).max() < 2.5


@pytest.mark.parametrize("seed", [50, 73, 100, 124, 153, 195])
def test_micro_contacts_of_a_disc_fill_no_ellipse(seed):
    """Among the most elongated of 200 scatters of a hundred places."""
    disc = micro_contact_disc(*drawn(100, 300, 300, 0.0, seed), (1200, 1600))
    assert np.isnan(disc.angle)
    assert np.isnan(disc.axes_px).all()
    assert abs(disc.radius_px - 300) < 3 * disc.radius_sd_px
