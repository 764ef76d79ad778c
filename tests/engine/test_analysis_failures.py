"""An analysis that fails on frames never ends what is measured."""

import threading

from short_run import SMALL

from app import config, live
from app.engine.pipeline import Pipeline
from app.offline.replay import Replay
from app.records import RESTART
from app.session.reader import SessionReader


class Fragile(Pipeline):
    """Fails on some frames, the first `times` that it is given them."""

    def __init__(self, settings, fragile, times):
        super().__init__(settings)
        self.fragile, self.times, self.tried = fragile, times, {}

    def step(self, index, sample, image, now):
        if self.fragile(index):
            self.tried[index] = self.tried.get(index, 0) + 1
            if self.tried[index] <= self.times:
                raise FloatingPointError(f"no minimum in frame {index}")
        return super().step(index, sample, image, now)


def run_with(path, fragile, times=99, *, more=()):
    settings = config.load(None, [*SMALL, *more])
    run = live.make_run(settings, path, pace=None, pipeline=Fragile(settings, fragile, times))
    run.start()
    return run.wait(300)


def restarts(path):
    with SessionReader(path) as session:
        return [event for event in session.events() if event.kind == RESTART]


def replayed(path):
    replay = Replay(path, pace=None)
    replay.start()
    replay.wait(300)
    return replay.comparison()


def test_a_frame_that_fails_once_is_analysed_after_a_restart(tmp_path):
    outcome = run_with(tmp_path / "a.h5", lambda index: index == 40, 1)
    assert (outcome.state, outcome.counts.frames_skipped) == ("done", 0)
    assert [e.text for e in restarts(tmp_path / "a.h5")] == [
        "frame 40 could not be analysed (no minimum in frame 40)"
    ]
    comparison = replayed(tmp_path / "a.h5")
    assert comparison.all_identical, comparison.first_difference


def test_frames_that_always_fail_are_recorded_and_left_out(tmp_path):
    outcome = run_with(tmp_path / "a.h5", lambda index: index in (40, 41, 60))
    counts = outcome.counts
    assert (outcome.state, counts.frames_skipped) == ("done", 3)
    assert counts.frames_recorded == counts.triggers == counts.frames_analysed + 3
    assert outcome.summary is not None
    comparison = replayed(tmp_path / "a.h5")
    assert comparison.all_identical, comparison.first_difference
    assert comparison.frames == counts.frames_analysed


def test_an_analysis_that_only_fails_is_given_up_and_the_run_goes_on(tmp_path):
    outcome = run_with(tmp_path / "a.h5", lambda index: index >= 30)
    counts = outcome.counts
    assert (outcome.state, counts.frames_analysed) == ("done", 30)
    assert counts.frames_recorded == counts.triggers == 30 + counts.frames_skipped
    assert len(restarts(tmp_path / "a.h5")) == 40
    with SessionReader(tmp_path / "a.h5") as session:
        assert any("given up after 20 failures" in event.text for event in session.events())


def test_without_a_reference_nothing_is_dragged(tmp_path):
    outcome = run_with(tmp_path / "a.h5", lambda index: True)
    assert outcome.state == "failed"
    assert "could not be analysed (no minimum in frame" in outcome.reason
    assert outcome.counts.frames_skipped <= outcome.counts.frames_recorded
    with SessionReader(tmp_path / "a.h5") as session:
        assert "drive" not in [event.text for event in session.events()]
    assert threading.active_count() < 20
