"""What no inversion can use is refused in a sentence; a grid that only looks odd is not."""

from __future__ import annotations

import math

import numpy as np
import pytest

from analysis.contact.rings import ring_means
from analysis.inversion.axisymmetric import AxisymmetricInversion
from analysis.inversion.iterative import conjugate_gradient, van_cittert
from analysis.inversion.problem import InversionProblem
from analysis.inversion.regularised import RegularisedInversion
from analysis.inversion.result import EndOfInversion
from analysis.mechanics import cattaneo_mindlin, hertz
from analysis.mechanics.interface import elastic_length

P, E, NU, R, MU, Q = 0.5, 3.43e6, 0.5, 128.8e-3, 0.93, 0.3
A = hertz.contact_radius(P, E, NU, R)
MASK, PITCH, NOISE = 1.2 * A, 80e-6, 40e-9


def grid(step_x: float = PITCH, step_y: float = PITCH) -> tuple[np.ndarray, np.ndarray]:
    half = 2.2 * A
    count_x, count_y = (int(half / abs(step)) for step in (step_x, step_y))
    return np.meshgrid(
        step_x * np.arange(-count_x, count_x + 1), step_y * np.arange(-count_y, count_y + 1)
    )


def field(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    moved, _ = cattaneo_mindlin.displacement(x, y, Q, MU, P, A, E, NU)
    return 30e-6 - moved + np.random.default_rng(3).normal(0, NOISE, x.shape)


def axisymmetric(x: np.ndarray, y: np.ndarray, **more: float) -> AxisymmetricInversion:
    return AxisymmetricInversion(x, y, PITCH, MASK, E, NU, **more)


def test_a_grid_with_two_pitches_is_refused_not_inverted_to_half_of_the_force() -> None:
    x, y = grid(PITCH, 2 * PITCH)
    for make in (
        lambda: RegularisedInversion(x, y, MASK, E, NU),
        lambda: axisymmetric(x, y),
    ):
        with pytest.raises(ValueError, match=r"8e-05 m along x and at 0\.00016 m along y"):
            make()


def test_a_transposed_grid_is_refused() -> None:
    x, y = grid()
    with pytest.raises(ValueError, match="x does not grow along the rows"):
        axisymmetric(x.T, y.T)


def test_a_grid_that_runs_backwards_has_the_same_stress_and_uncertainty() -> None:
    x, y = grid()
    u, found = field(x, y), []
    for turn in (slice(None), slice(None, None, -1)):
        rings = ring_means(
            np.hypot(x, y)[:, turn],
            u[:, turn],
            PITCH,
            theta=np.arctan2(y, x)[:, turn],
        )
        found.append(axisymmetric(x[:, turn], y[:, turn]).solve(rings))
    forth, back = found
    assert (back.sigma_sd[: len(back.sigma) // 3] > 0).all()
    np.testing.assert_allclose(back.sigma, forth.sigma, rtol=1e-9, atol=1e-3)
    np.testing.assert_allclose(back.sigma_sd, forth.sigma_sd, rtol=1e-6)


@pytest.mark.parametrize("thickness", [0.0, -1e-3, math.nan, 1e-9, 1e-5])
def test_a_layer_too_thin_for_the_grid_is_refused_at_once(thickness: float) -> None:
    x, y = grid()
    for make in (
        lambda: axisymmetric(x, y, thickness=thickness),
        lambda: RegularisedInversion(x, y, MASK, E, NU, thickness=thickness),
        lambda: InversionProblem(np.hypot(x, y) < MASK, PITCH, E, NU, thickness=thickness),
    ):
        with pytest.raises(ValueError, match=r"3 pitches"):
            make()


@pytest.mark.parametrize("box", [math.nan, -1e-6, math.inf])
def test_a_box_that_is_none_is_refused(box: float) -> None:
    x, y = grid()
    with pytest.raises(ValueError, match="box of"):
        axisymmetric(x, y, box=box)


@pytest.mark.parametrize("method", [conjugate_gradient, van_cittert])
def test_pure_noise_is_no_stress_that_converged(method) -> None:
    x, y = grid()
    problem = InversionProblem(np.hypot(x, y) < MASK, PITCH, E, NU)
    noise = 30e-6 + np.random.default_rng(1).normal(0, NOISE, x.shape)
    silent = method(problem, noise, 1.1 * NOISE)
    assert silent.stopped is EndOfInversion.SILENT
    assert not silent.is_converged
    assert "no stress is seen" in " ".join(silent.notes)
    loud = method(problem, field(x, y), 1.1 * NOISE, iterations=2000)
    assert loud.stopped is EndOfInversion.DISCREPANCY
    assert loud.is_converged


def test_a_force_that_is_the_limit_but_for_rounding_has_a_shift() -> None:
    limit = MU * P
    rounded = cattaneo_mindlin.shift(limit * (1 + 1e-15), MU, P, A, E, NU)
    assert rounded == pytest.approx(cattaneo_mindlin.full_shift(MU, P, A, E, NU), rel=1e-6)
    assert math.isnan(cattaneo_mindlin.shift(limit * 1.001, MU, P, A, E, NU))


@pytest.mark.parametrize(("h", "nu"), [(1e-6, 1.0), (1e-6, -0.1), (-1e-6, 0.5), (math.nan, 0.5)])
def test_an_elastic_length_of_what_no_block_has_is_refused(h: float, nu: float) -> None:
    with pytest.raises(ValueError, match="elastic length"):
        elastic_length(h, nu)
