"""A field of the material seen from the lens, beside points that were not measured."""

from __future__ import annotations

import numpy as np
import pytest
from friction import elasto_plastic_world as world

from analysis.inversion.material import as_seen
from analysis.inversion.methods import invert

PITCH = 100e-6
X, Y = world.points((60, 80), PITCH)
BOWL = 4.0  # 1/m: 4 um lower at a distance of a millimetre
LOST = {
    "a hole": np.hypot(X - 3e-4, Y + 1e-4) < 3.6e-4,
    "a point": (abs(X - 2.5e-4) < 0.6 * PITCH) & (abs(Y - 2.5e-4) < 0.6 * PITCH),
    "columns": abs(X + 1e-4) < 1.6 * PITCH,
    "the rim": (X > 3.3e-3) | (Y < -2.4e-3),
}


def bowl(x):
    """A displacement at places at rest."""
    return 75e-6 - BOWL * (x * x + Y * Y)


def of_material():
    """The same at the points of the material: u of X is that of the place X + u."""
    u = bowl(X)
    for _ in range(20):
        u = bowl(X + u)
    return u


@pytest.mark.parametrize("lost", LOST.values(), ids=LOST)
def test_what_lies_beside_lost_points_is_seen_as_if_they_were_there(lost):
    u = np.where(lost, np.nan, of_material())
    seen, _ = as_seen(u, np.full(X.shape, 1e-8), PITCH)
    known = np.isfinite(seen)
    assert known.sum() > (~lost).sum() - 3 * 60
    inner = known & (X.min() + 2 * PITCH < X)
    assert np.abs(seen - bowl(X))[inner].max() < 15e-9


def test_an_uncertainty_stays_between_those_that_are_given():
    sd = np.where(np.hypot(X, Y) < 4e-4, 2e-7, 1e-8)
    _, seen_sd = as_seen(of_material(), sd, PITCH)
    assert np.nanmin(seen_sd) == pytest.approx(1e-8)
    assert np.nanmax(seen_sd) == pytest.approx(2e-7)


@pytest.mark.parametrize(("method", "bound"), [("regularised", 0.005), ("cgls", 0.02)])
def test_lost_points_of_a_block_that_has_moved_leave_the_stress_what_it_is(method, bound):
    """It slides, and nothing was measured within 0.36 mm of a place in the contact."""
    contact = world.loaded(0.5, 1.0)
    x, y = world.points((76, 96))
    u = contact.displacement(x, y, box=0.0)
    for _ in range(4):
        u = contact.displacement(x + u, y, box=0.0)
    u += np.random.default_rng(1).normal(0, 2e-8, u.shape)
    u[np.hypot(x - 3e-4, y) < 3.6e-4] = np.nan
    block = {"P": 0.5, "E": world.E, "nu": world.NU, "R": world.R}
    found = invert(x, y, u, method=method, **block)
    r = np.hypot(x, y)
    off = ((found.sigma - contact.sigma(r)) / contact.full)[r < 0.8 * contact.a]
    assert np.sqrt(np.mean(off**2)) < bound
    assert abs(found.Q / contact.Q - 1) < 3e-3
