"""Young's modulus from the balance of stress and force."""

import numpy as np
import pytest
from friction import elasto_plastic_world as world
from scipy.signal import lfilter

from analysis.contact.rings import Rings
from analysis.friction.modulus import balance_modulus

E, SUPPOSED = 3.43e6, 2.9e6
FRAMES = 60
TRUE_Q = 0.465 * np.minimum(np.arange(FRAMES) / 40, 1)


def _balance(seed, integral_sd=1e-3, force_sd=1e-3, zero=0.0):
    rng = np.random.default_rng(seed)
    integral = SUPPOSED / E * TRUE_Q + rng.normal(0, integral_sd, FRAMES)
    return integral, TRUE_Q + zero + rng.normal(0, force_sd, FRAMES)


@pytest.mark.parametrize(("integral_sd", "force_sd"), [(1e-3, 1e-3), (0.02, 1e-3), (1e-4, 0.02)])
def test_no_bias_and_the_stated_uncertainty(integral_sd, force_sd):
    found = []
    for seed in range(300):
        integral, Q = _balance(seed, integral_sd, force_sd)
        modulus = balance_modulus(integral, integral_sd, Q, SUPPOSED, Q_sd=force_sd)
        found.append((modulus.E - E, modulus.E_sd))
    error, stated = np.array(found).T
    # noise of the integral alone would flatten a plain line
    assert abs(error.mean()) < 3 * error.std() / np.sqrt(300)
    assert 0.60 < np.mean(np.abs(error) < stated) < 0.78


def test_the_zero_of_the_force_is_an_offset():
    integral, Q = _balance(0, zero=0.05)
    modulus = balance_modulus(integral, 1e-3, Q, SUPPOSED)
    assert abs(modulus.E / E - 1) < 0.005
    assert abs(modulus.offset - 0.05) < 0.002


def test_outlying_and_lost_frames_are_left_out():
    integral, Q = _balance(1)
    integral[[10, 50]] += 0.1
    Q[20] = np.nan
    modulus = balance_modulus(integral, 1e-3, Q, SUPPOSED)
    assert abs(modulus.E / E - 1) < 0.005
    assert (modulus.frames, modulus.outliers) == (FRAMES - 3, 2)


def test_errors_that_frames_share_widen_the_uncertainty():
    integral, Q = _balance(2)
    plain = balance_modulus(integral, 1e-3, Q, SUPPOSED)
    slow = balance_modulus(integral + 3e-3 * np.sin(np.arange(FRAMES) / 4), 1e-3, Q, SUPPOSED)
    assert slow.E_sd > 2 * plain.E_sd


def test_errors_that_last_over_many_frames_are_in_the_uncertainty():
    true_q, pulls = 0.465 * np.minimum(np.arange(200) / 130, 1), []
    for seed in range(100):
        slow, quick = np.random.default_rng(seed).normal(size=(2, 300))
        slow = 1e-3 * lfilter([np.sqrt(1 - 0.9**2)], [1, -0.9], slow)[100:]
        integral, Q = SUPPOSED / E * true_q + slow, true_q + 1e-4 * quick[100:]
        modulus = balance_modulus(integral, 1e-3, Q, SUPPOSED, Q_sd=1e-4)
        pulls.append((modulus.E - E) / modulus.E_sd)
    assert 0.8 < np.sqrt(np.mean(np.square(pulls))) < 1.3


def test_inverted_displacements_give_the_modulus():
    run = world.drive(0.5, 24)
    ux, error, Q = run.measured(232e-9, 0)
    invert = world.inversion(run.world.a, SUPPOSED, rim=1.0)
    solved = [
        invert.solve(Rings(run.radius, u, sd, run.count)) for u, sd in zip(ux, error, strict=True)
    ]
    modulus = balance_modulus([s.Q for s in solved], [s.Q_sd for s in solved], Q, SUPPOSED)
    assert abs(modulus.E / world.E - 1) < 0.015
    assert abs(modulus.E - world.E) < 4 * modulus.E_sd


@pytest.mark.parametrize(
    ("integral", "Q", "words"),
    [
        (TRUE_Q[:5], TRUE_Q[:5], "5 frames"),
        (0 * TRUE_Q, 0 * TRUE_Q, "varies"),
        (-TRUE_Q, TRUE_Q, "opposite"),
    ],
)
def test_what_cannot_be_told_is_not(integral, Q, words):
    modulus = balance_modulus(integral, 1e-3, Q, SUPPOSED)
    assert np.isnan([modulus.E, modulus.E_sd]).all()
    assert words in modulus.notes[0]


def test_a_modulus_of_zero_is_refused():
    with pytest.raises(ValueError, match="modulus: E 0 Pa"):
        balance_modulus(TRUE_Q, 1e-3, TRUE_Q, 0.0)
