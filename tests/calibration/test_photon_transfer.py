"""Gain, read noise and full well of cameras of which they are known, from pairs of pictures."""

import math

import numpy as np
import pytest
from blobs import Speckle

from analysis.calibration.photon_transfer import (
    NoiseLevels,
    best_exposure,
    noise_levels,
    photon_transfer,
)

SCENE = Speckle((160, 200), seed=2).grey(contrast=0.18, level=0.02)  # of the brightest level
SCENE /= SCENE.max()
LIGHTS = 0.05, 0.12, 0.25, 0.45, 0.7, 0.95


class Sensor:
    """A camera: electrons by chance, read noise, black level, rounding and the end of the scale."""

    def __init__(self, seed, gain=0.0127, read=1.2, dark=8.0, top=255):
        self.rng, self.gain, self.read, self.dark, self.top = (
            np.random.default_rng(seed),
            gain,
            read,
            dark,
            top,
        )

    def picture(self, light, scene=SCENE):
        electrons = self.rng.poisson(scene * light * (self.top - self.dark) / self.gain)
        grey = self.dark + self.gain * electrons + self.read * self.rng.normal(size=scene.shape)
        return np.clip(np.rint(grey), 0, self.top).astype(np.uint16)


def measured(sensor, lights=LIGHTS, scene=SCENE, change=lambda image, n: image):
    pairs = [[change(sensor.picture(light, scene), n) for n in (0, 1)] for light in lights]
    found = [noise_levels(*pair, top=sensor.top) for pair in pairs]
    bins = (
        np.concatenate([getattr(one, v) for one in found]) for v in ("level", "variance", "count")
    )
    return photon_transfer(
        NoiseLevels(*bins),
        sensor.top,
        dark=sensor.dark,
        mean_level=[np.mean(pair) for pair in pairs],
        exposure_s=np.array(lights) * 0.01,
    )


def test_the_truth_is_within_the_stated_uncertainty():
    pulls = {name: [] for name in ("gain", "read", "full well")}
    for seed in range(60):
        hidden = np.random.default_rng([7, seed])
        sensor = Sensor(seed, hidden.uniform(0.008, 0.05), hidden.uniform(0.8, 2.5), 9.0)
        found = measured(sensor, (0.1, 0.25, 0.5, 0.9))
        full = (sensor.top - sensor.dark) / sensor.gain
        pulls["gain"].append((found.gain - sensor.gain) / found.gain_sd)
        pulls["read"].append((found.read_noise - sensor.read) / found.read_noise_sd)
        pulls["full well"].append((found.full_well - full) / found.full_well_sd)
        assert found.nonlinearity < 0.01
    for name, off in pulls.items():
        inside = [float((np.abs(off) < sigmas).mean()) for sigmas in (1, 2)]
        assert 0.6 <= inside[0] <= 0.76, name
        assert inside[1] >= 0.9, name


def test_a_flat_field_of_twelve_bits_tells_the_same():
    sensor = Sensor(1, 0.4, 3.0, 60.0, 4095)
    found = measured(sensor, scene=np.full((200, 200), 0.9))
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

    found = measured(Sensor(2), scene=0.9 + 0.1 * SCENE, change=full)
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
        measured(Sensor(5), change=spoil)


def test_exposures_that_are_too_close_are_refused():
    with pytest.raises(ValueError, match="take more exposures"):
        measured(Sensor(6), (0.5, 0.55), 0.9 + 0.05 * SCENE)


def test_the_best_exposure_saturates_as_few_pixels_as_asked():
    sensor = Sensor(8)
    camera = measured(sensor)
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
