"""The conditioner of the simulated sensors: late, smoothed, the same for every block."""

from __future__ import annotations

import numpy as np
import pytest
from worlds import scenario

from drivers.sim.conditioner import Conditioner
from drivers.sim.world import World


def test_a_step_comes_late_and_rises_exponentially() -> None:
    forces = np.repeat([[0.0, 0.0], [2.0, -1.0]], [10, 200], axis=0)
    found = Conditioner(5.0, 20.0).read(forces)
    assert np.all(found[:15] == 0)
    rise = 1 - np.exp(-(np.arange(195) + 1) / 20)
    np.testing.assert_allclose(found[15:], np.outer(rise, [2.0, -1.0]), atol=1e-12)


def test_a_ramp_is_late_by_the_sum_of_both() -> None:
    ramp = np.column_stack([np.arange(1000.0), -np.arange(1000.0)])
    late = (ramp - Conditioner(7.0, 40.0).read(ramp))[-1]
    np.testing.assert_allclose(late, [46.5, -46.5], atol=0.01)  # within a sample


def test_what_is_read_does_not_depend_on_the_block() -> None:
    forces = np.random.default_rng(1).standard_normal((300, 2))
    at_once, parts = Conditioner(9.0, 13.0), Conditioner(9.0, 13.0)
    pieces = np.split(forces, [1, 2, 9, 150])
    np.testing.assert_array_equal(
        at_once.read(forces), np.concatenate([parts.read(piece) for piece in pieces])
    )


@pytest.mark.parametrize("late", [{}, {"sensor_delay": 0.03}, {"sensor_filter": 0.03}])
def test_the_board_reads_the_forces_of_its_conditioner(late: dict[str, float]) -> None:
    world = World(scenario(press_time=0.1, press_samples=1, force_noise=0.0, **late), pace=None)
    world.start()
    world.advance(150)
    at_once = World(scenario(press_time=0.1, press_samples=1, force_noise=0.0), pace=None)
    at_once.start()
    at_once.advance(150)
    for one in (world, at_once):
        one.move(1e-3, 50e-6)
    read, truth = (one.advance(400).volts[:, 1] for one in (world, at_once))
    if not late:
        np.testing.assert_array_equal(read, truth)
        return
    step = np.diff(truth)[350:].mean()
    assert (truth - read)[-20:].mean() / step == pytest.approx(30, abs=2)
