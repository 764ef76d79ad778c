"""The emulated bench runs the same experiment as the simulated one, through the drivers of a real
bench.
"""

import numpy as np
import pytest
from hil_run import SMALL, HilRun
from short_run import TRACTION

from app.replay.reanalysis import Reanalysis
from app.runs import live
from app.settings import config


@pytest.fixture(scope="module")
def hil(tmp_path_factory):
    return HilRun(tmp_path_factory.mktemp("hil") / "run.h5", "run.travel=60", pace=1.0)


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    path = tmp_path_factory.mktemp("hil") / "sim.h5"
    run = live.make_run(config.load(None, [*SMALL, "run.travel=60", TRACTION]), path, pace=None)
    run.start()
    return run.wait(400)


@pytest.mark.slow
def test_every_trigger_and_sample_is_accounted_for(hil):
    assert (hil.outcome.state, hil.outcome.reason) == ("done", "the drive of 60 um is complete")
    assert hil.counts.triggers > 80
    assert hil.counts.frames_lost == hil.counts.samples_lost == 0


def test_every_frame_is_the_world_at_the_sample_of_its_trigger(hil):
    assert all(sample == 125 * index for index, (sample, _) in hil.frames.items())
    assert hil.wrong_frames() == []


def test_the_forces_are_those_of_the_world_to_the_bit(hil):
    from drivers.sim.world import World

    again = World(hil.world.scenario, pace=None)
    again._moves = hil.world._moves
    again.start()
    # before any move: noise and quantisation
    np.testing.assert_array_equal(hil.volts[:1250], again.advance(1250).volts[:1250])


@pytest.mark.slow
def test_the_results_are_those_of_the_simulated_bench_within_noise(hil, simulated):
    # a busy machine skips some
    every_frame = Reanalysis(
        hil.path, hil.path.with_name("every-frame.h5"), pace=None, overrides=[TRACTION]
    )
    every_frame.start()
    a, b = every_frame.wait(400).summary, simulated.summary
    # t_s falls elsewhere between two frames
    assert a.mu_s == pytest.approx(b.mu_s, abs=4 * np.hypot(a.mu_s_sd, b.mu_s_sd))
    assert a.mu_s_sd < 0.005 * a.mu_s
    assert a.apparent_radius_m == pytest.approx(b.apparent_radius_m, rel=0.01)
    assert a.onset_time_s == pytest.approx(b.onset_time_s, abs=0.3)
    assert a.young_modulus_pa == pytest.approx(b.young_modulus_pa, rel=0.01)
