"""The peak after a hold and the law of ageing, from made-up slides whose truth is known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from analysis.friction.ageing import MIN_FRAMES, fit_ageing, slide_friction


def slide(height: float, rng: np.random.Generator, noise: float) -> np.ndarray:
    """Q/P of a slide at mu_d = 0.7 after a hold, every 0.08 of the length of decay."""
    s = np.arange(0.0, 9.0, 0.08)
    rise = -np.expm1(-s / 0.4) * np.exp(-s)
    return 0.7 + height * rise / rise.max() + rng.normal(0, noise, len(s))


def test_the_peak_and_the_friction_after_it() -> None:
    rng, height, noise = np.random.default_rng(3), 0.05, 1e-3
    found = [slide_friction(slide(height, rng, noise)) for _ in range(400)]
    peaks = np.array([one.peak for one in found])
    # the top of noisy parabolas is half a standard deviation too high
    assert np.mean(peaks) - 0.75 == pytest.approx(0.0, abs=0.7 * found[0].peak_sd)
    assert np.std(peaks) == pytest.approx(np.mean([one.peak_sd for one in found]), rel=0.3)
    friction = np.array([one.mu_d for one in found])
    assert friction.mean() == pytest.approx(0.7, abs=1e-3)
    assert np.std(friction) == pytest.approx(np.mean([one.mu_d_sd for one in found]), rel=0.2)


def test_a_slide_that_still_rises_has_no_friction_and_a_short_one_nothing() -> None:
    rising = slide_friction(np.linspace(0, 0.7, 60))
    assert math.isnan(rising.mu_d)
    # a parabola through seven frames ends three before the last
    assert rising.peak == pytest.approx(0.7 * 56 / 59)
    assert math.isnan(slide_friction(np.full(MIN_FRAMES - 1, 0.7)).peak)
    assert math.isnan(slide_friction(np.full(50, np.nan)).peak)


@pytest.mark.parametrize(("rate", "time"), [(0.011, 1.0), (0.02, 0.1)])
def test_the_law_of_ageing_with_its_uncertainty(rate: float, time: float) -> None:
    rng, hold = np.random.default_rng(5), np.array([0.3, 1.0, 3.0, 10.0, 30.0, 100.0])
    sd = np.full(len(hold), 6e-4)
    off, factor = [], []
    for _ in range(300):
        rise = rate * np.log1p(hold / time) + rng.normal(0, sd)
        found = fit_ageing(hold, rise, sd)
        assert found.notes == ()
        off.append((found.rate - rate) / found.rate_sd)
        factor.append(math.log(found.time / time) * found.time / found.time_sd)
    assert abs(np.mean(off)) < 0.25
    assert 0.7 < np.std(off) < 1.2
    assert 0.7 < np.std(factor) < 1.25
    exact = fit_ageing(hold, rate * np.log1p(hold / time), sd)
    assert (exact.rate, exact.time) == pytest.approx((rate, time), rel=1e-4)


def test_what_the_holds_do_not_tell_is_said() -> None:
    for hold in ([1.0, 10.0], [2.0, 2.0, 2.0], []):
        found = fit_ageing(hold, [0.01] * len(hold), [1e-3] * len(hold))
        assert math.isnan(found.rate)
        assert "3 or more after holds of different length" in found.notes[0]
    proportional = fit_ageing([0.1, 0.2, 0.3], [0.001, 0.002, 0.003], [1e-5] * 3)
    assert math.isnan(proportional.rate)
    assert "do not determine t0" in proportional.notes[0]
