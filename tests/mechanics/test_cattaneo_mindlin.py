"""Cattaneo-Mindlin against quadrature of the Green's tensor, and against the conditions the
solution must meet.
"""

import numpy as np
import pytest
from hypothesis import example, given, strategies as st
from scipy.integrate import quad

from analysis.mechanics import cattaneo_mindlin as cm, hertz

E, R, P, MU = 3.43e6, 128.8e-3, 0.5, 0.93
LIMIT = MU * P
NUS = (0.0, 0.3, 0.5)
NODES, WEIGHTS = np.polynomial.legendre.leggauss(120)


def chord_points(x, y, radius, angle):
    """Along each ray from (x, y): distances and weights of nodes in the disc, graded for the square
    root at its ends.
    """
    b = x * np.cos(angle) + y * np.sin(angle)
    root = np.sqrt(np.maximum(b * b - (x * x + y * y - radius * radius), 0.0))
    start, end = np.maximum(-b - root, 0.0), np.maximum(-b + root, 0.0)
    bend = np.pi / 2 * NODES
    middle, half = (start + end)[:, None] / 2, (end - start)[:, None] / 2
    return middle + half * np.sin(bend), half * np.cos(bend) * np.pi / 2 * WEIGHTS


def by_quadrature(x, y, radius, q0, nu):
    """G*sigma of q0 sqrt(1 - r^2/radius^2) at one point: polar coordinates about that point take
    the kernel's 1/r away.
    """
    r = np.hypot(x, y)
    if r < radius:
        angle = 2 * np.pi * np.arange(400) / 400
        weight = np.full(400, 2 * np.pi / 400)
    else:
        opening = np.arcsin(radius / r)
        bend = np.pi / 2 * NODES
        angle = np.arctan2(-y, -x) + opening * np.sin(bend)
        weight = opening * np.cos(bend) * np.pi / 2 * WEIGHTS
    s, ds = chord_points(x, y, radius, angle)
    px, py = x + s * np.cos(angle)[:, None], y + s * np.sin(angle)[:, None]
    stress = q0 * np.sqrt(np.maximum(1 - (px**2 + py**2) / radius**2, 0.0))
    along = (stress * ds).sum(axis=1) * weight
    scale = (1 + nu) / (np.pi * E)
    return (
        scale * np.sum(along * (1 - nu + nu * np.cos(angle) ** 2)),
        scale * np.sum(along * nu * np.sin(angle) * np.cos(angle)),
    )


@pytest.mark.parametrize("nu", NUS)
@pytest.mark.parametrize("part", [0.02, 0.6, 0.97, 1.0])
def test_displacement_is_the_greens_tensor_summed_over_the_traction(nu, part):
    a = hertz.contact_radius(P, E, nu, R)
    Q = part * LIMIT
    c = a * (1 - part) ** (1 / 3)
    q0 = 3 * LIMIT / (2 * np.pi * a**2)
    scale = cm.full_shift(MU, P, a, E, nu)
    for distance, theta in (
        (0.0, 0.0),
        (0.31, 0.4),
        (0.83, 2.0),
        (0.999, -1.0),
        (1.001, 0.7),
        (1.6, 3.0),
        (2.5, 1.1),
        (6.0, -2.2),
        (40.0, 0.3),
    ):
        x, y = distance * a * np.cos(theta), distance * a * np.sin(theta)
        expected = np.array(by_quadrature(x, y, a, q0, nu))
        if c > 0:
            expected -= np.array(by_quadrature(x, y, c, q0 * c / a, nu))
        np.testing.assert_allclose(
            cm.displacement(x, y, Q, MU, P, a, E, nu), expected, rtol=1e-8, atol=1e-10 * scale
        )


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


@pytest.mark.parametrize("part", [0.0, 0.3, 0.9, 1.0])
def test_the_traction_adds_up_to_the_shear_force_and_slips_at_friction(part):
    a = 2e-3
    Q = part * LIMIT
    c = float(cm.stick_radius(Q, LIMIT, a))
    total = quad(
        lambda r: 2 * np.pi * r * cm.traction(r, Q, MU, P, a),
        0,
        a,
        points=[c] if 0 < c < a else None,
        epsabs=1e-12,
        limit=200,
    )[0]
    assert total == pytest.approx(Q, abs=1e-9)
    slipping = np.linspace(c, a, 9)
    np.testing.assert_allclose(
        cm.traction(slipping, Q, MU, P, a), MU * hertz.pressure(slipping, P, a)
    )
    sticking = np.linspace(0, c, 9)[:-1]
    assert (cm.traction(sticking, Q, MU, P, a) <= MU * hertz.pressure(sticking, P, a)).all()


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


def test_initial_stiffness_of_the_contact():
    a, nu = 2e-3, 0.5
    G = E / (2 * (1 + nu))
    assert 1e-9 / float(cm.shift(1e-9, MU, P, a, E, nu)) == pytest.approx(
        8 * G * a / (2 - nu), rel=1e-8
    )


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
