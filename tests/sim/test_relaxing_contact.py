"""A simulated contact whose block relaxes: its course in time, and what it does not depend on."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
from worlds import QUIET, carried_n, pressed

from drivers.sim import relaxing_contact
from drivers.sim.world import World

P, MU, SHARE, TAU = 0.1, 0.9, 0.2, 0.5


def world_of(**changes: object) -> World:
    relaxes = {"relaxation": SHARE, "relaxation_time": TAU, **changes}
    return pressed(normal_force=P, friction=MU, **relaxes)


def course(world: World, block: int) -> Iterator[np.ndarray]:
    """Readings of a drive, a hold in partial slip, a drive back and forth."""

    def passed(n: int) -> np.ndarray:
        sizes = [block] * (n // block) + [n % block] * bool(n % block)
        return np.concatenate([world.advance(size).volts for size in sizes])

    world.move(30e-6, 10e-6)
    yield passed(1003)
    world.halt()
    yield passed(707)
    world.move(0.0, 10e-6)
    yield passed(511)
    world.move(60e-6, 20e-6)
    yield passed(301)


def force(world: World, sample: int) -> float:
    return world.state(sample).shear_force_n


def test_neither_the_blocks_nor_who_looks_has_any_influence() -> None:
    one, other = world_of(), world_of()
    whole = [*course(one, 5000)]
    parts = []
    for volts in course(other, 7):
        parts.append(volts)
        other.state(other.now).radial(0.0)  # a command may follow that changes what comes after
        other.truth(other.now // 2)
    np.testing.assert_array_equal(np.concatenate(whole), np.concatenate(parts))
    for sample in (500, 1013, 1700, 1721, 2300, 2531):
        assert force(one, sample) == force(other, sample)
        r = np.linspace(0, 2e-3, 9)
        np.testing.assert_array_equal(one.state(sample).radial(r), other.state(sample).radial(r))


def test_states_that_were_not_kept_are_solved_again(monkeypatch: pytest.MonkeyPatch) -> None:
    kept = world_of()
    [*course(kept, 100)]
    monkeypatch.setattr(relaxing_contact, "MOST_STATES", 8)
    forgetful = world_of()
    [*course(forgetful, 100)]
    assert len(forgetful._contact._samples) <= 8 < len(kept._contact._samples)
    for sample in (2500, 700, 1701):
        assert force(forgetful, sample) == force(kept, sample)


def test_between_its_points_of_time_q_is_that_of_the_surface() -> None:
    """To 1e-6 N of a force noise of 1e-3 N, also where the stage stops and turns between them."""
    world = world_of()
    [*course(world, 100)]
    for sample in (300, 305, 311, 1014, 1016, 1025, 1722, 1729, 2235, 2243, 2400):
        state = world.state(sample)
        assert carried_n(state) == pytest.approx(state.shear_force_n, abs=2e-6)


def test_q_relaxes_while_the_stage_is_held() -> None:
    world = world_of()
    world.move(30e-6, 30e-6)
    world.advance(300)
    world.halt()
    here = world.now
    world.advance(8000)
    at_once, soon, late, end = (force(world, here + n) for n in (0, 300, 6000, 8000))
    assert at_once > 1.01 * soon > 1.01 * late
    assert end == pytest.approx(late, rel=1e-4)
    # a state of equilibrium of the elastic block, which depends on the way there but little
    elastic = world_of(relaxation=0.0)
    elastic.move(30e-6, 30e-6)
    elastic.advance(300)
    assert late == pytest.approx(force(elastic, elastic.now), rel=2e-2)


@pytest.mark.parametrize(("tau", "part"), [(1e4, 1 - SHARE), (1e-3, 1.0)])
def test_a_fast_and_a_slow_drive_are_those_of_elastic_blocks(tau: float, part: float) -> None:
    """Of the modulus at once on a lens as much flatter, and of the relaxed one; the lag of 1 ms
    is a share of 1e-3 of the drive.
    """
    E, R = QUIET.sample.young_modulus / part, QUIET.sample.lens_radius / part
    relaxing = world_of(relaxation_time=tau)
    elastic = world_of(relaxation=0.0, young_modulus=E, lens_radius=R)
    for world in (relaxing, elastic):
        world.move(60e-6, 20e-6)
        world.advance(2000)
    for sample in (200, 700, 1900):
        assert force(relaxing, sample) == pytest.approx(force(elastic, sample), rel=1e-3)
        centres = (float(w.state(sample).radial(0.0)[0]) for w in (relaxing, elastic))
        assert next(centres) == pytest.approx(next(centres), rel=2e-3)


def test_the_onset_is_that_of_the_relaxed_block_with_the_force_there() -> None:
    """The line of steady sliding is that of the block once it has yielded."""
    onset, ratio = [], []
    for share in (0.0, SHARE):
        world = world_of(relaxation=share, relaxation_time=20.0)
        world.move(60e-6, 20e-6)
        world.advance(2000)
        truth = world.truth(1990)
        onset.append(truth.onset_sample)
        ratio.append(truth.mu_s)
        assert truth.mu_s == pytest.approx(force(world, truth.onset_sample) / P, rel=1e-3)
    assert onset[0] == onset[1]
    assert ratio[1] > 1.01 * ratio[0]


def test_before_it_slides_the_truth_has_no_onset() -> None:
    world = world_of()
    world.move(60e-6, 20e-6)
    world.advance(200)
    truth = world.truth(150)
    assert truth.onset_sample is None
    assert np.isnan(truth.mu_s)


@pytest.mark.parametrize(
    "other",
    [
        {"law": "cattaneo-mindlin"},
        {"law": "table", "law_table": "nowhere.csv"},
        {"pressure": "jkr"},
        {"ageing": 0.01},
    ],
)
def test_what_a_relaxing_block_does_not_go_with_is_refused(other: dict[str, object]) -> None:
    with pytest.raises(ValueError, match=r"relaxes .* change these, or use sim.relaxation = 0"):
        world_of(**other)
