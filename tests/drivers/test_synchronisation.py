"""The account of frames in a world of faults, where every image carries the number of its trigger:
nothing that is said to be certain is wrong.
"""

import pytest

from benchmarks.synchronisation import MODES, World, outcomes
from drivers.protocols import Frame

RUNS = 60


@pytest.mark.parametrize("mode", MODES)
def test_no_frame_is_certain_and_wrong(mode):
    certain = 0
    for seed in range(RUNS):
        world = World(seed, mode)
        found = outcomes(world.play())
        wrong = found["CERTAIN AND WRONG"], found["outside its range"]
        assert wrong == (0, 0), f"seed {seed}: {found}, {world.faults}"
        certain += found["certain and right"]
    assert certain > 1000  # it is easy to be certain of nothing


@pytest.mark.parametrize("mode", MODES)
def test_a_healthy_bench_whose_images_come_in_time_is_certain_of_all(mode):
    worlds = (World(seed, mode) for seed in range(200))
    healthy = [
        world
        for world in worlds
        if not world.faults
        and world.truth[0][1].frame_id is not None
        and world.knows_first
        and all(
            came_s < world.at(world.train.sample(n + 1))
            for n, (came_s, _) in enumerate(world.truth)
        )
    ]
    assert len(healthy) >= 5
    for world in healthy[:10]:
        answers = world.play()
        assert all(isinstance(answer, Frame) and answer.is_certain for answer in answers)
        assert [answer.image[0, 0] for answer in answers] == list(range(world.triggers))
