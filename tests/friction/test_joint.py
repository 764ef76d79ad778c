"""Runs together: inputs that all share are not averaged out, and a run that an input spoils counts
less; both in closed form.
"""

import math

import numpy as np
import pytest

from analysis.friction.joint import common_value, joint_law, stiffness_length
from analysis.friction.local_law import LocalLaw

NOISE = 0.01


def runs(*lengths):
    return [LocalLaw(mu=0.9, mu_sd=0.001, L=L, L_sd=NOISE * L, E=3e6, E_sd=3e3) for L in lengths]


@pytest.mark.parametrize("count", [2, 5, 50])
def test_what_all_runs_share_alike_is_not_reduced_by_their_number(count):
    shared = np.full((count, 1), 0.03)
    loads = np.linspace(0.1, 1.4, count)
    joint = joint_law(runs(*[8e-7] * count), loads, inputs={"L": shared})
    assert joint.L.value == pytest.approx(8e-7, rel=1e-9)
    assert joint.L.sd / joint.L.value == pytest.approx(math.hypot(NOISE / count**0.5, 0.03))
    assert joint.E.sd / joint.E.value == pytest.approx(1e-3 / count**0.5)


def test_a_run_that_an_input_spoils_counts_less():
    inputs = np.array([[0.1], [0.0]])
    joint = joint_law(runs(9e-7, 8e-7), [0.1, 1.0], inputs={"L": inputs})
    own = NOISE**2 + 0.1**2, NOISE**2
    weight = np.array([1 / v for v in own])
    mean = np.exp(weight @ np.log([9e-7, 8e-7]) / weight.sum())
    assert joint.L.value == pytest.approx(mean, rel=1e-9)


def test_runs_that_an_input_sets_apart_go_together():
    apart = runs(8e-7, 9e-7, 1e-6)
    loads = [0.1, 0.5, 1.4]
    inputs = {"L": np.array([[0.0], [0.12], [0.22]])}
    assert any("L differs" in note for note in joint_law(apart, loads).notes)
    assert not joint_law(apart, loads, inputs=inputs).notes


def test_runs_without_a_value_are_left_out():
    found = common_value([1.0, math.nan, 1.0], [0.1, 0.1, 0.1])
    assert found.sd == pytest.approx(0.1 / 2**0.5)
    assert math.isnan(common_value([math.nan], [1.0]).value)


def test_the_stiffness_of_rings_gives_the_length_and_their_scatter_its_uncertainty():
    rng = np.random.default_rng(1)
    p = 5e4 * np.sqrt(1 - np.linspace(0, 0.9, 40) ** 2)
    values = []
    for _ in range(200):
        smooth = np.convolve(rng.standard_normal(42), np.ones(3) / 3**0.5, "valid")
        k = p / 8e-7 * np.exp(0.05 * smooth)  # noise that each ring shares with its neighbours
        values.append(stiffness_length(p, 1e-4 * p, k, 1e-3 * k))
    length, sd = np.array(values).T
    assert length.mean() == pytest.approx(8e-7, rel=0.005)
    assert length.std() == pytest.approx(sd.mean(), rel=0.3)


def test_rings_without_a_stiffness_tell_nothing():
    nothing = np.array([math.nan, 0.0])
    assert all(map(math.isnan, stiffness_length([1.0, 1.0], [0.1, 0.1], nothing, nothing)))


def test_runs_that_scatter_by_more_than_their_noise_widen_what_they_have_in_common():
    rng, pulls = np.random.default_rng(4), []
    for _ in range(150):
        found = common_value(8e-7 * np.exp(0.05 * rng.normal(size=12)), np.full(12, 8e-9))
        pulls.append((found.value - 8e-7) / found.sd)
    assert 0.8 < np.sqrt(np.mean(np.square(pulls))) < 1.25


@pytest.mark.parametrize("loads", [[0.5, 0.5003, 0.4998], [0.1, 0.5]])
def test_loads_that_do_not_tell_the_fall_of_mu_give_its_mean_and_say_so(loads):
    """A line through loads that are one reaches 1 N at any mu, and two loads leave no freedom."""
    mus = [0.9, 0.905, 0.895][: len(loads)]
    laws = [LocalLaw(mu=mu, mu_sd=0.005, L=8e-7, L_sd=8e-9, E=3e6, E_sd=3e3) for mu in mus]
    joint = joint_law(laws, loads)
    assert joint.mu.value == pytest.approx(math.prod(mus) ** (1 / len(mus)), rel=1e-4)
    assert joint.mu.sd == pytest.approx(0.005 / len(mus) ** 0.5, rel=0.05)
    assert math.isnan(joint.decay)
    assert any("not that at 1 N" in note for note in joint.notes)
