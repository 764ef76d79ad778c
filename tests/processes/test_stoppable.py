"""A stage that a command moves without a run is stopped from outside, like that of a run."""

import time
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import pytest
from processes.launched import SETTINGS, OutsideStage, wait_until

from app.cli import device_commands as commands
from app.processes import folder as folders, urgent
from app.processes.folder import reachable, running
from app.processes.stoppable import stoppable
from app.settings.config import Config


def moving_stage(outside):
    before = outside.stage.position()
    wait_until(lambda: abs(outside.stage.position() - before) > 2e-3, "the move")


@pytest.mark.parametrize(
    "command",
    [
        lambda settings: commands.check(None, move_um=60.0, overrides=settings),
        lambda settings: commands.check_driver(
            settings[-2].partition("=")[2], move=True, overrides=settings[-1:]
        ),
    ],
    ids=["check", "check-driver"],
)
def test_a_stage_that_is_checked_is_stopped_from_a_terminal(command, tmp_path, monkeypatch):
    monkeypatch.setattr(folders, "MEMORY", tmp_path)
    outside = OutsideStage()
    with ThreadPoolExecutor(1) as terminal:

        def stop():
            moving_stage(outside)
            (bench,) = reachable()
            assert bench.title.endswith("with the SMC100")
            assert running() == []
            return urgent.stop(None)

        answer = terminal.submit(stop)
        with pytest.raises(KeyboardInterrupt, match=r"^STOP MOTION$"):
            command([*SETTINGS, *outside.settings])
        said, has_failed = answer.result()
    assert not has_failed
    assert said[0].startswith("STOP MOTION: the SMC100 is at rest at 1")
    assert said[0].endswith("with the SMC100, without a run)")
    assert outside.stops()
    assert reachable() == []


def test_a_move_that_was_on_its_way_at_the_stop_is_stopped_too(tmp_path, monkeypatch):
    monkeypatch.setattr(folders, "MEMORY", tmp_path)
    stage = SimpleNamespace(name="stage", place=1e-3, moves=True)
    stage.stop = lambda: setattr(stage, "moves", False)
    stage.is_moving, stage.position_m = (lambda: stage.moves), (lambda: stage.place)

    def send_on():
        try:
            wait_until(lambda: False)
        except KeyboardInterrupt:
            time.sleep(0.5)
            stage.place, stage.moves = 2e-3, True
            raise

    with ThreadPoolExecutor(1) as terminal:
        with pytest.raises(KeyboardInterrupt), stoppable(Config(), stage, "check"):  # noqa: PT012
            answer = terminal.submit(urgent.stop, None)
            send_on()
        assert not stage.moves
        assert "the stage is at rest at 2.0000 mm" in answer.result()[0][0]
