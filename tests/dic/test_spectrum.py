"""What is read from the spectrum of an image, against images of known noise, grain and slope."""

from __future__ import annotations

import numpy as np
import pytest
from blobs import Speckle
from numpy.polynomial.polynomial import polyval

from analysis.dic.spectrum import BEYOND, gradient, interpolation, texture


@pytest.mark.parametrize("noise", [0.5, 2.0, 8.0])
def test_the_noise_and_the_contrast_are_told_apart(noise: float) -> None:
    grey = Speckle((300, 401)).grey(contrast=40, level=128) + noise * np.random.default_rng(
        1
    ).normal(size=(300, 401))
    found = texture(grey.astype(np.float32))
    assert found.noise == pytest.approx(noise, rel=0.1, abs=0.1)
    assert found.contrast == pytest.approx(40, rel=0.05)


@pytest.mark.parametrize("sigma", [0.9, 1.5, 2.5])
def test_the_grain_is_the_area_over_which_grey_levels_are_correlated(sigma: float) -> None:
    """White noise blurred by a Gaussian has the correlation exp(-r^2 / (4 sigma^2)), whose square
    integrates to 2 pi sigma^2.
    """
    image = Speckle((512, 512), grain=(sigma, sigma), density=0.5 / sigma**2).grey()
    assert texture(image.astype(np.float32)).grain_px2 == pytest.approx(
        2 * np.pi * (sigma**2 + 1 / 12), rel=0.2
    )


def test_interpolation_reads_whole_pixels_as_they_are_and_adds_up_to_one() -> None:
    matched = interpolation(texture(Speckle((300, 400)).image().astype(np.float32)).power_x)
    for t, place in ((0.0, 3), (1.0, 4)):
        np.testing.assert_allclose(polyval(t, matched.T), np.eye(8)[place], atol=2e-4)
    for t in np.linspace(-BEYOND, 1 + BEYOND, 7):
        assert polyval(t, matched.T).sum() == pytest.approx(1, abs=1e-9)


@pytest.mark.parametrize("t", [0.25, 0.5, 1.2])
def test_interpolation_errs_less_than_the_classical_ones_on_its_texture(t: float) -> None:
    speckle = Speckle((240, 320))
    image, truth = speckle.grey(), speckle.grey(-t)

    def error(weights, first):
        shifted = sum(w * np.roll(image, -(first + k), axis=1) for k, w in enumerate(weights))
        return float(np.std((shifted - truth)[:, 10:-10]))

    weights = interpolation(texture(image.astype(np.float32)).power_x)
    matched = error(polyval(t, weights.T), -3)
    whole, part = int(np.floor(t)), t - np.floor(t)
    sinc = np.sinc(part - np.arange(-3, 5)) * np.cos(np.pi / 9 * (part - np.arange(-3, 5)))
    assert matched < 0.6
    assert matched < error(sinc / sinc.sum(), -3 + whole)


def test_the_gradient_is_that_of_the_texture() -> None:
    speckle = Speckle((240, 320))
    image, step = speckle.grey(), 0.01
    exact = (speckle.grey(-step) - speckle.grey(step)) / (2 * step)
    grain = texture(image.astype(np.float32))
    found = sum(
        w * np.roll(image, 4 - k, axis=1)
        for k, w in enumerate(gradient(grain.power_x, grain.noise_share))
    )
    inside = np.s_[:, 10:-10]
    assert np.std((found - exact)[inside]) < 0.06 * np.std(exact[inside])
    assert np.mean((found * exact)[inside]) == pytest.approx(np.mean((found**2)[inside]), rel=0.01)


def test_an_image_without_texture_has_no_contrast() -> None:
    found = texture(np.full((60, 70), 7, np.float32))
    assert found.noise == found.contrast == 0
    assert np.isfinite([*found.power_x, *found.power_y, found.grain_px2]).all()


def test_a_bright_picture_has_the_grains_of_a_dim_one() -> None:
    """Squares of its power were infinite, and its grain counted as a pixel."""
    image = Speckle((96, 120)).grey().astype(np.float32)
    dim, bright = texture(image), texture(image * np.float32(2.0**32))
    assert bright.grain_px2 == pytest.approx(dim.grain_px2, rel=1e-6)
