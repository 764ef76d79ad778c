"""A run outlives its window and its analysis; what nobody reads is recorded all the same."""

import contextlib
import signal
import sys
import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest
import whole_runs
from processes.launched import (
    PATIENT_S,
    Program,
    bench_of,
    drives,
    kill,
    launched,
    wait_until,
    whole,
)
from short_run import BLIND, SMALL

from app.cli import run_commands as commands
from app.processes import launch
from app.processes.calls import Silent
from app.processes.client import LaunchedRun
from app.processes.folder import root, running
from app.processes.pipeline_process import PipelineProcess
from app.processes.starting import ProcessFailed, start_process, wait_until_ready
from app.records.record_types import NOTE, RESTART, Snapshot
from app.records.summary import Summary
from app.replay.replay import Replay
from app.session.reader import SessionReader
from app.settings import config
from app.system.errors import UserError
from app.system.stopping import Stop

posix = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")


def test_a_busy_computer_has_time_to_conclude(tmp_path):
    """Ten times as long as a quiet one needs, and more."""
    waits = {}

    def answer(name, *arguments, answer_s):
        waits[name] = answer_s
        return object.__new__(Summary)

    pipeline = PipelineProcess(config.load(None, SMALL), tmp_path, lambda number: None)
    pipeline._caller = answer
    pipeline.summary([])
    assert waits["summary"] >= 60


def test_a_frame_that_took_too_long_has_twice_the_time_in_the_next_process(tmp_path, monkeypatch):
    """A process that is started again on a busy computer would come no further in the same."""
    waits, answered = (
        [],
        SimpleNamespace(snapshot=object.__new__(Snapshot), contact=None, reference_frame=None),
    )

    def answer(name, *arguments, answer_s):
        waits.append(answer_s)
        if len(waits) not in {6, 8}:
            raise Silent("it computes")
        return answered

    pipeline = PipelineProcess(config.load(None, SMALL), tmp_path, lambda number: None)
    monkeypatch.setattr(pipeline, "wait", lambda: setattr(pipeline, "_caller", answer))
    image = np.zeros((360, 480), np.uint8)
    for _ in range(8):
        with contextlib.suppress(Silent):
            pipeline.step(0, 0, image, SimpleNamespace(phase=None), None)
    assert waits == [20, 40, 80, 160, 160, 160, 20, 40]


def test_the_frame_that_follows_comes_once_and_beside_the_one_before(tmp_path, monkeypatch):
    pipeline = PipelineProcess(config.load(None, SMALL), tmp_path, lambda number: None)
    copied, seen = [], []
    copy = np.copyto

    def answer(name, index, sample, place, now, effort, after, answer_s):
        seen.append((pipeline._images[place].max(), after and pipeline._images[after[2]].max()))
        return SimpleNamespace(
            snapshot=object.__new__(Snapshot), contact=None, reference_frame=None
        )

    def copied_once(to, image):
        copied.append(image.max())
        copy(to, image)

    pipeline._caller = answer
    monkeypatch.setattr(np, "copyto", copied_once)
    images = [np.full((360, 480), n + 1, np.uint8) for n in range(4)]
    now = SimpleNamespace(phase=None)
    for n, after in ((0, 1), (1, 2), (1, 2), (2, None), (3, None)):
        follows = None if after is None else (after, 0, images[after], None)
        pipeline.step(n, 0, images[n], now, None, follows)
    assert seen == [(1, 2), (2, 3), (2, 3), (3, None), (4, None)]
    assert copied == [1, 2, 3, 2, 3, 4]


def replayed(path):
    """How the session replays."""
    comparison = whole_runs.replayed(path).comparison()
    return comparison.identical, comparison.frames, comparison.first_difference


@pytest.fixture(scope="module")
def ended(tmp_path_factory):
    """A run that went its way with one note, and everything that its window read of it."""
    path, looks = tmp_path_factory.mktemp("launched") / "a.h5", []
    with launched(path) as run:
        assert run.look().health.state == "idle"
        with pytest.raises(UserError, match="is not under way; nothing was recorded"):
            commands.note("too soon", str(path))
        run.note("nor this")
        run.start()
        is_noted = False
        while run.look().outcome is None:
            now = run.look(0)
            looks.append((now.health, now.image, len(now.snapshots)))
            if not is_noted and now.health.phase == "drive":
                assert commands.note("the door\nwas opened", str(path)) == 0
                with pytest.raises(UserError, match="asks nothing now; nothing was sent"):
                    commands.answer("yes", str(path))
                is_noted = True
            time.sleep(0.1)
        run.note("too late")
    return path, run, looks


@pytest.mark.slow
def test_a_run_in_processes_gives_what_one_in_this_process_gives(ended):
    path, run, _ = ended
    outcome, _ = whole(path)
    assert (outcome.state, outcome.reason) == ("done", "the drive of 60 um is complete")
    assert outcome.counts.frames_lost == outcome.counts.samples_lost == 0
    identical, frames, difference = replayed(path)
    assert identical == frames == outcome.counts.frames_analysed, difference
    assert run.look().outcome.summary.mu_s == pytest.approx(outcome.summary.mu_s)
    assert any("samples of the" in note for note in outcome.summary.notes)


def test_the_window_reads_everything_and_keeps_it_after_the_end(ended):
    _, run, looks = ended
    healths, images, seen = zip(*looks, strict=True)
    assert {"background", "contact", "reference", "drive"} <= {h.phase for h in healths}
    assert len({id(i) for i in images if i is not None}) > 20
    assert 0 < seen[len(seen) // 2] <= run.look().outcome.counts.frames_analysed
    assert len(run.look(0).snapshots) == run.look().outcome.counts.frames_analysed
    assert run.look(0).snapshots[-1].field is not None
    assert run.look().contact is not None
    assert len(run.look().forces[0]) > 50
    assert run.look().image.shape == (360, 480)
    assert run.look().health.state == "done"


def test_a_note_is_recorded_with_its_time_from_any_process(ended):
    path, run, _ = ended
    with SessionReader(path) as reader:
        notes = [event for event in reader.events() if event.kind == NOTE]
        drive = next(e.sample for e in reader.events() if e.kind == "phase" and e.text == "drive")
    assert [note.text for note in notes] == ["the door was opened"]
    assert drive < notes[0].sample < run.look().outcome.counts.samples
    marks = [mark for mark in Replay(path, pace=None).timeline.marks if mark.kind == NOTE]
    assert [(mark.sample, mark.text) for mark in marks] == [
        (notes[0].sample, "the door was opened")
    ]


def test_the_reference_image_is_that_of_the_correlation(ended):
    path, run, _ = ended
    with SessionReader(path) as session:
        (taken,) = (event for event in session.events() if event.kind == "reference")
        reference = session.frame(int(taken.text.removeprefix("frame ")))[2]
    assert np.array_equal(run.look().reference, reference)
    assert run.look().reference is run.look().reference


def test_nothing_is_left_of_a_bench_that_has_ended(ended):
    path, run, _ = ended
    assert bench_of(path) is None
    assert not (root() / run.bench.name).exists()


@pytest.mark.slow
@posix
def test_a_killed_analysis_is_started_again_and_the_file_says_so(tmp_path):
    path = tmp_path / "a.h5"
    with launched(path, "camera.divisor=250") as run:  # time to restart on a busy computer
        run.start()
        wait_until(lambda: drives(run, 10), "the drive")
        kill(killed := bench_of(path).analysis_pid)
        wait_until(lambda: bench_of(path).analysis_pid != killed, "another analysis")
        outcome = run.wait(PATIENT_S)
    assert outcome.state == "done", outcome.reason
    counts = outcome.counts
    assert counts.triggers == counts.frames_recorded
    assert counts.frames_analysed + counts.frames_skipped == counts.frames_recorded
    _, events = whole(path)
    (restart,) = (event.sample for event in events if event.kind == RESTART)
    with SessionReader(path) as session:
        samples = [snapshot.sample for snapshot in session.snapshots()]
    assert samples[-1] > restart  # it goes on
    identical, frames, difference = replayed(path)
    assert identical == frames == counts.frames_analysed, difference


@pytest.mark.slow
@posix
def test_a_run_outlives_its_killed_window_and_another_one_attaches(tmp_path):
    program = Program(tmp_path / "a.h5", "run.travel=30")
    first = program.run()
    wait_until(lambda: drives(first), "the drive")
    _, code = program.end(signal.SIGKILL)
    assert code == -signal.SIGKILL
    second = launch.attached(str(program.path))
    assert second.look().health.state == "running"
    assert len(second.look(0).snapshots) > 10
    outcome = second.wait(PATIENT_S)
    assert (outcome.state, outcome.reason) == ("done", "the drive of 30 um is complete")
    counts = outcome.counts
    assert counts.frames_recorded == counts.triggers
    identical, frames, difference = replayed(program.path)
    assert identical == frames == counts.frames_analysed > 10, difference


@pytest.mark.slow
@posix
def test_a_program_that_is_told_to_end_ends_its_run_in_good_order(tmp_path):
    """So it does with each of the signals, see tests/cli."""
    program = Program(tmp_path / "a.h5", *BLIND)
    run = program.run()
    wait_until(lambda: drives(run), "the drive")
    said, code = program.end(signal.SIGTERM)
    assert code == 0, said
    outcome, _ = whole(program.path)
    reason = "the program received the signal to end"
    assert (outcome.state, outcome.reason) == ("done", reason)


@pytest.mark.slow
@posix
def test_a_bench_that_is_told_to_end_does(tmp_path):
    with launched(tmp_path / "a.h5", *BLIND) as run:
        run.start()
        wait_until(lambda: drives(run), "the drive")
        kill(run.bench.pid, signal.SIGTERM)
        outcome = run.wait(PATIENT_S)
    assert (outcome.state, outcome.reason) == ("done", "the program received the signal to end")
    whole(tmp_path / "a.h5")


@pytest.mark.slow
def test_a_question_is_answered_from_any_process(tmp_path, capfd):
    question = '{do="ask", question="Is the block clean?", timeout=900}'
    steps = f'{question}, {{do="approach"}}, {{do="reference"}}, {{do="drive", travel=8}}'
    path = tmp_path / "a.h5"
    with launched(path, *BLIND, f"run.steps=[{steps}]", "sim.press_time=0.1", pace=5.0) as run:
        run.start()
        health = wait_until(lambda: (h := run.look().health).question and h, "the question")
        assert health.step == "1 of 4: ask: Is the block clean?"
        assert health.left_s != health.left_s  # nobody knows
        assert health.all_left_s == pytest.approx(2.0)
        assert commands.answer("quite", str(path)) == 0
        assert "Is the block clean? quite" in capfd.readouterr().err
        outcome = run.wait(PATIENT_S)
        assert outcome.reason == "all 4 steps are complete"
    with SessionReader(path) as reader:
        assert [e.text for e in reader.events() if e.kind == "answer"] == ["quite"]


def test_what_can_not_be_made_is_refused_before_anything_moves(tmp_path):
    (tmp_path / "a.h5").write_bytes(b"x")
    settings = config.load(None, SMALL)
    with pytest.raises(UserError, match="a session of that name exists"):
        LaunchedRun(settings, tmp_path / "a.h5", pace=1.0, overwrite=False)
    with pytest.raises(UserError, match=r"no bench of yours runs|running benches"):
        launch.attached("no such bench")
    assert not [b for b in running() if b.session.startswith(str(tmp_path))]


def test_a_process_that_does_not_begin_is_told_with_what_it_said(tmp_path):
    log = tmp_path / "log"
    process = start_process("app.processes.bench", "not an order", log)
    with pytest.raises(ProcessFailed, match=r"bench: its process ended .*: AttributeError"):
        wait_until_ready(process, log)
    process.stdin.close()
    process.stdout.close()


@pytest.mark.slow
def test_an_analysis_whose_bench_is_killed_before_it_calls_ends(tmp_path):
    process = start_process(
        "app.processes.analysis", (config.load(None, SMALL), tmp_path / "image", None)
    )
    wait_until_ready(process)
    process.stdin.close()  # as the system does it
    process.wait(30)
    process.stdout.close()


@pytest.mark.parametrize(("caller", "order"), [("_others", "note"), ("_ends", "request_stop")])
def test_a_stop_waits_for_no_other_order(tmp_path, caller, order):
    class Silent:
        def __init__(self):
            self.asked, self.answers, self.close = [], threading.Event(), close

        def __call__(self, name, *_, **__):
            self.asked.append(name)
            assert self.answers.wait(60)

    with launched(tmp_path / "a.h5", *BLIND) as run:
        run.start()
        close = getattr(run, caller).close
        silent = Silent()
        setattr(run, caller, silent)
        asks = threading.Thread(target=getattr(run, order), args=("the door",), daemon=True)
        asks.start()
        asks.join(0.5)
        assert silent.asked == [order]
        assert run.stop_motion().kind is not Stop.FAILED
        assert run.wait(PATIENT_S) is not None
        silent.answers.set()
        asks.join()


@pytest.mark.slow
def test_a_bench_that_nobody_starts_ends(tmp_path):
    with launched(tmp_path / "a.h5", *BLIND) as run:
        for caller in (run.looks, run._states, run.orders, run._ends, run._others):
            caller.close()
        wait_until(lambda: not run.bench.is_alive, "its end")
    assert not (tmp_path / "a.h5").exists()
