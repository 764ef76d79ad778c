"""An analysis that fails on frames never ends what is measured."""

import threading

import pytest
import short_run
from short_run import TRACTION
from whole_runs import ended, replayed

from app.acquisition import analysis_thread
from app.evaluation import conclusions, pictures_at_rest, pipeline
from app.evaluation.pipeline import Pipeline
from app.records.record_types import RESTART, Phase
from app.runs import live
from app.session.reader import SessionReader
from app.settings import config
from app.system.errors import UserError

SMALL = (*short_run.SMALL, "run.travel=30")


class Fragile(Pipeline):
    """Fails on some frames, the first `times` that it is given them."""

    def __init__(self, settings, fragile, times):
        super().__init__(settings)
        self.fragile, self.times, self.tried = fragile, times, {}

    def step(self, index, sample, image, now, *effort):
        if self.fragile(index):
            self.tried[index] = self.tried.get(index, 0) + 1
            if self.tried[index] <= self.times:
                raise FloatingPointError(f"no minimum in frame {index}")
        return super().step(index, sample, image, now, *effort)


def run_with(path, fragile, times=99, *, more=()):
    settings = config.load(None, [*SMALL, *more])
    run = live.make_run(settings, path, pace=None, pipeline=Fragile(settings, fragile, times))
    return ended(run)


def restarts(path):
    with SessionReader(path) as session:
        return [event for event in session.events() if event.kind == RESTART]


def test_a_frame_that_fails_once_is_analysed_after_a_restart(tmp_path):
    outcome = run_with(tmp_path / "a.h5", lambda index: index == 40, 1)
    assert (outcome.state, outcome.counts.frames_skipped) == ("done", 0)
    assert [e.text for e in restarts(tmp_path / "a.h5")] == [
        "frame 40 could not be analysed (no minimum in frame 40)"
    ]
    comparison = replayed(tmp_path / "a.h5").comparison()
    assert comparison.all_identical, comparison.first_difference


@pytest.mark.slow
def test_what_was_begun_before_a_restart_is_done_again(tmp_path, monkeypatch):
    measure, followed = Pipeline._measure, []

    def fragile(self, snapshot, *rest):
        if snapshot.frame > 40 and not followed and self._fields._begun is not None:
            followed.append(snapshot.frame)
            raise FloatingPointError("no minimum")
        return measure(self, snapshot, *rest)

    monkeypatch.setattr(Pipeline, "_measure", fragile)
    outcome = run_with(tmp_path / "a.h5", lambda index: False)
    assert (outcome.state, outcome.counts.frames_skipped) == ("done", 0)
    assert len(restarts(tmp_path / "a.h5")) == len(followed) == 1
    monkeypatch.setattr(Pipeline, "_measure", measure)
    comparison = replayed(tmp_path / "a.h5").comparison()
    assert comparison.all_identical, comparison.first_difference


@pytest.mark.slow
def test_frames_that_always_fail_are_recorded_and_left_out(tmp_path):
    outcome = run_with(tmp_path / "a.h5", lambda index: index in (40, 41, 60))
    counts = outcome.counts
    assert (outcome.state, counts.frames_skipped) == ("done", 3)
    assert counts.frames_recorded == counts.triggers == counts.frames_analysed + 3
    assert outcome.summary is not None
    comparison = replayed(tmp_path / "a.h5").comparison()
    assert comparison.all_identical, comparison.first_difference
    assert comparison.frames == counts.frames_analysed


def test_an_analysis_that_only_fails_is_given_up_and_the_run_goes_on(tmp_path, monkeypatch):
    monkeypatch.setattr(analysis_thread, "MOST_FAILURES", 4)
    outcome = run_with(tmp_path / "a.h5", lambda index: index >= 30)
    counts = outcome.counts
    assert (outcome.state, counts.frames_analysed) == ("done", 30)
    assert counts.frames_recorded == counts.triggers == 30 + counts.frames_skipped
    assert len(restarts(tmp_path / "a.h5")) == 8
    with SessionReader(tmp_path / "a.h5") as session:
        assert any("given up after 4 failures" in event.text for event in session.events())


def test_without_a_reference_nothing_is_dragged(tmp_path):
    outcome = run_with(tmp_path / "a.h5", lambda index: True)
    assert outcome.state == "failed"
    assert "could not be analysed (no minimum in frame" in outcome.reason
    assert outcome.counts.frames_skipped <= outcome.counts.frames_recorded
    failed = {event.sample for event in restarts(tmp_path / "a.h5")}
    assert len(failed) == analysis_thread.MOST_BEFORE_REFERENCE
    with SessionReader(tmp_path / "a.h5") as session:
        assert "drive" not in [event.text for event in session.events()]
    assert threading.active_count() < 20


def test_no_estimator_ends_a_run_or_costs_a_frame(tmp_path, monkeypatch):
    """Each fails in every frame, on what numpy says of rings of two lengths."""

    def fail(*_, **__):
        raise ValueError("operands could not be broadcast together with shapes (3,) (2,)")

    def of(*_, **__):
        raise MemoryError("629 GiB")

    monkeypatch.setattr(pictures_at_rest, "apparent_contact", fail)
    monkeypatch.setattr(pipeline, "fit_stick_radius", fail)
    for name in ("sliding_onset", "inverted"):
        monkeypatch.setattr(conclusions, name, fail)
    monkeypatch.setattr(pipeline.Tractions, "of", of)
    outcome = run_with(tmp_path / "a.h5", lambda _: False, more=[TRACTION])
    assert (outcome.state, outcome.counts.frames_skipped) == ("done", 0), outcome.reason
    for what in ("contact", "stick radius", "onset", "local law", "shear traction"):
        (note,) = [note for note in outcome.summary.notes if note.startswith(f"{what} failed")]
        assert "could not be broadcast" in note or "MemoryError: 629 GiB" in note
    with SessionReader(tmp_path / "a.h5") as session:
        assert len(session.analysed_frames()) == outcome.counts.frames_recorded


def test_tractions_that_can_not_be_prepared_are_done_without(tmp_path, monkeypatch):
    def fail(*_, **__):
        raise MemoryError("629 GiB")

    monkeypatch.setattr(pipeline.Tractions, "__init__", fail)
    outcome = run_with(tmp_path / "a.h5", lambda _: False, more=[TRACTION])
    assert (outcome.state, outcome.counts.frames_skipped) == ("done", 0), outcome.reason
    assert "no shear traction was computed: 629 GiB" in outcome.summary.notes


def test_a_restart_that_fails_is_tried_again_at_the_next_step(tmp_path, monkeypatch):
    take, times = Pipeline._take_reference, []

    def failing(self, *arguments):
        times.append(1)
        if len(times) == 2:
            raise MemoryError("none left")
        take(self, *arguments)

    monkeypatch.setattr(Pipeline, "_take_reference", failing)
    outcome = run_with(tmp_path / "a.h5", lambda index: index == 40, 1)
    assert (outcome.state, outcome.counts.frames_skipped) == ("done", 0), outcome.reason
    with SessionReader(tmp_path / "a.h5") as session:
        drive = [one for one in session.snapshots() if one.conditions.phase is Phase.DRIVE]
    assert drive
    assert all(snapshot.field is not None for snapshot in drive)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        (["forces.block=10000", "forces.sample_rate=100", "camera.divisor=12"], "forces.block"),
        (["sample.thickness=0.0001", TRACTION], r"sample\.thickness .* use 0\.16 mm or more"),
        (["sample.thickness=0.4", TRACTION, "stress.field=true"], "use 0.48 mm or more"),
    ],
)
def test_settings_that_are_known_to_fail_are_refused_by_name(tmp_path, settings, words):
    with pytest.raises(UserError, match=words):
        live.make_run(config.load(None, [*SMALL, *settings]), tmp_path / "a.h5", pace=None)
