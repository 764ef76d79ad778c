"""What is measured of a live picture, against slow and obvious ways."""

import cv2
import numpy as np
import pytest

from app.acquisition.picture import RED, focus, picture_of


@pytest.fixture
def speckle():
    noise = np.random.default_rng(4).standard_normal((240, 330))
    smooth = cv2.GaussianBlur(noise, (0, 0), 1.5)
    return np.clip(110 + 40 * smooth / smooth.std(), 0, 250).astype(np.uint8)


def test_focus_is_the_variance_of_the_laplacian_over_the_square_of_the_mean(speckle):
    padded = np.pad(speckle.astype(float), 1, mode="reflect")
    laplacian = (
        padded[:-2, 1:-1] + padded[2:, 1:-1] + padded[1:-1, :-2] + padded[1:-1, 2:]
    ) - 4 * padded[1:-1, 1:-1]
    slow = 1e3 * laplacian.var() / speckle.mean() ** 2
    assert focus(speckle) == pytest.approx(slow, rel=1e-4)


def test_focus_falls_out_of_focus_and_knows_no_exposure(speckle):
    blurred = [cv2.GaussianBlur(speckle, (0, 0), width) for width in (0.7, 1.2, 2.0)]
    values = [focus(image) for image in (speckle, *blurred)]
    assert values == sorted(values, reverse=True)
    assert values[1] < 0.7 * values[0]
    assert focus((speckle // 2 * 2).astype(np.uint16) * 8) == pytest.approx(
        focus(speckle // 2 * 2), rel=1e-6
    )
    assert np.isnan(focus(np.zeros((8, 8), np.uint8)))


@pytest.mark.parametrize(("full", "kind"), [(255, np.uint8), (4095, np.uint16)])
def test_the_histogram_counts_every_pixel(full, kind):
    image = np.random.default_rng(0).integers(0, full + 1, (90, 120)).astype(kind)
    shown = picture_of(7, image, full, lost=2)
    slow, _ = np.histogram(image, bins=64, range=(0, full + 1))
    assert shown.histogram * image.size == pytest.approx(slow)
    assert shown.saturated == np.mean(image == full)
    assert shown.dark == np.mean(image == 0)
    assert shown.mean == pytest.approx(image.mean() / full)
    assert (shown.number, shown.lost) == (7, 2)


def test_one_saturated_pixel_is_red_in_a_thinned_picture(speckle):
    large = cv2.resize(np.minimum(speckle, 200), (1650, 1200))
    large[700, 1000] = 255
    shown = picture_of(0, large, 255)
    is_red = (shown.rgb == RED).all(axis=2)
    assert shown.rgb.shape[1] == 640
    assert 1 <= is_red.sum() <= 4  # those that it touches
    row, column = np.argwhere(is_red)[0]
    assert (row, column) == pytest.approx((700 / 1200 * 465, 1000 / 1650 * 640), abs=1)
    grey = shown.rgb[~is_red].astype(float)
    assert (grey[:, 0] == grey[:, 1]).all()
    assert grey.mean() == pytest.approx(large.mean(), abs=1)


def test_grey_levels_are_not_stretched():
    dark = np.full((60, 80), 30, np.uint8)
    dark[::2] = 40
    assert picture_of(0, dark, 255).rgb.max() == 40
