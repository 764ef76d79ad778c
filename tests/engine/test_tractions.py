"""The traction of each frame of a run: what it is made from, and what is said where it is not."""

import numpy as np
import pytest

from analysis.contact.rings import ring_means
from analysis.mechanics import cattaneo_mindlin, hertz
from app.evaluation.tractions import Tractions, as_seen
from app.settings.sections import Config

P, E, NU, MU, D = 0.5, 3.43e6, 0.5, 0.93, 20e-6
PITCH = 70.4e-6
A = hertz.contact_radius(P, E, NU, 128.8e-3)
X, Y = np.meshgrid((np.arange(158) - 78.5) * PITCH, (np.arange(118) - 58.5) * PITCH)
R, THETA = np.hypot(X, Y), np.arctan2(Y, X)


def rings_of(Q, seed=0, reach=4.1e-3):
    gx, _ = cattaneo_mindlin.displacement(X, Y, Q, MU, P, A, E, NU)
    noise = np.random.default_rng(seed).normal(0, 5e-8, X.shape)
    return ring_means(R, D - gx + noise, PITCH, reach, theta=THETA)


def test_force_far_displacement_profile_and_largest_traction():
    tractions = Tractions(Config(), X, Y, A)
    for Q in (0.15, 0.3, 0.44):
        found, profile = tractions.of(rings_of(Q))
        assert found.stress_force_n == pytest.approx(Q, rel=3e-3)
        assert found.block_m == pytest.approx(D, abs=5e-8)
        error = profile.stress_pa - cattaneo_mindlin.traction(profile.radius_m, Q, MU, P, A)
        assert np.sqrt(np.mean(error**2)) < 0.02 * MU * hertz.peak_pressure(P, A)
        c = float(cattaneo_mindlin.stick_radius(Q, MU * P, A))
        assert c - 0.02 * A < found.peak_radius_m < c + 0.1 * A  # the cusp is rounded outwards
    assert tractions.notes() == []


def test_frames_that_can_not_be_inverted_are_counted_with_the_reason():
    tractions = Tractions(Config(), X, Y, A)
    assert tractions.of(rings_of(0.2, reach=1.5e-3)) == (None, None)
    tractions.of(rings_of(0.2))
    (note,) = tractions.notes()
    assert "1 of 2 frames were not inverted" in note
    assert "rings inside the mask" in note


def test_a_traction_of_another_extent_is_told():
    """The settings say a stiffer, hence smaller contact than there is."""
    tractions = Tractions(Config(), X, Y, 0.7 * A)
    for seed in range(3):
        tractions.of(rings_of(0.3, seed))
    assert any("residual is above the noise" in note for note in tractions.notes())


def test_without_a_normal_force_there_is_no_contact():
    with pytest.raises(ValueError, match="press it"):
        Tractions(Config(), X, Y, float("nan"))


def test_what_a_camera_at_rest_sees_of_a_block_that_moved():
    """A field on the material grid, found again at places at rest."""
    columns = np.broadcast_to(np.arange(40.0), (30, 40))
    ux = PITCH * (1.5 + 0.01 * columns)  # metres, a stretch of 1 %
    places, rows = (np.array(v, float) for v in (columns, np.indices((30, 40))[0]))
    (x, y) = (as_seen(v, ux, PITCH, moves=ux)[0] for v in (places, rows))
    seen = np.isfinite(x)
    assert seen.sum() > 700
    np.testing.assert_allclose((x + 1.5 + 0.01 * x)[seen], columns[seen], atol=0.02)
    np.testing.assert_allclose(y[seen], rows[seen], atol=1e-4)
