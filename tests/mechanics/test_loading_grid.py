"""The grid solver against the axisymmetric one: two discretisations that share the interface law
alone.
"""

from dataclasses import replace

import numpy as np
import pytest
from mechanics.loading_grid import CLOSE, GridLoading, hertz_cells

from analysis.mechanics.half_space import SurfaceGreen
from analysis.mechanics.interface import Interface
from analysis.mechanics.loading import AxisymmetricLoading, SphereContact

CONTACT = SphereContact(P=0.5, E=3.43e6, nu=0.5, R=128.8e-3, mu=0.93, L=0.8e-6)
LIMIT = CONTACT.mu * CONTACT.P
SHIFT = CONTACT.full_shift
ROUND = AxisymmetricLoading(CONTACT)
CELLS = 48
GRID = GridLoading.of_sphere(CONTACT, CELLS)
PITCH = GRID.green.pitch[0]


def radius(loading):
    at = (np.arange(CELLS) - (CELLS - 1) / 2) * loading.green.pitch[0]
    return np.hypot(at[:, None], at)


def close_to_balance(loading, state, stage):
    u = np.zeros_like(state.s)
    (u[0] if loading.green.coupled else u)[...] = stage
    rest = u - state.s - loading.green.apply(state.sigma)
    return np.sqrt(np.mean(rest**2)) < 2 * CLOSE * abs(stage)


@pytest.mark.parametrize(
    "contact",
    [replace(CONTACT, nu=0.0), CONTACT, replace(CONTACT, thickness=15e-3)],
    ids=["nu 0", "nu 0.5", "layer"],
)
def test_first_loadings_agree(contact):
    grid, exact = GridLoading.of_sphere(contact, CELLS), AxisymmetricLoading(contact)
    for part in (0.1, 0.5, 0.9, 1.3):
        state, true = grid.driven(part * SHIFT), exact.at_block(part * SHIFT)
        assert pytest.approx(true.Q, rel=2.5e-3) == state.Q
        # nu turns the surface displacement by cos 2 theta, which the axisymmetric solver leaves to
        # the mean
        error = state.sigma - true.traction(radius(grid))
        inside = radius(grid) < 0.95 * contact.a
        assert (
            np.sqrt(np.mean(error[inside] ** 2))
            < (0.004 if contact.nu == 0 else 0.04) * true.sigma.max()
        )
        assert close_to_balance(grid, state, part * SHIFT)


@pytest.mark.parametrize("thickness", [np.inf, 15e-3])
def test_displacement_far_outside_agrees_in_both_components(thickness):
    contact, n, pitch = replace(CONTACT, thickness=thickness), 100, 0.24e-3
    state = AxisymmetricLoading(contact).at_block(0.6 * SHIFT)
    at = (np.arange(n) - (n - 1) / 2) * pitch
    r, double = np.hypot(at[:, None], at), 2 * np.arctan2(at[:, None], at)
    sigma = state.traction(r)
    gx, gy = SurfaceGreen(
        (n, n), pitch, contact.E, contact.nu, thickness=thickness, coupled=True
    ).apply([sigma * state.Q / (sigma.sum() * pitch**2), np.zeros((n, n))])
    g0, g2 = state.displacement(r)
    outside = r > 1.5 * contact.a
    np.testing.assert_allclose(gx[outside], (g0 + g2 * np.cos(double))[outside], atol=3e-4 * SHIFT)
    np.testing.assert_allclose(gy[outside], (g2 * np.sin(double))[outside], atol=3e-4 * SHIFT)


def test_finer_cells_come_closer():
    contact = replace(CONTACT, nu=0.0)
    Q = AxisymmetricLoading(contact).at_block(0.3 * SHIFT).Q
    errors = [
        abs(GridLoading.of_sphere(contact, cells).driven(0.3 * SHIFT).Q - Q)
        for cells in (24, 48, 96)
    ]
    assert errors[2] < errors[1] / 2 < errors[0] / 4
    assert errors[2] < 1e-3 * Q


def test_histories_agree():
    state, true = GRID.rest, ROUND.rest
    for P, part, compliance in (
        (0.5, 0.9, 0.0),
        (0.5, 0.3, 1e-4),
        (0.5, -0.4, 0.0),
        (0.4, 0.2, 0.0),
        (0.3, 0.1, 0.0),
        (0.45, 0.3, 1e-4),
        (0.45, 1.0, 0.0),
    ):
        held = replace(CONTACT, P=P)
        p = state.pressure if held == true.loading.contact else hertz_cells(held, CELLS, PITCH)
        state = GRID.advance(state, part * SHIFT, compliance=compliance, pressure=p)
        true = ROUND.advance(true, part * SHIFT, P=P, compliance=compliance)
        assert pytest.approx(true.Q, abs=1.5e-3 * CONTACT.mu * P) == state.Q
        assert state.D + compliance * state.Q == pytest.approx(part * SHIFT, rel=1e-12)
        assert pytest.approx(state.sigma.sum() * PITCH**2, rel=1e-12) == state.Q


def test_without_poissons_ratio_both_components_are_one():
    contact = replace(CONTACT, nu=0.0)
    one, both = (
        GridLoading.of_sphere(contact, CELLS, coupled=coupled).driven(0.6 * SHIFT)
        for coupled in (False, True)
    )
    np.testing.assert_allclose(both.sigma[0], one.sigma, atol=1e-4 * one.sigma.max())
    assert np.abs(both.sigma[1]).max() < 1e-6 * one.sigma.max()


@pytest.mark.parametrize("part", [0.3, 0.7, 1.2])
def test_sideways_motion_turns_the_traction_and_changes_Q_by_a_tenth_of_a_percent(part):
    grid = GridLoading.of_sphere(CONTACT, CELLS, coupled=True)
    both, one = grid.driven(part * SHIFT), GRID.driven(part * SHIFT)
    assert 2e-4 < abs(both.Q / one.Q - 1) < 3e-3
    assert np.abs(both.sigma[1]).max() > 0.005 * both.sigma[0].max()
    assert abs(both.sigma[1].sum()) < 1e-6 * both.sigma[0].sum()
    inside = GRID.pressure > 0
    # along the slip, and as large as the law says
    s, sigma = both.s[:, inside], both.sigma[:, inside]
    assert np.abs(s[0] * sigma[1] - s[1] * sigma[0]).max() < 1e-9 * np.abs(s).max() * sigma.max()
    law = Interface(CONTACT.mu, CONTACT.L).traction(np.hypot(*s), GRID.pressure[inside])
    np.testing.assert_allclose(np.hypot(*sigma), law, rtol=1e-9)
    assert close_to_balance(grid, both, part * SHIFT)


def test_cells_hold_the_whole_contact():
    p = GRID.pressure
    assert p.sum() * PITCH**2 == pytest.approx(CONTACT.P, rel=1e-12)
    assert p[CELLS // 2, 1] > 0
    assert p[:, 0].max() == 0
