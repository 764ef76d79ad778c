"""Stick radius against Cattaneo-Mindlin displacements summed numerically from the traction, through
the Green's function.
"""

from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from friction import elasto_plastic_world as world
from hypothesis import given, settings, strategies as st
from scipy.special import ellipkm1

from analysis.friction.stick import cattaneo_mindlin_profile, fit_stick_radius, seen_in_rings
from analysis.mechanics import cattaneo_mindlin

E, NU, R, MU = 3.43e6, 0.5, 0.1288, 0.93
G = E / (2 * (1 + NU))
P = 0.5
A = (3 * P * R * (1 - NU**2) / (4 * E)) ** (1 / 3)
Q0 = 3 * MU * P / (2 * np.pi * A**2)
PITCH, BOX = 70.4e-6, 20 * 7.04e-6
RADII = (np.arange(58) + 0.5) * PITCH
# a ring at r holds 2 pi r / pitch grid points of 232 nm each, of which every fourth is independent
SD = 232e-9 * 2 / np.sqrt(2 * np.pi * RADII / PITCH)


X, WEIGHT = np.polynomial.legendre.leggauss(120)
X, WEIGHT = (X + 1) / 2, WEIGHT / 2


def _traction(s, share):
    sigma = np.sqrt(np.maximum(1 - (s / A) ** 2, 0))
    return Q0 * (
        sigma - share * np.sqrt(np.maximum(1 - (s / (share * A)) ** 2, 0)) if share > 0 else sigma
    )


def _ring_mean(r, share):
    """Azimuthal mean of G*sigma: the azimuth is summed in closed form (an elliptic integral), the
    radius numerically.
    """
    corners = sorted({0.0, A, *(p for p in (r, share * A) if 0 < p < A)})
    total = 0.0
    for low, high in pairwise(corners):
        # nodes crowd at both ends, where roots and logarithms begin
        s = low + (high - low) * X**3 * (10 - 15 * X + 6 * X**2)
        slope = (high - low) * 30 * (X * (1 - X)) ** 2
        inverse_distance = 4 / (r + s) * ellipkm1(((r - s) / (r + s)) ** 2)
        total += np.sum(WEIGHT * slope * _traction(s, share) * s * inverse_distance)
    return (1 - NU / 2) / (2 * np.pi * G) * total


@cache
def _summed(share):
    """u_x = D - G*sigma in rings, with D = 30 um."""
    return 30e-6 - np.array([_ring_mean(r, share) for r in RADII])


@pytest.mark.parametrize("share", [0.0, 0.2, 0.5, 0.8, 0.95])
def test_exact_profiles_give_their_stick_radius(share):
    fit = fit_stick_radius(RADII, _summed(share), SD, A)
    assert abs(fit.stick_radius / A - share) < (0.03 if share == 0 else 5e-4)
    np.testing.assert_allclose(fit.offset, 30e-6, rtol=2e-3)
    np.testing.assert_allclose(fit.amplitude, Q0 * (1 - NU / 2) / (2 * np.pi * G), rtol=5e-3)
    assert fit.reduced_chi2 < 0.01


def test_bias_scatter_and_stated_uncertainty():
    scores = []
    for share in (0.2, 0.5, 0.8, 0.95):
        errors = []
        for seed in range(80):
            noise = np.random.default_rng(seed).normal(0, SD)
            fit = fit_stick_radius(RADII, _summed(share) + noise, SD, A)
            errors.append(fit.stick_radius / A - share)
            scores.append(errors[-1] * A / fit.stick_radius_sd)
        assert abs(np.mean(errors)) < 0.001
        assert np.std(errors) < 0.004
    assert 0.60 < np.mean(np.abs(scores) < 1) < 0.76


def test_noise_shared_by_neighbouring_rings_widens_the_uncertainty():
    scores = []
    for seed in range(150):
        white = np.random.default_rng(seed).normal(size=len(SD) + 2)
        noise = SD * (white[2:] + white[1:-1] + white[:-2]) / np.sqrt(3)
        fit = fit_stick_radius(RADII, _summed(0.5) + noise, SD, A)
        scores.append((fit.stick_radius - 0.5 * A) / fit.stick_radius_sd)
    assert 0.60 < np.mean(np.abs(scores) < 1) < 0.80


@pytest.mark.parametrize("share", [0.3, 0.6, 0.9])
def test_the_correlation_box_biases_by_less_than_half_a_percent(share):
    # the same profile averaged over boxes of 20 px, at eight azimuths of each ring
    offset = (np.arange(20) - 9.5) / 20 * BOX
    angle = (np.arange(8) + 0.5) * np.pi / 32
    x = RADII[:, None, None, None] * np.cos(angle)[:, None, None] + offset[:, None]
    y = RADII[:, None, None, None] * np.sin(angle)[:, None, None] + offset
    boxed = np.interp(np.hypot(x, y), RADII, _summed(share)).mean(axis=(1, 2, 3))
    inner = RADII < 55 * PITCH  # beyond, boxes leave the tabulated profile
    fit = fit_stick_radius(RADII[inner], boxed[inner], SD[inner], A)
    assert abs(fit.stick_radius / A - share) < 0.005


def test_where_c_is_lost_the_uncertainty_says_so():
    fits = [
        fit_stick_radius(RADII, _summed(0.0) + np.random.default_rng(s).normal(0, SD), SD, A)
        for s in range(40)
    ]
    values, stated = np.array([(f.stick_radius / A, f.stick_radius_sd / A) for f in fits]).T
    assert values.max() < 0.12
    assert 0.01 < np.median(stated) < 0.1
    assert np.mean(values < 2.001 * stated) > 0.85


def test_without_shear_nothing_is_told():
    for seed in range(20):
        fit = fit_stick_radius(RADII, np.random.default_rng(seed).normal(0, SD), SD, A)
        assert np.isnan(fit.stick_radius)
        assert np.isnan(fit.stick_radius_sd)


def test_a_profile_of_the_wrong_sign_is_no_contact():
    assert np.isnan(fit_stick_radius(RADII, -_summed(0.5), SD, A).stick_radius)


def test_rings_that_are_lost_are_ignored():
    u, sd = _summed(0.5).copy(), SD.copy()
    kept = np.ones(len(u), bool)
    kept[[0, 7, 20]] = False
    u[0], sd[7], u[20] = np.nan, np.nan, np.nan
    assert fit_stick_radius(RADII, u, sd, A) == fit_stick_radius(RADII[kept], u[kept], sd[kept], A)


def test_one_standard_error_may_be_that_of_all_rings():
    of_each = fit_stick_radius(RADII, _summed(0.5), np.full(len(RADII), 1e-8), A)
    assert fit_stick_radius(RADII, _summed(0.5), 1e-8, A) == of_each


@pytest.mark.parametrize("radius", [np.nan, 0.0])
def test_without_a_contact_there_is_no_fit(radius):
    assert np.isnan(fit_stick_radius(RADII, _summed(0.5), SD, radius).stick_radius)


@pytest.mark.parametrize("rings", [6, 7, 8])
def test_few_rings_are_fitted(rings):
    r = (np.arange(rings) + 0.5) * 2.5 * A / rings
    u = -3e-6 * cattaneo_mindlin_profile(r, 0.5 * A, A)[0] / A
    fit = fit_stick_radius(r, u, SD[:rings] / 100, A)
    assert fit.stick_radius == pytest.approx(0.5 * A, rel=0.01)


def test_too_few_rings_are_no_profile():
    nothing = np.full(len(RADII), np.nan)
    assert np.isnan(fit_stick_radius(RADII, nothing, nothing, A).stick_radius)
    assert np.isnan(fit_stick_radius(RADII[:5], _summed(0.5)[:5], SD[:5], A).stick_radius)


@settings(max_examples=20)
@given(st.floats(1e-3, 1e3), st.floats(1e-3, 1e3), st.floats(-1, 1))
def test_units_of_length_and_the_zero_of_displacement_do_not_matter(length, height, zero):
    u = _summed(0.5)
    plain = fit_stick_radius(RADII, u, SD, A)
    scaled = fit_stick_radius(
        RADII * length, u * height + zero * 1e-5 * height, SD * height, A * length
    )
    np.testing.assert_allclose(scaled.stick_radius, plain.stick_radius * length, rtol=1e-5)
    np.testing.assert_allclose(scaled.stick_radius_sd, plain.stick_radius_sd * length, rtol=1e-3)


def test_the_profile_is_the_summed_one():
    for share in (0.0, 0.5):
        expected = 30e-6 - _summed(share)
        found = (
            Q0 * (1 - NU / 2) / (2 * np.pi * G) * cattaneo_mindlin_profile(RADII, [share * A], A)[0]
        )
        np.testing.assert_allclose(found, expected, rtol=2e-6)


@cache
def _pictured(share, P=0.5):
    """u_x as measured: Cattaneo and Mindlin's field on the grid, averaged over boxes, its rings;
    and their points.
    """
    a = world.hertz_radius(P)
    g0, g2 = cattaneo_mindlin.radial_displacement(
        world.DENSE, MU * P * (1 - share**3), MU, P, a, E, NU
    )
    rings = world.State(P, 30e-6, 0.0, a, np.zeros_like, g0, g2).rings()
    return rings.radius, rings.mean, a


@pytest.mark.parametrize("P", [0.1, 1.4])
@pytest.mark.parametrize("share", [0.2, 0.6, 0.95])
def test_profiles_averaged_like_the_picture_leave_no_bias(share, P):
    r, u, a = _pictured(share, P)
    sd = 50e-9 / np.sqrt(2 * np.pi * r / PITCH)
    averaged = fit_stick_radius(r, u, sd, a, box=world.BOX, width=PITCH)
    assert abs(averaged.stick_radius / a - share) < 5e-4
    if share == 0.95:
        assert abs(fit_stick_radius(r, u, sd, a).stick_radius / a - share) > 1e-3


def test_the_average_over_boxes_and_rings_is_that_of_the_points_in_them():
    rng = np.random.default_rng(0)
    r = 0.5e-3 + PITCH * (rng.random(400_000) - 0.5)
    x, y = r[:, None] * np.array([1, np.cos(0.3), np.cos(0.7)]), r[:, None] * np.sin([0, 0.3, 0.7])
    x, y = (v + BOX * (rng.random(v.shape) - 0.5) for v in (x, y))
    found = seen_in_rings(lambda at: np.exp(-((at / 4e-4) ** 2)), np.array([0.5e-3]), BOX, PITCH)
    np.testing.assert_allclose(found, np.mean(np.exp(-(x**2 + y**2) / 4e-4**2)), rtol=1e-3)


@pytest.mark.parametrize(("P", "sd", "most"), [(0.5, 232e-9, 0.005), (0.1, 50e-9, 0.005)])
def test_noise_of_overlapping_boxes_scatters_little_and_is_stated(P, sd, most):
    mean, error = world.ring_noise(128, shared=True)
    scores = []
    for share in (0.2, 0.5, 0.8, 0.95):
        r, u, a = _pictured(share, P)
        fits = [
            fit_stick_radius(r, u + sd * m, sd * e, a, box=world.BOX, width=PITCH)
            for m, e in zip(mean[:80], error, strict=False)
        ]
        errors = np.array([fit.stick_radius / a - share for fit in fits])
        assert abs(errors.mean()) < 0.002
        assert errors.std() < most
        scores += list(errors * a / [fit.stick_radius_sd for fit in fits])
    assert 0.60 < np.mean(np.abs(scores) < 1) < 0.76
