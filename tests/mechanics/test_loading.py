"""The loading solver against its equations at other radii, quadrature of Green's tensor, and closed
forms in its limits.
"""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from analysis.mechanics import cattaneo_mindlin as cm
from analysis.mechanics.interface import Interface
from analysis.mechanics.loading import AxisymmetricLoading, SphereContact

CONTACT = SphereContact(P=0.5, E=3.43e6, nu=0.5, R=128.8e-3, mu=0.93, L=0.8e-6)
LIMIT = CONTACT.mu * CONTACT.P
LOADING = AxisymmetricLoading(CONTACT)
SHIFT = CONTACT.full_shift
PARTS = (0.02, 0.3, 0.6, 0.9, 1.3)


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])
@pytest.mark.parametrize("thickness", [np.inf, 15e-3])
def test_every_radius_is_in_equilibrium(nu, thickness):
    contact = replace(CONTACT, nu=nu, thickness=thickness)
    loading, r = AxisymmetricLoading(contact), np.linspace(0, 0.9999, 77) * contact.a
    for part in PARTS:
        state = loading.at_block(part * SHIFT)
        s = state.D - state.displacement(r)[0]
        expected = Interface(contact.mu, contact.L).traction(s, contact.pressure(r))
        np.testing.assert_allclose(
            state.traction(r), expected, atol=1e-9 * contact.mu * contact.pressure(0.0)
        )
        xi = np.linspace(0, 1, 2001)
        around = 2 * np.pi * contact.a**2 * xi * state.traction(contact.a * np.sqrt(1 - xi * xi))
        assert pytest.approx(np.trapezoid(around, xi), rel=1e-5) == state.Q


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])
def test_displacement_is_the_greens_tensor_summed_over_the_traction(nu):
    contact = replace(CONTACT, nu=nu)
    state = AxisymmetricLoading(contact).at_block(0.6 * SHIFT)
    a, G = contact.a, contact.G
    t, w = np.polynomial.legendre.leggauss(200)
    for x in np.array([0.0, 0.3, 0.9, 0.9999, 1.0001, 1.2, 3.0, 40.0]) * a:
        # polar coordinates about (x, 0): the kernel's 1/r goes; square roots at the ends of each
        # chord and of the opening go by a sine
        opening = np.pi if x < a else np.arcsin(a / x)
        angle = np.pi + opening * (t if x < a else np.sin(np.pi / 2 * t))
        weight = opening * w * (1 if x < a else np.pi / 2 * np.cos(np.pi / 2 * t))
        root = np.sqrt(np.maximum(a * a - (x * np.sin(angle)) ** 2, 0.0))
        start, end = np.maximum(-x * np.cos(angle) - root, 0.0), -x * np.cos(angle) + root
        half = ((end - start) / 2)[:, None]
        d = start[:, None] + half * (1 + np.sin(np.pi / 2 * t))
        sigma = state.traction(
            np.hypot(x + d * np.cos(angle)[:, None], d * np.sin(angle)[:, None]).ravel()
        ).reshape(d.shape)
        along = (
            (sigma * half * np.pi / 2 * np.cos(np.pi / 2 * t) * w).sum(axis=1)
            * weight
            / (2 * np.pi * G)
        )
        even, cos2 = along.sum() * (1 - nu / 2), (along * np.cos(2 * angle)).sum() * nu / 2
        sides = (along * np.sin(angle) ** 2).sum()
        g0, g2 = state.displacement(x)
        # at (x, 0) the tensor's xx part gives g0 + g2, its yy part (the traction turned by 90
        # degrees) g0 - g2
        assert g0 + g2 == pytest.approx(even + cos2, rel=3e-6)
        assert g0 - g2 == pytest.approx(along.sum() * (1 - nu) + nu * sides, rel=3e-6)


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.5])
def test_full_slip_has_the_closed_forms_displacement(nu):
    contact = replace(CONTACT, nu=nu)
    state = AxisymmetricLoading(contact).at_block(4 * SHIFT)
    r = contact.a * np.array([0, 1e-3, 0.5, 0.999, 1, 1.001, 1.7, 10, 100])
    expected = cm.radial_displacement(r, LIMIT, contact.mu, contact.P, contact.a, contact.E, nu)
    for g, g_cm in zip(state.displacement(r), expected, strict=True):
        np.testing.assert_allclose(g, g_cm, rtol=1e-10, atol=1e-14 * SHIFT)


@pytest.mark.parametrize("part", PARTS)
def test_twice_the_modes_change_nothing(part):
    few, many = (
        LOADING.at_block(part * SHIFT),
        AxisymmetricLoading(CONTACT, 128).at_block(part * SHIFT),
    )
    assert pytest.approx(many.Q, rel=1e-12) == few.Q
    r = np.linspace(0, 3, 50) * CONTACT.a
    for g, g_many in zip(few.displacement(r), many.displacement(r), strict=True):
        np.testing.assert_allclose(g, g_many, atol=1e-11 * few.D)


def first_order(part):
    """(D - D of Cattaneo-Mindlin)/L as L -> 0: slope in Q of the interface's complementary energy
    under Cattaneo-Mindlin's traction.
    """
    a, n = CONTACT.a, 20_000

    def energy(Q):
        r = (np.arange(n) + 0.5) / n * a
        p = CONTACT.mu * CONTACT.pressure(r)
        rest = 1 - cm.traction(r, Q, CONTACT.mu, CONTACT.P, a) / p
        density = (
            CONTACT.mu
            * p
            * (1 - rest + np.where(rest > 1e-12, rest * np.log(np.maximum(rest, 1e-12)), 0.0))
        )
        return np.sum(2 * np.pi * r * density) * a / n

    step = 1e-3 * LIMIT
    return (energy(part * LIMIT + step) - energy(part * LIMIT - step)) / (2 * step)


@pytest.mark.parametrize("part", [0.3, 0.6, 0.9])
def test_cattaneo_mindlin_is_the_limit_of_small_L_at_first_order(part):
    D = float(cm.shift(part * LIMIT, CONTACT.mu, CONTACT.P, CONTACT.a, CONTACT.E, CONTACT.nu))
    slopes, tractions = [], []
    for L in (0.4e-6, 0.2e-6, 0.1e-6):
        state = AxisymmetricLoading(replace(CONTACT, L=L), 128).at_force(part * LIMIT)
        slopes.append((state.D - D) / L)
        sharp = cm.traction(state.r, part * LIMIT, CONTACT.mu, CONTACT.P, CONTACT.a)
        tractions.append(np.sqrt(np.mean((state.sigma - sharp) ** 2)) / sharp.max())
    assert slopes[-1] == pytest.approx(first_order(part), rel=0.01)
    assert abs(slopes[2] / slopes[1] - 1) < abs(slopes[1] / slopes[0] - 1) + 1e-3
    assert tractions[2] < 0.8 * tractions[1] < 0.64 * tractions[0]


def test_the_three_ways_to_drive_agree_and_the_stiffness_is_the_slope():
    compliance = 2e-4
    for part in (1e-9, 0.3, 0.95, 0.9999):
        state = LOADING.at_force(part * LIMIT)
        assert pytest.approx(part * LIMIT, rel=1e-12) == state.Q
        assert pytest.approx(state.Q, rel=1e-12) == LOADING.at_block(state.D).Q
        assert (
            pytest.approx(state.Q, rel=1e-11)
            == LOADING.driven(state.D + compliance * state.Q, compliance).Q
        )
        assert pytest.approx(-state.D, rel=1e-12) == LOADING.at_force(-state.Q).D
        slope = (LOADING.at_block(1.0001 * state.D).Q - LOADING.at_block(0.9999 * state.D).Q) / (
            2e-4 * state.D
        )
        assert state.stiffness == pytest.approx(slope, rel=1e-5)
    soft = [AxisymmetricLoading(replace(CONTACT, L=L)).rest.stiffness for L in (1e-8, 1e-9)]
    rigid = 8 * CONTACT.G * CONTACT.a / (2 - CONTACT.nu)
    assert soft[1] == pytest.approx(rigid, rel=1e-3)
    assert soft[0] < soft[1] < rigid


def test_table_is_a_first_loading_up_to_sliding():
    states = LOADING.table(40)
    Q = np.array([s.Q for s in states])
    assert states[0].Q == 0
    assert Q[-1] == pytest.approx(LIMIT, rel=2e-6)
    assert (np.diff(Q) > 0).all()
    for state in states[1::8]:
        assert pytest.approx(LOADING.at_block(state.D).Q, rel=1e-11) == state.Q


@pytest.mark.parametrize("part", [0.3, 0.9, 1.2])
def test_a_reversal_repeats_the_first_loading_at_twice_its_size_and_a_closed_loop_is_forgotten(
    part,
):
    top = LOADING.at_block(part * SHIFT)
    for back in (0.8, 0.1, -0.7):
        down = LOADING.advance(top, back * top.D)
        assert (
            pytest.approx(top.Q - 2 * LOADING.at_block((top.D - down.D) / 2).Q, abs=1e-12 * LIMIT)
            == down.Q
        )
        up = LOADING.advance(down, 0.9 * top.D)
        assert (
            pytest.approx(down.Q + 2 * LOADING.at_block((up.D - down.D) / 2).Q, abs=1e-12 * LIMIT)
            == up.Q
        )
        beyond = LOADING.advance(up, 1.1 * top.D)
        assert pytest.approx(LOADING.at_block(1.1 * top.D).Q, rel=1e-11) == beyond.Q
        assert beyond.memory.slopes.tolist() == [1.0]


def test_unloading_tends_to_mindlin_and_deresiewiczs():
    errors = []
    for L in (0.4e-6, 0.2e-6, 0.1e-6):
        loading = AxisymmetricLoading(replace(CONTACT, L=L))
        top = loading.at_force(0.8 * LIMIT)
        down = loading.advance(top, 0.2 * top.D)
        sharp = cm.shear_force(
            (top.D - down.D) / 2, CONTACT.mu, CONTACT.P, CONTACT.a, CONTACT.E, CONTACT.nu
        )
        errors.append(top.Q - 2 * float(sharp) - down.Q)
    assert abs(errors[2]) < 0.01 * LIMIT
    assert errors[2] == pytest.approx(errors[1] / 2, rel=0.1)


def test_a_lower_normal_force_leaves_what_it_would_have_made():
    state = LOADING.advance(LOADING.at_block(0.6 * SHIFT), 0.6 * SHIFT, P=0.4)
    fresh = AxisymmetricLoading(replace(CONTACT, P=0.4)).at_block(0.6 * SHIFT)
    assert pytest.approx(fresh.Q, rel=1e-6) == state.Q
    np.testing.assert_allclose(state.s, fresh.s, atol=1e-5 * state.D)


def test_a_higher_normal_force_adds_no_shear_and_is_forgotten_once_all_has_slipped_further():
    before = LOADING.at_block(0.6 * SHIFT)
    state = LOADING.advance(before, before.D, P=0.6)
    fresh = AxisymmetricLoading(replace(CONTACT, P=0.6))
    assert pytest.approx(before.Q, rel=1e-4) == state.Q
    outside = state.r > CONTACT.a
    assert outside.any()
    assert np.abs(state.sigma[outside]).max() < 5e-3 * state.sigma.max()
    assert LOADING.advance(state, 0.7 * SHIFT).Q < 0.98 * fresh.at_block(0.7 * SHIFT).Q
    assert pytest.approx(fresh.at_block(SHIFT).Q, rel=1e-6) == LOADING.advance(state, SHIFT).Q


def test_any_history_stays_within_friction():
    rng = np.random.default_rng(1)
    state, P = LOADING.rest, CONTACT.P
    for _ in range(40):
        P = float(np.clip(P * np.exp(0.2 * rng.normal()), 0.05, 2))
        compliance = float(rng.choice([0.0, 1e-4]))
        stage = float(rng.normal() * SHIFT)
        state = LOADING.advance(state, stage, P=P, compliance=compliance)
        assert state.D + compliance * state.Q == pytest.approx(stage, rel=1e-12)
        assert (np.abs(state.sigma) <= CONTACT.mu * state.pressure * (1 + 1e-12)).all()
        np.testing.assert_allclose(
            state.s + state.displacement(state.r)[0], state.D, atol=1e-9 * SHIFT
        )


def test_a_layer_moves_less_than_a_half_space():
    layer = AxisymmetricLoading(replace(CONTACT, thickness=15e-3))
    for Q in (0.1, 0.46):
        assert pytest.approx(4.82e-6, rel=0.01) == (LOADING.at_force(Q).D - layer.at_force(Q).D) / Q
    g0, g2 = layer.at_force(Q).displacement(np.array([0.089, 0.091]))
    assert abs(g0[0]) < 1e-8
    assert g0[1] == g2[1] == 0


def test_peak_of_the_traction_lies_above_cattaneo_and_mindlins_c():
    for part in (0.3, 0.6, 0.9):
        state = LOADING.at_force(part * LIMIT)
        assert 0.02 < (state.peak_radius - state.stick_radius) / CONTACT.a < 0.1
        r = np.linspace(0, CONTACT.a, 20001)
        assert state.peak_radius == pytest.approx(
            r[np.argmax(state.traction(r))], abs=1e-4 * CONTACT.a
        )
    assert LOADING.at_block(2 * SHIFT).peak_radius == 0


@pytest.mark.parametrize(
    "change",
    [dict([c]) for c in itertools.product(["P", "E", "R", "mu", "L"], [0.0, -1.0, np.nan])]
    + [{"nu": -0.1}, {"nu": 0.51}, {"thickness": 1e-3}, {"thickness": np.nan}],
)
def test_bad_contacts_are_refused(change):
    with pytest.raises(ValueError, match=r"^loading: "):
        replace(CONTACT, **change)


def test_bad_requests_are_refused():
    for ask in (
        lambda: LOADING.at_force(LIMIT),
        lambda: LOADING.at_force(np.nan),
        lambda: LOADING.at_block(np.inf),
        lambda: LOADING.driven(1e-6, -1.0),
        lambda: AxisymmetricLoading(CONTACT, 3),
    ):
        with pytest.raises(ValueError, match=r"^loading: .* asked"):
            ask()
