"""What was decided is carried out on the board's clock, a stop wins over it, and the end has the
first reason that was given.
"""

from types import SimpleNamespace

import pytest

from app.acquisition.control_loop import ControlLoop
from app.acquisition.ending import Ending
from app.acquisition.run import Run
from app.experiment.course import Go
from app.experiment.decisions import Begin
from app.records.record_types import End, Event, Phase
from app.settings import config
from drivers.errors import DeviceFault


class Actuator:
    """A stage at 12 mm that keeps what it is told."""

    name, travel_limits_m = "stage X", (0.0, 25e-3)

    def __init__(self):
        self.calls, self.on_move = [], lambda: None

    def position_m(self):
        return 12e-3

    def is_moving(self):
        return False

    def set_velocity(self, velocity_m_s):
        self.calls.append("velocity")

    def move_to(self, position_m):
        self.on_move()
        self.calls.append("move")

    def stop(self):
        self.calls.append("stop")


class Bench:
    """A loop of which 100 samples were read, while 80 more wait on the board."""

    def __init__(self):
        board, self.actuator = SimpleNamespace(name="board", backlog=lambda: 80), Actuator()
        history = SimpleNamespace(end=100, begun=[], steps=[])
        history.begin = lambda phase, sample: history.begun.append((phase, sample))
        history.begin_step = lambda number, sample: history.steps.append((number, sample))
        devices = SimpleNamespace(forces=board, actuator=self.actuator)
        self.loop = ControlLoop(config.load(None, []), devices, history, pace=None)
        self.history, self.records = history, []
        self.loop.reader.record = self.records.append
        self.loop.stage.is_connected = True


@pytest.mark.parametrize(("phase", "sample"), [(Phase.DRIVE, 180), (Phase.REFERENCE, 90)])
def test_the_drive_begins_on_the_newest_sample_and_what_stands_on_one_that_was_read(phase, sample):
    bench = Bench()
    bench.loop._do(Begin(3, "3 of 4: a step", phase), 90)
    assert bench.history.begun == [(phase, sample)]
    assert bench.history.steps == [(3, sample)]
    assert {record.sample for record in bench.records if isinstance(record, Event)} == {sample}


def test_a_turn_is_recorded_on_the_newest_sample():
    bench = Bench()
    bench.loop._do(Go(-20e-6, 5e-6, is_turn=True), 90)
    assert [(record.sample, record.kind) for record in bench.records] == [(180, "reversal")]
    assert bench.actuator.calls == ["velocity", "move"]


def test_a_stop_that_comes_while_a_motion_is_sent_wins():
    bench = Bench()
    bench.actuator.on_move = lambda: bench.loop.ending.call("STOP was pressed", failed=False)
    bench.loop._do(Go(20e-6, 5e-6), 90)
    assert bench.actuator.calls == ["velocity", "stop", "move", "stop"]
    bench.actuator.calls.clear()
    bench.loop._do(Go(40e-6, 5e-6), 90)  # nothing is sent after it
    assert bench.actuator.calls == ["stop"]


@pytest.mark.parametrize(
    ("state", "phase", "is_owed", "drives"),
    [
        ("running", Phase.DRIVE, False, True),
        ("running", Phase.DRIVE, True, True),
        ("stopping", Phase.DRIVE, True, True),  # until the stage has taken the stop
        ("stopping", Phase.DRIVE, False, False),
        ("running", Phase.REFERENCE, False, False),
        ("done", Phase.DRIVE, True, False),
    ],
)
def test_a_supervisor_is_told_that_the_stage_drives_until_it_has_taken_the_stop_of_the_end(
    state, phase, is_owed, drives
):
    ending = Ending(lambda: None)
    if state != "running":
        ending.call("enough", failed=False)
    run = SimpleNamespace(
        _ending=ending,
        _state=state,
        _experiment=SimpleNamespace(phase=phase),
        _history=SimpleNamespace(end=7),
        _stage=SimpleNamespace(travel_m=3e-6, is_owed=is_owed),
    )
    assert Run.motion(run) == (7, 3e-6, drives)


def test_the_first_reason_stays_but_a_failure_stands_before_it():
    ending = Ending(lambda: None)
    ending.call("STOP was pressed", failed=False)
    ending.call("the run is complete", failed=False, is_complete=True)
    assert (ending.reason, ending.end) == ("STOP was pressed", End.STOPPED)
    ending.call("disk: full", failed=True)
    assert ending.reason == "disk: full (while ending: STOP was pressed)"
    assert ending.end is End.FAILED
    ending.call("board: gone", failed=True)
    assert ending.reason.startswith("disk: full")
    first = ending.reason

    def close():
        raise DeviceFault("a.h5 can be repaired")

    ending.attempt("session", close)
    assert ending.reason == first
    ending.attempt("session", close, in_any_case=True)
    assert ending.reason == f"{first}; a.h5 can be repaired"
    ending.attempt("session", close, in_any_case=True)
    assert ending.reason == f"{first}; a.h5 can be repaired"


def test_a_stop_that_is_not_confirmed_fails_the_run():
    def refuse():
        raise DeviceFault("stage X: the line is dead")

    ending = Ending(refuse)
    ending.call("STOP was pressed", failed=False)
    assert ending.end is End.FAILED
    assert ending.reason == (
        "the actuator did not confirm its stop: stage X: the line is dead"
        " (while ending: STOP was pressed)"
    )


def test_what_was_published_of_an_end_is_not_changed_any_more():
    ending = Ending(lambda: None)
    ending.call("the run is complete", failed=False, is_complete=True)
    ending.close()
    ending.call("camera: gone", failed=True)
    assert (ending.reason, ending.end) == ("the run is complete", End.COMPLETE)
