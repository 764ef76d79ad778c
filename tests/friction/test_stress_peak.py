"""c from the maximum of the stress, and corrections of c, in both worlds."""

import numpy as np
import pytest
from friction import elasto_plastic_world as world
from friction.stick_radius_calibration import calibrate, displacement_in_rings

from analysis.contact.rings import Rings
from analysis.friction.largest_stress import stress_peak
from analysis.friction.stick import fit_stick_radius, seen_in_rings
from analysis.inversion.axisymmetric import AxisymmetricInversion
from analysis.mechanics import cattaneo_mindlin
from analysis.mechanics.loading import AxisymmetricLoading, SphereContact

P, SD = 0.5, 232e-9
A = world.hertz_radius(P)
R = (np.arange(40) + 0.5) * world.PITCH
GAUSS = np.exp(-(((R - 1.2e-3) / 0.6e-3) ** 2) / 2)


def test_a_parabola_gives_its_vertex():
    peak = stress_peak(R, 5e4 - 1e10 * (R - 1.234e-3) ** 2, np.full(len(R), 100.0), reach=0.25e-3)
    np.testing.assert_allclose([peak.radius, peak.stress], [1.234e-3, 5e4], rtol=1e-9)


@pytest.mark.parametrize("shared_m", [0.0, 1e-4, 2.5e-4])
def test_the_stated_uncertainty_is_the_scatter(shared_m):
    """Errors of rings nearer than that to one another are alike."""
    distance = R[:, None] - R
    covariance = 2e-3**2 * (
        np.exp(-((distance / shared_m) ** 2) / 2) if shared_m else np.eye(len(R))
    )
    root = np.linalg.cholesky(covariance + 1e-12 * np.eye(len(R)))
    rng = np.random.default_rng(0)
    peaks = [
        stress_peak(R, GAUSS + root @ rng.normal(size=len(R)), covariance, reach=0.25e-3)
        for _ in range(300)
    ]
    error = np.array([peak.radius for peak in peaks]) - 1.2e-3
    assert abs(error.mean()) < 0.3 * error.std()
    assert 0.60 < np.mean(np.abs(error) < [peak.radius_sd for peak in peaks]) < 0.76


def test_rings_without_a_stress_are_ignored():
    stress = GAUSS.copy()
    stress[[3, 16]] = np.nan
    assert abs(stress_peak(R, stress, np.full(len(R), 1e-3), reach=0.25e-3).radius - 1.2e-3) < 1e-6


@pytest.mark.parametrize(
    ("stress", "words"),
    [
        (np.full(len(R), np.nan), "0 rings"),
        (np.sqrt(1 - (R / 3e-3) ** 2), "centre"),
        (R, "maximum"),
        (np.random.default_rng(1).normal(size=len(R)) * 1e-6, "noise"),
    ],
)
def test_without_a_maximum_there_is_no_c(stress, words):
    peak = stress_peak(R, stress, np.full(len(R), 0.01), reach=0.25e-3)
    assert np.isnan([peak.radius, peak.radius_sd]).all()
    assert words in peak.notes[0]


def test_a_calibration_undoes_a_known_bias():
    truth = np.linspace(0.2, 0.9, 15)
    biased = calibrate(lambda u: 0.1 + 0.8 * u[0] ** 2, truth[:, None], truth)
    value, sd = biased.corrected(0.1 + 0.8 * 0.6**2, 0.01)
    np.testing.assert_allclose([value, sd], [0.6, 0.01 / (1.6 * 0.6)], rtol=5e-3)
    assert np.isnan(biased.corrected(2.0, 0.01)).all()
    assert np.isnan(biased.corrected(np.nan)).all()


def test_a_calibration_with_noise_knows_bias_and_scatter_of_the_estimate():
    truth = np.linspace(0.2, 0.9, 15)
    noise = np.random.default_rng(2).normal(0, 0.05, (400, 1))
    noisy = calibrate(lambda u: u[0] ** 2, truth[:, None], truth, noise)
    value, sd = noisy.corrected(0.6**2 + 0.05**2)  # noise adds its variance to a square
    np.testing.assert_allclose([value, sd], [0.6, 0.05], rtol=0.05)
    assert abs(value - 0.6) < 2e-4


def test_an_estimate_that_does_not_follow_c_calibrates_nothing():
    with pytest.raises(ValueError, match="grows with c in 1 states"):
        calibrate(lambda u: 1.0, np.ones((10, 3)), np.arange(10.0))


def _inverted_peak():
    invert = AxisymmetricInversion(
        world.X,
        world.Y,
        world.PITCH,
        A + np.sqrt(world.R * 0.6e-6) + 2 * world.PITCH,
        world.E,
        world.NU,
        edge=A,
        box=world.BOX,
    )
    run = world.drive(P, 24)
    typical = SD * np.sqrt(np.mean(world.ring_noise(128, shared=True)[1] ** 2, axis=0))

    def peak(ux: np.ndarray) -> float:
        solved = invert.solve(Rings(run.radius, ux, typical, run.count))
        return stress_peak(solved.radius, solved.sigma, solved.covariance, reach=0.1 * A).radius

    def live(ux: np.ndarray) -> float:
        return fit_stick_radius(
            run.radius, ux, typical, A, box=world.BOX, width=world.PITCH
        ).stick_radius

    return run, peak, live


def _scores(estimate, calibration, profiles, truth):
    noise = SD * world.ring_noise(128, shared=True)[0][40:70]
    corrected = np.array(
        [[calibration.corrected(estimate(u + e)) for e in noise] for u in profiles]
    )
    error = corrected[..., 0] - np.asarray(truth)[:, None]
    bias, scatter = error.mean(axis=1) / A, error.std(axis=1) / A
    return bias, scatter, float(np.mean(np.abs(error) < corrected[..., 1]))


@pytest.mark.slow
def test_both_estimates_of_c_are_brought_to_the_maximum_of_the_true_stress():
    run, peak, live = _inverted_peak()
    loading = AxisymmetricLoading(SphereContact(P, world.E, world.NU, world.R, world.MU, world.L))
    states = [
        loading.at_force(world.MU * P * (1 - share**3)) for share in np.linspace(0.2, 0.98, 20)
    ]
    model = [displacement_in_rings(state, run.radius, world.BOX, world.PITCH) for state in states]
    peaks = [state.peak_radius for state in states]
    noise = SD * world.ring_noise(128, shared=True)[0][:20]
    chosen = (run.peak > 0.3 * A) & (run.peak < 0.93 * A)
    assert chosen.sum() > 8
    plain = np.array([live(u) for u in run.ux[chosen]]) - run.peak[chosen]
    assert plain.min() < -0.03 * A  # what there is to correct
    for estimate, worst in ((live, 0.003), (peak, 0.008)):
        calibration = calibrate(estimate, model, peaks, noise)
        bias, scatter, coverage = _scores(
            estimate, calibration, run.ux[chosen][::2], run.peak[chosen][::2]
        )
        assert np.abs(bias).max() < worst
        assert scatter.max() < 1.5 * worst
        assert 0.5 < coverage < 0.85


def test_the_maximum_of_the_stress_is_brought_to_cattaneo_and_mindlins_c():
    run, peak, _ = _inverted_peak()

    def profile(c: float) -> np.ndarray:
        Q = world.MU * P * (1 - c**3)
        return -seen_in_rings(
            lambda r: cattaneo_mindlin.radial_displacement(r, Q, world.MU, P, A, world.E, world.NU)[
                0
            ],
            run.radius,
            world.BOX,
            world.PITCH,
        )

    shares = np.linspace(0.15, 0.98, 20)
    calibration = calibrate(
        peak,
        [profile(c) for c in shares],
        A * shares,
        SD * world.ring_noise(128, shared=True)[0][:20],
    )
    truth = np.array([0.33, 0.62, 0.87])
    bias, scatter, coverage = _scores(peak, calibration, [profile(c) for c in truth], A * truth)
    assert np.abs(bias).max() < 0.005
    assert scatter.max() < 0.01
    assert 0.5 < coverage < 0.85
