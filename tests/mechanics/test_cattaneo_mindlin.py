"""Cattaneo-Mindlin against the conditions that the solution must meet; `test_closed_forms` has the
closed forms.
"""

import numpy as np
import pytest
from hypothesis import example, given, strategies as st

from analysis.mechanics import cattaneo_mindlin as cm, hertz

E, R, P, MU = 3.43e6, 128.8e-3, 0.5, 0.93
LIMIT = MU * P
NUS = (0.0, 0.3, 0.5)


@pytest.mark.parametrize("nu", NUS)
def test_the_stick_zone_moves_as_one_with_the_shift(nu):
    a = hertz.contact_radius(P, E, nu, R)
    for part in (1e-9, 0.1, 0.5, 0.99):
        Q = part * LIMIT
        c = float(cm.stick_radius(Q, LIMIT, a))
        r = np.linspace(0, c, 20)
        g0, g2 = cm.radial_displacement(r, Q, MU, P, a, E, nu)
        delta = float(cm.shift(Q, MU, P, a, E, nu))
        np.testing.assert_allclose(
            g0, delta, rtol=1e-12, atol=1e-14 * cm.full_shift(MU, P, a, E, nu)
        )
        np.testing.assert_allclose(g2, 0, atol=1e-15 * cm.full_shift(MU, P, a, E, nu))


@pytest.mark.parametrize("phi", [cm.phi0, cm.phi2])
def test_phi_has_no_seam_where_its_form_changes(phi):
    for place in (1.0, 1 / 0.35):
        below, above = phi([place * (1 - 1e-13), place * (1 + 1e-13)], 1.0)
        assert below == pytest.approx(above, rel=5e-13 if place > 1 else 1e-6)


@pytest.mark.parametrize("phi", [cm.phi0, cm.phi2])
def test_far_away_phi_is_that_of_a_point_force(phi):
    r = np.logspace(3, 12, 10)
    np.testing.assert_allclose(phi(r, 1.0) * r, 2 * np.pi / 3, rtol=1e-6)
    assert phi(1e8, 1.0) * 1e8 == pytest.approx(2 * np.pi / 3, rel=1e-14)


def test_phi_broadcasts_over_radii_of_the_contact():
    r, a = np.array([0.5, 1.5, 9.0]), np.array([[1.0], [2.0]])
    np.testing.assert_array_equal(cm.phi0(r, a), [cm.phi0(r, 1.0), cm.phi0(r, 2.0)])


@given(st.floats(1e-15, 1.0), st.sampled_from(NUS))
def test_shift_and_shear_force_undo_each_other_down_to_the_smallest_force(part, nu):
    delta = cm.shift(part * LIMIT, MU, P, 2e-3, E, nu)
    # close to full slip the shift hardly says anything about the force: its error is bounded in
    # newtons
    np.testing.assert_allclose(
        cm.shear_force(delta, MU, P, 2e-3, E, nu),
        part * LIMIT,
        rtol=1e-13,
        atol=1e-13 * LIMIT if part > 0.5 else 0,
    )
    assert cm.shear_force(-delta, MU, P, 2e-3, E, nu) == -cm.shear_force(delta, MU, P, 2e-3, E, nu)


def test_beyond_friction_there_is_no_shift_and_no_more_force():
    assert np.isnan(cm.shift(1.0001 * LIMIT, MU, P, 2e-3, E, 0.5))
    full = cm.full_shift(MU, P, 2e-3, E, 0.5)
    assert cm.shift(LIMIT, MU, P, 2e-3, E, 0.5) == pytest.approx(full, rel=1e-15)
    assert cm.shear_force(1.5 * full, MU, P, 2e-3, E, 0.5) == LIMIT
    assert cm.stick_radius(1.5 * LIMIT, LIMIT, 2e-3) == 0


# the slowest to converge: all in the spring, nearly sliding
@example(part=0.99609375, compliance=1.0)
@given(part=st.floats(0, 1), compliance=st.sampled_from([0.0, 1e-9, 1.05e-4, 1.0]))
def test_the_driven_contact_carries_the_force_that_its_springs_carry(part, compliance):
    a, nu = 2e-3, 0.5
    Q = part * LIMIT
    distance = float(cm.shift(Q, MU, P, a, E, nu)) + compliance * Q
    assert float(cm.driven_shear_force(distance, compliance, MU, P, a, E, nu)) == pytest.approx(
        Q, abs=1e-12
    )


def test_the_driven_contact_slides_at_friction_and_rests_before_the_drive():
    found = cm.driven_shear_force([-1e-6, 0.0, 1e-2], 1e-4, MU, P, 2e-3, E, 0.5)
    np.testing.assert_allclose(found, [0, 0, LIMIT], atol=1e-16)
