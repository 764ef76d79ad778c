"""E and w of simulated JKR tests with hidden constants, and what is refused.

The truth is the closed form of the radius at a force; the fit knows the one of the force at a
radius.
"""

import numpy as np
import pytest
from hidden_samples import (
    EACH,
    FORCE,
    FORCE_SD,
    NU,
    RADIUS_SD,
    W_OPEN,
    E,
    R,
    W,
    adhering,
    adhering_radii,
    adhesion,
)
from seeds import errors, holds, pulls, seen_by

from analysis.calibration.adhesion import adhesion_test
from analysis.mechanics import hertz, jkr


def test(a, P, **given):
    return adhesion_test(a, P, R, NU, **{"a_sd": RADIUS_SD, "P_sd": FORCE_SD} | given)


test.__test__ = False


def test_hidden_constants_lie_within_their_stated_uncertainties():
    found = seen_by(adhesion)
    for one in found.values():
        holds(pulls(one))
    off = errors(found["E by JKR"])
    assert np.sqrt(np.mean(np.square(off))) < 0.0075
    assert np.percentile(np.abs(off), 95) < 0.015


def test_the_covariance_of_E_and_w_is_that_of_many_tests():
    pairs = [(t.E, t.w) for t in (test(*adhering(seed), zero_sd=0.0) for seed in range(100))]
    stated = test(*adhering(7), zero_sd=0.0)
    assert np.std([E for E, _ in pairs]) == pytest.approx(stated.E_sd, rel=0.2)
    assert np.cov(np.transpose(pairs))[0, 1] == pytest.approx(stated.E_w_covariance, rel=0.4)


@pytest.mark.parametrize(
    ("input_", "change"),
    [
        (0, lambda r, a, P: (r * 1.01, a, P)),
        (1, lambda r, a, P: (r, a * 1.01, P)),
        (2, lambda r, a, P: (r, a, P * 1.01)),
    ],
)
def test_inputs_cost_what_is_stated(input_, change):
    """A per cent more of the sphere's radius, of all radii, of all forces."""
    before = adhesion_test(adhering_radii(), FORCE, R, NU, a_sd=1e-7, P_sd=1e-5, zero_sd=0.0)
    lens, a, P = change(R, adhering_radii(), FORCE)
    after = adhesion_test(a, P, lens, NU, a_sd=1e-7, P_sd=1e-5, zero_sd=0.0)
    sd = [0.0, 0.0, 0.0]
    sd[input_] = 0.01
    stated = adhesion_test(
        adhering_radii(), FORCE, R, NU, a_sd=1e-7, P_sd=1e-5, zero_sd=0.0, relative_sd=tuple(sd)
    )
    assert abs(after.E - before.E) == pytest.approx(stated.E_sd, rel=0.03)
    assert abs(after.w - before.w) == pytest.approx(stated.w_sd, rel=0.03, abs=2e-5)


def test_pull_off_outliers_and_nan():
    a, P = adhering(1)
    a[[3, 20]] += 1e-4
    a[8] = np.nan
    found = test(a, P, pull_off=jkr.pull_off_force(W_OPEN, R))
    assert found.w_pull_off == pytest.approx(W_OPEN)
    assert found.outliers == 2
    assert np.flatnonzero(np.isnan(found.residual_m)).tolist() == [3, 8, 20]
    assert abs(found.E / E - 1) < 0.01


def test_a_loading_alone_has_no_hysteresis():
    a, P = adhering(2)
    found = test(a[:EACH], P[:EACH])
    assert np.isnan([found.w_unloading, found.hysteresis]).all()
    assert abs(found.E - E) < 4 * found.E_sd
    few = test(a[: EACH + 3], P[: EACH + 3])
    assert np.isnan(few.hysteresis)
    assert "3 points of the unloading are left out" in few.notes[0]


def hertzian(seed=1, less=0.0):
    touching = FORCE > 0.01
    a = np.array([hertz.contact_radius(P, E, NU, R) for P in FORCE[touching]])
    noise = np.random.default_rng(seed).normal(0, RADIUS_SD, a.shape)
    return a + noise - less, FORCE[touching]


def test_without_adhesion_w_is_an_upper_bound_and_E_is_right():
    found = test(*hertzian())
    assert abs(found.w) < 3 * found.w_sd < 1e-3
    assert abs(found.E - E) < 3 * found.E_sd
    assert "no adhesion is resolved" in found.notes[0]


def test_a_small_hard_sphere_is_told_to_be_no_JKR_contact():
    """Tabor's parameter of 1 um on 70 GPa is 0.1."""
    R, E = 1e-6, 70e9
    P = np.linspace(0, 2e-5, EACH)
    a = jkr.contact_radius(P, W, E, 0.3, R)
    found = adhesion_test(a, P, R, 0.3, a_sd=a / 1e4, P_sd=1e-9, zero_sd=1e-10)
    assert any("Tabor" in note for note in found.notes)
    assert abs(found.E / E - 1) < 1e-3


@pytest.mark.parametrize(
    ("spoiled", "word"),
    [
        (lambda a, P: (a[::4], P[::4]), "loads of the loading"),
        (lambda a, P: (a[8:15], P[8:15]), "span a factor"),
        (lambda a, P: (a, -P), "do not grow"),
        (lambda a, P: (a * 1e6, P), "give those of the contact in m"),
        (lambda a, P: (a * np.nan, P), "0 loads"),
        (lambda a, P: (a, P + 0.02), "zero of the force"),
        (lambda a, P: (a, P - 0.02), "zero of the force"),
        (lambda a, P: (a, P + np.linspace(0, 0.02, len(P))), "drifts"),
        (lambda a, P: (a, P - np.linspace(0, 0.02, len(P))), "drifts"),
        (lambda a, P: hertzian(less=4e-5), "smaller than those of Hertz"),
        (lambda a, P: adhering(w_open=0.02), "adheres less"),
        (lambda a, P: (a + 1e-4 * np.sin(np.arange(len(a)) * 1.7), P), "do not grow"),
    ],
)
def test_what_is_no_jkr_test_is_refused(spoiled, word):
    with pytest.raises(ValueError, match=f"adhesion: .*{word}"):
        test(*spoiled(*adhering()))


def test_uncertainties_of_nothing_are_refused():
    for sd in (0.0, np.inf):
        with pytest.raises(ValueError, match="adhesion: a standard uncertainty"):
            test(*adhering(), a_sd=sd)


def test_points_that_scatter_more_than_stated_widen_the_uncertainty():
    a, P = adhering()
    a = a + np.random.default_rng(4).normal(0, 2e-5, a.shape)
    found = test(a, P)
    assert found.misfit > 4
    assert abs(found.E - E) < 3 * found.E_sd
    assert "scatter" in found.notes[0]


def test_noise_that_was_stated_forty_times_too_small_leaves_honest_uncertainties():
    """It would decide on the zero and on the edge otherwise, and these on E."""
    pulls = []
    for seed in range(40):
        a, P = adhering(seed)
        found = test(a, P, a_sd=RADIUS_SD / 40, P_sd=FORCE_SD / 40, edge_sd=7e-6)
        pulls.append((found.E - E) / found.E_sd)
    assert np.mean(np.abs(pulls) < 2) > 0.9
