"""c from the maximum of the stress."""

import numpy as np
import pytest
from friction import elasto_plastic_world as world

from analysis.contact.rings import Rings
from analysis.friction.largest_stress import stress_peak
from analysis.friction.stick import fit_stick_radius

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


@pytest.mark.slow
def test_c_of_the_inverted_stress_is_where_the_true_one_is_largest():
    """Where the fit of Cattaneo and Mindlin's profile says a smaller one."""
    invert, run = world.inversion(A, rim=1.0), world.drive(P, 24)
    mean, error = world.ring_noise(128, shared=True)
    typical = SD * np.sqrt(np.mean(error**2, axis=0))

    def peak(ux: np.ndarray) -> float:
        solved = invert.solve(Rings(run.radius, ux, typical, run.count))
        return stress_peak(solved.radius, solved.sigma, solved.covariance, reach=0.1 * A).radius

    def live(ux: np.ndarray) -> float:
        box = {"box": world.BOX, "width": world.PITCH}
        return fit_stick_radius(run.radius, ux, typical, A, **box).stick_radius

    chosen = (run.peak > 0.3 * A) & (run.peak < 0.93 * A)
    assert chosen.sum() > 8
    noisy = run.ux[chosen][:, None] + SD * mean[:20]
    off = np.array([[peak(u) for u in each] for each in noisy]) - run.peak[chosen][:, None]
    assert np.abs(off.mean(axis=1)).max() < 0.02 * A
    assert off.std(axis=1).max() < 0.015 * A
    assert (np.array([live(u) for u in run.ux[chosen]]) - run.peak[chosen]).max() < -0.03 * A
