"""A camera whose lens distorts: both renderers show the same, the truth is what they show, and a
free translation tells the distortion.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.calibration.distortion import distortion_of_translation
from analysis.dic import open_tracker
from analysis.grid import Grid
from analysis.settings import Correlation
from analysis.undistorted import ideal_places
from drivers.settings import CameraSettings
from drivers.sim.images import Renderer
from drivers.sim.optics import Lens
from drivers.sim.scenario import Scenario
from drivers.sim.settings import SimSettings
from drivers.sim.world import World

SHAPE = (300, 400)


def scenario(distortion: float, **sim: object) -> Scenario:
    more = {"press_time": 0.0, "read_noise": 0.0, "full_well": 0.0, **sim}
    camera = CameraSettings(width=SHAPE[1], height=SHAPE[0], pixel=14e-6)
    settings = SimSettings(distortion=distortion, **more)
    return Scenario(sim=settings, camera=camera, normal_force=0.1, press_samples=1)


def driven(distortion: float) -> World:
    world = World(scenario(distortion), pace=None)
    world.start()
    world.advance(10)
    world.move(60e-6, 20e-6)
    world.advance(3000)
    return world


def correlated(world: World, before: int, now: int) -> tuple[np.ndarray, ...]:
    """Places and displacements of the boxes between two samples, pixels."""
    renderer, grid = Renderer(world.scenario), Grid.cover(SHAPE, 24, 12)
    reference = renderer.image(world.state(before), 0)
    tracker = open_tracker(Correlation(box=24, step=12), reference)
    field = tracker.track(renderer.image(world.state(now), 1))
    tracker.close()
    x, y = np.meshgrid(grid.x_px, grid.y_px)
    return x, y, np.float64(field.ux_px), np.float64(field.uy_px)


@pytest.mark.parametrize("k", [-0.02, 0.004, 0.03])
def test_a_place_goes_there_and_back(k: float) -> None:
    lens, rng = Lens.of(k, SHAPE), np.random.default_rng(1)
    x, y = rng.uniform(0, 400, 200), rng.uniform(0, 300, 200)
    ideal = lens.ideal(x, y)
    np.testing.assert_allclose(lens.seen(*ideal), (x, y), atol=1e-9)
    np.testing.assert_allclose(ideal_places(x, y, k, SHAPE), ideal, atol=1e-9)
    corner, _ = lens.ideal(np.array(399.0), np.array(299.0))
    assert corner - 199.5 == pytest.approx(199.5 * (1 + k))


def test_a_blob_is_deformed_as_what_lies_around_it() -> None:
    """Against differences between neighbouring places."""
    lens, (x, y), step = (
        Lens.of(0.03, SHAPE),
        np.array([[20.0, 210.0, 390.0], [30.0, 280.0, 60.0]]),
        1e-3,
    )
    spread = np.array([[4.0, 1.0], [1.0, 2.0]])
    blobs = lens.seen_blobs(np.stack([x, y, *(np.full(3, s) for s in (4.0, 1.0, 2.0))]))
    at_x, at_y = lens.seen(x, y)
    for n, (seen_x, seen_y, xx, xy, yy) in enumerate(blobs.T):
        assert (seen_x, seen_y) == (at_x[n], at_y[n])
        ways = np.array([[step, 0.0], [0.0, step]])
        ends = [
            np.subtract(lens.ideal(seen_x + dx, seen_y + dy), lens.ideal(seen_x - dx, seen_y - dy))
            for dx, dy in ways
        ]
        back = np.linalg.inv(np.transpose(ends) / (2 * step))
        np.testing.assert_allclose([[xx, xy], [xy, yy]], back @ spread @ back.T, rtol=1e-6)


def test_both_renderers_show_the_same() -> None:
    world = driven(0.01)
    state = world.state(2500)
    fast, exact = (
        Renderer(replace(world.scenario, sim=replace(world.scenario.sim, renderer=name)))
        for name in ("fast", "exact")
    )
    shown = fast.grey(state, exact=False).astype(float)
    difference = shown - exact.grey(state, exact=True)
    assert np.sqrt(np.mean(difference**2)) < 0.4  # grey levels, of a contrast of 25
    plain = Renderer(scenario(0.0)).grey(state, exact=False)
    assert np.sqrt(np.mean((plain - shown) ** 2)) > 2


def test_the_truth_is_what_image_correlation_measures() -> None:
    world = driven(0.01)
    x, y, ux, uy = correlated(world, 100, 2900)
    true_x, true_y = world.truth(2900).displacement_px(x, y, 100)
    inner = (slice(2, -2), slice(2, -2))
    off = np.stack([ux - true_x, uy - true_y])[:, *inner]
    assert np.sqrt(np.nanmean(off**2)) < 0.02
    # without its lens the truth is another
    ideal, _ = driven(0.0).truth(2900).displacement_px(x, y, 100)
    assert np.abs(true_x - ideal).max() > 0.03


@pytest.mark.parametrize("k", [0.0, 0.01, -0.02])
def test_a_free_translation_tells_the_distortion(k: float) -> None:
    world = World(scenario(k, press_time=10.0), pace=None)
    world.start()
    world.move(300e-6, 200e-6)
    world.advance(3000)
    found = distortion_of_translation(*correlated(world, 0, 2900), SHAPE)
    assert found.k == pytest.approx(k, abs=max(4 * found.k_sd, 3e-4))
    assert found.k_sd < 5e-4
    assert found.shift_px[0] == pytest.approx(300 / 14, rel=2e-3)
    assert abs(found.angle) < 2e-3


def test_a_contact_is_no_free_translation() -> None:
    with pytest.raises(ValueError, match="no plain translation"):
        distortion_of_translation(*correlated(driven(0.0), 100, 2900), SHAPE)
