"""A simulated contact that is held while it slides: it holds more afterwards, as its law says."""

from __future__ import annotations

import math

import numpy as np
import pytest
from worlds import carried_n, pressed

from drivers.errors import OutOfLimits
from drivers.sim.scenario import Scenario
from drivers.sim.settings import SimSettings
from drivers.sim.world import World

P, MU, BETA, T0, DC = 0.1, 0.8, 0.02, 0.5, 6e-6


def world_of(**sim: object) -> World:
    ages = {"ageing": BETA, "ageing_time": T0, "ageing_slip": DC, **sim}
    return pressed(normal_force=P, friction=MU, **ages)


def go(
    world: World, way: float, speed: float = 10e-6, every: int = 20
) -> tuple[np.ndarray, np.ndarray]:
    """Travel and Q/P every so many samples of a move."""
    world.move(world.stage_m() + way, speed)
    travel, ratio = [], []
    while world.is_moving():
        world.advance(every)
        state = world.state(world.now - 1)
        travel.append(state.stage_m)
        ratio.append(state.shear_force_n / P)
    return np.array(travel), np.array(ratio)


@pytest.fixture(scope="module")
def held() -> tuple[World, list[tuple[float, np.ndarray, np.ndarray]]]:
    world, slides = world_of(), []
    go(world, 60e-6)
    for hold in (0.3, 3.0, 30.0):
        world.advance(round(hold * 1000))
        slides.append((hold, *go(world, 80e-6)))
    return world, slides


def test_the_peak_after_a_hold_is_that_of_the_law(held) -> None:
    world, slides = held
    for (hold, _, ratio), (held_s, peak) in zip(slides, world.peaks(), strict=True):
        assert held_s == pytest.approx(hold, abs=0.03)
        law = MU * (1 + BETA * math.log(1 + held_s / T0))
        assert peak == pytest.approx(law, rel=1e-6)
        assert ratio.max() == pytest.approx(law, rel=2e-4)
        # it begins where it was held, and is forgotten after some D_c
        assert ratio[0] == pytest.approx(MU, rel=1e-2)
        assert ratio[-1] == pytest.approx(MU, rel=1e-4)
    assert world.truth(world.now - 1).peaks == world.peaks()


def test_the_peak_decays_over_its_length(held) -> None:
    """Once the contact has yielded the excess falls as exp(-s/D_c), and the block lags behind the
    stage by what the excess stretches: s = x - X f.
    """
    world, slides = held
    _, travel, ratio = slides[-1]
    stretch = world._contact.onset
    excess = ratio / MU - 1
    late = (np.arange(len(excess)) > excess.argmax()) & (excess > 1e-3)
    slip = travel[late] - stretch * excess[late]
    far = slip > slip[0] + 3e-6
    slope = np.polyfit(slip[far], np.log(excess[late][far]), 1)[0]
    assert -1 / slope == pytest.approx(DC, rel=0.02)


def test_the_traction_carries_the_force_and_the_block_does_not_jump(held) -> None:
    world, _ = held
    end = world.now - 1
    samples = np.arange(end - 8000, end - 5500, 10)
    states = [world.state(int(sample)) for sample in samples]
    peak = max(states, key=lambda state: state.shear_force_n)
    assert carried_n(peak) == pytest.approx(peak.shear_force_n, rel=2e-3)
    assert peak.shear_force_n > MU * P * 1.01
    steps = np.diff([state.block_m for state in states])
    assert (steps > -1e-12).all()
    assert steps.max() < 5 * 10e-6 * 0.01


def test_a_hold_before_it_slides_or_without_ageing_changes_nothing() -> None:
    for world, first in ((world_of(), 12e-6), (world_of(ageing=0.0), 60e-6)):
        go(world, first)
        world.advance(20_000)
        _, ratio = go(world, 60e-6)
        assert ratio.max() <= MU * (1 + 1e-6)
        assert np.diff(ratio).min() > -1e-9


@pytest.mark.slow
def test_a_second_hold_adds_to_what_is_left_of_the_first() -> None:
    world = world_of()
    go(world, 60e-6)
    world.advance(20_000)
    _, before = go(world, 6e-6)
    world.advance(1)
    held = world.state(world.now - 1).shear_force_n / P
    assert held > MU * 1.02
    world.advance(3000)
    assert world.state(world.now - 1).shear_force_n / P == pytest.approx(held, rel=1e-9)
    _, after = go(world, 40e-6, 1e-6, every=30)
    assert before[-1] == pytest.approx(held, rel=2e-3)
    assert after[0] == pytest.approx(held, rel=1e-3)
    assert after.max() > held + MU * BETA * math.log(1 + 3.0 / T0) * 0.3
    assert world.peaks()[-1][1] == pytest.approx(after.max(), rel=1e-3)
    assert after[-1] == pytest.approx(MU, rel=1e-3)


def test_a_change_of_velocity_without_a_stop_is_no_hold() -> None:
    world = world_of()
    world.move(100e-6, 10e-6)
    world.advance(8000)
    world.move(100e-6, 20e-6)
    assert world.is_moving()
    before = world.stage_m()
    world.advance(1000)
    assert world.stage_m() - before == pytest.approx(20e-6, rel=0.03)
    assert world.peaks() == ()


def test_a_halt_in_a_move_begins_a_hold() -> None:
    world = world_of()
    world.move(200e-6, 10e-6)
    world.advance(8000)
    world.halt()
    world.advance(1000)
    world.halt()  # again, which does not end it
    world.advance(1000)
    go(world, 40e-6)
    assert [round(hold, 3) for hold, _ in world.peaks()] == [2.0]


@pytest.mark.slow
def test_it_ages_on_the_way_back_as_on_the_way_forth_and_a_turn_forgets() -> None:
    world = world_of()
    go(world, 60e-6)
    world.advance(5000)
    _, back = go(world, -120e-6)
    assert back.min() == pytest.approx(-MU, rel=1e-4)
    world.advance(5000)
    _, on = go(world, -40e-6)
    law = MU * (1 + BETA * math.log(1 + world.peaks()[-1][0] / T0))
    assert -on.min() == pytest.approx(law, rel=3e-4)


def test_what_would_jump_is_refused_before_it_moves() -> None:
    settings = SimSettings(law="elasto-plastic", ageing=0.02, ageing_slip=1e-6)
    with pytest.raises(ValueError, match=r"after a hold of 30 s friction .* would jump"):
        World(Scenario(sim=settings, longest_hold=30.0))
    World(Scenario(sim=settings, longest_hold=0.0))
    world = world_of(ageing_slip=0.5e-6)
    go(world, 60e-6)
    world.advance(60_000)
    here = world.stage_m()
    with pytest.raises(OutOfLimits, match="and the contact would jump"):
        world.move(here + 20e-6, 10e-6)
    world.advance(100)
    assert world.stage_m() == here
    assert not world.is_moving()


@pytest.mark.parametrize("law", ["cattaneo-mindlin", "table"])
def test_a_law_without_memory_does_not_age(law: str) -> None:
    with pytest.raises(ValueError, match=f"the law '{law}' has no memory and cannot age"):
        World(Scenario(sim=SimSettings(law=law, ageing=0.01)))
