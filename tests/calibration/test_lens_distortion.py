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
