"""Stress fields from displacement fields: conjugate gradients, Van-Cittert, the regularised method,
and their flags.
"""

import numpy as np
import pytest
from friction import elasto_plastic_world as world

from analysis.inversion.iterative import conjugate_gradient, van_cittert
from analysis.inversion.problem import InversionProblem, mask_radius
from analysis.inversion.regularised import RegularisedInversion
from analysis.inversion.result import EndOfInversion
from analysis.mechanics import cattaneo_mindlin
from analysis.mechanics.half_space import SurfaceGreen

X, Y = world.points()
RADIUS = np.hypot(X, Y)
P = 0.5
LIMIT = mask_radius(P, world.E, world.NU, world.R, world.H, world.PITCH)


@pytest.fixture(scope="module")
def problem():
    return InversionProblem(RADIUS < LIMIT, world.PITCH, world.E, world.NU, box=world.BOX)


@pytest.fixture(scope="module")
def regularised():
    return RegularisedInversion(
        X, Y, LIMIT, world.E, world.NU, edge=world.hertz_radius(P), box=world.BOX, noise_box=0.0
    )


@pytest.fixture(scope="module")
def contact():
    return world.loaded(P, 0.6)


@pytest.fixture(scope="module")
def clean(contact):
    return contact.displacement(X, Y)


def field_error(found, contact, centre=(0.0, 0.0)):
    r = np.hypot(X - centre[0], Y - centre[1])
    error = (found.sigma - contact.sigma(r))[r < contact.a] / contact.full
    return np.sqrt(np.mean(error**2))


def test_conjugate_gradients_warm_from_the_previous_frames(problem):
    last = None
    for n in range(3):
        contact = world.loaded(P, 0.86 + 0.02 * n)
        u = contact.displacement(X, Y) + world.noise(n)
        last = conjugate_gradient(
            problem, u, world.NOISE, start=last and last.sigma, iterations=5 if last else 50
        )
    assert last.is_converged
    assert last.iterations <= 5
    assert field_error(last, contact) < 0.026
    assert abs(last.Q / contact.Q - 1) < 2e-3
    assert abs(last.D - contact.D) < 0.05e-6
    assert (last.sigma[~problem.mask] == 0).all()
    assert last.residual == pytest.approx(u - (last.D - problem.green.apply(last.sigma)), abs=1e-11)


def test_the_noise_is_measured_where_it_is_not_given(problem, contact, clean):
    u = clean + world.noise(3, world.BOX)
    assert problem.noise_level(u) == pytest.approx(world.NOISE, rel=0.04)
    assert abs(conjugate_gradient(problem, u).Q / contact.Q - 1) < 5e-3


@pytest.mark.parametrize("method", [conjugate_gradient, van_cittert])
def test_outliers_and_holes_change_little(problem, contact, clean, method):
    u = clean + world.noise(1)
    before = method(problem, u, world.NOISE)
    rng = np.random.default_rng(0)
    wrong = rng.random(u.shape) < 0.01
    u[wrong] += 70e-6 * rng.choice([-1, 1], wrong.sum())
    u[20:24, 30:40] = np.nan
    found = method(problem, u, world.NOISE)
    assert found.is_converged
    assert found.is_covered
    assert np.isnan(found.residual[20:24, 30:40]).all()
    assert abs(found.Q / before.Q - 1) < 3e-3
    assert field_error(found, contact) < field_error(before, contact) + 0.01


def test_points_of_little_precision_count_little(problem, contact, clean):
    sd = np.where(X > 3e-3, 100 * world.NOISE, world.NOISE)
    found = conjugate_gradient(problem, clean + world.noise(1) + np.where(X > 3e-3, 3e-6, 0), sd)
    assert abs(found.Q / contact.Q - 1) < 5e-3
    assert abs(found.D - contact.D) < 0.05e-6


def test_van_cittert_reaches_the_noise_and_says_so(problem, contact, clean):
    found = van_cittert(problem, clean + world.noise(1), world.NOISE, D=contact.D)
    assert found.stopped is EndOfInversion.DISCREPANCY
    assert found.iterations < 40
    assert field_error(found, contact) < 0.09
    assert abs(found.Q / contact.Q - 1) < 5e-3
    assert found.D_sd == 0
    fitted = van_cittert(problem, clean + world.noise(1), world.NOISE)
    assert abs(fitted.D - contact.D) < 0.1e-6


def test_van_cittert_over_the_whole_field_as_in_the_paper(contact, clean):
    whole = InversionProblem(
        np.ones(world.SHAPE, np.bool_), world.PITCH, world.E, world.NU, box=world.BOX
    )
    found = van_cittert(whole, clean + world.noise(1), world.NOISE, D=contact.D)
    assert found.stopped is EndOfInversion.DISCREPANCY
    assert not found.is_covered  # the mask reaches the rim
    assert abs(found.Q / contact.Q - 1) < 1e-2
    with pytest.raises(ValueError, match="outside"):
        van_cittert(whole, clean, world.NOISE)


def test_a_wrong_far_displacement_stagnates_and_is_flagged(problem, contact, clean):
    found = van_cittert(problem, clean + world.noise(1), world.NOISE, D=contact.D + 1e-6)
    assert found.stopped is EndOfInversion.STAGNATION
    assert not found.is_converged
    assert "times the noise" in found.notes[0]


def test_too_few_iterations_are_flagged(problem, clean):
    found = van_cittert(problem, clean + world.noise(1), world.NOISE, iterations=3)
    assert (found.stopped, found.iterations, found.is_converged) == (
        EndOfInversion.ITERATIONS,
        3,
        False,
    )


@pytest.mark.slow
def test_van_cittert_converges_on_any_grid_mask_and_unit():
    rng = np.random.default_rng(5)
    for _ in range(300):
        ny, nx = rng.integers(3, 9, 2)
        pitch, E, nu = 10 ** rng.uniform(-6, -2), 10 ** rng.uniform(3, 10), rng.uniform(0, 0.5)
        y, x = np.ogrid[:ny, :nx]
        mask = np.hypot(
            x - rng.integers(nx), (y - rng.integers(ny)) * rng.uniform(0.5, 2)
        ) < rng.uniform(0.5, 8)
        problem = InversionProblem(mask, pitch, E, nu, box=rng.choice([0, 0, 0, pitch]))
        image = problem.green.apply(np.where(mask, E, 0.0))
        D, sd = rng.normal() * pitch, 0.01 * image.std() + 1e-3 * image.mean()
        u = D - image + sd * rng.normal(size=mask.shape)
        nothing = np.mean((D - u) ** 2)
        found = van_cittert(problem, u, 0.5 * sd, D=D, step=rng.uniform(0.6, 1.9), iterations=25)
        assert np.abs(found.sigma).max() < 10 * E
        assert np.mean(found.residual**2) < 0.1 * nothing
        assert not found.sigma[~mask].any()


def test_regularised_field_of_a_round_contact(regularised, contact, clean):
    found = regularised.solve(clean + world.noise(1), world.NOISE)
    assert field_error(found, contact) < 0.015
    assert abs(found.Q / contact.Q - 1) < 2e-3
    assert abs(found.D - contact.D) < 0.05e-6
    assert abs(found.Q / (found.sigma.sum() * world.PITCH**2) - 1) < 2e-3
    inside = contact.a > RADIUS
    assert (
        0.4 < np.mean((np.abs(found.sigma - contact.sigma(RADIUS)) < found.sigma_sd)[inside]) < 0.95
    )
    assert found.is_converged


@pytest.mark.parametrize("pitch", [140e-6, 200e-6])
@pytest.mark.parametrize("load", [0.1, 0.5])
def test_regularised_force_on_a_coarse_grid_is_within_its_uncertainty(pitch, load):
    """Few points carry the round part, whose force they show too large or too small."""
    contact, rng = world.loaded(load, 0.6), np.random.default_rng(1)
    side = int(8e-3 / pitch) | 1
    for _ in range(3):
        x, y = world.points((side, side), pitch, centre=rng.uniform(-0.5, 0.5, 2) * pitch)
        solver = RegularisedInversion(
            x, y, 1.2 * contact.a, world.E, world.NU, edge=contact.a, box=world.BOX, noise_box=0.0
        )
        found = solver.solve(contact.displacement(x, y), np.full(x.shape, 50e-9))
        assert abs(found.Q - contact.Q) < 2 * found.Q_sd
        assert found.Q_sd < 1.5e-3 * contact.Q


def test_regularised_field_follows_what_is_not_round(regularised, contact):
    centre = (2.5 * world.PITCH, -1.5 * world.PITCH)
    x, y = world.points(centre=centre)
    found = regularised.solve(contact.displacement(x, y) + world.noise(1), world.NOISE)
    assert found.is_converged
    assert abs(found.Q / contact.Q - 1) < 3e-3
    assert field_error(found, contact, centre) < 0.06
    r = np.hypot(x, y)
    stated = (np.abs(found.sigma - contact.sigma(r)) < found.sigma_sd)[r < contact.a]
    assert 0.4 < np.mean(stated) < 0.95
    shift = np.sum(found.sigma * X) / found.sigma.sum(), np.sum(found.sigma * Y) / found.sigma.sum()
    assert shift == pytest.approx(centre, abs=0.3 * world.PITCH)


def test_a_contact_at_the_rim_is_not_covered(contact):
    x, y = world.points(centre=(4e-3, 0.0))
    off = InversionProblem(np.hypot(x, y) < LIMIT, world.PITCH, world.E, world.NU, box=world.BOX)
    found = conjugate_gradient(off, contact.displacement(x, y) + world.noise(1), world.NOISE)
    assert not found.is_covered
    assert "widen the field" in found.notes[0]


@pytest.mark.parametrize(
    "mask", [np.zeros((8, 8), np.bool_), np.ones(8, np.bool_), np.ones((1, 1), np.bool_)]
)
def test_masks_and_grids_of_no_use_are_refused(mask):
    with pytest.raises(ValueError, match=r"a mask of shape|two or more"):
        InversionProblem(mask, 1e-4, 1e6, 0.5)


@pytest.mark.parametrize("invert", [conjugate_gradient, van_cittert])
def test_fields_of_no_use_are_refused(problem, clean, invert):
    with pytest.raises(ValueError, match="same grid"):
        invert(problem, clean[1:], world.NOISE)
    with pytest.raises(ValueError, match="outside were measured"):
        invert(problem, np.where(problem.mask, clean, np.nan), world.NOISE)
    with pytest.raises(ValueError, match="0 points inside"):
        invert(problem, np.where(problem.mask, np.nan, clean), world.NOISE)
    with pytest.raises(ValueError, match="do not reveal its noise"):
        invert(problem, np.full_like(clean, np.nan))


@pytest.mark.parametrize("step", [0.0, 2.0, np.nan])
def test_a_step_that_diverges_is_refused(problem, clean, step):
    with pytest.raises(ValueError, match="between 0 and 2"):
        van_cittert(problem, clean, world.NOISE, step=step)


def test_a_mask_of_one_point_is_inverted():
    mask = np.zeros((9, 9), np.bool_)
    mask[4, 4] = True
    green = SurfaceGreen((9, 9), 1e-4, 1e6, 0.3)
    u = 3e-6 - green.apply(np.where(mask, 1e4, 0.0))
    found = conjugate_gradient(InversionProblem(mask, 1e-4, 1e6, 0.3), u, 1e-12)
    assert found.sigma[4, 4] == pytest.approx(1e4, rel=1e-6)
    assert abs(found.D / 3e-6 - 1) < 1e-9


def test_van_cittert_finds_the_stress_under_points_that_are_lost():
    """The force of Cattaneo and Mindlin's contact, of which a stripe is not seen."""
    x, block = np.linspace(-4e-3, 4e-3, 61), {"E": 3.4e6, "nu": 0.5}
    _, ux, _ = cattaneo_mindlin.field(x, x, Q=0.3, mu=0.9, P=0.5, a=2.4e-3, **block)
    u = 20e-6 - ux + np.random.default_rng(0).normal(0, 2e-8, ux.shape)
    u[np.abs(x) < 2e-4] = np.nan
    mask = np.hypot(*np.meshgrid(x, x)) < 2.7e-3
    found = van_cittert(InversionProblem(mask, x[1] - x[0], **block), u, 2e-8)
    assert pytest.approx(0.3, rel=5e-3) == found.Q
    assert found.stopped is EndOfInversion.DISCREPANCY
