"""Summits of surfaces of known moments, and what they carry."""

import math

import numpy as np
import pytest
from hidden_samples import PITCH, H, surface

from analysis.calibration.roughness import roughness
from analysis.calibration.summits import summits
from analysis.mechanics import greenwood_tripp, hertz

LENGTH = 8e-6
E, NU, R = 3.43e6, 0.5, 128.8e-3


@pytest.fixture(scope="module")
def surfaces():
    return [surface(seed, (512, 512), LENGTH) for seed in range(3)]


def means(surfaces, name, **waves):
    return np.mean([getattr(summits(roughness(z, PITCH, **waves)), name) for z in surfaces])


def test_summits_are_those_of_the_moments(surfaces):
    """The autocorrelation exp(-(r/l)^2) has m0 = h^2, m2 = 2 h^2/l^2, m4 = 12 h^2/l^4."""
    for name, true in (
        ("bandwidth", 3.0),
        ("density", 1 / (math.pi * math.sqrt(3) * LENGTH**2)),
        ("radius", 0.375 * math.sqrt(math.pi / 12) * LENGTH**2 / H),
        ("h", math.sqrt(1 - 0.8968 / 3) * H),
    ):
        assert means(surfaces, name, form="none") == pytest.approx(true, rel=0.05), name


def test_summits_that_are_counted_in_the_map_are_as_many_as_high_and_as_curved(surfaces):
    count, heights, bent = 0, [], []
    for z in surfaces:
        inner, around = z[1:-1, 1:-1], [
            z[1 + i : z.shape[0] - 1 + i, 1 + j : z.shape[1] - 1 + j]
            for i in (-1, 0, 1) for j in (-1, 0, 1) if (i, j) != (0, 0)
        ]  # fmt: skip
        is_top = np.all([inner > one for one in around], axis=0)
        count += is_top.sum()
        heights += inner[is_top].tolist()
        north, west, east, south = around[1], around[3], around[4], around[6]
        bent += ((4 * inner - north - west - east - south) / 2 / PITCH**2)[is_top].tolist()
    area = len(surfaces) * inner.size * PITCH**2
    assert means(surfaces, "density") == pytest.approx(count / area, rel=0.06)
    assert means(surfaces, "h") == pytest.approx(np.std(heights), rel=0.08)
    assert 1 / means(surfaces, "radius") == pytest.approx(np.mean(bent), rel=0.06)


def test_short_waves_that_do_not_count_leave_blunt_summits(surfaces):
    sharp, blunt = (means(surfaces, "radius", shortest=s) for s in (0.0, 20e-6))
    assert blunt > 1.3 * sharp


def test_what_they_carry_is_the_load_and_ends_outside_of_hertz_s_contact(surfaces):
    """Greenwood and Tripp's: mu = (8/3) eta sigma sqrt(2 R beta), heights in sigma."""
    found = summits(roughness(surfaces[0], PITCH))
    mu = 8 / 3 * found.density * found.h * math.sqrt(2 * R * found.radius)
    assert found.mu(R) == pytest.approx(mu)
    contact = found.contact(0.1, E, NU, R)
    same = greenwood_tripp.rough_contact(0.1, E, NU, R, found.h, mu)
    r = np.linspace(0, contact.reach, 20000)
    np.testing.assert_allclose(contact.pressure(r), same.pressure(r))
    assert np.trapezoid(2 * np.pi * r * contact.pressure(r), r) == pytest.approx(0.1, rel=1e-4)
    a = hertz.contact_radius(0.1, E, NU, R)
    assert contact.peak_pressure < hertz.peak_pressure(0.1, a)
    assert a < contact.radius_at(0.01) < a + 3 * math.sqrt(R * H)
