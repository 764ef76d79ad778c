"""Passes with a quadratic displacement within each box: against the iteration of each box by
itself, against exact pictures, and what a box sees of the prediction against a fit by hand.
"""

from __future__ import annotations

import numpy as np
import pytest
from regression import by_spline, slow_newton
from trackers import tracker_at_rest

from analysis.dic import Correlation, Grid
from analysis.dic.quadratic import SeenByBox
from analysis.dic.smoothing import cubic
from analysis.dic.spectrum import slopes, texture
from app.tradeoff.exact_speckle import Wave
from benchmarks.speckle import ExactMotion, Pattern, camera

SIZE = (360, 480)
PATTERN = Pattern(SIZE, 3)
RNG = np.random.default_rng(4)
REFERENCE = camera(PATTERN.grey(ExactMotion.uniform(0.0)), 1, RNG)


def follow(images, **options):
    """The field of the last of the pictures, each of which starts from the one before."""
    tracker = tracker_at_rest(REFERENCE, **options)
    for image in images:
        field = tracker.track(image)
    tracker.close()
    return tracker.grid, field


def contact(drive: float) -> ExactMotion:
    return ExactMotion(0.0, drive, 30.0, 150.0, (240.0, 180.0))


@pytest.mark.slow
@pytest.mark.parametrize(("box", "step"), [(50, 10), (38, 10), (25, 8)])
def test_the_same_as_each_box_by_itself(box: int, step: int) -> None:
    images = [camera(PATTERN.grey(contact(drive)), 1, RNG) for drive in (0.5, 1.0)]
    grid, shared = follow(images, order=2, box=box, step=step)
    reference, image = REFERENCE.astype(np.float64), images[-1].astype(np.float64)
    gradients, usable = slopes(reference, texture(REFERENCE.astype(np.float32))), image >= 0
    ny, nx = grid.shape
    some = [(i, j) for i in range(3, ny - 3, 6) for j in range(3, nx - 3, 8)]
    read = by_spline(image)
    boxes = [slow_newton(reference, read, gradients, grid, *at, 2, usable) for at in some]
    ux, zncc, std = (np.array(v) for v in zip(*((p[0], z, s[0]) for p, z, s in boxes), strict=True))
    at = tuple(np.transpose(some))
    apart = (shared.ux_px[at] - ux) / std
    assert np.isfinite(apart).all()
    assert np.sqrt(np.mean(apart**2)) < 0.35
    np.testing.assert_allclose(shared.ux_std_px[at], std, rtol=0.15)
    assert np.median(shared.ux_std_px[at] / std) == pytest.approx(1, abs=0.01)
    np.testing.assert_allclose(shared.zncc[at], zncc, atol=0.003)


def test_curvature_in_a_box_is_followed_where_a_mean_flattens_it() -> None:
    wave = Wave(90.0)
    image = camera(PATTERN.grey(wave), 1, RNG)
    passed = {}
    for order in (1, 2):
        grid, field = follow([image], box=40, order=order)
        x, y = np.meshgrid(grid.x_px, grid.y_px)
        inside = (np.abs(x - 240) < 160) & (np.abs(y - 180) < 100)
        true = wave(x[inside], y[inside])[0]
        passed[order] = np.polyfit(true, field.ux_px[inside], 1)[0]
    assert passed[2] > 0.97
    assert passed[1] < 0.85


@pytest.mark.parametrize(("box", "step"), [(50, 10), (21, 10), (16, 30), (9, 4)])
def test_what_a_box_sees_of_a_prediction_is_its_least_squares_quadratic(
    box: int, step: int
) -> None:
    grid, pad = Grid.cover((200, 260), box, step), 12
    ny, nx = grid.shape
    control = np.random.default_rng(1).normal(size=(ny + 2 * pad, nx + 2 * pad)).astype(np.float32)
    seen = np.empty(grid.shape)
    SeenByBox(grid, pad).of(control, seen)
    offsets = np.arange(box) - (box - 1) / 2
    y, x = (axis.ravel() for axis in np.meshgrid(offsets, offsets, indexing="ij"))
    terms = np.stack([x**0, x, y, x * x, x * y, y * y], axis=1)
    for i, j in ((0, 0), (ny // 2, nx // 3), (ny - 1, nx - 1)):
        rows = cubic(offsets[:, None] / step - (np.arange(ny + 2 * pad) - pad - i) + 2)[0]
        columns = cubic(offsets[:, None] / step - (np.arange(nx + 2 * pad) - pad - j) + 2)[0]
        values = rows @ control @ columns.T
        fitted = np.linalg.lstsq(terms, values.ravel(), rcond=None)[0]
        assert seen[i, j] == pytest.approx(fitted[0], abs=1e-6)


def test_a_box_whose_quadratic_can_not_be_solved_for_is_no_measurement() -> None:
    """A box of which only a corner has texture tells a shift, but no curvature."""
    image = REFERENCE.copy()
    image[100:200, 100:200] = 20
    image[100:104, 100:104] = 220
    tracker = tracker_at_rest(image, order=2, box=30, step=10)
    field = tracker.track(image)
    ok = field.status == 0
    assert np.abs(field.ux_px[ok]).max() < 0.05
    flat = (np.abs(tracker.grid.x_px - 150) < 34) & (np.abs(tracker.grid.y_px - 150) < 34)[:, None]
    assert not ok[flat].any()


@pytest.mark.slow
def test_the_noise_is_that_of_a_smaller_box() -> None:
    """Its variance, and what neighbours share of it, as inversions expect it."""
    ratios, sums, grey = [], [], PATTERN.grey(ExactMotion.uniform(0.4))
    for seed in range(6):
        still = camera(grey, 4, np.random.default_rng(seed))
        fields = {order: follow([still], order=order, box=40, step=8)[1] for order in (1, 2)}
        mean, middle = (fields[k].ux_px[4:-4, 4:-4].astype(float) - 0.4 for k in (1, 2))
        ratios.append(middle.var() / mean.var())
        blocks = middle[:24, :40].reshape(3, 8, 5, 8).mean(axis=(1, 3))
        sums.append(blocks.var() / middle.var())
    small = Correlation(order=2, box=40).noise_box_px
    assert small == pytest.approx(40 / np.sqrt(3.5))
    # of a plain mean, whose noise is amplified a little by the passes
    assert 3.0 < np.mean(ratios) < 3.7
    # a block of 64 px holds so many independent boxes
    assert np.mean(sums) == pytest.approx((small / 64) ** 2, rel=0.45)
