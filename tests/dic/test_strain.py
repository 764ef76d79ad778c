"""Gradient and strain of a field: exact polynomials, an independent fit point by point, and the
stated uncertainty against noise.
"""

from __future__ import annotations

import numpy as np
import pytest

from analysis.dic.strain import strain
from analysis.grid import Grid

GRID = Grid.cover((240, 320), 20, 10)
X, Y = np.meshgrid(GRID.x_px, GRID.y_px)
BOX, STEP = 20, 10


def holes(share, seed):
    """True at points to be lost."""
    return np.random.default_rng(seed).random(GRID.shape) < share


def noise(rng):
    """Errors of unit variance as boxes make them: the mean of white pixel noise over each box."""
    sums = np.pad(rng.normal(size=(240, 320)), ((1, 0), (1, 0))).cumsum(0).cumsum(1)
    rows, columns = GRID.top[:, None], GRID.left
    return (
        sums[rows + BOX, columns + BOX]
        - sums[rows, columns + BOX]
        - sums[rows + BOX, columns]
        + sums[rows, columns]
    ) / BOX


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("lost", [0.0, 0.2])
def test_polynomials_of_its_order_are_exact(order, lost):
    x, y = X - 160, Y - 120
    ux = 0.7 + 3e-3 * x - 2e-3 * y + (order - 1) * (4e-6 * x**2 - 7e-6 * x * y + 2e-6 * y**2)
    uy = -0.2 + 1e-3 * x + 5e-3 * y - (order - 1) * 3e-6 * x * y
    ux[holes(lost, 1)] = np.nan
    result = strain(GRID, ux, uy, window=7, order=order)
    known = np.isfinite(result.exx)
    assert known.mean() > (0.7 if lost else 0.999)
    np.testing.assert_allclose(
        result.exx[known], (3e-3 + (order - 1) * (8e-6 * x - 7e-6 * y))[known], rtol=0, atol=1e-12
    )
    np.testing.assert_allclose(
        result.eyy[known], (5e-3 - (order - 1) * 3e-6 * x)[known], rtol=0, atol=1e-12
    )
    shear = (-2e-3 + 1e-3 + (order - 1) * (4e-6 * y - 7e-6 * x - 3e-6 * y)) / 2
    np.testing.assert_allclose(result.exy[known], shear[known], rtol=0, atol=1e-12)


@pytest.mark.parametrize(("order", "window"), [(1, 5), (2, 7)])
@pytest.mark.parametrize("stated", [True, False])
def test_each_point_agrees_with_a_fit_of_its_own(order, window, stated):
    rng = np.random.default_rng(2)
    u = rng.normal(size=(2, *GRID.shape))
    std = rng.uniform(0.5, 2, size=(2, *GRID.shape))
    u[0, holes(0.15, 3)] = np.nan
    u[1, holes(0.15, 4)] = np.nan
    known = np.isfinite(u).all(0)
    result = strain(
        GRID,
        *u,
        window=window,
        order=order,
        **({"ux_std_px": std[0], "uy_std_px": std[1]} if stated else {}),
    )
    checked = 0
    for i, j in rng.integers((0, 0), GRID.shape, (60, 2)):
        near = (
            known
            & (abs(X - X[i, j]) <= window // 2 * STEP)
            & (abs(Y - Y[i, j]) <= window // 2 * STEP)
        )
        x, y = X[near] - X[i, j], Y[near] - Y[i, j]
        design = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y][: 3 * order], 1)
        if not known[i, j] or len(x) < 2 * design.shape[1]:
            assert np.isnan(result.exx[i, j])
            continue
        checked += 1
        shared = np.maximum(0, 1 - abs(x - x[:, None]) / BOX) * np.maximum(
            0, 1 - abs(y - y[:, None]) / BOX
        )
        estimator = np.linalg.pinv(design)
        for k, (names, displacement) in enumerate(
            [(("dux_dx", "dux_dy"), u[0]), (("duy_dx", "duy_dy"), u[1])]
        ):
            fit, *_ = np.linalg.lstsq(design, displacement[near], rcond=None)
            if stated:
                errors = np.outer(std[k][near], std[k][near]) * shared
            else:
                rest = np.eye(len(x)) - design @ estimator
                errors = shared * np.sum((rest @ displacement[near]) ** 2) / np.trace(rest @ shared)
            spread = np.sqrt(np.diag(estimator @ errors @ estimator.T))
            for n, name in enumerate(names, 1):
                assert getattr(result, name)[i, j] == pytest.approx(fit[n], rel=1e-9, abs=1e-12)
                assert getattr(result, f"{name}_std")[i, j] == pytest.approx(spread[n], rel=1e-9)
    assert checked > 30


def test_uncertainty_is_that_of_correlated_noise():
    rng = np.random.default_rng(5)
    lost = holes(0.1, 6)
    std = 0.01 * (1 + X / 320)
    square, stated, estimated = {}, {}, {}
    for _ in range(80):
        ux, uy = np.where(lost, np.nan, std * noise(rng)), np.where(lost, np.nan, std * noise(rng))
        known = strain(GRID, ux, uy, window=5, ux_std_px=std, uy_std_px=std)
        guessed = strain(GRID, ux, uy, window=5)
        for name in ("exx", "eyy", "exy"):
            square.setdefault(name, []).append(getattr(known, name) ** 2)
            stated[name] = getattr(known, f"{name}_std") ** 2
            estimated.setdefault(name, []).append(getattr(guessed, f"{name}_std") ** 2)
    for name, values in square.items():
        variance = np.mean(values, 0)
        assert np.nanmean(variance / stated[name]) == pytest.approx(1, abs=0.1)
        assert np.nanmean(np.mean(estimated[name], 0) / stated[name]) == pytest.approx(1, abs=0.1)


def test_independent_points_have_less_uncertain_gradients():
    """Sum of squares over a 5 x 5 window: variance 1 / (50 step^2) in closed form."""
    one = np.ones(GRID.shape)
    result = strain(GRID, X, Y, window=5, ux_std_px=one, uy_std_px=one, correlation_px=0)
    assert result.exx_std[10, 10] == pytest.approx(1 / np.sqrt(50) / STEP)
    assert (
        strain(GRID, X, Y, window=5, ux_std_px=one, uy_std_px=one).exx_std[10, 10]
        > 1.5 * result.exx_std[10, 10]
    )


def test_points_that_do_not_determine_a_fit_are_nan():
    ux = np.full(GRID.shape, np.nan)
    ux[10] = 1.0  # one line of points, more than enough of them
    ux[3, 3] = 1.0
    assert np.isnan(strain(GRID, ux, ux, window=11).exx).all()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"window": 4}, "window of 4 points"),
        ({"window": 3, "order": 2}, "order 2, a window of 3"),
        ({"order": 3}, "order 3"),
        ({"correlation_px": -1}, "correlation of -1 px"),
        ({"ux_std_px": X}, "only one component"),
        ({"ux_std_px": X, "uy_std_px": X[1:]}, "the grid has"),
    ],
)
def test_what_can_not_be_used_is_said(options, message):
    with pytest.raises(ValueError, match=message):
        strain(GRID, X, Y, **options)
