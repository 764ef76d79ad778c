"""The states of the simulated world that the rows of one image show."""

from __future__ import annotations

import math

import numpy as np

from drivers.sim.truth import TrueState
from drivers.sim.world import World

STEP_S, STEP_PX = 10e-3, 0.2  # at most, between states that an image mixes


def states_shown(world: World, begin: int) -> tuple[TrueState, ...]:
    """The state at the middle of the exposure that began on a sample, and with a rolling shutter
    those up to the middle of the exposure of the last row, in order.

    Raises
    ------
    ValueError
        The exposure of the last row is not over yet.
    """
    s = world.scenario
    middle = begin + s.exposure_samples // 2
    last = middle + math.ceil(s.readout_samples)
    first = world.state(middle)
    if last == middle:
        return (first,)
    final = world.state(last)
    moved_px = math.dist(first.rigid_m, final.rigid_m) / s.camera.pixel
    n = 1 + math.ceil(max(abs(s.sim.readout) / STEP_S, moved_px / STEP_PX))
    samples = np.unique(np.linspace(middle, last, n).round().astype(int))
    return (first, *map(world.state, samples[1:-1].tolist()), final)
