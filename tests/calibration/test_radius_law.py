"""Apparent radii over loads: hidden E and extension, and which law holds."""

import numpy as np
import pytest
from hidden_samples import (
    LOADS,
    E,
    H,
    R,
    apparent_radii,
    drawn_radii,
    law_of_radii,
    radii_over_loads,
)
from seeds import SEEDS, holds, pulls, seen_by

from analysis.calibration.radius_law import radius_law


def test_hidden_constants_lie_within_their_stated_uncertainties():
    for one in seen_by(radii_over_loads).values():
        holds(pulls(one), most_at_one=0.80)  # the free fit widens
    fits = [drawn_radii(seed)[0] for seed in range(SEEDS)]
    assert np.median([one.smooth.likelihood for one in fits]) < 1e-6
    assert np.mean([one.rough.chi2 for one in fits]) == pytest.approx(len(LOADS) - 1, rel=0.2)


def test_the_numbers_of_the_paper():
    """E = 3.43 +- 0.05 MPa, h = 0.595 +- 0.013 um: an extension of 277 um, which the paper rounds
    to 280 um, beyond Hertz's radii.
    """
    found = law_of_radii(LOADS, apparent_radii(), modulus=(E, 0.05e6), h_sd=0.013e-6)
    assert found.expected_m == pytest.approx(277e-6, abs=1e-6)
    np.testing.assert_allclose(found.excess_m, found.expected_m, rtol=1e-9)
    assert np.all(found.excess_sd_m < 4e-5)
    assert found.rough.chi2 == pytest.approx(0, abs=1e-9)
    assert any("Hertz's contact does not hold" in note for note in found.notes)
    smooth = law_of_radii(LOADS, apparent_radii(h=0.0))
    assert smooth.smooth.likelihood > 0.5
    assert abs(smooth.smooth.E / E - 1) < 1e-6
    assert abs(smooth.free.extension) < smooth.free.extension_sd
    assert any("sqrt(R h) does not hold" in note for note in smooth.notes)


@pytest.mark.parametrize("law", ["smooth", "rough", "free"])
@pytest.mark.parametrize("input_", [0, 1, 2])
def test_inputs_cost_what_is_stated(law, input_):
    """A per cent of the sphere's radius, of all radii, of all forces."""
    exact = {"P_sd": 1e-9, "a_sd": 1e-9}
    by = np.ones(3)
    by[input_] += 1e-4
    P, a = LOADS * by[2], apparent_radii(h=0.0 if law == "smooth" else H)
    h = H
    before = getattr(law_of_radii(LOADS, a, **exact), law)
    after = getattr(law_of_radii(P, a * by[1], R=R * by[0], h=h / by[0], **exact), law)
    stated = getattr(law_of_radii(LOADS, a, relative_sd=tuple((by - 1).tolist()), **exact), law)
    assert abs(after.E - before.E) == pytest.approx(stated.E_sd, rel=0.02, abs=2 * before.E_sd)


def test_points_that_scatter_more_than_stated():
    a = apparent_radii() + 1e-4 * np.array([1, -1, 1, -1, 1, -1])
    found = law_of_radii(LOADS, a)
    assert found.rough.likelihood < 1e-3
    assert found.free.E_sd > 3 * law_of_radii(LOADS, apparent_radii()).free.E_sd
    assert len(found.notes) == 2


@pytest.mark.parametrize(
    ("spoiled", "word"),
    [
        (lambda P, a: (P[:3], a[:3]), "3 loads"),
        (lambda P, a: (P, np.where(P > 0.4, np.nan, a)), "2 loads"),
        (lambda P, a: (1 + P / 10, a), "span a factor"),
        (lambda P, a: (P, a[::-1]), "do not grow"),
        (lambda P, a: (-P, a), "leave that contact out"),
    ],
)
def test_radii_of_no_law_are_refused(spoiled, word):
    with pytest.raises(ValueError, match=f"apparent radius: .*{word}"):
        law_of_radii(*spoiled(LOADS, apparent_radii()))


def test_a_modulus_of_elsewhere_is_not_needed():
    assert np.isnan(law_of_radii(LOADS, apparent_radii()).excess_m).all()


def test_few_radii_that_scatter_more_than_stated_tell_badly_by_how_much():
    """Two degrees of freedom: within three stated uncertainties lie 94 % of Student's."""
    P, off = np.geomspace(0.1, 1.4, 4), []
    hertz = np.cbrt(0.75 * 0.1288 * 0.75 * P / 3.43e6)
    for seed in range(3 * SEEDS):
        a = hertz + 277e-6 + 6e-5 * np.random.default_rng(seed).standard_normal(4)
        law = radius_law(P, a, 0.1288, 0.595e-6, 0.5, P_sd=1e-3, a_sd=2e-5).free
        off.append((law.extension - 277e-6) / law.extension_sd)
    assert np.mean(np.abs(off) < 1) > 0.62
    assert np.mean(np.abs(off) < 3) > 0.9
