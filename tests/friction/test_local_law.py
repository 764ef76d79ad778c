"""mu, L and E from runs whose truth is solved by Abel's integrals, not by the loading solution that
is fitted.
"""

import numpy as np
import pytest
from friction import elasto_plastic_world as world

from analysis.contact.rings import Rings
from analysis.friction.local_law import displacement_in_rings, fit_local_law
from analysis.friction.master_curve import master_curve
from analysis.inversion.axisymmetric import AxisymmetricInversion
from analysis.mechanics import cattaneo_mindlin, hertz
from analysis.mechanics.loading import AxisymmetricLoading, SphereContact

KNOWN = {"E": 3.0e6, "nu": world.NU, "R": world.R, "box": world.BOX, "width": world.PITCH}


@pytest.fixture(scope="module")
def run() -> world.Run:
    return world.drive(0.5, 24)


def test_the_two_solutions_of_the_contact_agree():
    contact = world.World(0.5)
    state = contact.run(np.array([25e-6]))[0]
    found = AxisymmetricLoading(
        SphereContact(0.5, world.E, world.NU, world.R, world.MU, world.L)
    ).at_block(25e-6)
    np.testing.assert_allclose(found.Q, state.Q, rtol=1e-11)
    np.testing.assert_allclose(found.displacement(world.DENSE)[0], state.g0, atol=1e-15)
    np.testing.assert_allclose(found.displacement(world.DENSE)[1], state.g2, atol=1e-12)
    assert abs(found.peak_radius - state.peak) < 1e-3 * contact.a


def test_boxes_and_rings_average_the_model_as_the_picture_does(run):
    state = AxisymmetricLoading(
        SphereContact(0.5, world.E, world.NU, world.R, world.MU, world.L)
    ).at_block(run.states[9].D)
    full = run.count > 12
    np.testing.assert_allclose(
        displacement_in_rings(state, run.radius, world.BOX, world.PITCH)[full],
        run.ux[9][full],
        atol=1e-8,
    )


def test_a_run_without_noise_gives_mu_L_E_and_h(run):
    law = fit_local_law(
        run.radius, run.ux, 1e-8 / np.sqrt(run.count) + 0 * run.ux, 0.5, run.Q, **KNOWN
    )
    np.testing.assert_allclose([law.mu, law.E], [world.MU, world.E], rtol=3e-4)
    np.testing.assert_allclose([law.L, law.h], [world.L, world.L * 2 / 3], rtol=3e-3)
    np.testing.assert_allclose(law.D, [state.D for state in run.states], atol=3e-8)


@pytest.mark.parametrize(("sd", "seed"), [(50e-9, 1), (232e-9, 2)])
def test_a_noisy_run_meets_the_requirements_and_its_own_uncertainty(run, sd, seed):
    ux, error, Q = run.measured(sd, seed)
    law = fit_local_law(run.radius, ux, error, np.full(len(Q), 0.5), Q, **KNOWN)
    for found, stated, truth, limit in (
        (law.mu, law.mu_sd, world.MU, 0.01),
        (law.L, law.L_sd, world.L, 0.08),
        (law.E, law.E_sd, world.E, 0.015),
    ):
        assert abs(found / truth - 1) < limit
        assert abs(found - truth) < 4 * stated < 4 * limit * truth


def test_a_run_that_stops_halfway_gives_less_certain_numbers(run):
    ux, error, Q = run.measured(50e-9, 3)
    early = Q < 0.75 * world.MU * 0.5
    law = fit_local_law(run.radius, ux[early], error[early], 0.5, Q[early], **KNOWN)
    assert 5e-4 < law.mu_sd / world.MU < 0.01
    assert abs(law.mu - world.MU) < 4 * law.mu_sd
    assert abs(law.L - world.L) < 4 * law.L_sd


def test_outliers_and_gaps_do_not_matter(run):
    ux, error, Q = run.measured(50e-9, 4)
    ux[np.random.default_rng(0).random(ux.shape) < 0.03] += 5e-6
    ux[5], ux[:, 30] = np.nan, np.nan
    law = fit_local_law(run.radius, ux, error, 0.5, Q, **KNOWN)
    assert abs(law.mu / world.MU - 1) < 0.005
    assert abs(law.L / world.L - 1) < 0.03
    assert np.flatnonzero(np.isnan(law.D)).tolist() == [5]


def test_what_cannot_be_told_is_not(run):
    ux, error, Q = run.measured(50e-9, 5)
    rng = np.random.default_rng(1)
    cases = {
        "11 frames": (ux[:11], error[:11], 0.5, Q[:11]),
        "rings": (np.full_like(ux, np.nan), error, 0.5, Q),
        "drive further": (ux, error, 0.5, 0 * Q),
        "do not go together": (ux, error, 0.5, rng.uniform(0, 0.5, len(Q))),
        "check E": (-ux, error, 0.5, Q),
        "without contact": (ux, error, 0.0, Q),
    }
    for words, (u, sd, P, force) in cases.items():
        law = fit_local_law(run.radius, u, sd, P, force, **KNOWN)
        assert np.isnan([law.mu, law.L, law.E, law.h]).all()
        assert words in law.notes[0]


def test_exact_stress_over_pressure_is_the_master_curve(run):
    sigma = np.array(
        [np.where(run.radius < run.world.a, state.sigma(run.radius), 0.0) for state in run.states]
    )
    slip = np.array(
        [state.D - np.interp(run.radius, world.DENSE, state.g0) for state in run.states]
    )
    small = np.full(slip.shape, 1e-9)
    curve = master_curve(run.radius, slip, small, sigma, small * 1e11, 0.5, run.world.a)
    np.testing.assert_allclose([curve.mu, curve.L], [world.MU, world.L], rtol=1e-4)
    law = world.MU * -np.expm1(-curve.slip / (world.MU * world.L))
    np.testing.assert_allclose(curve.ratio, law, atol=1e-4)
    assert curve.radius.max() < 0.9 * run.world.a
    np.testing.assert_allclose(curve.stiffness[0], run.world.peak_pressure / world.L, rtol=1e-3)
    assert (np.diff(curve.bin_slip) > 0).all()
    assert curve.outliers == 0


def test_inverted_stress_gives_the_master_curve_within_its_smoothing(run):
    ux, error, Q = run.measured(50e-9, 6)
    a = run.world.a
    invert = AxisymmetricInversion(
        world.X,
        world.Y,
        world.PITCH,
        a + np.sqrt(world.R * 0.6e-6) + 2 * world.PITCH,
        world.E,
        world.NU,
        edge=a,
        box=world.BOX,
    )
    solved = [
        invert.solve(Rings(run.radius, u, sd, run.count)) for u, sd in zip(ux, error, strict=True)
    ]
    n = len(run.radius)
    sigma, sigma_sd = (
        np.array([v[:n] for v in column])
        for column in zip(*((s.sigma, s.sigma_sd) for s in solved), strict=True)
    )
    sigma[3, 4] *= 5
    curve = master_curve(run.radius, ux, error, sigma, sigma_sd, np.full(len(Q), 0.5), a)
    assert abs(curve.mu / world.MU - 1) < 0.005
    assert -0.01 < curve.L / world.L - 1 < 0.05
    assert 0 < curve.outliers < 0.05


def test_a_master_curve_of_nothing_is_empty(run):
    nothing = np.full(run.ux.shape, np.nan)
    curve = master_curve(run.radius, nothing, nothing, nothing, nothing, 0.5, run.world.a)
    assert np.isnan(curve.mu)
    assert "0 frames" in curve.notes[0]


def test_an_interface_too_stiff_to_be_told_is_said_to_be_so() -> None:
    """Cattaneo and Mindlin's displacements, in closed form."""
    P, E, nu, R, mu = 0.5, 3.43e6, 0.5, 128.8e-3, 0.93
    a = hertz.contact_radius(P, E, nu, R)
    r, forces = (np.arange(50) + 0.5) * 70.4e-6, 0.465 * np.append(np.linspace(0.02, 0.98, 40), 1.0)
    g = np.array([cattaneo_mindlin.radial_displacement(r, Q, mu, P, a, E, nu)[0] for Q in forces])
    D = cattaneo_mindlin.shift(forces, mu, P, a, E, nu)
    ux = D[:, None] - g + np.random.default_rng(2).normal(0, 3e-9, g.shape)
    law = fit_local_law(
        r, ux, np.full(ux.shape, 3e-9), np.full(41, P), forces, E=E, nu=nu, R=R, Q_sd=1e-4
    )
    assert np.isnan(law.L)
    assert "too short to be determined" in law.notes[0]
