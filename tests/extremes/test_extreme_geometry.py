"""Blocks from a nanometre to a kilometre, any roughness, grids from two points to 2000 x 2000."""

from __future__ import annotations

import functools
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from scipy.integrate import quad
from scipy.special import j0, jv, roots_legendre

from analysis.arrays import F64
from analysis.mechanics import hertz
from analysis.mechanics.greenwood_tripp import rough_contact
from analysis.mechanics.half_space import SurfaceGreen, layer_correction
from analysis.mechanics.loading import SphereContact

E, R, P, PITCH = 3.43e6, 128.8e-3, 0.5, 70e-6


@functools.cache
def wave_numbers() -> tuple[F64, F64]:
    """Times the thickness, and their weights; exp(-48) is left beyond."""
    nodes, weights = roots_legendre(4000)
    return 12 * (1 + nodes), 12 * weights


def layer_by_quadrature(r: float, nu: float, thickness: float) -> tuple[float, float]:
    """Layer less half-space from the textbook form of F, in every wave number by itself."""
    (q_h, w_h), k, G = wave_numbers(), 3 - 4 * nu, E / (2 * (1 + nu))
    numerator = k * np.sinh(2 * q_h) + 2 * q_h
    denominator = k * np.cosh(2 * q_h) + 2 * q_h**2 + 5 - 12 * nu + 8 * nu * nu
    along, across = (1 - nu) * (numerator / denominator - 1), np.tanh(q_h) - 1
    scale, at = w_h / (4 * np.pi * G * thickness), q_h * r / thickness
    return (
        float(np.sum(scale * j0(at) * (along + across))),
        float(-np.sum(scale * jv(2, at) * (along - across))),
    )


@pytest.mark.slow
@pytest.mark.parametrize("nu", [0.0, 0.5])
@pytest.mark.parametrize("furthest", [1.0, 39.0, 41.0, 300.0, 1000.0])
def test_a_layer_is_right_near_the_load_however_far_the_grid_reaches(
    furthest: float, nu: float
) -> None:
    thickness = 3 * PITCH
    r = np.array([0.0, 0.3, 1.0, 2.5, 7.0, furthest]) * thickness
    even, double = layer_correction(r, E, nu, thickness)
    scale = abs(even[0])
    for at, first, second in zip(r, even, double, strict=True):
        if at < 100 * thickness:  # beyond, the quadrature here would need more nodes
            expected = layer_by_quadrature(float(at), nu, thickness)
            assert (first, second) == pytest.approx(expected, abs=1e-6 * scale)
    if furthest > 40:  # the surface rests there: all of the half-space's motion is taken away
        G = E / (2 * (1 + nu))
        rest = -1 / (2 * np.pi * G * r[-1])
        assert even[-1] == pytest.approx((1 - nu / 2) * rest, rel=1e-12)
        assert double[-1] == pytest.approx(nu / 2 * rest, rel=1e-12)


@pytest.mark.parametrize("thickness", [1e-9, 2.9 * PITCH, 0.0, -1.0, float("nan")])
def test_a_block_thinner_than_three_points_is_refused(thickness: float) -> None:
    with pytest.raises(ValueError, match="3 pitches"):
        SurfaceGreen((8, 8), PITCH, E, 0.5, thickness=thickness)
    with pytest.raises(ValueError, match="two contact radii"):
        SphereContact(P, E, 0.5, R, 0.9, 1e-6, thickness)


def test_a_block_of_a_kilometre_is_a_half_space() -> None:
    stress = np.random.default_rng(0).normal(size=(9, 11))
    thick = SurfaceGreen((9, 11), PITCH, E, 0.5, thickness=1e3).apply(stress)
    half_space = SurfaceGreen((9, 11), PITCH, E, 0.5).apply(stress)
    np.testing.assert_allclose(thick, half_space, rtol=0, atol=1e-6 * np.abs(half_space).max())


@pytest.mark.parametrize("mu", [None, 1.0, 17.0, 1e6])
@pytest.mark.parametrize("alpha", [1.001e-3, 0.1, 1.0, 30.0, 9.99e3])
def test_a_rough_pressure_carries_the_force_from_smooth_to_above_hertzs_indentation(
    alpha: float, mu: float | None
) -> None:
    """The roughness h is alpha times the indentation: up to 10,000 times it."""
    a = hertz.contact_radius(P, E, 0.5, R)
    rough = rough_contact(P, E, 0.5, R, alpha * hertz.indentation(a, R), mu)
    knots = np.unique(np.minimum([0.0, 0.5, 0.9, 1.0, 1.1, 1.5, 3.0, np.inf], rough.reach / a))
    force = sum(
        quad(lambda r: 2 * np.pi * r * rough.pressure(r), low, high, limit=200)[0]
        for low, high in pairwise((knots * a).tolist())
    )
    assert force == pytest.approx(P, rel=2e-5)
    smooth = hertz.peak_pressure(P, a)
    assert 0 < rough.peak_pressure < 1.001 * smooth
    if alpha < 2e-3 and mu is None:
        assert rough.peak_pressure == pytest.approx(smooth, rel=2e-3)


@pytest.mark.parametrize("h", [0.0, 1e-12, 1e3, float("nan"), -1e-6])
def test_a_roughness_beyond_the_theory_is_refused_in_a_sentence(h: float) -> None:
    with pytest.raises(ValueError, match=r"rough contact: .*give"):
        rough_contact(P, E, 0.5, R, h)


@pytest.mark.parametrize("shape", [(1, 2), (2, 1), (2, 2), (3, 500)])
def test_the_smallest_grids_have_the_closed_form(shape: tuple[int, int]) -> None:
    """The integral of 1/r over a square seen from its middle is 4 ln(1 + sqrt 2) times its side."""
    stress = np.zeros(shape)
    stress[0, 0] = 1.0
    moved = SurfaceGreen(shape, PITCH, E, 0.0).apply(stress)
    expected = 4 * PITCH * np.log(1 + np.sqrt(2)) / (np.pi * E)
    assert moved[0, 0] == pytest.approx(expected, rel=1e-12)


@pytest.mark.slow
def test_a_grid_of_2000_by_2000_points_moves_like_a_point_force_far_away() -> None:
    n, nu = 2000, 0.5
    green = SurfaceGreen((n, n), PITCH, E, nu)
    stress = np.zeros((n, n))
    stress[0, 0] = 1.0
    moved = green.apply(stress)
    i, j = np.array([40, 700, 0, 1999, 1999]), np.array([30, 1, 1999, 0, 1999])
    x, y = j * PITCH, i * PITCH
    r = np.hypot(x, y)
    force = PITCH**2 * (1 + nu) / (np.pi * E)
    np.testing.assert_allclose(moved[i, j], force * (1 - nu + nu * (x / r) ** 2) / r, rtol=1e-4)


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.3, 0.5]), st.booleans())
def test_mirror_swap_reciprocity_and_energy_of_the_surface(
    seed: int, nu: float, is_layer: bool
) -> None:
    rng = np.random.default_rng(seed)
    thickness = 4 * PITCH if is_layer else np.inf
    green, other = (
        SurfaceGreen(shape, PITCH, E, nu, thickness=thickness, coupled=True)
        for shape in ((6, 9), (9, 6))
    )
    s, t = rng.normal(size=(2, 2, 6, 9))
    u = green.apply(s)
    size = np.abs(u).max()
    mirrored = green.apply(np.stack([-s[0], s[1]])[:, :, ::-1])
    np.testing.assert_allclose(
        mirrored, np.stack([-u[0], u[1]])[:, :, ::-1], rtol=0, atol=1e-12 * size
    )
    swapped = other.apply(s[::-1].transpose(0, 2, 1))
    np.testing.assert_allclose(swapped, u[::-1].transpose(0, 2, 1), rtol=0, atol=1e-12 * size)
    assert np.vdot(t, u) == pytest.approx(np.vdot(s, green.apply(t)), rel=1e-9, abs=1e-9 * size)
    assert np.vdot(s, u) > 0


@given(st.integers(-20, 20), st.integers(-10, 10))
def test_the_surface_scales_exactly_with_modulus_and_pitch(e: int, p: int) -> None:
    stress = np.random.default_rng(1).normal(size=(5, 7))
    one = SurfaceGreen((5, 7), 2.0**-14, 2.0**20, 0.5).apply(stress)
    other = SurfaceGreen((5, 7), 2.0 ** (p - 14), 2.0 ** (e + 20), 0.5).apply(stress)
    np.testing.assert_array_equal(other * 2.0 ** (e - p), one)
