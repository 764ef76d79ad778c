"""The distortion of a lens from a translation of the block, with its stated uncertainty."""

import numpy as np
import pytest
from hidden_benches import overlapping

from analysis.calibration.distortion import distortion_of_translation
from drivers.sim.optics import Lens

SHAPE, SHIFT_PX, NOISE_PX = (480, 640), 18.0, 0.02


@pytest.mark.parametrize("k", [0.0, -0.015])
def test_the_stated_uncertainty_is_the_scatter(k):
    lens, rng, pulls = Lens.of(k, SHAPE), np.random.default_rng(9), []
    x, y = np.meshgrid(np.arange(20.0, 600, 10), np.arange(20.0, 460, 10))
    ideal_x, ideal_y = lens.ideal(x, y)
    to_x, to_y = lens.seen(ideal_x + SHIFT_PX, ideal_y)
    for _ in range(40):
        u, v = (to - at + NOISE_PX * overlapping(rng, x.shape) for to, at in ((to_x, x), (to_y, y)))
        found = distortion_of_translation(x, y, u, v, SHAPE)
        pulls.append((found.k - k) / found.k_sd)
    assert 0.75 < np.sqrt(np.mean(np.square(pulls))) < 1.3


@pytest.mark.parametrize(("off_px", "tilt"), [((10, 0), 0), ((0, 10), 0), ((0, 0), 1e-3)])
@pytest.mark.parametrize("way_px", [(80.0, 0.0), (80.0, 40.0)])
def test_another_centre_or_an_oblique_camera_is_no_distortion(off_px, tilt, way_px):
    """The block shows itself through a lens whose centre is off that of the picture, by a camera
    for which the scale grows to the right: both by displacements of a closed form.
    """
    k, rng, pulls = -0.008, np.random.default_rng(4), []
    middle = np.array([(SHAPE[1] - 1) / 2, (SHAPE[0] - 1) / 2])
    centre, corner = (middle + off_px)[:, None, None], np.hypot(*middle)
    places = np.stack(np.meshgrid(np.arange(40.0, 530, 10), np.arange(40.0, 410, 10)))
    grown = 1 + tilt * (places[0] / middle[0] - 1)

    def ideal(at):
        return at + k * (((at - centre) / corner) ** 2).sum(axis=0) * (at - centre)

    there = places + np.array(way_px)[:, None, None]
    for _ in range(30):  # where the block is seen after its way
        there += ideal(places) + np.array(way_px)[:, None, None] * grown - ideal(there)
    for _ in range(20):
        noise = [0.25 * NOISE_PX * overlapping(rng, there[0].shape) for _ in range(2)]
        found = distortion_of_translation(*places, *(there - places + noise), SHAPE)
        pulls.append((found.k - k) / found.k_sd)
    assert np.sqrt(np.mean(np.square(pulls))) < 1.3
    # in the middle of the picture, where nothing is magnified but by k there
    assert found.shift_px == pytest.approx(way_px, abs=0.02)


def test_a_displacement_is_the_mean_over_its_box():
    k, box, lens = -0.015, 40, Lens.of(-0.015, SHAPE)
    x, y = np.meshgrid(np.arange(30.0, 600, 30), np.arange(30.0, 460, 30))
    within = (np.arange(box) + 0.5) - box / 2
    at_x, at_y = x[..., None, None] + within, y[..., None, None] + within[:, None]
    ideal_x, ideal_y = lens.ideal(at_x, at_y)
    to_x, to_y = lens.seen(ideal_x + SHIFT_PX, ideal_y)
    u, v = (np.mean(to - at, axis=(2, 3)) for to, at in ((to_x, at_x), (to_y, at_y)))
    found = distortion_of_translation(x, y, u, v, SHAPE, box)
    assert found.shift_px == pytest.approx((SHIFT_PX, 0), abs=1e-4)
    assert found.k == pytest.approx(k, rel=1e-3)
