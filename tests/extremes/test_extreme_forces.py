"""Closed forms and loading from a micronewton to 100 N, from 1e-12 of full slip to full slip."""

from __future__ import annotations

import math

import mpmath as mp
import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st

from analysis.mechanics import cattaneo_mindlin as cm, hertz, jkr
from analysis.mechanics.interface import Interface
from analysis.mechanics.loading import AxisymmetricLoading, LoadingState, SphereContact

E, NU, R, MU = 3.43e6, 0.5, 128.8e-3, 0.93
FORCES = (1e-6, 0.5, 100.0)
MODULI = (1e3, 3.43e6, 1e9)  # six decades
POISSON = (0.0, 0.3, 0.5)
SHARES = (1e-12, 1e-6, 0.5, 1 - 1e-6, 1 - 1e-12)


def contact(P: float, E: float, nu: float, length: float, R: float = R) -> SphereContact:
    """With the elastic length in the shift at which all slides."""
    a = hertz.contact_radius(P, E, nu, R)
    return SphereContact(P, E, nu, R, MU, length * cm.full_shift(MU, P, a, E, nu))


def part_carried(way: float, soft: float, stiff: float) -> float:
    """1 - c^3 with ``soft (1 - c^2) + stiff (1 - c^3) = way``, by bisection in 60 digits."""
    with mp.workdps(60):
        low, high = mp.mpf(0), mp.mpf(1)
        for _ in range(190):
            c = (low + high) / 2
            is_low = soft * (1 - c * c) + mp.mpf(stiff) * (1 - c**3) > way
            low, high = (c, high) if is_low else (low, c)
        return float(1 - low**3)


def excess(state: LoadingState) -> tuple[float, float]:
    """How far a state is from the law of the interface, and from the elasticity of the block,
    which is summed up here by another quadrature than in the solver.
    """
    loading, L = state.loading, state.loading.contact.L
    law = Interface(MU, L).traction(state.s, state.pressure)
    r = loading.r[:: len(loading.r) // 4]
    moved = state.displacement(r)[0]
    here = state.D - state.s[:: len(loading.r) // 4]
    return (
        float(np.abs(law - state.sigma).max() / np.abs(state.sigma).max()),
        float(np.abs(moved - here).max() / abs(state.D)),
    )


@pytest.mark.parametrize("nu", POISSON)
@pytest.mark.parametrize("modulus", MODULI)
@pytest.mark.parametrize("P", FORCES)
def test_shift_and_stick_radius_hold_12_digits_at_any_force(
    P: float, modulus: float, nu: float
) -> None:
    a = hertz.contact_radius(P, modulus, nu, R)
    with mp.workdps(50):
        for share in SHARES:
            Q = share * MU * P
            left = 1 - mp.mpf(Q) / (mp.mpf(MU) * mp.mpf(P))
            full = 3 * mp.mpf(MU) * P * (2 - mp.mpf(nu)) * (1 + mp.mpf(nu)) / (8 * mp.mpf(modulus))
            shift = full / mp.mpf(a) * (1 - mp.cbrt(left) ** 2)
            # MU P is rounded once: 1e-4 of what is left at 1 - 1e-12
            doubt = 1e-12 + 2e-16 / float(left) if share > 0.5 else 1e-12
            assert float(cm.shift(Q, MU, P, a, modulus, nu)) == pytest.approx(
                float(shift), rel=1e-12
            )
            found = float(cm.stick_radius(Q, MU * P, a))
            assert found == pytest.approx(float(mp.cbrt(left)) * a, rel=doubt)


@pytest.mark.parametrize("compliance", [0.0, 1e-12, 1e-6, 1e3, 1e8])
@pytest.mark.parametrize("P", FORCES)
def test_the_driven_force_solves_its_cubic_at_any_compliance(P: float, compliance: float) -> None:
    a = hertz.contact_radius(P, E, NU, R)
    soft = cm.full_shift(MU, P, a, E, NU)
    stiff = MU * P * compliance
    for share in (1e-15, 1e-12, 1e-6, 0.3, 1 - 1e-9, 1 - 1e-12):
        way = share * (soft + stiff)
        found = float(cm.driven_shear_force(way, compliance, MU, P, a, E, NU))
        assert found == pytest.approx(MU * P * part_carried(way, soft, stiff), rel=1e-11)


@pytest.mark.parametrize("length", [1e-9, 1e-6, 1e-3, 1.0, 1e3, 1e9])
@pytest.mark.parametrize("P", FORCES)
def test_the_loading_is_in_equilibrium_for_any_elastic_length_up_to_full_slip(
    P: float, length: float
) -> None:
    for modulus, nu in ((1e3, 0.0), (1e9, 0.5)):
        loading = AxisymmetricLoading(contact(P, modulus, nu, length))
        for share in SHARES:
            state = loading.at_force(share * MU * P)
            assert pytest.approx(share * MU * P, rel=1e-9) == state.Q
            law, elasticity = excess(state)
            assert law < 1e-9
            assert elasticity < 1e-8


def test_a_vanishing_elastic_length_gives_cattaneo_and_mindlin() -> None:
    for share in (0.1, 0.5, 0.9):
        Q = share * MU * 0.5
        sharp = contact(0.5, E, NU, 1e-6)
        state = AxisymmetricLoading(sharp, 128).at_force(Q)
        shift = float(cm.shift(Q, MU, 0.5, sharp.a, E, NU))
        assert pytest.approx(shift, rel=1e-4) == state.D
        assert state.peak_radius == pytest.approx(
            float(cm.stick_radius(Q, MU * 0.5, sharp.a)), abs=0.02 * sharp.a
        )


def test_a_huge_elastic_length_makes_the_interface_the_only_spring() -> None:
    soft = contact(0.5, E, NU, 1e9)
    state = AxisymmetricLoading(soft).at_force(0.5 * MU * 0.5)
    assert pytest.approx(MU * soft.L * math.log(2), rel=1e-7) == state.D


@pytest.mark.parametrize("Q", [1 + 1e-9, 2.0, math.inf, math.nan])
@pytest.mark.parametrize("sign", [1, -1])
def test_more_than_the_contact_carries_is_no_shift_no_traction_and_no_state(
    Q: float, sign: int
) -> None:
    a = hertz.contact_radius(0.5, E, NU, R)
    force = sign * Q * MU * 0.5
    assert math.isnan(cm.shift(force, MU, 0.5, a, E, NU))
    with pytest.raises(ValueError, match="slides at mu P"):
        cm.traction([0.0], force, MU, 0.5, a)
    with pytest.raises(ValueError, match="carries less than mu P"):
        AxisymmetricLoading(contact(0.5, E, NU, 0.1)).at_force(force)


@pytest.mark.parametrize("P", [-1.0, -1e-300, math.nan, math.inf])
def test_a_normal_force_that_is_none_is_refused_in_a_sentence(P: float) -> None:
    for refused in (
        lambda: hertz.contact_radius(P, E, NU, R),
        lambda: cm.full_shift(MU, P, 1e-3, E, NU),
        lambda: SphereContact(P, E, NU, R, MU, 1e-6),
    ):
        with pytest.raises(ValueError, match="found; give"):
            refused()


@pytest.mark.parametrize("compliance", [-1e-6, math.inf, math.nan])
def test_a_compliance_that_is_none_is_refused(compliance: float) -> None:
    with pytest.raises(ValueError, match="compliance of"):
        cm.driven_shear_force(1e-6, compliance, MU, 0.5, 1e-3, E, NU)


@given(st.sampled_from(SHARES), st.integers(-6, 6))
def test_forces_moduli_and_radii_scale_exactly(share: float, n: int) -> None:
    """By powers of eight, which a number holds without rounding."""
    k = 8.0**n
    one = cm.shift(share * MU, MU, 1.0, 1e-3, 1e6, NU)
    assert cm.shift(share * MU * k, MU, k, 1e-3, 1e6 * k, NU) == one  # to the bit
    assert cm.shift(share * MU, MU, 1.0, 1e-3 / k, 1e6 * k, NU) == one
    a = hertz.contact_radius(1.0, 1e6, NU, 0.1)
    assert hertz.contact_radius(k, 1e6 * k, NU, 0.1) == a
    assert hertz.contact_radius(k, 1e6, NU, 0.1 * k * k) == pytest.approx(a * k, rel=4e-16)


@example([0.0, 2.0**-52])
@given(st.lists(st.floats(0, 1, exclude_max=True), min_size=2, max_size=9, unique=True))
def test_the_stick_radius_never_grows_with_the_force_and_the_work_is_never_negative(
    shares: list[float],
) -> None:
    Q = np.sort(shares) * MU * 0.5
    a = hertz.contact_radius(0.5, E, NU, R)
    c = cm.stick_radius(Q, MU * 0.5, a)
    assert (c <= a).all()
    assert (np.diff(c) <= np.spacing(a)).all()  # a cube root is good to its last digit
    delta = cm.shift(Q, MU, 0.5, a, E, NU)
    assert (np.diff(delta) >= 0).all()
    assert (Q * delta >= 0).all()


@settings(max_examples=30)
@given(st.lists(st.floats(-1, 1), min_size=1, max_size=5))
def test_no_path_from_rest_gives_work_and_its_mirror_image_gives_the_same_force(
    turns: list[float],
) -> None:
    loading = AxisymmetricLoading(contact(0.5, E, NU, 0.05), 16)
    far = 1.5 * loading.contact.full_shift
    forth, back, work = loading.rest, loading.rest, 0.0
    for D in np.array(turns) * far:
        for step in np.linspace(forth.D, D, 9)[1:].tolist():
            last, forth = forth, loading.advance(forth, step)
            back = loading.advance(back, -step)
            work += (forth.Q + last.Q) / 2 * (forth.D - last.D)
    assert pytest.approx(-forth.Q, abs=1e-9 * MU * 0.5) == back.Q
    assert work >= -1e-3 * MU * 0.5 * far  # of the trapezoids


@pytest.mark.parametrize("share", SHARES)
def test_the_traction_integrates_to_the_force(share: float) -> None:
    """With the angle that takes the roots at c and a away, and the ring's width in its own
    digits.
    """
    a, Q = 1e-3, share * MU * 0.5
    t, w = np.polynomial.legendre.leggauss(200)
    c = float(cm.stick_radius(Q, MU * 0.5, a))
    total = 0.0
    for low, high in ((0.0, c), (c, a)):
        angle = np.pi / 4 * (1 + t)
        r = low + (high - low) * np.sin(angle) ** 2
        dr = (high - low) * np.sin(2 * angle) * np.pi / 4
        total += float(np.sum(w * dr * 2 * np.pi * r * cm.traction(r, Q, MU, 0.5, a)))
    # at 1e-12 of full slip the ring is 7e-16 m wide: 1e-4 of it is a rounding of a
    assert total == pytest.approx(Q, rel=1e-10 + 1e-16 / share)


def test_without_adhesion_the_johnson_kendall_roberts_contact_is_hertz_at_any_force() -> None:
    for P in FORCES:
        a = hertz.contact_radius(P, E, NU, R)
        assert float(jkr.contact_radius(P, 0.0, E, NU, R)) == pytest.approx(a, rel=1e-15)
        assert float(jkr.normal_force(a, 0.0, E, NU, R)) == pytest.approx(P, rel=1e-14)


@pytest.mark.parametrize("w", [1e-12, 1e-3, 1.0, 1e6])
def test_the_adhesive_contact_tears_off_at_its_force_and_comes_back(w: float) -> None:
    pull = jkr.pull_off_force(w, R)
    for share in (1 - 1e-12, 0.5, 0.0, -1e3):
        a = jkr.contact_radius(share * pull, w, E, NU, R)
        back = float(jkr.normal_force(a, w, E, NU, R))
        assert back == pytest.approx(share * pull, rel=1e-9, abs=1e-9 * abs(pull))
    assert math.isnan(jkr.contact_radius(1.000001 * pull, w, E, NU, R))
