"""Gain, read noise and full well of cameras of which they are known, from pairs of pictures."""

import math

import numpy as np
import pytest
from blobs import Speckle
from hidden_benches import LIGHTS, SCENE, Sensor, photons, transferred
from seeds import SEEDS, holds, pulls, seen_by

from analysis.calibration.photon_transfer import (
    NoiseLevels,
    best_exposure,
    noise_levels,
    photon_transfer,
)


@pytest.mark.slow
def test_the_truth_is_within_the_stated_uncertainty():
    for one in seen_by(photons, SEEDS // 2).values():
        holds(pulls(one))


def test_a_flat_field_of_twelve_bits_tells_the_same():
    sensor = Sensor(1, 0.4, 3.0, 60.0, 4095)
    found = transferred(sensor, scene=np.full((200, 200), 0.9))
    assert found.gain == pytest.approx(0.4, rel=0.02)
    assert found.read_noise == pytest.approx(3.0, abs=3 * found.read_noise_sd + 0.1)
    assert found.largest_snr == pytest.approx(math.sqrt(found.full_well), rel=0.01)
    assert found.noise(2000.0) == pytest.approx(math.sqrt(0.4 * 1940 + 9), rel=0.02)


def test_a_pixel_is_not_called_bright_by_its_own_noise():
    sensor = Sensor(9, read=4.0)
    found = noise_levels(*(sensor.picture(0.5, np.ones((200, 200))) for _ in range(2)), 255)
    assert len(found.level) == 40
    assert np.ptp(found.level) < 1.5  # with a noise of 4 grey levels
    assert np.average(found.variance, weights=found.count) == pytest.approx(
        4**2 + 0.0127 * 123.5 + 1 / 12, rel=0.03
    )


def test_pixels_that_are_full_below_the_end_of_the_scale():
    def full(image, _):
        return np.minimum(image, 180)

    found = transferred(Sensor(2), scene=0.9 + 0.1 * SCENE, change=full)
    assert found.gain == pytest.approx(0.0127, rel=0.05)
    assert 150 < found.dark + found.full_well * found.gain <= 181


def test_a_flicker_and_a_motion_that_are_small_do_not_matter():
    sensor, other = Sensor(4), Speckle((160, 200), seed=2)
    moved = other.grey(0.04, 0, contrast=0.18, level=0.02)
    moved *= 1.01 / moved.max()
    levels = [noise_levels(sensor.picture(a), sensor.picture(a, moved), 255) for a in LIGHTS]
    bins = (
        np.concatenate([getattr(one, v) for one in levels]) for v in ("level", "variance", "count")
    )
    found = photon_transfer(NoiseLevels(*bins), 255, dark=8.0)
    assert found.gain == pytest.approx(0.0127, rel=0.08)


@pytest.mark.parametrize(
    ("spoil", "says"),
    [
        (lambda image, n: image + 20 * n, "the light of a pair changed"),
        (lambda image, n: np.roll(image, n, axis=1), "moved by .* px between the two"),
        (lambda image, n: np.full_like(image, 255), "0 grey levels are not saturated"),
        (lambda image, n: (255 * (image / 255) ** 0.45).astype(int), "no straight line|no shot"),
        (lambda image, n: np.rint(SCENE * 200) + n * 0, "no shot noise"),
    ],
)
def test_a_camera_that_cannot_be_judged_is_refused(spoil, says):
    with pytest.raises(ValueError, match=says):
        transferred(Sensor(5), change=spoil)


def test_exposures_that_are_too_close_are_refused():
    with pytest.raises(ValueError, match="take more exposures"):
        transferred(Sensor(6), (0.5, 0.55), 0.9 + 0.05 * SCENE)


def test_the_best_exposure_saturates_as_few_pixels_as_asked():
    sensor = Sensor(8)
    camera = transferred(sensor)
    found = best_exposure(sensor.picture(0.3), 0.004, camera, 255, most_saturated=2e-3)
    longer = sensor.picture(0.3 * found.exposure_s / 0.004)
    assert (longer >= 255).mean() == pytest.approx(2e-3, abs=1e-3)
    assert found.mean_level == pytest.approx(longer.mean(), rel=0.01)
    assert found.contrast == pytest.approx(longer.std(), rel=0.02)
    assert found.noise == pytest.approx(
        math.sqrt(0.0127 * (found.mean_level - 8) + 1.2**2 + 1 / 12), rel=0.05
    )
    short = best_exposure(sensor.picture(0.3), 0.004, camera, 255, longest_s=0.005)
    assert short.exposure_s == pytest.approx(0.005)
    with pytest.raises(ValueError, match="pixels are saturated"):
        best_exposure(sensor.picture(3.0), 0.004, camera, 255)
    with pytest.raises(ValueError, match="as large as the noise"):
        best_exposure(sensor.picture(0.0), 0.004, camera, 255)
