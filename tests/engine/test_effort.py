"""Runs that compute less than everything: what is recorded, and that a replay repeats it."""

import math
import time

import numpy as np
import pytest
from short_run import SMALL, TRACTION
from whole_runs import done, replayed

from app.evaluation.frame_analysis import Analysis
from app.evaluation.quality import LATEST_S, Quality
from app.records.effort import Product
from app.records.record_types import Phase
from app.replay.reanalysis import Reanalysis
from app.runs import live
from app.session.reader import SessionReader
from app.settings import config

SETTINGS = (*SMALL, TRACTION, "run.travel=40")
SUMMARY = Analysis.summary


@pytest.fixture(scope="module", autouse=True)
def _no_summaries():
    """The summary of a run takes longer than the run, and only two look at it."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(Analysis, "summary", lambda self: None)
        yield


def run_to(path, *settings, sabotage=lambda run: None):
    run = live.make_run(config.load(None, [*SETTINGS, *settings]), path, pace=None)
    sabotage(run)
    return done(run)


def content(path):
    with SessionReader(path) as session:
        return list(session.snapshots()), session.events()


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    path = tmp_path_factory.mktemp("whole") / "x.h5"
    run_to(path)
    return content(path)[0]


@pytest.fixture(scope="module")
def profiles(tmp_path_factory):
    path = tmp_path_factory.mktemp("profiles") / "x.h5"
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(Analysis, "summary", SUMMARY)
        return path, run_to(path, "recording.results=profiles")


@pytest.mark.slow
def test_profiles_are_recorded_without_fields_and_are_those_of_whole_fields(whole, profiles):
    path, outcome = profiles
    snapshots, _ = content(path)
    driven = [s for s in snapshots if s.conditions.phase is Phase.DRIVE and s.traction]
    assert len(driven) > 30
    for one in driven:
        assert one.field is None
        assert one.effort.products == Product.CONTACT | Product.SETTLED
        assert one.effort.took_s > 0
    by_frame = {s.frame: s for s in whole}
    # the same pictures: what differs is the far field that D and the smoothing would have had
    pairs = [(s.traction, by_frame[s.frame].traction) for s in driven]
    c = [(a.peak_radius_m - b.peak_radius_m) / a.peak_radius_sd_m for a, b in pairs]
    force = [(a.stress_force_n - b.stress_force_n) / a.stress_force_sd_n for a, b in pairs]
    assert np.nanmedian(np.abs(c)) < 0.5
    assert np.median(np.abs(force)) < 0.5
    assert outcome.summary.mu_d > 0


def test_a_replay_computes_what_the_run_has_computed_to_the_bit(profiles):
    comparison = replayed(profiles[0]).comparison()
    assert comparison.all_identical, comparison.first_difference
    assert comparison.frames > 30


def test_a_further_analysis_computes_all_fields(profiles, whole):
    path = profiles[0]
    done(Reanalysis(path, path.with_name("again.h5"), pace=None))
    snapshots, _ = content(path.with_name("again.h5"))
    assert [s.frame for s in snapshots if s.field] == [s.frame for s in whole if s.field]
    last = next(s for s in reversed(snapshots) if s.field)
    held = next(s for s in whole if s.frame == last.frame)
    np.testing.assert_array_equal(last.field.ux_px, held.field.ux_px)


@pytest.mark.slow
def test_forces_alone_need_no_correlation(tmp_path, monkeypatch):
    monkeypatch.setattr(
        "app.evaluation.pipeline.open_tracker", lambda *_: pytest.fail("images were correlated")
    )
    monkeypatch.setattr(Analysis, "summary", SUMMARY)
    outcome = run_to(tmp_path / "x.h5", "recording.results=forces")
    snapshots, _ = content(tmp_path / "x.h5")
    assert not any(s.motion or s.field or s.rings or s.stick or s.traction for s in snapshots)
    assert max(s.conditions.shear_force_n for s in snapshots) > 0.05
    assert outcome.summary.apparent_radius_m > 0  # of the two pictures that everything rests on
    assert replayed(tmp_path / "x.h5").comparison().all_identical


@pytest.mark.slow
def test_a_window_that_opens_during_a_run_of_forces_is_shown_fields(tmp_path):
    def sabotage(run):
        step = run._analysis.pipeline.step

        def shown_late(index, *rest):
            if index > 40:
                run.look(0, is_shown=True)
            return step(index, *rest)

        run._analysis.pipeline.step = shown_late

    run_to(tmp_path / "x.h5", "recording.results=forces", sabotage=sabotage)
    snapshots, _ = content(tmp_path / "x.h5")
    assert {bool(s.rings) for s in snapshots if s.frame > 45} == {True}
    assert {bool(s.rings) for s in snapshots if s.frame < 40} == {False}
    assert replayed(tmp_path / "x.h5").comparison().all_identical


class BusyProcessor(Quality):
    """Decides as on a processor that soon has other things to do: then a frame takes 0.12 s, of one
    pass 0.02 s, which is said and not measured.
    """

    def __init__(self, config):
        super().__init__(config, pace=1.0)
        self.told, self.now_s = [], 0.0

    def took(self, waited_s, took_s, skipped, now_s):
        self.told.append((waited_s, took_s))
        is_whole = len(self.told) > 30 and self.effort().products & Product.SETTLED
        took_s = 0.12 if is_whole else 0.02
        self.now_s += max(took_s, self.period_s)
        return super().took(0.0, took_s, 0, self.now_s)


@pytest.mark.slow
def test_a_slow_processor_is_given_less_which_is_recorded_and_repeated(tmp_path):
    settings = "dic.quality=auto", "camera.divisor=50"
    busy = BusyProcessor(config.load(None, (*SETTINGS, *settings)))

    def sabotage(run):
        run._quality = busy
        step = run._analysis.pipeline.step

        def slower(index, *rest):
            time.sleep(0.02 * (index > 40))
            return step(index, *rest)

        run._analysis.pipeline.step = slower

    path = tmp_path / "x.h5"
    run_to(path, *settings, sabotage=sabotage)
    snapshots, events = content(path)
    assert max(s.effort.shed for s in snapshots) == 4
    shed = [s for s in snapshots if s.effort.shed == 4]
    assert len(shed) > 20
    assert all(s.effort.products == Product.CONTACT for s in shed)
    assert all(s.rings is not None and s.traction is not None for s in shed[3:])
    first = next(e.text for e in events if e.kind == "quality")
    assert first.startswith("left out: every second redraw; ")
    # what a frame has cost is measured, recorded and what is decided by
    costs = [(s.effort.waited_s, s.effort.took_s) for s in snapshots]
    assert costs[-100:] == busy.told[-100:]
    assert all(s.effort.took_s > 0.02 for s in snapshots if s.frame > 40)
    comparison = replayed(path).comparison()
    assert comparison.all_identical, comparison.first_difference


def test_no_frame_of_a_drive_waits_until_it_is_late(tmp_path):
    run = live.make_run(
        config.load(None, [*SETTINGS, "dic.quality=auto"]), tmp_path / "x.h5", pace=1.0
    )
    depth = run._to_analysis.depth
    run._hurry()
    assert 1 <= run._to_analysis.depth < depth
    assert run._to_analysis.depth / run.config.frame_rate_hz <= LATEST_S / 2


def test_where_everything_is_computed_frames_wait_until_they_are_too_many(tmp_path):
    used = config.load(None, [*SETTINGS, "camera.divisor=42"])
    run = live.make_run(used, tmp_path / "x.h5", pace=1.0)
    channel, rate_hz = run._to_analysis, run.config.frame_rate_hz
    run._hurry()
    for _ in range(math.ceil(1.5 * rate_hz) + 1):
        channel.put(object())
    assert channel.depth == math.ceil(1.5 * rate_hz) + 1
    assert channel.skipped == 0
    channel.put(object())
    waiting = math.ceil(1.5 * rate_hz) + 2 - channel.skipped
    assert 2 <= waiting + 1 <= round(rate_hz * LATEST_S / 2), "one more is begun beside another"


@pytest.mark.parametrize(("share", "is_cut"), [(0.9, False), (1.1, True)])
def test_an_analysis_slower_than_the_frames_come_is_found_out(share, is_cut, tmp_path, monkeypatch):
    run = live.make_run(config.load(None, SETTINGS), tmp_path / "x.h5", pace=2.0)
    now_s = [100.0]
    monkeypatch.setattr("app.acquisition.channels.time.monotonic", lambda: now_s[0])
    channel, rate_hz = run._to_analysis, run.config.frame_rate_hz
    run._hurry()
    for _ in range(channel.depth):
        channel.put(object())
    for _ in range(10):
        channel.get(0)
        now_s[0] += share / (2.0 * rate_hz)  # at twice the pace they come twice as often
        channel.put(object())
    assert bool(channel.skipped) == is_cut
