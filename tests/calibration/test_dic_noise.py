"""Sigma and bias of the correlation against the box, on exact pictures of a simulated block, and
the recommendation that follows.
"""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from seeds import SEEDS, holds

from analysis.calibration.dic_noise import (
    ErrorByBox,
    correlation_map,
    noise_by_box,
    noise_floor,
    recommended_box,
)
from analysis.settings import Correlation

SHAPE = 240, 320
BOXES = 10, 20, 40
SHIFTS = np.linspace(0, 13.3, 9)


def waves(rng, count=400):
    """A texture of plane waves that can be drawn at any place exactly."""
    k = rng.normal(0, 0.45, (2, count))
    return k, rng.uniform(0, 6.28, count)


def drawn(pattern, shift, order=0):
    """The texture displaced by (x, y), or its derivative along x: exact between pixels."""
    (kx, ky), phase = pattern
    ex = np.exp(1j * np.multiply.outer(np.arange(SHAPE[1]) - shift[0], kx)) * (1j * kx) ** order
    ey = np.exp(1j * (np.multiply.outer(np.arange(SHAPE[0]) - shift[1], ky) + phase))
    return 128 * (order == 0) + 25 * np.sqrt(2 / len(kx)) * (ey @ ex.T).real


def series(seed, noise, shifts=SHIFTS):
    rng = np.random.default_rng(seed)
    pattern = waves(rng)
    return [
        (drawn(pattern, (s, 0.01 * s)) + noise * rng.standard_normal(SHAPE)).astype(np.float32)
        for s in shifts
    ]


def test_sigma_is_at_the_floor_and_falls_with_the_box():
    found = noise_by_box(series(1, 2.0), np.arange(9), BOXES)
    slope = np.polyfit(np.log(found.box), np.log(found.sigma), 1)[0]
    assert -1.2 < slope < -0.85
    steep = drawn(waves(np.random.default_rng(1)), (0, 0), order=1) ** 2
    for floor, box in zip(found.floor, BOXES, strict=True):
        sums = steep.reshape(SHAPE[0] // box, box, -1, box).sum(axis=(1, 3))
        assert floor == pytest.approx(2 * np.sqrt(2 * np.mean(1 / sums)), rel=0.03)
    assert np.all(found.sigma > 0.9 * found.floor)
    assert found.sigma[1:] == pytest.approx(found.floor[1:], rel=0.25)
    assert found.shift == pytest.approx(np.linspace(0, 13.3, 9)[1:], abs=0.01)
    assert np.abs(found.bias).max() < 0.01


def test_the_papers_method_has_its_error_without_any_noise():
    images = series(2, 0.0)
    direct = noise_by_box(images, np.arange(9), (20,), Correlation(method="direct"))
    assert direct.floor[0] < 1e-3
    assert 0.005 < direct.sigma[0] < 0.05
    # the systematic error of a peak through nine places, as a function of the fraction of a pixel
    assert np.abs(direct.bias).max() < 0.02


def test_the_lens_is_left_out_of_sigma():
    from drivers.sim.optics import Lens

    lens, plain = Lens.of(0.01, SHAPE), series(3, 2.0)
    y, x = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(np.float64)
    import cv2

    place = [one.astype(np.float32) for one in lens.ideal(x, y)]
    seen = [cv2.remap(image, *place, cv2.INTER_LANCZOS4) for image in plain]
    inner = [image[20:-20, 20:-20] for image in seen]
    found = noise_by_box(inner, np.arange(9), (20,))
    before = noise_by_box([image[20:-20, 20:-20] for image in plain], np.arange(9), (20,))
    assert found.bend > 0.08
    assert before.bend < 0.02
    assert found.sigma[0] == pytest.approx(before.sigma[0], rel=0.25)


@pytest.mark.slow
def test_uncertainty_of_sigma_is_its_scatter():
    clean, rng = series(1, 0.0)[::2], np.random.default_rng(9)
    settings, found = Correlation(threads=1), []
    for _ in range(SEEDS // 2):
        noisy = [one + 3 * rng.standard_normal(SHAPE, dtype=np.float32) for one in clean]
        found.append(noise_by_box(noisy, np.arange(5), (20,), settings))
    sigma, sd = (np.array([getattr(one, n)[0] for one in found]) for n in ("sigma", "sigma_sd"))
    holds((sigma - sigma.mean()) / sd)


def test_what_is_no_steady_translation_is_refused():
    images, times = series(4, 2.0), np.arange(9)
    with pytest.raises(ValueError, match="3 pictures"):
        noise_by_box(images[:3], times[:3], BOXES)
    with pytest.raises(ValueError, match="has moved by"):
        noise_by_box(series(4, 2.0, np.linspace(0, 0.5, 9)), times, (20,))
    with pytest.raises(ValueError, match="from a steady motion"):
        noise_by_box(series(4, 2.0, 13 * np.linspace(0, 1, 9) ** 2), times, (20,))
    with pytest.raises(ValueError, match="boxes of 90 px"):
        noise_by_box(images, times, (90,))
    held = [image.copy() for image in images]
    for image in held[1:]:
        image[60:180, 80:240] = images[0][60:180, 80:240]  # a contact that sticks
    with pytest.raises(ValueError, match="let the block touch nothing"):
        noise_by_box(held, times, (20,))


def test_the_function_of_one_box_has_its_peak_where_it_went():
    reference, image = (drawn(waves(np.random.default_rng(5)), s) for s in ((0, 0), (3.3, -1.2)))
    found = correlation_map(reference, image, 100, 100)
    assert found.peak == pytest.approx((3.3, -1.2), abs=0.06)
    i, j = np.unravel_index(np.argmax(found.c), found.c.shape)
    assert (found.tau_x[j], found.tau_y[i]) == (3.0, -1.0)
    with pytest.raises(ValueError, match="leaves the picture"):
        correlation_map(reference, image, 5, 100)
    with pytest.raises(ValueError, match="no peak"):
        correlation_map(reference, image, 100, 100, search=2)


def test_a_box_that_is_accurate_and_small_enough():
    box = np.array([10.0, 20, 40, 80])
    zero = np.zeros(1)
    found = ErrorByBox(box, 0.66 / box, box, zero, box, zero, 0.0)
    assert recommended_box(found, 0.0264, 434) == 25
    assert recommended_box(found, 1.0, 434) == 10
    for wanted, diameter in ((0.0264, 240), (1e-4, 4000)):
        with pytest.raises(ValueError, match="ask for less"):
            recommended_box(found, wanted, diameter)


def test_floor_of_a_picture_without_noise_is_none():
    smooth = gaussian_filter(np.random.default_rng(0).uniform(0, 255, SHAPE), 2.5)
    assert noise_floor(smooth, 20) < 1e-3
