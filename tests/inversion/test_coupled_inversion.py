"""Both components of the traction, from displacements in closed form of a contact that is driven in
any direction.
"""

from __future__ import annotations

import math

import numpy as np
import pytest

from analysis.inversion.coupled import CoupledProblem
from analysis.inversion.iterative import conjugate_gradient
from analysis.inversion.problem import InversionProblem
from analysis.inversion.result import EndOfInversion
from analysis.mechanics import cattaneo_mindlin, hertz

P, E, NU, R, MU, Q = 0.5, 3.43e6, 0.5, 128.8e-3, 0.93, 0.4
A = hertz.contact_radius(P, E, NU, R)
PITCH, NOISE, FAR = 90e-6, 45e-9, 30e-6
HALF = int(2 * A / PITCH)
X, Y = np.meshgrid(*(PITCH * np.arange(-HALF, HALF + 1),) * 2)
MASK = np.hypot(X, Y) < A + 2 * PITCH
LARGEST = MU * hertz.peak_pressure(P, A)


def displaced(angle: float, nu: float = NU) -> tuple[np.ndarray, np.ndarray]:
    """Both fields of a contact driven at an angle to x: Cattaneo and Mindlin's, turned."""
    cos, sin = math.cos(angle), math.sin(angle)
    along, across = cattaneo_mindlin.displacement(
        cos * X + sin * Y, cos * Y - sin * X, Q, MU, P, A, E, nu
    )
    rng = np.random.default_rng(7)
    ux, uy = (FAR - along) * cos + across * sin, (FAR - along) * sin - across * cos
    return ux + rng.normal(0, NOISE, X.shape), uy + rng.normal(0, NOISE, X.shape)


@pytest.mark.parametrize("degrees", [0.0, 35.0, 90.0, -120.0])
def test_the_traction_goes_where_the_drive_goes(degrees: float) -> None:
    angle = math.radians(degrees)
    found = CoupledProblem(MASK, PITCH, E, NU).solve(displaced(angle), (NOISE, NOISE))
    true = cattaneo_mindlin.traction(np.hypot(X, Y), Q, MU, P, A)
    for one, share in zip(found, (math.cos(angle), math.sin(angle)), strict=True):
        assert pytest.approx(Q * share, abs=5e-3 * Q) == one.Q
        assert pytest.approx(FAR * share, abs=60e-9) == one.D
        error = (one.sigma - share * true)[MASK] / LARGEST
        assert np.sqrt(np.mean(error**2)) < 0.06
        assert one.is_converged
        assert one.is_covered


def test_one_component_alone_takes_the_other_for_its_own() -> None:
    """At 45 degrees u_x has a part that the traction along y causes."""
    ux, uy = displaced(math.radians(45))
    alone = conjugate_gradient(InversionProblem(MASK, PITCH, E, NU), ux, NOISE)
    both = CoupledProblem(MASK, PITCH, E, NU).solve((ux, uy), (NOISE, NOISE))
    true = math.sqrt(0.5) * cattaneo_mindlin.traction(np.hypot(X, Y), Q, MU, P, A)
    wrong, right = (
        np.sqrt(np.mean(((sigma - true)[MASK] / LARGEST) ** 2))
        for sigma in (alone.sigma, both[0].sigma)
    )
    assert right < 0.5 * wrong


def test_a_layer_and_a_box_are_those_of_the_problem() -> None:
    ux, uy = displaced(0.3)
    thin = CoupledProblem(MASK, PITCH, E, NU, thickness=15e-3).solve((ux, uy), (NOISE, NOISE))
    half = CoupledProblem(MASK, PITCH, E, NU).solve((ux, uy), (NOISE, NOISE))
    assert [one.D for one in thin] != [one.D for one in half]
    with pytest.raises(ValueError, match="3 pitches"):
        CoupledProblem(MASK, PITCH, E, NU, thickness=1e-5)


def test_noise_alone_is_silent_and_other_shapes_are_refused() -> None:
    problem, rng = CoupledProblem(MASK, PITCH, E, NU), np.random.default_rng(3)
    fields = rng.normal(0, NOISE, (2, *X.shape))
    found = problem.solve((fields[0], fields[1]), (1.1 * NOISE, 1.1 * NOISE))
    for one in found:
        assert one.stopped is EndOfInversion.SILENT
        assert not one.is_converged
    with pytest.raises(ValueError, match="use the same grid"):
        problem.solve((fields[0], fields[1][1:]))
