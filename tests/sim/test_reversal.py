"""A simulated contact that is driven forth and back."""

from __future__ import annotations

import numpy as np
import pytest
from worlds import carried_n, pressed

from analysis.friction.cycles import branches, loop_work, masing_deviation
from drivers.errors import OutOfLimits
from drivers.sim.world import World


def driven(ends: list[float], **sim: object) -> tuple[World, np.ndarray, np.ndarray]:
    """A world after these places of the stage; travel and force every 100 samples."""
    world = pressed(**sim)
    travel, force = [], []
    for end in ends:
        world.move(end, 20e-6)
        while world.is_moving():
            world.advance(100)
            state = world.state(world.now - 1)
            travel.append(state.stage_m)
            force.append(state.shear_force_n)
    return world, np.array(travel), np.array(force)


@pytest.mark.parametrize("pressure", ["hertz", "greenwood-tripp"])
def test_a_reversal_repeats_the_first_loading_at_twice_its_size(pressure: str) -> None:
    _, x, Q = driven([150e-6, 0.0, 150e-6], law="elasto-plastic", pressure=pressure)
    first, back, forth = branches(x, least=1e-6)
    assert masing_deviation(x[first], Q[first], x[back], Q[back]) < 3e-3
    assert masing_deviation(x[first], Q[first], x[forth], Q[forth]) < 3e-3
    assert loop_work(x[back.start : forth.stop], Q[back.start : forth.stop]) > 3e-6


def test_what_a_camera_sees_of_a_block_that_came_back_is_a_state_of_its_own() -> None:
    world, _, Q = driven([60e-6, 25e-6], law="elasto-plastic")
    state = world.state(world.now - 1)
    assert state.shear_force_n == pytest.approx(Q[-1])
    assert carried_n(state) == pytest.approx(state.shear_force_n, rel=2e-3)
    assert state.traction(0.95 * state.hertz_radius_m) < 0 < state.traction(0.0)
    early = world.state(2500)  # a state of the first loading is what it was
    assert early.stage_m < 60e-6
    assert (early.traction(np.linspace(0, state.hertz_radius_m, 400)) >= 0).all()


def test_a_law_without_memory_can_not_turn_back() -> None:
    with pytest.raises(OutOfLimits, match=r"move back by 50 um .* use 'elasto-plastic'"):
        driven([60e-6, 10e-6], law="cattaneo-mindlin")
