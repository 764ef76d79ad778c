"""A bench that is connected in a process of its own: it frees its devices for the run that follows,
and a process that dies hurts nobody.
"""

import math
import os
import signal
import sys
import threading
import time
from contextlib import contextmanager
from types import SimpleNamespace

import psutil
import pytest
from processes.launched import PATIENT_S, SETTINGS, OutsideStage, kill, wait_until
from short_run import SMALL

from app.gui.run_factory import RunFactory
from app.processes import preview as preview_process, urgent
from app.processes.calls import Silent
from app.processes.client import LaunchedPreview
from app.processes.folder import root
from app.processes.preview import ServedPreview
from app.records.bench_view import DeviceState, StageTask
from app.runs.live import make_run
from app.settings import config
from app.system.errors import UserError
from app.system.stopping import Stop
from drivers.errors import DeviceError

posix = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
EMULATED = (
    "forces.source=nidaqmx-emulated",
    "camera.source=pylon-emulated",
    "actuator.source=smc100-emulated",
)
FAST = 100e-6


@contextmanager
def connected(*overrides):
    preview = LaunchedPreview(config.load(None, [*SMALL, *overrides]))
    try:
        yield preview
    finally:
        preview.close()


def ready(preview):
    """What a bench shows as soon as it shows all."""

    def shows_all():
        view = preview.look()
        failed = [d.sentence for d in view.devices.values() if d.state is DeviceState.FAILED]
        assert not failed
        return view if view.picture and view.forces and view.stage else None

    return wait_until(shows_all, "the bench")


def jog(preview, way_um):
    """Jog a bench that is ready, until its stage has gone that far."""
    start = ready(preview).stage.position_m
    while (preview.look().stage.position_m - start) * 1e6 <= way_um:
        preview.jog(1, FAST)
        time.sleep(0.05)


def test_a_run_follows_a_preview_of_the_same_bench(tmp_path, memory):
    settings = config.load(None, [*SMALL, *EMULATED])
    made = []
    factory = RunFactory(made.append)
    preview = factory.preview(settings)
    try:
        jog(preview, 10)
        assert factory.stop_others(None) is None
        of_another_window = RunFactory(made.append).stop_others(None)
        assert of_another_window.kind is Stop.AT_REST
        assert of_another_window.sentence.endswith("without a run)")
        wait_until(lambda: not preview.look().stage.is_moving, "its rest")
        assert urgent.stop(None) == ([of_another_window.sentence], False)
        run = factory.run(settings, tmp_path / "a.h5")  # closes the preview
        assert preview.process.poll() is not None
        with pytest.raises(DeviceError, match="disconnected"):
            preview.look()
        run.start()
        wait_until(lambda: run.look().health.state == "running", "the run")
        run.request_stop("it is enough")
        assert run.wait(60).state == "done"
    finally:
        preview.close()


def test_a_run_lets_go_of_the_bench_first_and_only_the_first_replaces_its_file(
    monkeypatch, tmp_path
):
    did = []

    def made(settings, path, pace, may_replace):
        did.append((path.name, may_replace))
        return SimpleNamespace(source=None)

    monkeypatch.setattr("app.processes.prepared.prepared_run", made)
    closes = SimpleNamespace(close=lambda: did.append("closed"))
    monkeypatch.setattr("app.processes.client.LaunchedPreview", lambda settings: closes)
    factory, session = RunFactory(lambda run: None, overwrite=True), tmp_path / "a.h5"
    session.touch()
    factory.preview(config.Config())
    for _ in range(2):
        factory.run(config.Config(), session)
    assert did == ["closed", ("a.h5", True), ("a-2.h5", False)]


@pytest.mark.slow
def test_a_stage_on_a_real_line_is_free_for_the_run_and_for_nobody_before(tmp_path):
    outside = OutsideStage()
    settings = config.load(None, [*SETTINGS, *outside.settings])
    with connected(*outside.settings) as preview:
        ready(preview)
        run = make_run(settings, tmp_path / "a.h5", pace=1.0)
        run.start()
        assert "another program has" in run.wait(PATIENT_S).reason
        preview.close()
        assert preview.process.poll() is not None
        run = make_run(settings, tmp_path / "b.h5", pace=1.0)
        run.start()
        wait_until(lambda: run.health().state == "running", "the run")
        run.request_stop("it is enough")
        assert run.wait(60).state == "done"


@posix
def test_a_preview_that_is_killed_stops_its_stage_and_frees_it():
    outside = OutsideStage()
    with connected(*outside.settings) as preview:
        jog(preview, 5)
        kill(preview.process.pid)
        wait_until(outside.stops, "the supervisor's stop")
        with pytest.raises(
            DeviceError, match=r"its process .* has ended, and its devices are free"
        ):
            wait_until(preview.look)
        answer = preview.stop_motion()
        assert answer.kind is Stop.SENT
        assert "was sent by the supervisor" in answer.sentence
        wait_until(lambda: not outside.stage.is_moving(), "the stage's rest")
    with connected(*outside.settings) as again:
        ready(again)


@pytest.mark.slow
def test_nothing_is_left_of_a_preview_that_was_closed():
    threads = threading.active_count()
    with connected() as preview:
        ready(preview)
    assert not (root() / preview.bench.name).exists()
    assert preview.process.poll() is not None
    wait_until(lambda: threading.active_count() <= threads, "the end of its threads")


def test_a_window_that_lets_go_without_a_word_frees_the_bench():
    preview = LaunchedPreview(config.load(None, SMALL))
    ready(preview)
    for caller in (preview._look, preview._jog, preview.orders, preview._zero):
        caller.close()
    wait_until(lambda: preview.process.poll() is not None, "its end")
    assert not (root() / preview.bench.name).exists()


def test_a_bench_that_can_not_be_made_says_why():
    stored = ("forces.source=replay", "replay.session=nowhere.h5")
    with pytest.raises(UserError, match=r"nowhere\.h5"):
        LaunchedPreview(config.load(None, [*SMALL, *stored]))


@posix
def test_an_order_to_a_suspended_bench_that_nobody_waits_for_is_not_carried_out():
    with connected() as preview:
        place = ready(preview).stage.position_m
        os.kill(preview.process.pid, signal.SIGSTOP)
        process = psutil.Process(preview.process.pid)
        wait_until(lambda: process.status() == psutil.STATUS_STOPPED, "the suspension")
        goal, speed = place + 50e-6, 5e-6
        with pytest.raises(Silent):
            preview._call(preview._jog, "move", goal, speed, answer_s=0.3)
        os.kill(preview.process.pid, signal.SIGCONT)
        late = wait_until(lambda: preview.look().stage, "the bench again")
        for _ in range(5):
            assert late.task is None
            preview.go_on()  # as a window that looks
            time.sleep(0.05)
            late = preview.look().stage
        preview.move(goal, speed)  # and one that is waited for is
        wait_until(lambda: preview.look().stage.task is StageTask.MOVE, "the move")
        assert preview.stop_motion().kind is not Stop.FAILED


@pytest.mark.parametrize("stop", ["stop_motion", "let_go", "close"])
def test_an_order_that_a_stop_has_overtaken_does_not_move_the_stage(monkeypatch, stop):
    done = []
    served = ServedPreview.__new__(ServedPreview)
    names = ("move", "home", "jog", "go_on", "look", "let_go", "stop_motion", "stop_answer")
    others = ("zero", "set_zero", "adjust_camera")
    served.preview = SimpleNamespace(
        motion=lambda: (0, 0.0, False),
        **{name: lambda *_, name=name: done.append(name) for name in (*names, *others)},
    )
    served._stopped_at, served.close = -math.inf, lambda: done.append("close")
    methods, asked = served.methods(), time.monotonic()
    monkeypatch.setattr(preview_process, "asked_at", lambda: asked)
    moves = ("jog", "move", "home")
    for name in (*moves, stop):
        methods[name]()
    for name in moves:
        with pytest.raises(DeviceError, match="a stop came after this order"):
            methods[name]()
    assert done == [*moves, stop]
    asked = time.monotonic() + 1e-3
    methods["move"]()
    assert done[-1] == "move"


@pytest.mark.parametrize("is_driven", [False, True])
def test_a_stop_that_comes_as_the_stage_is_sent_on_is_sent_again(monkeypatch, is_driven):
    """The stage may have been stopped before it knew of the order."""
    done, methods = [], {}

    class Slow:
        def move(self):
            methods["let_go"]()
            done.append("move")

        def motion(self):
            return 0, 0.0, is_driven

        def __getattr__(self, name):
            return lambda: done.append(name)

    served = ServedPreview.__new__(ServedPreview)
    served.preview, served._stopped_at = Slow(), -math.inf
    methods.update(served.methods())
    asked = time.monotonic()
    monkeypatch.setattr(preview_process, "asked_at", lambda: asked)
    with pytest.raises(DeviceError, match="a stop came after this order"):
        methods["move"]()
    assert done == ["let_go", "move", *["stop_motion"] * is_driven]


@posix
def test_what_the_supervisor_has_sent_is_told_of_a_bench_that_dies_before_it_is_let_go_of():
    outside = OutsideStage()
    with connected(*outside.settings) as preview:
        jog(preview, 5)
        kill(preview.process.pid)
        answer = preview.close()
        assert answer is not None
        assert "was sent by the supervisor" in answer.sentence


def test_a_stage_that_could_not_be_stopped_as_its_bench_was_let_go_of_is_told():
    outside = OutsideStage()
    with connected(*outside.settings) as preview:
        jog(preview, 5)
        outside.line.cut()
        answer = preview.close()
        assert answer is not None
        assert answer.kind is Stop.FAILED
        assert preview.close() is answer  # who asks later learns of it, too
