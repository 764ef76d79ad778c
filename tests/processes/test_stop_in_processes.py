"""A stop of a run in another process answers what became of it, also when that process is gone."""

import os
import signal
import sys

import pytest
from processes.launched import PATIENT_S, OutsideStage, drives, kill, launched, wait_until

from app.commands import experiment as commands
from app.processes import launch
from app.processes.supervisor import Watch, _stop
from app.stopping import CUT_POWER, Stop
from drivers.errors import DeviceFault

posix = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")


def test_a_stop_from_a_terminal_is_confirmed_by_the_position(tmp_path, capfd):
    outside = OutsideStage()
    with launched(tmp_path / "a.h5", *outside.settings) as run:
        assert run.stop_answer() is None
        run.start()
        wait_until(lambda: drives(run), "the drive")
        assert commands.stop(str(tmp_path / "a.h5")) == 0
        said = capfd.readouterr().err
        assert "STOP MOTION: the SMC100 is at rest at 12.50" in " ".join(said.split())
        outcome = run.wait(PATIENT_S)
        assert outcome.reason == "STOP MOTION was pressed"
        assert run.stop_answer().kind is Stop.AT_REST
        answer = run.stop_motion()
        assert answer.kind is Stop.NOT_CONNECTED
        assert "the run has ended" in answer.sentence
    outside.line.cut()


def test_a_stop_whose_line_is_cut_has_failed(tmp_path, capfd):
    outside = OutsideStage()
    with launched(tmp_path / "a.h5", *outside.settings) as run:
        run.start()
        wait_until(lambda: drives(run), "the drive")
        other = launch.attached(run.bench.name)
        outside.line.cut()
        answer = other.stop_motion()
        assert answer.kind is Stop.FAILED
        assert answer.sentence.startswith(f"{CUT_POWER}: SMC100: ")
        outcome = run.wait(PATIENT_S)
        assert outcome.state == "failed"
        assert run.stop_motion().kind is Stop.FAILED
    assert outside.stage.is_moving()


@posix
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_the_supervisor_answers_for_a_bench_that_is_gone(tmp_path, number):
    outside = OutsideStage()
    with launched(tmp_path / "a.h5", *outside.settings) as run:
        run.start()
        wait_until(lambda: drives(run), "the drive")
        os.kill(run.bench.pid, number)
        answer = run.stop_motion()
        assert answer.kind is Stop.SENT, answer
        assert "by the supervisor" in answer.sentence
        assert outside.stops()
        outcome = run.wait(PATIENT_S)
        assert "a stop was sent to its stage from outside" in outcome.reason
        assert run.stop_answer() == answer
    outside.line.cut()


@posix
def test_a_bench_that_is_gone_without_a_supervisor_could_not_be_stopped(tmp_path):
    with launched(tmp_path / "a.h5") as run:
        run.start()
        wait_until(lambda: drives(run), "the drive")
        kill(run.bench.pid)
        answer = run.stop_motion()
        assert answer.kind is Stop.FAILED
        assert "no supervisor watches its stage" in answer.sentence


class Refuses:
    """A way to the stage that is cut."""

    def stop(self):
        raise DeviceFault("SMC100: 'ST' can not be sent, the line is dead")


def test_a_supervisor_whose_way_is_cut_says_that_it_has_failed(tmp_path, monkeypatch):
    killed = []
    monkeypatch.setattr("os.kill", lambda *what: killed.append(what))
    _stop(Watch(Refuses(), 12345, 1.0, 1e-4, tmp_path / "stop.json"), and_kill=False)
    assert killed
    monkeypatch.setattr("app.processes.folder.root", lambda: tmp_path.parent)
    from app.processes.folder import told

    answer = told(tmp_path.name)
    assert answer.kind is Stop.FAILED
    assert "'ST' can not be sent, the line is dead" in answer.sentence
