"""The tests' truth on annuli against their truth by Abel's integrals, and against the program's
Greenwood and Tripp.
"""

import numpy as np
import pytest
from friction import elasto_plastic_world as smooth, rough_world

from analysis.mechanics import greenwood_tripp


def test_under_hertz_s_pressure_both_truths_agree():
    pressure, reach = rough_world.hertz_pressure(0.5)
    (rough,) = rough_world.World(0.5, pressure, reach).run(np.array([25e-6]))
    (known,) = smooth.World(0.5).run(np.array([25e-6]))
    assert pytest.approx(known.Q, rel=2e-4) == rough.Q
    np.testing.assert_allclose(rough.g0, known.g0, atol=5e-9)
    np.testing.assert_allclose(rough.g2, known.g2, atol=5e-9)
    assert rough.peak == pytest.approx(known.peak, abs=8e-6)


@pytest.mark.parametrize("P", [0.1, 1.4])
def test_the_rough_pressure_is_that_of_greenwood_and_tripp(P):
    pressure, _ = rough_world.greenwood_tripp(P)
    known = greenwood_tripp.rough_contact(
        P, rough_world.E, rough_world.NU, rough_world.R, rough_world.H
    )
    r = np.linspace(0, known.radius_at(1e-3), 50)
    np.testing.assert_allclose(pressure(r), known.pressure(r), atol=1e-3 * known.peak_pressure)


def test_the_traction_of_a_rough_contact_balances_the_force_and_vanishes_at_the_reach():
    world = rough_world.rough(0.3)
    state = world.run(np.array([10e-6, 60e-6]))[1]
    r = np.linspace(0, world.reach, 2001)
    total = np.trapezoid(2 * np.pi * r * state.sigma(r), r)
    assert total == pytest.approx(state.Q, rel=1e-4)
    assert pytest.approx(world.mu * world.P, rel=1e-3) == state.Q
    assert state.sigma(world.reach * 0.999) < 1e-6 * state.sigma(0.0)
