"""What is predicted for somebody's pictures is what a correlation of truly displaced pictures of
that texture scatters by; the pictures come from elsewhere than the prediction.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest
from tradeoff.grains import Speckle

from analysis.dic import Correlation, open_tracker
from app.tradeoff import correlation_study as correlation
from app.tradeoff.exact_speckle import AT_REST, ExactMotion, Pattern, noise_bound
from app.tradeoff.texture import texture_of

SHAPE = (480, 640)
SMALL = (320, 480)  # of grains that are drawn one by one
SHIFTS = (0.25, 0.5, 0.75)
BOX = 24


class Optics:
    """Band-limited speckle, as of coherent light: flat up to a cut-off, nothing beyond, periodic,
    so that a phase ramp moves it exactly.
    """

    def __init__(self, cutoff: float, aspect: float = 1.0) -> None:
        rng = np.random.default_rng(11)
        self._f = np.fft.rfftfreq(SHAPE[1])
        passes = np.hypot(np.fft.fftfreq(SHAPE[0])[:, None] * aspect, self._f) < cutoff
        self._spectrum = np.fft.rfft2(rng.normal(size=SHAPE)) * passes
        self._spectrum[0, 0] = 0

    def image(self, ux: float = 0.0, noise: float = 3.0, seed: int = 0) -> np.ndarray:
        moved = np.fft.irfft2(self._spectrum * np.exp(-2j * np.pi * self._f * ux), SHAPE)
        still = np.fft.irfft2(self._spectrum, SHAPE)
        grey = 120 + 28 * moved / still.std()
        grey += noise * np.random.default_rng(seed).normal(size=SHAPE)
        return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


@cache
def coarse_grey(ux: float) -> np.ndarray:
    made = Speckle(SMALL, seed=3, grain=(1.2, 2.5), density=0.05)
    return made.grey(ux, contrast=30, level=60)


def coarse(ux: float = 0.0, noise: float = 3.0, seed: int = 0) -> np.ndarray:
    grey = coarse_grey(ux) + noise * np.random.default_rng(seed).normal(size=SMALL)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def measured_sigma(picture, noise: float) -> float:
    errors = []
    for n, ux in enumerate(SHIFTS):
        tracker = open_tracker(Correlation(box=BOX), picture(0.0, noise, n))
        u = tracker.track(picture(ux, noise, 10 + n)).ux_px[2:-2, 2:-2]
        errors.append(float(np.var(u)))
        tracker.close()
    return float(np.sqrt(np.mean(errors)))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("picture", "noise"),
    [
        (coarse, 3.0),
        (coarse, 6.0),
        (Optics(0.16).image, 3.0),
        (Optics(0.12, aspect=0.6).image, 4.0),
    ],
)
def test_the_predicted_scatter_is_that_of_truly_displaced_pictures(picture, noise: float) -> None:
    reference, *rest = (picture(0.0, noise, 20 + k) for k in range(3))
    texture = texture_of(reference, rest)
    assert texture.noise == pytest.approx(noise, rel=0.02)
    shape = reference.shape
    bench = correlation.VariantTimer(texture, shape, correlation.Scale(shape, 4), threads=2)
    tracking = correlation.Tracking({"method": "shared", "box": BOX}, 2, texture.end)
    _, predicted, lost = bench.errors(tracking, BOX)
    assert lost == 0
    assert predicted == pytest.approx(measured_sigma(picture, noise), rel=0.1)


def test_noise_that_grows_with_the_grey_level_is_seen() -> None:
    rng = np.random.default_rng(5)
    grey = Speckle(SMALL, seed=2).grey(contrast=40, level=30)

    def picture():
        noise = np.sqrt(1.5 + 0.06 * grey) * rng.normal(size=SMALL)
        return np.clip(np.rint(grey + noise), 0, 255).astype(np.uint8)

    texture = texture_of(picture(), [picture() for _ in range(4)])
    at = np.array([40.0, 160.0])
    assert texture.variance(at) == pytest.approx(1.5 + 0.06 * at + 1 / 12, rel=0.06)
    assert abs(texture.neighbours) < 0.02


def test_a_small_shift_and_other_light_between_pictures_at_rest_are_no_noise() -> None:
    speckle = Speckle(SMALL, seed=2)
    first = speckle.image(noise=2, seed=1)
    rng = np.random.default_rng(7)
    grey = 1.04 * speckle.grey(0.02, -0.01) + 3 + 2 * rng.normal(size=SMALL)
    second = np.clip(np.rint(grey), 0, 255).astype(np.uint8)
    assert texture_of(first, [second]).noise == pytest.approx(2, rel=0.08)


def test_noise_of_neighbours_that_is_correlated_is_told() -> None:
    grey, rng = Speckle(SMALL, seed=2).grey(), np.random.default_rng(8)

    def picture():
        white = rng.normal(size=(SMALL[0], SMALL[1] + 1))
        noise = 3 * (white[:, 1:] + white[:, :-1]) / np.sqrt(2)
        return np.clip(np.rint(grey + noise), 0, 255).astype(np.uint8)

    assert texture_of(picture(), [picture()]).neighbours == pytest.approx(0.5, abs=0.05)


def test_grains_that_are_longer_along_one_axis_stay_so() -> None:
    texture = texture_of(Optics(0.16, aspect=0.5).image())
    slopes = []
    for dx, dy in ((0.01, 0.0), (0.0, 0.01)):
        made = texture.pattern(SHAPE)
        change = made.grey(ExactMotion.uniform(dx), dy) - made.grey(ExactMotion.uniform(-dx), -dy)
        slopes.append(float(np.mean((change / 0.02) ** 2)))
    # the mean square slopes of a flat disc of half the height: as 1 to 1/aspect^2 along y
    assert slopes[1] / slopes[0] == pytest.approx(4.0, rel=0.15)


@pytest.mark.parametrize("dtype", ["uint16", "float32"])
def test_other_pixels_give_the_same_texture(dtype: str) -> None:
    plain = texture_of(coarse())
    other = texture_of((16 * coarse().astype(dtype)).astype(dtype), full_scale=4095)
    assert other.contrast == pytest.approx(16 * plain.contrast, rel=0.01)
    assert other.dtype == dtype
    made = other.picture(other.pattern((64, 64)).grey(AT_REST), np.random.default_rng(0))
    assert made.dtype == dtype


@pytest.mark.parametrize("flat", [np.full(SHAPE, 100.0), np.arange(SHAPE[1]) * np.ones(SHAPE) / 4])
def test_a_picture_without_grains_is_refused(flat) -> None:
    noisy = flat + 2 * np.random.default_rng(1).normal(size=SHAPE)
    with pytest.raises(ValueError, match="no speckle found"):
        texture_of(np.clip(np.rint(noisy), 0, 255).astype(np.uint8))


def test_the_floor_of_one_blob_is_that_of_its_closed_form() -> None:
    pattern = Pattern((64, 64))
    amplitude, variance, noise = 50.0, 9.0, 4.0
    pattern.x, pattern.y = np.array([31.5]), np.array([31.5])
    pattern.variance, pattern.peak = np.full((2, 1), variance), np.array([amplitude / 40.0])
    from analysis.grid import Grid

    grid = Grid.cover((64, 64), 50, 10)
    middle = noise_bound(grid, pattern.information(noise))[grid.shape[0] // 2, grid.shape[1] // 2]
    # the sum of the squared slopes of a Gaussian blob is pi A^2 / 2, whatever its width; the blur
    # of the pixels widens it by 1/12 and lowers it
    energy = np.pi * amplitude**2 / 2 * (variance / (variance + 1 / 12)) ** 2
    assert middle == pytest.approx(np.sqrt(2 * noise / energy), rel=0.002)
