"""Strain by local least squares: exact for linear fields, damped and noisy as stated."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import analysis

X, Y = 1e-4 * np.arange(31), 3e-3 + 1.5e-4 * np.arange(24)


def test_a_linear_field_is_measured_exactly_at_the_rim_and_beside_holes() -> None:
    ux, uy = (a * X + b * Y[:, None] for a, b in ((2e-3, -1e-3), (4e-3, 5e-3)))
    ux[10:12, 5] = uy[3, 3] = np.nan
    found = analysis.strain(X, Y, ux, uy)
    for values, truth in zip(found, (2e-3, 5e-3, 1.5e-3), strict=True):
        assert_allclose(values[np.isfinite(values)], truth, rtol=1e-9)
    assert np.array_equal(np.isnan(found.xx), np.isnan(ux))
    assert np.array_equal(np.isnan(found.yy), np.isnan(uy))
    assert np.array_equal(np.isnan(found.xy), np.isnan(ux + uy))


@pytest.mark.parametrize("points", [3, 5, 9])
def test_a_wave_is_damped_as_slopes_over_a_window_are(points: int) -> None:
    k = 2 * np.pi / 12e-4
    ux = np.sin(k * X) * np.ones((len(Y), 1))
    offset = np.arange(points) - points // 2
    factor = (offset * np.sin(k * 1e-4 * offset)).sum() / (offset**2).sum() / (k * 1e-4)
    found = analysis.strain(X, Y, ux, 0 * ux, points).xx[8:-8, 8:-8]
    assert_allclose(
        found, (factor * k * np.cos(k * X) * np.ones((len(Y), 1)))[8:-8, 8:-8], atol=1e-9
    )
    assert 0.5 < factor < 0.96


def test_the_noise_is_what_the_docstring_says() -> None:
    noise = 1e-8 * np.random.default_rng(3).standard_normal((24, 31))
    for points in (5, 9):
        found = analysis.strain(X, Y, noise, 0 * noise, points).xx[5:-5, 5:-5]
        stated = 1e-8 * np.sqrt(12) / (1e-4 * points**2)
        assert np.std(found) == pytest.approx(stated, rel=0.2)


def test_too_little_gives_nothing() -> None:
    ux = np.full((24, 31), np.nan)
    ux[:, 8] = 1.0  # a line: no slope along x
    assert np.isnan(analysis.strain(X, Y, ux, ux).xx).all()
    with pytest.raises(ValueError, match="a window of 4 points; give an odd number"):
        analysis.strain(X, Y, ux, ux, 4)
    for x in (X**2, 0 * X):
        with pytest.raises(ValueError, match="not evenly spaced, or not apart; interpolate them"):
            analysis.strain(x, Y, ux, ux)
    with pytest.raises(ValueError, match=r"fields of shapes \(24, 31\)"):
        analysis.strain(X[:-1], Y, ux, ux)
