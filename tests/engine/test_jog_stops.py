"""The stop of a jog that fails is tried again until it is taken, and meanwhile the stage counts as
driven; nothing unexpected ends the watch over it.
"""

import threading
import time
from types import SimpleNamespace

import numpy as np
import pytest

from app.acquisition import (
    jog as jog_module,
    stage as stage_module,
    watchdog as watchdog_module,
)
from app.acquisition.connected_bench import Preview
from app.acquisition.jog import JoggedStage
from app.experiment.course import Go
from app.experiment.decisions import Experiment, ExperimentFailed, MeasuredBlock
from app.processes.preview import ServedPreview
from app.processes.starting import Launch
from app.records.bench_view import HOLD_S
from app.settings import config
from app.system.stopping import CUT_POWER, Stop, failed
from drivers import turns
from drivers.errors import DeviceFault, DeviceTimeout, OutOfLimits

UM = 1e-6


class Stage:
    """An actuator that goes on at its velocity until a stop is taken; the first `failing` are
    not.
    """

    name, travel_limits_m = "stage X", (0.0, 25e-3)

    def __init__(self, failing=0):
        self.failing = failing
        self.tried, self.targets = 0, []
        self.velocity = self.began = None
        self.at = 12.5e-3

    def set_velocity(self, velocity):
        self.velocity = velocity

    def move_to(self, target):
        self.targets.append(target)
        self.began = time.monotonic()

    def stop(self):
        self.tried += 1
        if self.tried <= self.failing:
            raise DeviceFault("stage X: the line is noisy")
        self.at, self.began = self.position_m(), None

    def is_moving(self):
        return self.began is not None

    def position_m(self):
        return self.at + (0 if self.began is None else 1e-6 * (time.monotonic() - self.began))


def forces(normal=0.1, shear=0.0, age=0.0, used=(0.1, 0.1)):
    return MeasuredBlock(0, np.array([[normal, shear]]), 0.0, False, False, used, age)


@pytest.fixture(autouse=True)
def clock(monkeypatch):
    """The clock by which a jog is held, which stands until a test turns it."""
    monkeypatch.setattr(stage_module, "AGAIN_S", 0.0)
    clock = SimpleNamespace(now=100.0, monotonic=lambda: clock.now)
    monkeypatch.setattr(jog_module, "time", clock)
    return clock


def jogged(actuator, newest=forces, *overrides):
    stage = JoggedStage(config.load(None, list(overrides)), actuator, newest)
    stage.poll()
    return stage


def until_it_stands(stage):
    """Look as the watch does."""
    give_up = time.monotonic() + 30
    while stage.is_driven:
        assert time.monotonic() < give_up, "it is still driven"
        stage.check()
        time.sleep(0.001)


def test_a_jog_that_nobody_holds_ends_when_its_time_is_over(clock):
    stage = jogged(actuator := Stage())
    stage.hold(1, 10 * UM)
    for later_s, is_moving in ((0.9, True), (1.8, True), (2.9, False)):  # held once more at 0.9
        clock.now = 100.0 + later_s * HOLD_S
        stage.check()
        assert actuator.is_moving() is is_moving
        if later_s == 0.9:
            stage.hold(1, 10 * UM)


def test_a_stop_that_comes_as_a_jog_is_sent_is_sent_once_more_after_it():
    """Also where it has not returned yet: which of them the stage heard first is not known."""
    stage = jogged(actuator := Stage())
    is_sent, may_return, stop = threading.Event(), threading.Event(), actuator.stop

    def slow_stop():
        stop()
        is_sent.set()
        assert actuator.tried > 1 or may_return.wait(30)

    def stopped_meanwhile(target):
        threading.Thread(target=stage.stop_now).start()
        assert is_sent.wait(30)

    actuator.stop, actuator.move_to = slow_stop, stopped_meanwhile
    stage.hold(1, 10 * UM)
    assert actuator.tried == 2
    may_return.set()


def test_a_stop_that_fails_is_tried_until_it_is_taken():
    actuator = Stage(failing=3)
    stage = jogged(actuator)
    stage.hold(1, 10 * UM)
    stage._held_until = -1.0  # nobody holds it any more
    stage.check()
    assert (actuator.tried, stage.is_driven, actuator.is_moving()) == (1, True, True)
    assert stage.failure.kind is Stop.FAILED
    assert stage.said.startswith(CUT_POWER)
    until_it_stands(stage)
    assert (actuator.tried, actuator.is_moving()) == (4, False)
    assert stage.failure is None  # it is no longer so
    assert "the line is noisy" in stage.said
    assert "stopped" in stage.said
    assert CUT_POWER not in stage.said
    stage.check()
    assert actuator.tried == 4


def test_a_stage_that_could_not_be_stopped_is_not_sent_on():
    actuator = Stage(failing=99)
    stage = jogged(actuator)
    stage.hold(1, 10 * UM)
    stage._held_until = -1.0
    stage.check()
    for direction in (1, -1):
        with pytest.raises(DeviceFault, match="the line is noisy"):
            stage.hold(direction, 10 * UM)
    assert len(actuator.targets) == 1
    assert stage.is_driven


def test_a_release_whose_stop_fails_is_tried_again():
    actuator = Stage(failing=2)
    stage = jogged(actuator)
    stage.hold(1, 10 * UM)
    assert stage.let_go().kind is Stop.FAILED
    assert stage.is_driven
    until_it_stands(stage)
    assert not actuator.is_moving()
    assert stage.let_go().kind is Stop.AT_REST
    stage.hold(-1, 10 * UM)  # what forbade a jog is forgotten
    assert actuator.is_moving()


def test_a_turn_whose_stop_fails_is_tried_again():
    actuator = Stage(failing=1)
    stage = jogged(actuator)
    stage.hold(1, 10 * UM)
    with pytest.raises(DeviceFault, match="noisy"):
        stage.hold(-1, 10 * UM)
    assert stage.is_driven
    until_it_stands(stage)
    assert not actuator.is_moving()


def test_a_stage_that_takes_the_stop_and_moves_on_is_told_again(monkeypatch):
    monkeypatch.setattr(stage_module, "STANDS_WITHIN_S", 0.2)
    actuator = Stage()
    stage = jogged(actuator)
    stage.hold(1, 10 * UM)
    stop, actuator.stop = actuator.stop, lambda: None  # the line loses it
    assert stage.let_go().kind is Stop.FAILED
    assert stage.is_driven
    actuator.stop = stop
    until_it_stands(stage)
    assert not actuator.is_moving()


@pytest.mark.parametrize("has_begun", [True, False])
def test_a_stop_that_does_not_return_is_asked_once_at_a_time(monkeypatch, has_begun):
    monkeypatch.setattr(watchdog_module, "PATIENCE_S", 0.05)
    actuator, release = Stage(), threading.Event()
    stage = jogged(actuator)
    stage.hold(1, 10 * UM)
    stop, make = actuator.stop, turns.settle
    if has_begun:
        actuator.stop = lambda: (release.wait(30), stop())
    else:  # its thread has no turn
        late = lambda *call: (release.wait(30), make(*call))  # noqa: E731
        monkeypatch.setattr(turns, "settle", late)
    stage._held_until = -1.0
    before = threading.active_count()
    for _ in range(20):
        stage.check()
    assert stage.is_driven
    assert "did not return" in stage.failure.sentence
    assert threading.active_count() <= before + 1
    release.set()
    until_it_stands(stage)
    assert not actuator.is_moving()
    assert stage.failure is None


def test_a_move_whose_answer_does_not_come_is_stopped():
    actuator = Stage()
    move = actuator.move_to

    def unanswered(target):
        move(target)
        raise DeviceTimeout("stage X: no answer")

    actuator.move_to = unanswered
    stage = jogged(actuator)
    with pytest.raises(DeviceTimeout):
        stage.hold(1, 10 * UM)
    assert stage.is_driven
    stage.check()  # at once, although the button is still held
    assert not actuator.is_moving()


def test_a_stop_that_comes_as_the_jog_is_sent_wins():
    actuator = Stage()
    stage, move = jogged(actuator), actuator.move_to

    def overtaken(target):
        stage.stop_now()  # of another thread: the controller hears it before the move
        move(target)

    actuator.move_to = overtaken
    stage.hold(1, 10 * UM)
    assert actuator.targets
    assert not actuator.is_moving()
    assert not stage.is_driven


def test_a_stage_that_still_slows_down_is_not_sent_the_other_way():
    actuator = Stage()
    stage = jogged(actuator)
    actuator.is_moving = lambda: True
    stage.hold(-1, 10 * UM)
    assert not actuator.targets
    del actuator.is_moving
    stage.hold(-1, 10 * UM)
    assert len(actuator.targets) == 1


def test_what_forbids_the_first_jog_forbids_the_next():
    def guard():
        raise DeviceFault("no supervisor")

    actuator = Stage()
    stage = JoggedStage(config.load(None, []), actuator, forces, guard)
    stage.poll()
    for _ in range(2):
        with pytest.raises(DeviceFault, match="no supervisor"):
            stage.hold(1, 10 * UM)
    assert not actuator.targets


def test_forces_that_can_not_be_judged_stop_the_jog():
    actuator = Stage()
    newest = [forces()]
    stage = jogged(actuator, lambda: newest[0])
    stage.hold(1, 10 * UM)
    newest[0] = SimpleNamespace(age_s=None)
    stage.check()
    assert not actuator.is_moving()
    assert "TypeError" in stage.said


def test_nothing_unexpected_ends_the_watch():
    """The thread that looks after a jog goes on, whatever is raised in it."""
    settings = config.load(None, [])
    device = SimpleNamespace(name="x")
    bench = SimpleNamespace(forces=device, camera=device, actuator=device)
    preview, looks = Preview(settings, bench), []

    def check():
        looks.append(True)
        if len(looks) < 3:
            raise [ValueError("odd"), SystemExit(1)][len(looks) - 1]
        preview._closing.set()

    preview._stage.check = check
    preview._watch.start()
    preview._watch.join(30)
    assert len(looks) == 3


@pytest.mark.parametrize("sign", [1, -1])
def test_the_limit_of_the_normal_force_holds_for_either_sign(sign):
    """With the wrong forces.sign an operator presses towards minus infinity."""
    actuator, newest = Stage(), [forces()]
    stage = jogged(actuator, lambda: newest[0], "limits.normal_force=1")
    stage.hold(1, 10 * UM)
    newest[0] = forces(normal=sign * 0.99)
    stage.check()
    assert actuator.is_moving()
    newest[0] = forces(normal=sign * 1.01)
    stage.check()
    assert not actuator.is_moving()
    assert f"the normal force reached {sign * 1.01:.3f} N" in stage.said
    assert ("forces.sign" in stage.said) == (sign < 0)
    stage.let_go()
    with pytest.raises(DeviceFault, match=r"limits\.normal_force"):
        stage.hold(1, 10 * UM)


@pytest.mark.parametrize("sign", [1, -1])
def test_beyond_the_limit_of_the_shear_force_a_jog_only_leads_back(sign):
    actuator, newest = Stage(), [forces(shear=sign * 1.01)]
    stage = jogged(actuator, lambda: newest[0], "limits.shear_force=1")
    with pytest.raises(DeviceFault, match=r"shear force reached 1\.010 N.*jog the other way"):
        stage.hold(sign, 10 * UM)
    assert not actuator.targets
    stage.hold(-sign, 10 * UM)
    assert np.sign(actuator.targets[0] - actuator.at) == -sign
    newest[0] = forces(shear=sign * 1.05)  # as it comes to rest the stage may creep
    stage.check()
    assert actuator.is_moving()
    newest[0] = forces(shear=sign * 1.07)
    stage.check()
    assert not actuator.is_moving()
    assert "shear force reached 1.070 N" in stage.said


@pytest.mark.parametrize("way", [1, -1])
def test_a_jog_and_a_motion_of_a_run_end_at_the_same_limit_of_travel(way):
    actuator = Stage()
    stage = jogged(actuator, forces, "limits.travel=200")
    stage.hold(way, 10 * UM)
    assert actuator.targets == [pytest.approx(actuator.at + way * 200 * UM)]
    stage.let_go()
    with pytest.raises(OutOfLimits, match=r"limits\.travel is 200 um"):
        stage.go(Go(way * 201 * UM, 10 * UM))
    assert len(actuator.targets) == 1


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [
        ({"normal": float("nan")}, "not a number"),
        ({"used": (0.98, 0.1)}, "the normal sensor is at the end of its range of 10 V"),
        ({"used": (0.1, 0.98)}, "the shear sensor is at the end of its range of 10 V"),
        ({"age": 100.0}, "no force came for"),
    ],
)
def test_forces_that_are_not_known_stop_a_jog_and_end_a_run(wrong, reason):
    actuator, newest = Stage(), [forces()]
    stage = jogged(actuator, lambda: newest[0])
    stage.hold(1, 10 * UM)
    newest[0] = forces(**wrong)
    stage.check()
    assert not actuator.is_moving()
    assert reason in stage.said
    if "age" in wrong:
        return
    block = np.tile([wrong.get("normal", 0.1), 0.0], (50, 1))
    used = wrong.get("used", (0.1, 0.1))
    with pytest.raises(ExperimentFailed, match=reason):
        Experiment(config.load(None, [])).advance(MeasuredBlock(50, block, 0, False, False, used))


@pytest.mark.parametrize("is_driven", [True, False])
def test_a_bench_that_can_not_stop_its_stage_leaves_it_to_the_supervisor(tmp_path, is_driven):
    served = ServedPreview(Launch(config.load(None, []), tmp_path))
    left, answer = [], failed("the line is dead")
    served.preview = SimpleNamespace(
        close=lambda: left.append("bench"),
        motion=lambda: (0, 0.0, is_driven),
        stop_answer=lambda: answer,
    )
    served._supervised = SimpleNamespace(end_watch=lambda: left.append("supervisor"))
    assert served.close() is answer
    assert left == ["bench", *["supervisor"] * (not is_driven)]
    assert served.has_ended.is_set()


def test_a_jog_that_nobody_holds_ends_in_its_time(clock):
    actuator = Stage()
    stage = jogged(actuator)
    stage.hold(1, 10 * UM)
    clock.now += 0.99 * HOLD_S
    stage.check()
    assert actuator.is_moving()
    clock.now += 0.02 * HOLD_S
    stage.check()
    assert not actuator.is_moving()


def test_a_jog_that_is_held_does_not_go_on_after_a_stop_from_elsewhere(clock):
    actuator = Stage()
    stage = jogged(actuator)
    stage.hold(1, 10 * UM)
    stage.stop_motion()
    for _ in range(8):  # a window asks again for as long as the button is held
        clock.now += HOLD_S / 3
        with pytest.raises(DeviceFault, match="STOP MOTION was pressed; let go"):
            stage.hold(1, 10 * UM)
    assert not actuator.is_moving()
    assert len(actuator.targets) == 1
    stage.let_go()
    stage.hold(1, 10 * UM)
    assert len(actuator.targets) == 2
    stage.stop_motion()
    clock.now += 1.01 * HOLD_S  # nobody held it
    stage.hold(-1, 10 * UM)
    assert len(actuator.targets) == 3
