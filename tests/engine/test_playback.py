"""A replay under control: it pauses, steps, changes its pace, shows any frame, and gives
the same bits all the same.
"""

import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
import short_run
from processes.launched import wait_until
from sparse_session import sparse_copy
from whole_runs import PATIENCE_S, recorded

from app.replay import playback as playback_module
from app.replay.playback import Playback
from app.replay.replay import Replay
from app.session.reader import SessionReader
from app.system.errors import UserError
from tests.same_results import difference

SMALL = (*short_run.SMALL, "run.travel=30")


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    path = tmp_path_factory.mktemp("playback") / "a.h5"
    recorded(path, *SMALL)
    return path


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


@pytest.mark.slow
def test_any_frame_is_shown_as_it_was_recorded_and_the_replay_is_the_same_to_the_bit(session):
    replay = Replay(session, pace=None)
    replay.playback.pause()
    replay.start()
    for n in (1, 2, 3):
        replay.playback.step()
        wait_until(lambda n=n: len(replay.look(0).snapshots) == n)
    assert (replay.frame, replay.is_browsing, replay.browsed()) == (2, False, None)
    with SessionReader(session) as recorded:
        for number in (replay.frame_count - 1, 0, 40):
            replay.browser.show(number)
            assert (replay.frame, replay.is_browsing) == (number, True)
            assert difference(replay.browsed(), recorded.snapshot(number)) == ""
            np.testing.assert_array_equal(
                replay.latest_image(), recorded.frame(recorded.snapshot(number).frame)[2]
            )
    assert len(replay.look(0).snapshots) == 3
    replay.browser.show(None)
    replay.playback.resume()
    assert replay.wait(PATIENCE_S).state == "done"
    assert replay.comparison().all_identical
    assert replay.comparison().frames == replay.frame_count
    replay.browser.close()


LAST = 63
SKIPPED = (50, 51, 52, 57)  # recorded, but not analysed
LOST = (40, 41)


@pytest.fixture(scope="module")
def sparse(session):
    """The session of a run whose analysis skipped some frames, and whose camera lost some."""
    return sparse_copy(session, session.with_name("sparse.h5"), SKIPPED, LOST)


def test_any_recorded_frame_is_shown_by_the_number_it_was_recorded_with(session, sparse):
    replay = Replay(sparse, pace=None)
    with SessionReader(session) as whole:
        for frame in (LAST, 0, 39, 60, 49, 58):
            replay.show(frame)
            assert (replay.frame, replay.browsed().frame, replay.has_results(frame)) == (
                *(frame, frame),
                True,
            )
            image = replay.latest_image()
            np.testing.assert_array_equal(image, whole.frame(frame)[2])
        for frame in SKIPPED:  # of which the run has no results
            replay.show(frame)
            shown = replay.browsed()
            assert (replay.frame, shown.frame, shown.field) == (frame, frame, None)
            assert not replay.has_results(frame)
            # what the bench measured is the same as for the run that analysed them
            assert shown.conditions == whole.snapshot(frame).conditions
            np.testing.assert_array_equal(replay.latest_image(), whole.frame(frame)[2])
    replay.show(41)  # which has no image: the nearest one that has
    assert replay.frame == 42
    replay.move(-1)
    assert replay.frame == 39
    replay.browser.close()


def test_results_of_a_skipped_frame_are_computed_on_request(session, sparse):
    replay = Replay(sparse, pace=None)
    replay.show(51)
    assert replay.browsed().field is None
    replay.analyse(51)
    assert replay.has_results(51)
    now = replay.browsed()
    with SessionReader(session) as whole:
        then = whole.snapshot(51)
    # the search began elsewhere, which changes a displacement by a small part of its uncertainty
    apart = np.abs(now.field.ux_px - then.field.ux_px) / then.field.ux_std_px
    assert np.nanmedian(apart) < 0.05
    assert now.conditions == then.conditions
    assert abs(now.motion.centre_ux_m - then.motion.centre_ux_m) < 0.1 * then.motion.centre_ux_sd_m
    with pytest.raises(UserError, match="frame 1 was exposed before a reference was taken"):
        replay.analyse(1)
    replay.browser.close()


@pytest.mark.parametrize("jump", [40, 10])  # ahead of what was replayed, and back
def test_play_goes_on_from_the_frame_that_is_shown(session, jump, monkeypatch):
    clock = SimpleNamespace(monotonic=lambda: clock.now_s, now_s=1000.0)
    monkeypatch.setattr(playback_module, "time", clock)
    replay = Replay(session, pace=2.0)
    replay.playback.pause()
    replay.start()
    for n in range(1, 31):
        replay.playback.step()
        wait_until(lambda n=n: len(replay.look(0).snapshots) == n)
    replay.show(jump)
    replay.play()
    assert replay.frame == jump
    for due in (4, 8, 12):
        clock.now_s += 0.26  # at twice the pace of 8 frames a second
        wait_until(lambda due=due: replay.frame == jump + due)
    replay.pause()
    clock.now_s += 60
    assert replay.frame == jump + 12
    replay.playback.set_pace(None)
    replay.play()
    assert replay.wait(PATIENCE_S).state == "done"
    assert (replay.comparison().frames, replay.verdict().agrees) == (replay.frame_count, True)
    assert replay.verdict().sentences[0].startswith("the replay agrees to the bit: 64 of 64")
    clock.now_s += 60
    wait_until(lambda: replay.frame == LAST)
    replay.play()  # from the beginning
    assert replay.frame < 10
    replay.browser.close()


def test_the_next_frame_is_replayed_if_it_is_its_turn_else_shown(sparse):
    replay = Replay(sparse, pace=None)
    replay.playback.pause()
    replay.start()
    for n in range(50):  # 0 to 39, 42 to 49
        replay.move(1) if n else replay.playback.step()
        wait_until(lambda n=n: len(replay.look(0).snapshots) == min(n + 1, 48))
        if replay.frame == 49:
            break
    assert not replay.is_browsing
    replay.move(1)
    assert (replay.frame, replay.is_browsing, replay.has_results(50)) == (50, True, False)
    replay.request_stop("enough")
    replay.wait(PATIENCE_S)
    replay.browser.close()


def test_a_standing_replay_can_be_ended(session):
    replay = Replay(session, pace=1.0)
    replay.playback.pause()
    replay.start()
    replay.request_stop("enough")
    assert replay.wait(PATIENCE_S).reason == "enough"
