"""A stop answers what became of it: sent, read at rest, failed, or nothing to send it to."""

import threading
from contextlib import suppress
from types import SimpleNamespace

import pytest
from short_run import SMALL

from app.acquisition import run as run_module, stage as stage_module, watchdog as watchdog_module
from app.acquisition.ending import Ending
from app.acquisition.stage import Stage
from app.acquisition.watchdog import Watchdog
from app.experiment.course import Go
from app.records.record_types import Phase
from app.runs import live
from app.settings import config
from app.system.stopping import CUT_POWER, Stop
from drivers.errors import DeviceFault, DeviceTimeout
from slipscope import Session

TIMEOUT = 120


class Clock:
    """Time that passes where somebody sleeps, and by a millisecond where somebody looks at it."""

    now = 0.0

    def monotonic(self):
        self.now += 1e-3
        return self.now

    def sleep(self, seconds):
        self.now += seconds


@pytest.fixture(autouse=True)
def clock(monkeypatch):
    """The clock by which the stage is given time to stand."""
    monkeypatch.setattr(stage_module, "time", clock := Clock())
    return clock


class Actuator:
    """A stage at 12.5 mm that goes on at 5 um/s until it is stopped, and does as it is told."""

    name = "stage X"

    def __init__(self):
        self.clock = stage_module.time
        self.began, self.stopped_at = self.clock.now, None
        self.obeys, self.says_so, self.refuses, self.hangs, self.is_cut = True, True, "", None, ""
        self.calls = []

    def stop(self):
        self.calls.append("stop")
        if self.hangs:
            self.hangs.wait(TIMEOUT)
        if self.refuses:
            raise DeviceFault(self.refuses)
        self.stopped_at = self.clock.now if self.obeys else None

    def position_m(self):
        self.calls.append("position")
        if self.is_cut:
            raise DeviceTimeout(self.is_cut)
        until = min(self.clock.now, self.clock.now if self.stopped_at is None else self.stopped_at)
        return 12.5e-3 + 5e-6 * (until - self.began)

    def is_moving(self):
        if self.is_cut:
            raise DeviceTimeout(self.is_cut)
        return self.stopped_at is None and self.says_so


def stage_of(actuator, velocity_m_s=5e-6):
    """That stage in a run at the pace of a bench, connected."""
    ending = Ending(lambda: None)
    watchdog = Watchdog(ending, 1.0, is_direct=False)
    stage = Stage(config.load(None, SMALL), actuator, watchdog)
    stage.velocity_m_s, stage.may_move = velocity_m_s, True
    ending._stop_actuator = stage.stop
    stage.is_connected = True
    return stage, ending


@pytest.mark.parametrize("hangs", [False, True])
def test_power_is_not_to_be_cut_before_any_motion_was_asked_for(hangs):
    actuator = Actuator()
    actuator.stopped_at = actuator.began
    actuator.refuses = "stage X: no answer to 'ST'"
    stage, ending = stage_of(actuator)
    stage.may_move = False
    if hangs:
        actuator.hangs, actuator.refuses = threading.Event(), ""
        stage._watchdog.given_up.add("stage X")
    ending.call("stage X gave no answer to 'SL0'", failed=True)
    stage.confirm_stop()
    answer = stage.answer_to_stop("armed")
    assert (answer.kind, answer.is_final) == (Stop.NOT_CONNECTED, True)
    assert CUT_POWER not in answer.sentence
    assert answer.sentence.startswith("STOP MOTION: no motion was asked of the stage X, ")
    assert hangs or actuator.refuses in answer.sentence
    assert ending.failed
    if hangs:
        actuator.hangs.set()


def test_power_is_to_be_cut_from_the_first_move_on_and_where_the_stage_was_found_moving():
    actuator = Actuator()
    actuator.refuses = "stage X: no answer to 'ST'"
    actuator.move_to, actuator.set_velocity = lambda m: None, lambda v: None
    for asked in ("go", "arm", "aim"):
        stage, ending = stage_of(actuator)
        stage.may_move = False
        with suppress(DeviceFault):
            getattr(stage, asked)(*[Go(1e-6, 5e-6)] * (asked == "go"))
        ending.call("enough", failed=True)
        assert stage.stop_answer.sentence.startswith(CUT_POWER), asked


def test_a_stop_that_was_sent_says_so_before_the_position_is_read():
    actuator = Actuator()
    stage, ending = stage_of(actuator)
    ending.call("enough", failed=False)
    assert actuator.calls == ["stop"]
    answer = stage.answer_to_stop("running")
    assert (answer.kind, answer.is_final) == (Stop.SENT, False)
    assert answer.sentence == "STOP MOTION was sent to the stage X; its position is being read."
    stage.confirm_stop()
    answer = stage.answer_to_stop("stopping")
    assert (answer.kind, answer.is_final) == (Stop.AT_REST, True)
    assert answer.sentence.startswith("STOP MOTION: the stage X is at rest at 12.5000 mm; ")


def test_a_second_stop_of_a_stage_that_was_read_at_rest_is_sent_and_it_is_at_rest():
    stage, ending = stage_of(actuator := Actuator())
    ending.call("enough", failed=False)
    stage.confirm_stop()
    ending.call("enough", failed=False)
    assert actuator.calls.count("stop") == 2
    assert stage.answer_to_stop("stopping").kind is Stop.AT_REST


def test_an_actuator_that_refuses_to_stop_and_moves_on_has_failed():
    actuator = Actuator()
    actuator.refuses = "stage X: the command is not allowed"
    stage, ending = stage_of(actuator)
    ending.call("enough", failed=False)
    answer = stage.answer_to_stop("running")
    assert answer.kind is Stop.FAILED
    assert answer.sentence == f"{CUT_POWER}: stage X: the command is not allowed"
    assert "did not confirm its stop: stage X: the command is not allowed" in ending.reason
    stage.confirm_stop()
    assert stage.stop_answer.kind is Stop.FAILED
    assert "1.5 s after the stop it says that it moves, and was read at 12.50" in (
        stage.stop_answer.sentence
    )


def test_an_actuator_that_refuses_to_stop_and_stands_is_at_rest():
    actuator = Actuator()
    actuator.refuses, actuator.stopped_at = "stage X: not allowed in READY", actuator.began
    stage, ending = stage_of(actuator)
    ending.call("enough", failed=False)
    assert stage.stop_answer.kind is Stop.FAILED
    stage.confirm_stop()
    assert stage.stop_answer.kind is Stop.AT_REST
    assert (
        "although the stop was refused (stage X: not allowed in READY)"
        in stage.stop_answer.sentence
    )


@pytest.mark.parametrize("says_so", [True, False])
def test_an_actuator_that_takes_the_stop_and_moves_on_has_failed(clock, says_so):
    """Also one that says that it stands: its position tells."""
    actuator = Actuator()
    actuator.obeys, actuator.says_so = False, says_so
    stage, ending = stage_of(actuator)
    ending.call("enough", failed=False)
    assert stage.stop_answer.kind is Stop.SENT
    began = clock.now
    stage.confirm_stop()
    assert clock.now - began < 3
    assert (stage.stop_answer.kind, stage.stop_answer.is_final) == (Stop.FAILED, True)
    says = "moves" if says_so else "stands"
    assert f"1.5 s after the stop it says that it {says}" in stage.stop_answer.sentence
    assert stage.stop_answer.sentence.startswith(f"{CUT_POWER}: stage X: ")


def test_a_stage_that_stands_and_says_that_it_moves_is_not_at_rest():
    actuator = Actuator()
    actuator.is_moving = lambda: True
    stage, ending = stage_of(actuator)
    ending.call("enough", failed=False)
    stage.confirm_stop()
    assert stage.stop_answer.kind is Stop.FAILED


def test_a_stage_whose_position_can_not_be_read_stays_sent():
    actuator = Actuator()
    actuator.is_cut = "stage X: no answer"
    stage, ending = stage_of(actuator)
    ending.call("enough", failed=False)
    stage.confirm_stop()
    assert (stage.stop_answer.kind, stage.stop_answer.is_final) == (Stop.SENT, True)
    assert "whether it stands could not be read: stage X: no answer" in stage.stop_answer.sentence
    assert "cut the actuator's power if it moves" in stage.stop_answer.sentence


def test_a_stage_that_neither_stops_nor_answers_has_failed():
    actuator = Actuator()
    actuator.is_cut = actuator.refuses = "stage X: the line is dead"
    stage, ending = stage_of(actuator)
    ending.call("enough", failed=False)
    stage.confirm_stop()
    assert (stage.stop_answer.kind, stage.stop_answer.is_final) == (Stop.FAILED, True)
    assert "nor could its position be read" in stage.stop_answer.sentence
    stage.is_connected = False
    assert stage.answer_to_stop("failed").kind is Stop.FAILED  # after the end as well


def test_a_stage_that_does_not_return_from_a_stop_has_failed():
    actuator = Actuator()
    actuator.hangs = threading.Event()
    stage, ending = stage_of(actuator)
    pressed = threading.Thread(target=ending.call, args=("enough",), kwargs={"failed": False})
    pressed.start()
    assert stage.stop_answer is None  # it is on its way
    ending.is_called.wait(TIMEOUT)
    stage._watchdog.given_up.add("stage X")  # by the thread that decides, which has asked it too
    ending.call("given up", failed=True)
    assert stage.stop_answer.kind is Stop.FAILED
    assert stage.stop_answer.sentence == f"{CUT_POWER}: stage X: it does not return from its calls"
    actuator.hangs.set()
    pressed.join()


def test_a_stage_that_never_returns_from_a_stop_holds_up_nobody(monkeypatch):
    """It held up the thread that ends the run, for ever, and whoever had pressed STOP."""
    monkeypatch.setattr(watchdog_module, "PATIENCE_S", 0.1)
    actuator = Actuator()
    actuator.hangs = threading.Event()
    stage, ending = stage_of(actuator)
    ending.call("the drive is complete", failed=False, is_complete=True)
    assert ending.failed
    assert "stage X: it did not return from a call within 0.1 s" in ending.reason
    assert ending.reason.endswith("(while ending: the drive is complete)")
    assert stage.stop_answer.kind is Stop.FAILED
    assert stage.is_owed
    actuator.hangs.set()


def test_slow_stages_are_given_the_way_of_their_velocity():
    """Slower than the encoder tells in the time: what the controller says counts."""
    stage, ending = stage_of(Actuator(), velocity_m_s=0.1e-6)
    ending.call("enough", failed=False)
    stage.confirm_stop()
    assert stage.stop_answer.kind is Stop.AT_REST


def test_a_stage_that_needs_a_while_to_come_to_rest_is_at_rest():
    stage, ending = stage_of(actuator := Actuator())
    ending.call("enough", failed=False)
    actuator.stopped_at += 0.4
    stage.confirm_stop()
    assert stage.stop_answer.kind is Stop.AT_REST


def test_a_stop_that_was_refused_is_sent_again_while_the_position_is_read():
    stage, ending = stage_of(actuator := Actuator())
    actuator.refuses = "stage X: the line is noisy"
    stop = actuator.stop

    def noisy():
        if actuator.calls.count("stop") == 2:
            actuator.refuses = ""
        stop()

    actuator.stop = noisy
    ending.call("enough", failed=False)
    assert stage.stop_answer.kind is Stop.FAILED
    stage.confirm_stop()
    assert (stage.stop_answer.kind, stage.stop_answer.is_final) == (Stop.AT_REST, True)
    assert actuator.calls.count("stop") == 3
    assert not stage.is_owed


def test_a_stage_that_was_given_up_stays_failed():
    stage, ending = stage_of(actuator := Actuator())
    actuator.hangs = threading.Event()
    stage._watchdog.given_up.add("stage X")
    ending.call("given up", failed=True)
    stage.confirm_stop()
    assert (stage.stop_answer.kind, stage.stop_answer.is_final) == (Stop.FAILED, True)
    actuator.hangs.set()


def test_a_fast_stage_that_creeps_on_is_not_at_rest():
    """Also where it says that it stands, and goes far less than it was told to."""
    actuator = Actuator()
    actuator.obeys = actuator.says_so = False
    stage, ending = stage_of(actuator, velocity_m_s=100e-6)
    ending.call("enough", failed=False)
    stage.confirm_stop()
    assert stage.stop_answer.kind is Stop.FAILED


# ------------------------------------------------------------------ in each state of a run


def made(path, *overrides):
    return live.make_run(config.load(None, [*SMALL, "run.travel=5", *overrides]), path, pace=None)


def in_drive(run, action):
    """Do `action` once, from the thread that reads the forces, while the stage drives."""
    read, done = run._bench.forces.read, []

    def wrapped(timeout):
        block = read(timeout)
        began = run._history.phase_start(Phase.DRIVE)
        if not done and began is not None and block.end > began + 300:
            done.append(True)
            action()
        return block

    run._bench.forces.read = wrapped


def test_a_stop_before_the_run_and_after_its_end_is_sent_to_nothing(tmp_path):
    run = made(tmp_path / "x.h5")
    answer = run.stop_motion()
    assert answer.kind is Stop.NOT_CONNECTED
    assert "the run has not begun" in answer.sentence
    assert run.stop_answer() is None
    run.start()
    run.wait(TIMEOUT)
    answer = run.stop_motion()
    assert answer.kind is Stop.NOT_CONNECTED
    assert "the run has ended and its bench is closed" in answer.sentence


@pytest.mark.parametrize("moment", ["compiles", "opens", "checks", "arms"])
def test_a_stop_while_the_run_is_made_ready_starts_and_writes_nothing(
    tmp_path, monkeypatch, moment
):
    run, answers, done = made(tmp_path / "x.h5"), [], []

    def noted(what, step):
        def call(*arguments):
            done.append(what)
            if what == moment:
                answers.append(run.stop_motion())
                assert run.health().state == "stopping"
            return step(*arguments)

        return call

    bench = run._bench
    run._prepare = noted("compiles", run._prepare)
    monkeypatch.setattr(run_module, "check_camera", noted("checks", run_module.check_camera))
    run._stage.arm = noted("arms", run._stage.arm)
    for device in (bench.forces, bench.camera, bench.actuator):
        name = "opens" if device is bench.actuator else f"open {device.name}"
        device.open = noted(name, device.open)
    for device in (bench.forces, bench.camera):
        device.start = noted("start", device.start)
    run._create_sink = noted("session", run._create_sink)
    run.start()
    outcome = run.wait(TIMEOUT)
    assert (outcome.state, outcome.ended_as) == ("done", "stopped")
    assert outcome.reason == "the run was stopped before it began: STOP MOTION was pressed"
    assert run.health().state == "done"
    assert outcome.counts.triggers == outcome.counts.samples == 0
    assert not {"start", "session"} & set(done)
    assert any(what.startswith("open") for what in done) == (moment != "compiles")
    assert list(tmp_path.glob("*.h5")) == []
    is_open = moment in ("checks", "arms")
    assert [answer.kind for answer in answers] == [Stop.SENT if is_open else Stop.NOT_CONNECTED]
    if is_open:
        assert run.stop_answer().kind is Stop.AT_REST
    else:
        assert "not connected yet; the run ends before it begins" in answers[0].sentence


def test_a_stop_while_a_bench_hangs_as_it_opens_ends_the_run_in_good_order(tmp_path, monkeypatch):
    """What it has opened is closed, should it ever return."""
    monkeypatch.setattr(watchdog_module, "PATIENCE_S", 0.2)
    opening, release, closed = threading.Event(), threading.Event(), threading.Event()

    def wrap(bench):
        def hang():
            opening.set()
            release.wait(TIMEOUT)
            bench.open()

        devices = {name: getattr(bench, name) for name in ("forces", "camera", "actuator")}
        return SimpleNamespace(open=hang, close=lambda: (bench.close(), closed.set()), **devices)

    run = live.make_run(config.load(None, SMALL), tmp_path / "x.h5", pace=1.0, wrap=wrap)
    run.start()
    assert opening.wait(TIMEOUT)
    assert run.stop_motion().kind is Stop.NOT_CONNECTED
    outcome = run.wait(TIMEOUT)
    assert (outcome.state, outcome.ended_as) == ("done", "stopped")
    assert not closed.is_set()
    release.set()
    assert closed.wait(TIMEOUT)
    assert list(tmp_path.glob("*.h5")) == []


def test_a_failure_while_the_run_is_made_ready_is_still_one(tmp_path):
    run = made(tmp_path / "x.h5")

    def fail():
        raise DeviceFault("stage X: it is not there")

    run._bench.actuator.open = fail
    run.start()
    outcome = run.wait(TIMEOUT)
    assert (outcome.state, outcome.reason) == ("failed", "stage X: it is not there")


def test_a_stop_in_the_drive_and_one_while_the_run_ends(tmp_path):
    run, answers, drives = made(tmp_path / "x.h5"), [], []

    def press():
        drives.append(run.motion()[2])
        answers.append(run.stop_motion())
        drives.append(run.motion()[2])

    in_drive(run, press)
    stop = run._bench.camera.stop
    run._bench.camera.stop = lambda: (answers.append(run.stop_motion()), stop())
    run.start()
    outcome = run.wait(TIMEOUT)
    assert (outcome.state, outcome.reason) == ("done", "STOP MOTION was pressed")
    assert outcome.ended_as == "stopped"
    assert 0.2 < run.health().progress < 0.9
    with Session(tmp_path / "x.h5") as session:
        assert session.state == "stopped"
    assert [answer.kind for answer in answers][:2] == [Stop.SENT, Stop.AT_REST]
    assert drives == [True, False]  # or a supervisor would end a bench that closes its session
    assert run.stop_answer().kind is Stop.AT_REST


def test_a_stop_that_is_refused_in_the_drive_says_so_and_fails_the_run(tmp_path):
    run, answers, drives = made(tmp_path / "x.h5"), [], []

    def refuse():
        raise DeviceFault("simulated actuator: the command is unknown to it")

    def press():
        run._bench.actuator.stop = refuse
        answers.append(run.stop_motion())
        drives.append(run.motion()[2])

    in_drive(run, press)
    run.start()
    outcome = run.wait(TIMEOUT)
    assert answers[0].kind is Stop.FAILED
    assert answers[0].sentence.startswith(
        f"{CUT_POWER}: simulated actuator: the command is unknown"
    )
    assert outcome.state == "failed"
    assert drives == [True]  # so that a supervisor stops it
    assert "did not confirm its stop" in outcome.reason
    assert run.stop_motion().kind is Stop.FAILED  # it was not heard of since


def test_a_run_that_ends_by_itself_leaves_a_stage_that_was_read_at_rest(tmp_path, monkeypatch):
    monkeypatch.setattr(stage_module, "STANDS_WITHIN_S", 0.0)
    run = made(tmp_path / "x.h5")
    run.start()
    assert run.wait(TIMEOUT).ended_as == "done"
    assert run.health().progress == 1.0
    assert run.stop_answer().kind is Stop.AT_REST


def test_a_stop_while_the_session_is_made_ends_the_run(tmp_path):
    run = made(tmp_path / "x.h5")
    create, answers = run._create_sink, []

    def created():
        answers.append(run.stop_motion())
        return create()

    run._create_sink = created
    run.start()
    outcome = run.wait(TIMEOUT)
    assert outcome is not None, "it did not end"
    assert (outcome.state, outcome.ended_as) == ("done", "stopped")
    assert [answer.kind for answer in answers] == [Stop.SENT]
    assert run.stop_answer().kind is Stop.AT_REST
