"""Interpolants against their definitions, and the reading kernels against a loop over taps."""

import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from analysis.dic.interpolants import BETA, CLASSICAL, Interpolant
from analysis.dic.reading import (
    IMAGE_MARGIN,
    SLACK,
    lay_out,
    read_deformed,
    read_shifted,
    room,
    target_for,
)

RNG = np.random.default_rng(3)
IMAGE = RNG.uniform(0, 255, (40, 50))
# of a deformation, px at the box's edge
TERMS = np.array([[0.31, 0.02, -0.4, 0.3, -0.2, 0.1], [-0.27, 0.5, 0.03, 0.1, 0.2, -0.3]])


def slow_read(interpolant, image, x, y):
    """Values between the pixels: the definition of an `Interpolant`, one place after the other."""
    ready, taps = interpolant.prepare(image), interpolant.weights.shape[0]

    def weights(t):
        return [sum(c * t**p for p, c in enumerate(row)) for row in interpolant.weights]

    out = []
    for px, py in zip(np.ravel(x), np.ravel(y), strict=True):
        i, j = int(np.floor(py)), int(np.floor(px))
        rows = ready[i - taps // 2 + 1 : i + taps // 2 + 1, j - taps // 2 + 1 : j + taps // 2 + 1]
        out.append(weights(py - i) @ rows @ weights(px - j))
    return np.array(out)


def places(n=40):
    return RNG.uniform(6, 42, n), RNG.uniform(6, 32, n)


@pytest.mark.parametrize("name", CLASSICAL)
def test_a_constant_stays_and_pixels_are_met(name):
    interpolant = CLASSICAL[name]
    total = interpolant.weights.sum(axis=0)
    assert total == pytest.approx(np.eye(1, total.size)[0], abs=1e-12)
    x, y = np.arange(10, 20), np.arange(8, 18)
    assert slow_read(interpolant, IMAGE, x, y) == pytest.approx(
        IMAGE[y, x], abs=1e-2 if "sinc" in name else 1e-9
    )


@pytest.mark.parametrize(("name", "order"), [("bilinear", 1), ("bspline3", 3), ("bspline5", 5)])
def test_splines_are_those_of_scipy(name, order):
    x, y = places()
    expected = map_coordinates(IMAGE, [y, x], order=order, mode="mirror")
    assert slow_read(CLASSICAL[name], IMAGE, x, y) == pytest.approx(expected, abs=1e-9)


def keys(s):
    """Cubic convolution, Keys (1981), equation 15."""
    s = np.abs(s)
    return np.where(
        s < 1, 1.5 * s**3 - 2.5 * s**2 + 1, np.where(s < 2, -0.5 * s**3 + 2.5 * s**2 - 4 * s + 2, 0)
    )


def windowed_sinc(taps):
    return lambda s: np.sinc(s) * np.i0(BETA * np.sqrt(np.maximum(0, 1 - (2 * s / taps) ** 2)))


@pytest.mark.parametrize(
    ("name", "kernel", "error"),
    [
        ("bicubic", keys, 1e-14),
        ("sinc6", windowed_sinc(6), 1e-5),
        ("sinc8", windowed_sinc(8), 1e-5),
    ],
)
def test_weights_are_values_of_the_kernel(name, kernel, error):
    weights = CLASSICAL[name].weights
    taps, degree = weights.shape
    t = np.linspace(0, 1, 301)[:-1]
    values = kernel(t[:, None] - np.arange(taps) + taps // 2 - 1)
    assert np.vander(t, degree, increasing=True) @ weights.T == pytest.approx(
        values / values.sum(axis=1, keepdims=True), abs=error
    )


C1, C2, C3 = np.cos(np.pi / 5 * np.arange(1, 4))
KEPT = {
    "bilinear": C1,
    "bicubic": (9 * C1 - C3) / 8,
    "bspline3": (23 * C1 + C3) / (16 + 8 * C2),
    "sinc6": 1,
    "sinc8": 1,
}


@pytest.mark.parametrize(("name", "kept"), KEPT.items())
def test_of_a_wave_of_5_px_as_much_is_kept_half_way_between_its_pixels_as_theory_says(name, kept):
    wave = np.tile(np.cos(2 * np.pi * np.arange(60) / 5), (60, 1))
    x = np.arange(20.5, 40)
    read = slow_read(CLASSICAL[name], wave, x, np.full_like(x, 30))
    assert read == pytest.approx(
        kept * np.cos(2 * np.pi * x / 5), abs=1.3e-3 if "sinc" in name else 1e-7
    )


@pytest.mark.parametrize("degree", [3, 5])
def test_single_precision_has_the_same_coefficients(degree):
    interpolant = CLASSICAL[f"bspline{degree}"]
    single = interpolant.prepare(IMAGE.astype(np.float32))
    assert single.dtype == np.float32
    assert interpolant.prepare(IMAGE).dtype == np.float64
    assert single == pytest.approx(interpolant.prepare(IMAGE), abs=3e-3 if degree == 5 else 5e-4)


def prepared(interpolant, kind, box, order):
    target = target_for(IMAGE.shape, interpolant, kind)
    target.image[IMAGE_MARGIN:-IMAGE_MARGIN, IMAGE_MARGIN:-IMAGE_MARGIN] = interpolant.prepare(
        IMAGE.astype(kind)
    )
    layout = lay_out(target, box, order)
    layout = layout._replace(places=layout.places.astype(kind))
    return target, room(target, layout), layout, np.full(box * layout.pitch, np.nan, kind)


def compiled(f):
    return f


def plain(f):
    return f.py_func


@pytest.mark.parametrize("name", CLASSICAL)
@pytest.mark.parametrize(
    ("kind", "error", "jit"),
    [(np.float32, 2e-3, compiled), (np.float64, 1e-9, compiled), (np.float64, 1e-9, plain)],
)
def test_boxes_are_read_as_defined(name, kind, error, jit):
    box, top, left = (5, 12, 14) if jit is plain else (17, 10, 13)
    target, memory, layout, out = prepared(CLASSICAL[name], kind, box, 0)
    warp = np.zeros((2, 6), kind)
    warp[:, 0] = 0.3, 0.85
    assert jit(read_shifted)(target, memory, layout, warp, top, left, out)
    y, x = np.mgrid[top : top + box, left : left + box]
    expected = slow_read(CLASSICAL[name], IMAGE, x + 0.3, y + 0.85).reshape(box, box)
    assert out.reshape(box, -1)[:, :box] == pytest.approx(expected, abs=error)

    target, memory, layout, out = prepared(CLASSICAL[name], kind, box, 2)
    assert jit(read_deformed)(target, memory, layout, TERMS.astype(kind), top, left, out)
    s, t = ((a - a.mean()) / (box / 2) for a in (x, y))
    ux, uy = TERMS @ np.stack([np.ones_like(s), s, t, s * s, s * t, t * t]).reshape(6, -1)
    expected = slow_read(CLASSICAL[name], IMAGE, x.ravel() + ux, y.ravel() + uy).reshape(box, box)
    assert out.reshape(box, -1)[:, :box] == pytest.approx(expected, abs=5 * error)


@pytest.mark.parametrize("name", ["bilinear", "sinc8"])
@pytest.mark.parametrize("read", [read_shifted, read_deformed])
def test_a_box_is_outside_if_it_leaves_by_more_than_a_little(name, read):
    box, order = 9, 0 if read is read_shifted else 1
    target, memory, layout, out = prepared(CLASSICAL[name], np.float32, box, order)
    warp = np.full((2, 6), [0.5, 0, 0, 0, 0, 0], np.float32)

    def inside(top, left):
        return read(target, memory, layout, warp, top, left, out)

    bottom, right = (size - box + SLACK for size in IMAGE.shape)
    assert inside(-SLACK, -SLACK)
    assert inside(bottom - 1, right - 1)
    assert not any(
        inside(*corner)
        for corner in [(-SLACK - 1, 20), (20, -SLACK - 1), (bottom + 1, 20), (20, right + 1)]
    )


@pytest.mark.parametrize(
    ("weights", "spline", "said"),
    [
        ((3, 2), 0, "3 taps"),
        ((10, 2), 0, "10 taps"),
        ((4, 9), 0, "degree 8"),
        ((4, 4), 2, "spline of degree 2"),
    ],
)
def test_what_can_not_be_used_is_named(weights, spline, said):
    with pytest.raises(ValueError, match=said):
        Interpolant("odd", np.zeros(weights), spline)
