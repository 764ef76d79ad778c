"""Greenwood and Tripp's rough contact: its equations checked by quadrature at other points, and its
limits.
"""

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import ellipkm1

from analysis.mechanics import greenwood_tripp as gt, hertz

E, NU, R, P = 3.43e6, 0.5, 128.8e-3, 0.5
A = hertz.contact_radius(P, E, NU, R)
PEAK = hertz.peak_pressure(P, A)
STIFF = E / (1 - NU**2)


def rough(alpha, mu=None):
    return gt.rough_contact(P, E, NU, R, alpha * A**2 / R, mu)


def bending(contact, r):
    """u_z at r: rings of pressure, each moving the surface by 4/(pi E*) p s K(k)/(r + s) ds
    (Johnson, section 3.8).
    """

    def ring(s):
        return contact.pressure(s) * s / (r + s) * ellipkm1(max(((r - s) / (r + s)) ** 2, 1e-300))

    return (
        4
        / (np.pi * STIFF)
        * sum(
            quad(ring, *ends, limit=200, epsabs=0, epsrel=1e-8)[0]
            for ends in ((0, r), (r, contact.reach))
        )
    )


def gaussian_pressure(gap, mu):
    """Sum of mu (s - gap)^(3/2) over a normal distribution of s, which is the pressure in E*
    sqrt(h/(8 R)); `gap` in h.
    """
    return (
        mu
        * quad(
            lambda t: t**1.5 * np.exp(-((t + gap) ** 2) / 2) / np.sqrt(2 * np.pi),
            0,
            12 - min(gap, 0),
            epsabs=0,
            limit=200,
        )[0]
    )


@pytest.mark.parametrize("alpha", [0.016, 0.5, 20.0])
def test_exponential_heights_the_gap_follows_from_the_pressure_and_the_pressure_from_the_gap(alpha):
    contact, h = rough(alpha), alpha * A**2 / R
    r = contact.radius_at(0.5) * np.array([0.3, 0.8, 1.2, 1.6])
    gap = r**2 / (2 * R) + [bending(contact, v) for v in r]
    logs = np.log(contact.pressure(r))
    np.testing.assert_allclose(np.diff(logs), -np.diff(gap) / h, rtol=1e-6)


@pytest.mark.parametrize("mu", [4.0, 17.0])
def test_gaussian_heights_the_gap_follows_from_the_pressure_and_the_pressure_from_the_gap(mu):
    alpha = 0.3
    contact, h = rough(alpha, mu), alpha * A**2 / R
    r = contact.radius_at(0.5) * np.array([0.3, 0.8, 1.2, 1.6])
    unit = STIFF * np.sqrt(h / (8 * R))
    gap = (r**2 / (2 * R) + [bending(contact, v) for v in r]) / h
    wanted = contact.pressure(r) / unit
    low, high = -30.0, 30.0
    for _ in range(60):  # the approach, from the pressure at the first radius
        middle = (low + high) / 2
        low, high = (
            (middle, high) if gaussian_pressure(gap[0] + middle, mu) > wanted[0] else (low, middle)
        )
    np.testing.assert_allclose([gaussian_pressure(g + low, mu) for g in gap], wanted, rtol=1e-5)


@pytest.mark.parametrize("mu", [None, 4.0])
@pytest.mark.parametrize("alpha", [2e-3, 0.016, 1.0, 1e3])
def test_the_pressure_carries_the_normal_force_and_makes_the_effective_radius(alpha, mu):
    contact = rough(alpha, mu)
    r, dr = np.linspace(0, contact.reach, 40001, retstep=True)
    p = contact.pressure(r)
    assert 2 * np.pi * np.sum(p * r) * dr == pytest.approx(P, rel=1e-6)
    assert 3 * np.pi / 4 * np.sum(p * r) / (np.sum(p) - p[0] / 2) == pytest.approx(
        contact.effective_radius, rel=1e-6
    )
    assert p[0] == pytest.approx(contact.peak_pressure, rel=1e-12)
    assert (np.diff(p) <= 1e-6 * PEAK).all()
    assert contact.pressure(contact.radius_at(0.2)) == pytest.approx(
        0.2 * contact.peak_pressure, rel=1e-3
    )
    assert contact.pressure(2 * contact.reach) == 0


# Gaussian heights: the gap too depends on alpha
@pytest.mark.parametrize(("mu", "order"), [(None, 1.0), (17.0, 0.85)])
def test_little_roughness_is_hertz_to_the_first_order(mu, order):
    r = np.linspace(0, 0.9 * A, 20)
    distance = []
    for alpha in (0.008, 0.004, 0.002):
        contact = rough(alpha, mu)
        distance.append(contact.effective_radius / A - 1)
        np.testing.assert_allclose(
            contact.pressure(r), hertz.pressure(r, P, A), atol=3 * alpha * PEAK
        )
    assert np.log2(distance[0] / distance[1]) == pytest.approx(order, abs=0.1)
    assert np.log2(distance[1] / distance[2]) == pytest.approx(order, abs=0.1)


def test_an_extremely_rough_plane_does_not_bend():
    """Then the gap is that of the rigid sphere and exponential heights give a Gaussian pressure."""
    contact, h = rough(5e3), 5e3 * A**2 / R
    r = np.sqrt(2 * R * h) * np.linspace(0, 3, 7)
    np.testing.assert_allclose(
        contact.pressure(r) / contact.peak_pressure,
        np.exp(-(r**2) / (2 * R * h)),
        rtol=2e-5,
        atol=1e-9,
    )


@pytest.mark.parametrize("mu", [4.0, 17.0])
def test_johnsons_rule_of_0_05(mu):
    """Johnson, section 13.5: Hertz serves up to alpha = 0.05, where it is some per cent off."""
    contact = rough(0.05, mu)
    assert 0.93 < contact.peak_pressure / PEAK < 0.97
    assert 1.02 < contact.effective_radius / A < 1.05


def test_the_papers_estimate_is_where_its_sample_has_about_a_hundredth_of_the_peak_pressure():
    for force in (0.1, 0.5, 1.4):
        a = hertz.contact_radius(force, E, NU, R)
        contact = gt.rough_contact(force, E, NU, R, 0.595e-6)
        assert (
            0.004
            < contact.pressure(gt.apparent_radius(a, R, 0.595e-6)) / contact.peak_pressure
            < 0.025
        )
    assert gt.apparent_radius(A, R, 0.595e-6) - A == pytest.approx(
        0.277e-3, abs=1e-6
    )  # "about 280 um"


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: rough(1e-4), "use Hertz below"),
        (lambda: rough(0.1, 0.1), "mu = 0.1"),
        (lambda: gt.rough_contact(0.0, E, NU, R, 1e-6), "force = 0"),
        (lambda: gt.rough_contact(P, E, NU, R, 0.0), "height = 0"),
        (lambda: gt.rough_contact(P, E, 0.7, R, 1e-6), "Poisson's ratio 0.7"),
        (lambda: rough(0.1).radius_at(1.0), "radius at 1 of"),
        (lambda: gt.apparent_radius(A, R, -1e-6), "-1e-06 m"),
    ],
)
def test_what_can_not_be_solved_is_refused_in_a_sentence(call, words):
    with pytest.raises(ValueError, match=words):
        call()
