"""A replay under control: it pauses, steps, changes its pace, shows any frame, and gives
the same bits all the same.
"""

import threading
import time

import numpy as np
import pytest
import short_run

from app import config, live
from app.offline.playback import Playback
from app.offline.replay import Replay, difference
from app.session.reader import SessionReader

SMALL = (*short_run.SMALL, "run.travel=30")
PATIENCE_S = 400.0


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    path = tmp_path_factory.mktemp("playback") / "a.h5"
    run = live.make_run(config.load(None, SMALL), path, pace=None)
    run.start()
    assert run.wait(400).state == "done"
    return path


def wait_until(condition):
    give_up = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < give_up
        time.sleep(0.005)


def played(playback, times):
    """A thread that plays frames of these times; the list of those that it has played."""
    done = []

    def work():
        for t in times:
            if not playback.wait_for_turn(t):
                done.append("over")
                return
            done.append(t)

    threading.Thread(target=work, daemon=True).start()
    return done


def test_as_fast_as_the_machine_nobody_waits():
    playback = Playback(None)
    done = played(playback, range(1000))
    wait_until(lambda: len(done) == 1000)


def test_the_pace_is_kept_from_the_frame_it_was_set_on():
    playback = Playback(2.0)
    began = time.monotonic()
    assert playback.wait_for_turn(100.0)
    assert playback.wait_for_turn(100.2)
    assert time.monotonic() - began >= 0.1
    playback.set_pace(20.0)
    assert playback.wait_for_turn(100.2)
    assert playback.wait_for_turn(101.2)
    assert time.monotonic() - began >= 0.15


def test_a_paused_replay_plays_as_many_frames_as_steps():
    playback = Playback(None)
    playback.pause()
    done = played(playback, range(10))
    for n in (1, 2):
        playback.step()
        wait_until(lambda n=n: len(done) == n)
    assert not threading.Event().wait(0.05)
    assert done == [0, 1]
    playback.resume()
    wait_until(lambda: len(done) == 10)


@pytest.mark.parametrize("paused", [True, False])
def test_the_end_wakes_whoever_waits(paused):
    playback = Playback(1e-6)
    assert playback.wait_for_turn(0.0)
    if paused:
        playback.pause()
    done = played(playback, [1.0])
    playback.end()
    wait_until(lambda: done == ["over"])


def test_any_frame_is_shown_as_it_was_recorded_and_the_replay_is_the_same_to_the_bit(session):
    replay = Replay(session, pace=None)
    replay.playback.pause()
    replay.start()
    for n in (1, 2, 3):
        replay.playback.step()
        wait_until(lambda n=n: len(replay.snapshots_since(0)) == n)
    assert (replay.place, replay.is_browsing, replay.browsed()) == (2, False, None)
    with SessionReader(session) as recorded:
        for number in (replay.frame_count - 1, 0, 40):
            replay.browser.show(number)
            assert (replay.place, replay.is_browsing) == (number, True)
            assert difference(replay.browsed(), recorded.snapshot(number)) == ""
            np.testing.assert_array_equal(
                replay.latest_image(), recorded.frame(recorded.snapshot(number).frame)[2]
            )
    assert len(replay.snapshots_since(0)) == 3
    replay.browser.show(None)
    replay.playback.resume()
    assert replay.wait(PATIENCE_S).state == "done"
    assert replay.comparison().all_identical
    assert replay.comparison().frames == replay.frame_count
    replay.browser.close()


def test_a_standing_replay_can_be_ended(session):
    replay = Replay(session, pace=1.0)
    replay.playback.pause()
    replay.start()
    replay.request_stop("enough")
    assert replay.wait(PATIENCE_S).reason == "enough"
