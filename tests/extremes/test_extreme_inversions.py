"""What every inversion says of pure noise, holes, wild points, wrong noise, small masks."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from analysis.contact.rings import ring_means
from analysis.inversion.coupled import CoupledProblem
from analysis.inversion.iterative import conjugate_gradient, van_cittert
from analysis.inversion.problem import InversionProblem
from analysis.inversion.regularised import RegularisedInversion
from analysis.inversion.result import EndOfInversion, Inversion
from analysis.mechanics import cattaneo_mindlin, hertz

P, E, R, MU = 0.5, 3.43e6, 128.8e-3, 0.93
NU = 0.0  # Cattaneo and Mindlin are exact, and u_y is 0
A = hertz.contact_radius(P, E, NU, R)
PITCH, MASK, NOISE = A / 10, 1.25 * A, 40e-9
HALF = int(2.4 * A / PITCH)
X, Y = np.meshgrid(*2 * [PITCH * np.arange(-HALF, HALF + 1)])
INSIDE = np.hypot(X, Y) < MASK
METHODS = ("axisymmetric", "regularised", "cgls", "van-cittert", "coupled")
ITERATIVE = ("cgls", "van-cittert", "coupled")
Solve = Callable[..., Any]


def moved(Q: float) -> np.ndarray:
    """u_x of Cattaneo and Mindlin."""
    return 30e-6 - cattaneo_mindlin.displacement(X, Y, Q, MU, P, A, E, NU)[0]


def noise(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(0, NOISE, X.shape)


def in_rings(u: np.ndarray) -> Any:
    return ring_means(np.hypot(X, Y), u, PITCH, theta=np.arctan2(Y, X))


def in_one(x: Inversion, y: Inversion) -> Inversion:
    """The result along x, with the stresses of both components."""
    return replace(x, sigma=np.stack([x.sigma, y.sigma]))


@pytest.fixture(scope="module")
def solvers() -> dict[str, Solve]:
    """From u_x and its uncertainty to a result, by any method."""
    problem = InversionProblem(INSIDE, PITCH, E, NU)
    both = CoupledProblem(INSIDE, PITCH, E, NU)
    whole = RegularisedInversion(X, Y, MASK, E, NU, edge=A)
    return {
        "axisymmetric": lambda u, sd: whole.round.solve(in_rings(u)),
        "regularised": whole.solve,
        "cgls": lambda u, sd, **more: conjugate_gradient(problem, u, sd, **more),
        "van-cittert": lambda u, sd, **more: van_cittert(problem, u, sd, **more),
        "coupled": lambda u, sd, **more: in_one(*both.solve((u, noise(99)), (sd, sd), **more)),
    }


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("stated", [0.9, 1.0, 1.1])
def test_pure_noise_is_silent_by_every_method_whatever_noise_is_stated(
    solvers: dict[str, Solve], method: str, stated: float
) -> None:
    for seed in range(5):
        found = solvers[method](30e-6 + noise(seed), stated * NOISE)
        assert not found.is_converged
        if stated >= 1 or method == "axisymmetric":  # which measures the noise itself
            assert found.stopped is EndOfInversion.SILENT
            assert any("no stress is seen" in note for note in found.notes)


@pytest.mark.parametrize("method", METHODS)
def test_a_thousandth_of_full_slip_is_seen_by_every_method(
    solvers: dict[str, Solve], method: str
) -> None:
    found = solvers[method](moved(1e-3 * MU * P) + noise(1), NOISE)
    assert found.is_converged
    assert found.stopped in (EndOfInversion.DISCREPANCY, EndOfInversion.GCV)


@pytest.mark.parametrize("method", ITERATIVE)
def test_every_ending_of_an_iteration_is_told_with_its_residual(
    solvers: dict[str, Solve], method: str
) -> None:
    solve, u = solvers[method], moved(0.5 * MU * P) + noise(2)
    early = solve(u, NOISE, iterations=1)
    assert early.stopped is EndOfInversion.ITERATIONS
    assert not early.is_converged
    assert "stopped (iterations) after 1 iterations with a residual of" in " ".join(early.notes)
    still = solve(u, NOISE / 10, iterations=10_000)
    assert still.stopped is EndOfInversion.STAGNATION
    assert not still.is_converged
    assert still.chi2 > 10
    done = solve(u, NOISE, iterations=10_000)
    assert done.is_converged == (done.chi2 < 1.03**2)
    assert done.is_converged or method == "van-cittert"  # which may stagnate at the rim


@pytest.mark.parametrize("D", [math.nan, math.inf, -math.inf])
def test_a_displacement_far_away_that_is_no_number_is_refused(D: float) -> None:
    problem = InversionProblem(INSIDE, PITCH, E, NU)
    with pytest.raises(ValueError, match="far away was given"):
        van_cittert(problem, moved(0.2), NOISE, D=D)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("level", [math.nan, math.inf])
def test_a_field_without_a_number_is_refused(
    solvers: dict[str, Solve], method: str, level: float
) -> None:
    with pytest.raises(ValueError, match="measured"):
        solvers[method](np.full_like(X, level), NOISE)


@pytest.mark.parametrize("method", METHODS)
def test_wild_points_and_holes_leave_the_force_right_or_the_result_unconverged(
    solvers: dict[str, Solve], method: str
) -> None:
    u = moved(0.3) + noise(3)
    u[5, 5], u[HALF + 3, HALF - 2] = 1e-3, -1e-3  # a millimetre off
    u[10:13, 40:43] = math.nan
    found = solvers[method](u, NOISE)
    assert not found.is_converged or pytest.approx(0.3, rel=0.01) == found.Q


@pytest.mark.parametrize("method", METHODS)
def test_a_view_smaller_than_the_contact_is_told(method: str) -> None:
    part = np.s_[:, HALF - 4 :]  # the centre is seen, the left half is not
    u, sd = (moved(0.3) + noise(4))[part], NOISE
    inside = INSIDE[part]
    if method in ("axisymmetric", "regularised"):
        whole = RegularisedInversion(X[part], Y[part], MASK, E, NU, edge=A)
        x, y = X[part], Y[part]
        rings = ring_means(np.hypot(x, y), u, PITCH, theta=np.arctan2(y, x))
        found = whole.round.solve(rings) if method == "axisymmetric" else whole.solve(u, sd)
    elif method == "coupled":
        found, _ = CoupledProblem(inside, PITCH, E, NU).solve((u, noise(5)[part]), (sd, sd))
    else:
        iterate = conjugate_gradient if method == "cgls" else van_cittert
        found = iterate(InversionProblem(inside, PITCH, E, NU), u, sd)
    assert not found.is_covered
    assert any("widen the field" in note for note in found.notes)


def test_a_mask_of_one_point_finds_the_force_on_it() -> None:
    mask = np.zeros((21, 21), np.bool_)
    mask[10, 10] = True
    problem = InversionProblem(mask, PITCH, E, NU)
    stress = np.where(mask, 5e4, 0.0)
    u = 1e-6 - problem.green.apply(stress)
    for found in (
        conjugate_gradient(problem, u, 1e-10),
        van_cittert(problem, u, 1e-10, iterations=10_000),
    ):
        assert pytest.approx(5e4 * PITCH**2, rel=1e-2) == found.Q
        assert found.is_converged
    whole = InversionProblem(np.ones((9, 9), np.bool_), PITCH, E, NU)
    with pytest.raises(ValueError, match="0 outside were measured"):
        conjugate_gradient(whole, np.zeros((9, 9)), 1e-9)


@pytest.mark.parametrize("method", ["cgls", "van-cittert"])
def test_the_inversion_scales_exactly_with_displacement_and_modulus(method: str) -> None:
    iterate = conjugate_gradient if method == "cgls" else van_cittert
    u = moved(0.3) + noise(6)
    one = iterate(InversionProblem(INSIDE, PITCH, E, NU), u, NOISE)
    larger = iterate(InversionProblem(INSIDE, PITCH, E, NU), u * 8, NOISE * 8)
    np.testing.assert_array_equal(larger.sigma, one.sigma * 8)
    stiffer = iterate(InversionProblem(INSIDE, PITCH, E * 1024, NU), u, NOISE)
    if method == "cgls":
        np.testing.assert_array_equal(stiffer.sigma, one.sigma * 1024)
    assert pytest.approx(one.Q * 1024, rel=1e-9) == stiffer.Q
    assert pytest.approx((one.D * 8, one.D), rel=1e-9) == (larger.D, stiffer.D)


@pytest.mark.parametrize("method", METHODS)
def test_a_shift_and_a_mirror_image_of_the_field_do_the_same_to_the_result(
    solvers: dict[str, Solve], method: str
) -> None:
    u = moved(0.3) + noise(7)
    one, moved_on = (solvers[method](field, NOISE) for field in (u, u + 5e-6))
    scale = np.abs(one.sigma).max()
    np.testing.assert_allclose(moved_on.sigma, one.sigma, rtol=0, atol=1e-4 * scale)
    first, second = (np.ravel(found.D)[0] for found in (one, moved_on))
    assert second - first == pytest.approx(5e-6, rel=1e-3)
    if method in ("cgls", "van-cittert", "regularised"):
        mirrored = solvers[method](u[:, ::-1], NOISE)
        np.testing.assert_allclose(mirrored.sigma[:, ::-1], one.sigma, rtol=0, atol=1e-3 * scale)


@pytest.mark.parametrize("method", METHODS)
def test_the_stress_adds_up_to_the_force_that_is_told(
    solvers: dict[str, Solve], method: str
) -> None:
    found = solvers[method](moved(0.3) + noise(8), NOISE)
    if method == "coupled":
        both = CoupledProblem(INSIDE, PITCH, E, NU).solve(
            (moved(0.3) + noise(8), noise(99)), (NOISE, NOISE)
        )
        for one in both:
            assert one.sigma.sum() * PITCH**2 == pytest.approx(one.Q)
    elif method == "axisymmetric":  # rings of one pitch
        r, sigma = found.radius, found.sigma
        assert np.sum(2 * np.pi * r * sigma) * PITCH == pytest.approx(found.Q, rel=0.02)
    else:
        assert found.sigma.sum() * PITCH**2 == pytest.approx(found.Q, rel=0.005)


@pytest.mark.parametrize("method", METHODS)
def test_single_precision_costs_a_fiftieth_of_what_noise_does(
    solvers: dict[str, Solve], method: str
) -> None:
    """Sessions hold displacements in single precision."""
    u = moved(0.3)
    one, single, other = (
        solvers[method](field, NOISE)
        for field in (u + noise(9), (u + noise(9)).astype(np.float32), u + noise(10))
    )
    by_noise = np.abs(one.sigma - other.sigma).max()
    assert np.abs(one.sigma - single.sigma).max() < 0.02 * by_noise


@pytest.mark.parametrize(("points", "least", "most"), [(8, 8, 20), (24, 30, 60)])
def test_the_condition_number_of_the_operator_grows_with_the_points_across(
    points: int, least: float, most: float
) -> None:
    """It is what rounding and noise are multiplied by at most: an exact inverse of 24 x 24 points
    in single precision keeps five digits.
    """
    green = InversionProblem(np.ones((points, points), np.bool_), PITCH, E, NU).green
    units = np.eye(points**2).reshape(-1, points, points)
    matrix = np.array([green.apply(unit).ravel() for unit in units])
    condition = float(np.linalg.cond(matrix))
    assert least < condition < most, f"condition number {condition:.3g}"
    stress = np.random.default_rng(0).normal(size=points**2)
    u = matrix @ stress
    back = np.linalg.solve(matrix, u.astype(np.float32).astype(np.float64))
    off = np.linalg.norm(back - stress) / np.linalg.norm(stress)
    assert off < condition * 2.0**-24
