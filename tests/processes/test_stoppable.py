"""A stage that a command moves without a run is stopped from outside, like that of a run."""

import threading
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import pytest
from processes.launched import SETTINGS, OutsideStage, wait_until

from app.acquisition.watchdog import Patience
from app.cli import device_commands as commands
from app.processes import folder as folders, urgent
from app.processes.folder import reachable, running
from app.processes.stoppable import STOPPED, StoppableActuator, stoppable
from app.settings.config import Config
from app.system.stopping import Stop


@pytest.fixture(autouse=True)
def memory(short_path, monkeypatch):
    monkeypatch.setattr(folders, "MEMORY", short_path)


@pytest.mark.parametrize(
    ("name", "command"),
    [
        ("check", lambda settings: commands.check(None, move_um=60.0, overrides=settings)),
        (
            "check-driver",
            lambda settings: commands.check_driver(
                settings[-2].partition("=")[2], move=True, overrides=settings[-1:]
            ),
        ),
    ],
    ids=["check", "check-driver"],
)
def test_a_stage_that_is_checked_is_stopped_from_a_terminal(name, command):
    outside = OutsideStage()
    start = outside.stage.position()

    def stop():
        wait_until(lambda: abs(outside.stage.position() - start) > 2e-3, "the move")
        assert [bench.title for bench in reachable()] == [name]
        assert running() == []
        return urgent.stop(None)

    with ThreadPoolExecutor(1) as terminal:
        answer = terminal.submit(stop)
        with pytest.raises(KeyboardInterrupt, match=STOPPED):
            command([*SETTINGS, *outside.settings])
        (said,), has_failed = answer.result()
    assert not has_failed
    assert said.startswith("STOP MOTION: the SMC100 is at rest at 1")
    assert said.endswith(f"({name}, without a run)")
    assert outside.stops()
    assert reachable() == []


class Slow:
    """A stage whose moves begin only when they are let through."""

    name = "stage"

    def __init__(self):
        self.place, self.moves = 1e-3, False
        self.is_asked, self.may_begin = threading.Event(), threading.Event()

    def open(self):
        pass

    def close(self):
        self.place = 0.0  # what it would say then is not read

    def stop(self):
        self.moves = False

    def move_to(self, place):
        self.is_asked.set()
        assert self.may_begin.wait(60)
        self.place, self.moves = place, True

    def is_moving(self):
        return self.moves

    def position_m(self):
        return self.place


def test_a_move_that_was_on_its_way_at_the_stop_is_stopped_too():
    slow, has_stopped = Slow(), threading.Event()
    stage = StoppableActuator(Config(), slow, has_stopped)
    stage.open()
    with ThreadPoolExecutor(1) as command:
        moved = command.submit(stage.move_to, 2e-3)
        assert slow.is_asked.wait(60)
        has_stopped.set()
        assert stage.stop_for_good().kind is Stop.SENT
        slow.may_begin.set()
        moved.result()
    stage.close()  # waits until the position was read
    assert not slow.moves
    assert stage.stop_answer().kind is Stop.AT_REST
    assert "at rest at 2.0000 mm" in stage.stop_answer().sentence
    for ask in (stage.is_moving, stage.position_m, stage.open, lambda: stage.move_to(3e-3)):
        with pytest.raises(KeyboardInterrupt, match=STOPPED):
            ask()


def test_a_stop_between_two_moves_ends_the_command_before_the_next():
    opened = []

    def command(wrap):
        first = wrap(Slow())
        first.open()
        first.close()
        (said,), has_failed = urgent.stop(None)
        assert "nothing was sent, because its line is closed at this moment" in said
        assert not has_failed
        wrap(SimpleNamespace(name="next", open=lambda: opened.append(1))).open()

    with pytest.raises(KeyboardInterrupt, match=STOPPED), stoppable(Config(), "check") as wrap:
        command(wrap)
    assert opened == []


def test_a_stop_in_the_last_moment_is_not_forgotten():
    with pytest.raises(KeyboardInterrupt, match=STOPPED), stoppable(Config(), "check"):
        urgent.stop(None)


def test_a_stop_is_no_fault_of_the_stage():
    stopped = threading.Event()
    stopped.set()
    stage = StoppableActuator(Config(), Slow(), stopped)
    with pytest.raises(KeyboardInterrupt, match=STOPPED):
        Patience().aside("stage", stage.position_m)


def test_what_a_driver_lacks_is_not_hidden():
    stage = StoppableActuator(Config(), SimpleNamespace(name="x"), threading.Event())
    assert not hasattr(stage, "move_to")
    assert not hasattr(stage, "stopper")
    assert stage.name == "x"
