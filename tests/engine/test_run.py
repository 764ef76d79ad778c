"""Whole runs on the simulated bench: what is recorded, what is repeated to the bit, and how a run
ends when something breaks.
"""

import threading
import time
from dataclasses import asdict

import h5py
import numpy as np
import pytest
from numpy.testing import assert_equal
from short_run import BLIND, DRIVE, SMALL, TRACTION
from whole_runs import replayed

from app.acquisition.recorder_thread import Recorder
from app.acquisition.run import Run
from app.evaluation import conclusions
from app.records.record_types import (
    REFERENCE,
    ContactResult,
    Event,
    FrameMotion,
    Phase,
    Snapshot,
)
from app.runs import live
from app.session.reader import SessionReader
from app.settings import config
from drivers.errors import DeviceFault
from drivers.protocols import LostFrame
from tests.same_results import difference

TIMEOUT = 400
SPENT = conclusions._spent


def run_to(path, *overrides, pace=None, sabotage=None):
    run = live.make_run(config.load(None, [*SMALL, *overrides]), path, pace=pace)
    if sabotage:
        sabotage(run)
    run.start()
    outcome = run.wait(TIMEOUT)
    assert outcome is not None, "the run did not end"
    return run, outcome


def content(path):
    with SessionReader(path) as s:
        return {
            "volts": s.forces().volts,
            "newtons": s.forces().forces,
            "positions": np.array(s.positions()[1]),
            "frames": [(index, sample, image.tobytes()) for index, sample, image in s.frames()],
            "events": s.events(),
            "snapshots": {snapshot.frame: snapshot for snapshot in s.snapshots()},
        }


def same(a, b):
    return difference(a, b) == ""


def alike(a, b, share):
    """Whether all that was not measured in the image is the same, and u_x differs by less than that
    share of its uncertainty.
    """
    bench = [
        Snapshot(s.frame, s.sample, s.conditions, s.motion and FrameMotion(s.motion.lens_m, 0.0))
        for s in (a, b)
    ]
    if not same(*bench) or a.field is None or b.field is None:
        return same(*bench) and a.field is b.field
    change = (a.field.ux_px - b.field.ux_px) / a.field.ux_std_px
    same_points = np.array_equal(a.field.status, b.field.status)
    return same_points and np.sqrt(np.nanmean(change**2)) < share


def test_a_run_ends_done_with_every_trigger_and_sample_accounted_for(small_run):
    path, outcome = small_run
    assert (outcome.state, outcome.reason) == ("done", "the drive of 60 um is complete")
    counts = outcome.counts
    assert (
        counts.triggers
        == counts.frames_received
        == counts.frames_recorded
        == counts.frames_analysed
        > 80
    )
    assert counts.frames_lost == counts.frames_skipped == counts.samples_lost == 0
    recorded = content(path)
    assert len(recorded["volts"]) == counts.samples
    assert [f[0] for f in recorded["frames"]] == list(range(counts.triggers))
    assert all(sample == 125 * index for index, sample, _ in recorded["frames"])
    assert [e.text for e in recorded["events"] if e.kind == "phase"] == list(Phase)


def test_the_contact_is_recorded_as_soon_as_it_is_known(tmp_path, monkeypatch):
    """A run that is cut short in its drive has it."""
    told, append = [], Recorder.append
    monkeypatch.setattr(Recorder, "append", lambda self, one: (told.append(one), append(self, one)))
    run_to(tmp_path / "a.h5", *BLIND, "run.travel=1")
    kinds = [type(one) for one in told]
    before = told[: kinds.index(ContactResult)]
    reference = next(one.number for one in told if isinstance(one, Event) and one.kind == REFERENCE)
    assert kinds.count(ContactResult) == 1
    assert max(one.frame for one in before if isinstance(one, Snapshot)) == reference
    with SessionReader(tmp_path / "a.h5") as s:
        assert s.contact() is not None


def test_the_summary_is_the_simulated_truth(small_run):
    summary = small_run[1].summary
    assert summary.mu_s == pytest.approx(0.93, rel=0.02)
    assert summary.mu_d == pytest.approx(0.93, rel=0.02)
    assert summary.normal_force_n == pytest.approx(0.1, rel=0.01)
    assert summary.sliding_velocity_m_s == pytest.approx(4.9e-6, rel=0.01)
    assert summary.onset_time_s == pytest.approx(5.5, rel=0.03)
    assert any("Q_s from" in note and "samples of the" in note for note in summary.notes)


@pytest.mark.slow
def test_two_runs_are_equal_whatever_the_pace(small_run, tmp_path):
    """Pace 40 stands for real time: the clock on the wall decides when blocks come and so which
    frames are skipped, and nothing else.
    """
    first = content(small_run[0])
    _, outcome = run_to(tmp_path / "b.h5", "limits.age=10", pace=40.0)
    second = content(tmp_path / "b.h5")
    assert outcome.counts.triggers == small_run[1].counts.triggers
    for name in ("volts", "newtons", "positions"):
        assert np.array_equal(first[name], second[name]), name
    assert first["frames"] == second["frames"]
    both = first["snapshots"].keys() & second["snapshots"].keys()
    assert len(both) > 10
    assert all(alike(first["snapshots"][n], second["snapshots"][n], 1.0) for n in both)
    assert replayed(tmp_path / "b.h5").comparison().all_identical


@pytest.mark.slow
def test_a_reference_that_takes_longer_than_forces_may_be_old_does_not_end_the_drive(tmp_path):
    def slow(run):
        take = run._analysis.pipeline._take_reference
        run._analysis.pipeline._take_reference = lambda *image: (time.sleep(1.5), take(*image))

    _, outcome = run_to(tmp_path / "a.h5", "limits.age=0.8", pace=40.0, sabotage=slow)
    assert outcome.state == "done", outcome.reason


def test_replay_gives_the_live_results_to_the_bit(tmp_path, monkeypatch):
    monkeypatch.setattr(conclusions, "_spent", SPENT)
    monkeypatch.setattr(conclusions, "BUDGET_FRAMES", 12)
    _, outcome = run_to(tmp_path / "whole.h5", TRACTION, "run.travel=48")
    assert "pixel size" in outcome.summary.budget_inputs
    assert outcome.summary.young_modulus_pa == pytest.approx(3.43e6, rel=0.01)
    replay = replayed(tmp_path / "whole.h5")
    assert replay.comparison().all_identical, replay.comparison()
    assert_equal(asdict(replay.outcome().summary), asdict(outcome.summary))


def test_replay_skips_what_the_live_run_skipped(small_run, tmp_path):
    """The fields depend on the frames before, in their last digits: the same frames give the same
    bits.
    """

    def sabotage(run):
        wait_for = run._history.wait_for
        run._history.wait_for = lambda sample, *at_most: (
            (sample // 125 < 60 or sample // 125 % 3 > 0) and wait_for(sample, *at_most)
        )

    _, outcome = run_to(tmp_path / "x.h5", sabotage=sabotage)
    assert outcome.counts.frames_skipped > 10
    replay = replayed(tmp_path / "x.h5")
    assert replay.comparison().all_identical, replay.comparison()
    assert replay.outcome().counts == outcome.counts
    whole, holed = content(small_run[0])["snapshots"], content(tmp_path / "x.h5")["snapshots"]
    assert not all(same(whole[n], s) for n, s in holed.items())


@pytest.mark.slow
def test_a_session_from_before_there_was_a_choice_of_method_replays_to_the_bit(tmp_path):
    """Its settings name no method, its fields have no uncertainties: it was measured by the direct
    search.
    """
    new = (
        "method",
        "order",
        "tolerance",
        "max_saturated",
        "full_scale",
    )
    new += ("update", "update_every", "update_below")
    direct = "dic.method=direct", "dic.search=16", "dic.step=20"
    _, outcome = run_to(tmp_path / "old.h5", "run.travel=30", *direct)
    with h5py.File(tmp_path / "old.h5", "r+") as file:
        file.attrs["slipscope_format"] = 1
        del file["/entry/fields/ux_errors"], file["/entry/fields/uy_errors"]
        toml = file["/entry/settings/toml"]
        toml[()] = "\n".join(
            line
            for line in toml.asstr()[()].splitlines()
            if line.partition(" = ")[0] not in new or line == 'method = "none"'  # of the traction
        )
    replay = replayed(tmp_path / "old.h5")
    assert (replay.config.dic.method, replay.config.dic.search) == ("direct", 16)
    assert replay.comparison().all_identical, replay.comparison()
    assert_equal(asdict(replay.outcome().summary), asdict(outcome.summary))


def test_another_seed_is_another_run(small_run, tmp_path):
    run_to(tmp_path / "c.h5", "sim.seed=2", "run.travel=5")
    other = content(tmp_path / "c.h5")
    assert not np.array_equal(other["volts"], content(small_run[0])["volts"][: len(other["volts"])])


class Journal:
    """Wraps the actuator to know in which order things were asked of it."""

    def __init__(self, run):
        self.calls = []
        actuator = run._bench.actuator
        for name in ("stop", "move_to", "close"):
            setattr(actuator, name, self._noted(name, getattr(actuator, name)))

    def _noted(self, name, method):
        def call(*args):
            self.calls.append(name)
            return method(*args)

        return call


def in_drive(run, action):
    """Do `action` once, from the thread that reads the forces, half a second into the drive, when
    all that was read before is written.
    """
    read, done = run._bench.forces.read, []

    def wrapped(timeout):
        block = read(timeout)
        began = run._history.phase_start(Phase.DRIVE)
        if not done and began is not None and block.end > began + 500:
            done.append(True)
            while run._workers.recorder.fill:
                time.sleep(0.001)
            action()
        return block

    run._bench.forces.read = wrapped


def broken(method):
    def fail(*args, **kwargs):
        raise DeviceFault(f"{method}: it went away; plug it in again")

    return fail


def stopped_by_itself(journal):
    return "stop" in journal.calls[journal.calls.index("move_to") :]


@pytest.mark.slow
@pytest.mark.parametrize(
    "culprit", ["forces.read", "forces.backlog", "camera.read", "actuator.position_m"]
)
def test_a_device_that_fails_in_the_drive_ends_the_run_by_name(culprit, tmp_path):
    device, method = culprit.split(".")
    journals = []

    def sabotage(run):
        journals.append(Journal(run))
        in_drive(run, lambda: setattr(getattr(run._bench, device), method, broken(culprit)))

    _, outcome = run_to(tmp_path / "x.h5", *BLIND, sabotage=sabotage)
    assert outcome.state == "failed"
    assert outcome.reason == f"{culprit}: it went away; plug it in again"
    assert stopped_by_itself(journals[0])
    with SessionReader(tmp_path / "x.h5") as s:
        assert (s.outcome.state, s.outcome.reason) == ("failed", outcome.reason)
        assert len(s.forces().volts) == outcome.counts.samples
    assert outcome.counts.triggers == outcome.counts.frames_received + outcome.counts.frames_lost


@pytest.mark.parametrize(
    ("where", "words"),
    [
        (
            lambda run: setattr(
                run._workers.recorder._sink,
                "append",
                lambda *a: (_ for _ in ()).throw(OSError(28, "No space left")),
            ),
            "No space left",
        ),
        (lambda run: setattr(run._experiment, "advance", lambda *a: 1 / 0), "ZeroDivisionError"),
    ],
)
def test_an_exception_anywhere_stops_the_actuator_first(where, words, tmp_path):
    journals = []

    def sabotage(run):
        journals.append(Journal(run))
        in_drive(run, lambda: where(run))

    _, outcome = run_to(tmp_path / "x.h5", *BLIND, sabotage=sabotage)
    assert outcome.state == "failed"
    assert words in outcome.reason
    assert stopped_by_itself(journals[0])
    assert "Traceback" not in outcome.reason
    with SessionReader(tmp_path / "x.h5") as s:
        assert len(s.forces().volts) > DRIVE


def test_stop_motion_stops_in_the_calling_thread(tmp_path):
    stopped, others = [], set(threading.enumerate())

    def sabotage(run):
        journal = Journal(run)

        def press():
            run.stop_motion()
            stopped.append(stopped_by_itself(journal))

        in_drive(run, press)

    _run, outcome = run_to(tmp_path / "x.h5", *BLIND, sabotage=sabotage)
    assert stopped == [True]
    assert (outcome.state, outcome.reason) == ("done", "STOP MOTION was pressed")
    assert outcome.counts.frames_lost == 0
    left = set(threading.enumerate()) - others
    assert not [t.name for t in left if t.name.startswith("slipscope")]


def test_a_limit_ends_the_run_by_name(tmp_path):
    _, outcome = run_to(tmp_path / "x.h5", *BLIND, "limits.shear_force=0.05")
    assert outcome.state == "failed"
    assert "limits.shear_force is 0.05 N" in outcome.reason
    with SessionReader(tmp_path / "x.h5") as s:
        assert s.forces().forces[:, 1].max() < 0.06


def test_the_actuator_is_asked_for_the_run_s_travel_and_no_more(tmp_path):
    asked = []

    def sabotage(run):
        actuator = run._bench.actuator
        move = actuator.move_to

        def noted(target):
            asked.append(target - actuator.position_m())
            move(target)

        actuator.move_to = noted

    run_to(tmp_path / "x.h5", *BLIND, "run.travel=5", sabotage=sabotage)
    assert asked == [pytest.approx(5e-6, abs=1e-9)]


class Jogged:
    """Moves the scale of the stage in one phase, as a jog by hand does, or one reading of it."""

    def __init__(self, run, phase, by_m, *, once=False):
        self.run, self.phase, self.by_m, self.once = run, phase, by_m, once
        self.is_over, self.offset, self.asked = False, 0.0, []
        self.position, self.move = run._bench.actuator.position_m, run._bench.actuator.move_to
        run._bench.actuator.position_m, run._bench.actuator.move_to = self.read, self.go

    def read(self):
        misread = 0.0
        if self.run._experiment.phase is self.phase and not self.is_over:
            self.is_over = True
            misread = self.by_m * self.once
            self.offset = self.by_m * (not self.once)
        return self.position() + self.offset + misread

    def go(self, target):
        self.asked.append(target - self.position() - self.offset)
        self.move(target - self.offset)


@pytest.mark.parametrize("by_m", [-400e-6, 900e-6])
def test_a_jog_before_the_drive_does_not_change_its_travel(tmp_path, by_m):
    jogs = []
    _, outcome = run_to(
        tmp_path / "x.h5",
        *BLIND,
        "run.travel=5",
        sabotage=lambda run: jogs.append(Jogged(run, Phase.CONTACT, by_m)),
    )
    assert (outcome.state, outcome.reason) == ("done", "the drive of 5 um is complete")
    assert jogs[0].asked == [pytest.approx(5e-6, abs=1e-9)]


def test_a_misread_position_begins_no_drive(tmp_path):
    jogs = []

    def sabotage(run):
        jogs.append(Jogged(run, Phase.DRIVE, 2547e-6, once=True))

    _, outcome = run_to(tmp_path / "x.h5", *BLIND, "run.travel=5", sabotage=sabotage)
    assert outcome.state == "failed"
    assert "the drive was to begin where the stage stands" in outcome.reason
    assert jogs[0].asked == []


def test_a_stage_that_is_driven_by_something_else_in_the_drive_ends_the_run(tmp_path):
    for by_m in (-20e-6, 100e-6):
        _, outcome = run_to(
            tmp_path / f"{by_m}.h5",
            *BLIND,
            sabotage=lambda run, by_m=by_m: in_drive(
                run, lambda: setattr(Jogged(run, None, 0.0), "offset", by_m)
            ),
        )
        assert outcome.state == "failed"
        assert "run.travel is 60 um; let nothing else move it" in outcome.reason


def test_too_many_lost_frames_end_the_run_by_name(tmp_path):
    _, outcome = run_to(tmp_path / "x.h5", *BLIND, "sim.faults=['lost-frame 22 6']")
    assert outcome.state == "failed"
    assert "6 of 28 triggers have no image, limits.lost_frames is 0.2" in outcome.reason


@pytest.mark.slow
def test_a_lost_frame_keeps_its_index_and_shifts_nothing(small_run, tmp_path):
    def sabotage(run):
        read = run._bench.camera.read

        def lossy(timeout):
            answer = read(timeout)
            return (
                LostFrame(answer.index, answer.sample, "cable")
                if answer.index in (40, 41)
                else answer
            )

        run._bench.camera.read = lossy

    _, outcome = run_to(tmp_path / "x.h5", sabotage=sabotage)
    assert (outcome.state, outcome.counts.frames_lost) == ("done", 2)
    whole, holed = content(small_run[0]), content(tmp_path / "x.h5")
    assert [f for f in whole["frames"] if f[0] not in (40, 41)] == holed["frames"]
    assert all(
        same(whole["snapshots"][n], s) if n < 40 else alike(whole["snapshots"][n], s, 0.1)
        for n, s in holed["snapshots"].items()
    )


def test_a_run_starts_once(tmp_path):
    run = live.make_run(config.load(None, [*SMALL, *BLIND]), tmp_path / "x.h5", pace=None)
    assert isinstance(run, Run)
    run.start()
    with pytest.raises(RuntimeError, match="make a new run"):
        run.start()
    run.request_stop("enough")  # before it began or after
    assert run.wait(TIMEOUT).reason.endswith("enough")
