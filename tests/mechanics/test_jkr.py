"""JKR against what defines it: the pressure carries P, the edge opens by the work of adhesion,
energy is kept, less force tears it off.
"""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.optimize import minimize_scalar

from analysis.mechanics import hertz, jkr

E, NU, R, W = 3.43e6, 0.5, 128.8e-3, 0.05
SAMPLE = (E, NU, R)
STIFF = E / (1 - NU * NU)
# in sqrt(1 - r^2/a^2), where the pressure's root becomes a power
DEPTH, WEIGHT = np.polynomial.legendre.leggauss(60)


@given(st.floats(-0.03, 2.0), st.floats(1e-6, 1.0))
def test_radius_force_and_work_of_adhesion_agree(P, w):
    a = jkr.contact_radius(P, w, *SAMPLE)
    pull_off = jkr.pull_off_force(w, R)
    if pull_off > P:
        assert np.isnan(a)
        return
    scale = 4 * STIFF * a**3 / (3 * R)
    assert jkr.normal_force(a, w, *SAMPLE) == pytest.approx(P, abs=1e-12 * scale)
    assert jkr.work_of_adhesion(a, P, *SAMPLE) == pytest.approx(w, rel=1e-8, abs=1e-12 * scale / R)


def test_no_contact_holds_more_than_the_pull_off_force():
    least = minimize_scalar(
        lambda a: float(jkr.normal_force(a, W, *SAMPLE)),
        bounds=(1e-5, 2e-3),
        method="bounded",
        options={"xatol": 1e-12},
    )
    assert least.fun == pytest.approx(jkr.pull_off_force(W, R), rel=1e-9)
    assert jkr.contact_radius(jkr.pull_off_force(W, R) * (1 - 1e-12), W, *SAMPLE) == pytest.approx(
        least.x, rel=1e-4
    )
    assert np.isnan(jkr.contact_radius(1.0001 * jkr.pull_off_force(W, R), W, *SAMPLE))


@pytest.mark.parametrize("P", [-0.02, 0.0, 0.5])
def test_the_pressure_carries_the_force_and_opens_the_edge(P):
    a = float(jkr.contact_radius(P, W, *SAMPLE))
    carried = (
        np.pi
        * a**2
        * np.sum(WEIGHT * np.abs(DEPTH) * jkr.pressure(a * np.sqrt(1 - DEPTH**2), a, W, *SAMPLE))
    )
    assert carried == pytest.approx(P, abs=1e-11)
    distance = 1e-9 * a
    intensity = -jkr.pressure(a - distance, a, W, *SAMPLE) * np.sqrt(2 * np.pi * distance)
    assert intensity**2 / (2 * STIFF) == pytest.approx(W, rel=1e-3)  # Irwin
    assert jkr.pressure(a, a, W, *SAMPLE) == -np.inf
    assert (jkr.pressure([1.001 * a, 5 * a], a, W, *SAMPLE) == 0).all()


@pytest.mark.parametrize("P", [0.1, 1.4])
def test_the_force_does_the_work_of_indentation_less_that_of_adhesion(P):
    """At a fixed radius the block answers as a flat punch, dP = 2 a E* d delta; along equilibrium,
    both change.
    """
    a, da = float(jkr.contact_radius(P, W, *SAMPLE)), 1e-7

    def energy(radius):  # of strain: loaded as Hertz to that radius, then pulled back as a punch
        full, force = (
            float(jkr.normal_force(radius, 0.0, *SAMPLE)),
            float(jkr.normal_force(radius, W, *SAMPLE)),
        )
        return 8 * STIFF * radius**5 / (15 * R**2) - (full**2 - force**2) / (4 * STIFF * radius)

    work = P * float(jkr.indentation(a + da, W, *SAMPLE) - jkr.indentation(a - da, W, *SAMPLE))
    assert energy(a + da) - energy(a - da) - work == pytest.approx(
        W * np.pi * 4 * a * da, rel=1e-6, abs=0
    )


@pytest.mark.parametrize("P", [0.01, 0.5])
def test_without_adhesion_it_is_hertz(P):
    a = hertz.contact_radius(P, *SAMPLE)
    assert jkr.contact_radius(P, 0.0, *SAMPLE) == pytest.approx(a, rel=1e-14)
    assert jkr.contact_radius(P, 1e-12, *SAMPLE) == pytest.approx(a, rel=1e-4)
    assert jkr.indentation(a, 0.0, *SAMPLE) == pytest.approx(hertz.indentation(a, R), rel=1e-15)
    r = np.linspace(0, 1.2 * a, 13)
    np.testing.assert_allclose(
        jkr.pressure(r, a, 0.0, *SAMPLE), hertz.pressure(r, P, a), rtol=1e-12, atol=1e-3
    )
    assert np.isnan(jkr.contact_radius(-1e-6, 0.0, *SAMPLE))
    assert np.isnan(jkr.work_of_adhesion(0.99 * a, P, *SAMPLE))


def test_soft_rubber_is_a_case_for_jkr_and_a_stiff_bead_is_not():
    assert jkr.tabor_parameter(W, *SAMPLE) > 1000
    assert jkr.tabor_parameter(W, 70e9, 0.2, 1e-6) < 1


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: jkr.contact_radius(0.1, -1e-3, *SAMPLE), "work of adhesion of -0.001"),
        (lambda: jkr.pull_off_force(0.0, R), "work = 0"),
        (lambda: jkr.pressure(0.0, 0.0, W, *SAMPLE), "radius = 0"),
        (lambda: jkr.normal_force(1e-3, W, E, 0.6, R), "Poisson's ratio 0.6"),
        (lambda: jkr.indentation(1e-3, W, E, NU, 0.0), "R = 0"),
    ],
)
def test_what_no_contact_has_is_refused_in_a_sentence(call, words):
    with pytest.raises(ValueError, match=words):
        call()
