"""A run through a lens that distorts, with and without its correction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from app.evaluation.pipeline import Pipeline
from app.evaluation.setup import places_m
from app.records.record_types import Conditions, Phase
from app.settings.config import Config
from drivers.settings import CameraSettings
from drivers.sim.images import Renderer
from drivers.sim.scenario import Scenario
from drivers.sim.settings import SimSettings
from drivers.sim.world import World

LENS = 0.015


def analysed(correction: float) -> tuple[float, float, float]:
    """Ring mean of u_x at the rim, the largest radius of a ring, and the true displacement of the
    block, metres.
    """
    camera = CameraSettings(width=640, height=480, pixel=12e-6)
    sim = SimSettings(press_time=0.01, read_noise=0.5, force_noise=0.0, distortion=LENS)
    scenario = Scenario(sim=sim, camera=camera, normal_force=0.1, press_samples=1)
    world = World(scenario, pace=None)
    world.start()
    world.advance(100)
    world.move(80e-6, 40e-6)
    world.advance(2500)
    config = Config(camera=replace(camera, distortion=correction), sim=sim)
    renderer, pipeline = Renderer(scenario), Pipeline(config)
    at = ((5, Phase.BACKGROUND), (50, Phase.REFERENCE), (2400, Phase.DRIVE))
    for index, (sample, phase) in enumerate(at):
        state = world.state(sample)
        now = Conditions(phase, 2.0, state.normal_force_n, state.shear_force_n, 80e-6)
        shot = pipeline.step(index, sample, renderer.image(state, index), now)
    state, rest = world.state(2400), world.state(50)
    pipeline.close()
    r, ux = shot.rings.radius_m, shot.rings.ux_m
    known = np.flatnonzero(np.isfinite(ux))[-3:]
    far = state.block_m - rest.block_m
    true = far - float(np.mean(state.radial(r[known])[0]))
    return float(np.mean(ux[known])) + shot.motion.lens_m - state.lens_m, float(r[known[-1]]), true


def test_a_known_distortion_is_corrected() -> None:
    wrong, near, _ = analysed(0.0)
    right, far, true = analysed(LENS)
    assert abs(right - true) < 0.12e-6
    assert abs(wrong - true) > 2.5 * abs(right - true)
    assert far > near - 1e-4


def test_without_a_distortion_places_are_to_the_bit_what_they_were() -> None:
    x = np.linspace(0.0, 600.0, 7)
    config = Config()
    found, _ = places_m(config, x, x)
    np.testing.assert_array_equal(found, x * config.camera.pixel)
