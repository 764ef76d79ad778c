"""A stage without a run that is sent to a place, or to its origin: within its bounds, only while
somebody watches over it, and never again once it was stopped.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from app.acquisition.jog import JoggedStage
from app.experiment.course import MeasuredBlock
from app.records.bench_view import MOVE_HOLD_S, StageTask
from app.settings import config
from drivers.errors import DeviceFault, OutOfLimits

UM, START = 1e-6, 12.5e-3


@pytest.fixture(autouse=True)
def clock(monkeypatch):
    """The clock by which somebody watches, which stands until a test turns it."""
    clock = SimpleNamespace(now=100.0, monotonic=lambda: clock.now)
    monkeypatch.setattr("app.acquisition.jog.time", clock)
    return clock


class Stage:
    """An actuator that goes where it is sent, and that a test puts somewhere on the way."""

    name, travel_limits_m = "stage X", (0.0, 25e-3)
    can_change_velocity = False

    def __init__(self):
        self.at, self.target, self.speed = START, None, None
        self.targets, self.did = [], []
        self.fault = None

    def make_ready(self):
        self.did.append("make ready")

    def home(self):
        self.did.append("home")
        if self.fault:
            raise self.fault
        self.target = 0.0

    def set_velocity(self, velocity):
        self.speed = velocity

    def move_to(self, target):
        self.targets.append(target)
        self.target = target

    def stop(self):
        self.target = None
        self.did.append("stop")

    def is_moving(self):
        return self.target is not None

    def position_m(self):
        return self.at

    def arrives(self, short_m=0.0):
        self.at, self.target = self.target - short_m, None


class Renewed(Stage):
    can_change_velocity = True


def connected(actuator, newest=None, *overrides):
    block = MeasuredBlock(0, np.array([[0.1, 0.0]]), 0.0, False, False, (0.1, 0.1), 0.0)
    stage = JoggedStage(
        config.load(None, list(overrides)), actuator, lambda: newest[0] if newest else block
    )
    stage.poll()
    return stage


def test_a_move_goes_to_its_place_and_ends():
    actuator = Stage()
    stage = connected(actuator)
    stage.move(START + 120 * UM, 50 * UM)
    assert actuator.targets == [pytest.approx(START + 120 * UM)]
    assert actuator.speed == 50 * UM
    assert stage.is_driven
    view = stage.view()
    assert (view.task, view.goal_m) == (StageTask.MOVE, pytest.approx(START + 120 * UM))
    stage.go_on()
    assert len(actuator.targets) == 1
    actuator.arrives()
    stage.go_on()
    assert not stage.is_driven
    assert stage.view().task is None
    stage.check()
    assert "stop" not in actuator.did
    stage.poll()
    stage.move(START - 80 * UM, 50 * UM)
    assert actuator.targets[-1] == pytest.approx(START - 80 * UM)


@pytest.mark.parametrize("way", [1, -1])
def test_a_stage_that_takes_new_targets_is_never_sent_far(way):
    actuator = Renewed()
    stage = connected(actuator)
    stage.move(START + way * 400 * UM, 50 * UM)
    assert actuator.targets == [pytest.approx(START + way * 100 * UM)]  # of two holds
    actuator.at = START + way * 350 * UM
    stage.go_on()
    assert actuator.targets[-1] == pytest.approx(START + way * 400 * UM)  # and not beyond
    actuator.arrives()
    stage.go_on()
    assert not stage.is_driven


@pytest.mark.parametrize(
    ("limits", "goal_um", "refused"),
    [
        ((0.0, 25e-3), 501, r"12\.0000 to 13\.0000 mm: within its travel, and 500 um \(limits\.t"),
        ((0.0, 25e-3), -501, r"a move to 11\.9990 mm was asked"),
        ((12.45e-3, 12.55e-3), 60, r"from 12\.4500 to 12\.5500 mm"),
    ],
)
def test_a_place_out_of_bounds_is_refused_in_words(limits, goal_um, refused):
    actuator = Stage()
    actuator.travel_limits_m = limits
    stage = connected(actuator)
    with pytest.raises(OutOfLimits, match=refused):
        stage.move(START + goal_um * UM, 50 * UM)
    assert not actuator.targets
    assert not stage.is_driven


@pytest.mark.parametrize("ends", ["stop_now", "let_go"])
def test_what_comes_after_a_stop_moves_nothing(ends):
    actuator = Stage()
    stage = connected(actuator)
    stage.move(START + 120 * UM, 50 * UM)
    order = stage._under_way
    getattr(stage, ends)()
    assert not actuator.is_moving()
    stage.go_on()
    stage._keep(order, begins=False)  # it was on its way as the stop came
    assert len(actuator.targets) == 1
    assert not stage.is_driven


def test_a_move_that_nobody_watches_over_is_stopped_and_says_so(clock):
    actuator = Stage()
    stage = connected(actuator)
    stage.move(START + 120 * UM, 50 * UM)
    clock.now += MOVE_HOLD_S - 0.01
    stage.check()
    assert actuator.is_moving()
    clock.now += 0.02
    stage.check()
    assert not actuator.is_moving()
    assert "move: it was stopped: nobody asked for 1 s whether it goes on" in stage.said
    stage.move(START + 120 * UM, 50 * UM)  # and may be asked for again
    assert actuator.is_moving()


def test_a_limit_of_the_forces_stops_a_move_and_a_search():
    def block(shear):
        return MeasuredBlock(0, np.array([[0.1, shear]]), 0.0, False, False, (0.1, 0.1), 0.0)

    for order in (lambda s: s.move(START + 90 * UM, 50 * UM), lambda s: s.home()):
        actuator, newest = Stage(), [block(0.0)]
        stage = connected(actuator, newest, "limits.shear_force=1")
        order(stage)
        newest[0] = block(1.06)
        stage.check()
        assert not actuator.is_moving()
        assert "shear force reached 1.060 N" in stage.said
        with pytest.raises(DeviceFault, match="shear force"):
            stage.home()
        newest[0] = None
        with pytest.raises(DeviceFault, match="only while forces are read"):
            order(stage)


def test_a_search_of_the_origin_counts_the_travel_from_its_end():
    actuator = Stage()
    stage = connected(actuator)
    stage.home()
    assert actuator.did == ["home"]  # a stage that is not referenced cannot be made ready
    assert stage.view().task is StageTask.HOME
    actuator.at = 6e-3
    stage.poll()
    stage.go_on()
    stage.check()
    assert actuator.is_moving()
    assert stage.travel_m == 0.0  # for the supervisor: no limit of travel is passed
    actuator.arrives()
    stage.poll()
    stage.go_on()
    assert not stage.is_driven
    assert stage.view().high_m == pytest.approx(500 * UM)
    with pytest.raises(OutOfLimits, match=r"0\.0000 to 0\.5000 mm"):
        stage.move(START, 50 * UM)


def test_a_search_that_is_refused_is_one_sentence_and_stops():
    actuator = Stage()
    actuator.fault = DeviceFault("stage X: a recording cannot search its origin")
    stage = connected(actuator)
    with pytest.raises(DeviceFault, match="a recording cannot search"):
        stage.home()
    stage.check()
    assert actuator.did[-1] == "stop"
    assert not stage.is_driven
    assert stage.said == ""


@pytest.mark.parametrize(("way", "goal", "place"), [(1, 6200, 6110), (-1, 3800, 3890)])
def test_a_stage_that_stands_short_of_its_place_is_told_of(way, goal, place):
    actuator = Stage()
    stage = connected(actuator)
    stage.move(START + way * 120 * UM, 50 * UM)
    actuator.arrives(short_m=way * 9 * UM)
    with pytest.raises(DeviceFault, match=rf"sent to 12\.{goal} mm and stands at 12\.{place} mm"):
        stage.go_on()
    assert not stage.is_driven


def test_a_jog_in_a_move_stops_it_first():
    actuator = Stage()
    stage = connected(actuator)
    stage.move(START + 120 * UM, 50 * UM)
    stage.hold(1, 50 * UM)
    assert not actuator.is_moving()
    stage.hold(1, 50 * UM)
    assert actuator.targets[-1] == pytest.approx(START + 500 * UM)
