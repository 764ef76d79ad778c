"""What the bench tells its supervisor, without a process: its limits, its beats, and what becomes
of a bench whose supervisor does not start, or dies.
"""

import os
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from app.processes import supervision
from app.processes.starting import ProcessFailed
from app.processes.supervision import MARGIN_M, MARGIN_S, SupervisedBench
from app.settings.sections import Limits
from app.system.errors import UserError

SOON_S = 30.0


class Process:
    """A supervisor that keeps what it is told, and is gone after the first `lives` beats; one that
    is suspended reads nothing, and does not end.
    """

    is_suspended = False

    def __init__(self, watch, lives):
        self.watch, self.lives, self.pid, self.told = watch, lives, id(self), []
        self.ends = os.pipe()  # nobody reads it
        self.stdin = SimpleNamespace(
            write=self._write, flush=lambda: None, fileno=lambda: self.ends[1], close=self._close
        )
        self.has_ended = self.is_killed = self.is_closed = False

    def _write(self, beat):
        if self.is_closed:
            raise ValueError("write to closed file")
        if len(self.told) == self.lives:
            raise BrokenPipeError
        self.told.append(beat.decode())
        os.write(self.ends[1], beat)

    def _close(self):
        self.is_closed = True
        raise BlockingIOError  # what it has not read

    def wait(self, timeout):
        if self.is_suspended and not self.is_killed:
            raise subprocess.TimeoutExpired("supervisor", timeout)
        self.has_ended = True

    def kill(self):
        self.is_killed = True


class Started:
    """The supervisors that were started; those numbered in `failing` do not begin, and of those in
    `unknown` nobody can be told.
    """

    def __init__(self, monkeypatch, *, lives=10**6, failing=(), unknown=()):
        self.all, self.failing, self.lives, self.closed = [], failing, lives, False
        self.unknown = unknown
        self.motion, self.beaten = (7, -3.5e-6, True), threading.Event()
        monkeypatch.setattr(supervision, "BEAT_S", 0.001)
        monkeypatch.setattr(supervision, "start_process", self._start)
        monkeypatch.setattr(supervision, "wait_until_ready", self._wait)

    def close(self):
        for supervisor in self.all:
            for end in supervisor.ends:
                os.close(end)

    def _start(self, module, watch):
        assert module == "app.processes.supervisor"
        self.all.append(Process(watch, self.lives if not self.all else 10**6))
        return self.all[-1]

    def _wait(self, process):
        if len(self.all) in self.failing:
            raise ProcessFailed("supervisor: it did not begin")

    def _look(self):
        if self.all and self.all[-1].told:
            self.beaten.set()
        return self.motion

    def bench(self):
        actuator = SimpleNamespace(stopper=lambda: "the way to the stage")
        device = SimpleNamespace(
            forces=None,
            camera=None,
            actuator=actuator,
            open=lambda: None,
            close=lambda: setattr(self, "closed", True),
        )
        limits, answer = Limits(age=0.5, travel=200e-6), Path("stop.json")
        return SupervisedBench(device, limits, self._look, self._publish, answer)

    def _publish(self, pid):
        if len(self.all) in self.unknown:
            raise UserError("no room for the record of the bench")


@pytest.fixture
def start(monkeypatch):
    """Makes supervisors; see `Started`."""
    made = []

    def start(**how):
        made.append(Started(monkeypatch, **how))
        return made[-1]

    yield start
    for one in made:
        one.close()


def test_the_limits_of_the_supervisor_are_a_little_wider_than_those_of_the_run(start):
    started = start()
    bench = started.bench()
    bench.open()
    bench.close()
    watch = started.all[0].watch
    assert watch.stopper == "the way to the stage"
    assert watch.age_s == pytest.approx(0.5 + MARGIN_S)
    assert watch.travel_m == pytest.approx(200e-6 + MARGIN_M)
    assert 0 < MARGIN_S < 1.0
    assert 0 < MARGIN_M < 10e-6


@pytest.mark.parametrize("drives", [True, False])
def test_a_beat_is_the_sample_the_travel_and_whether_it_drives(start, drives):
    started = start()
    started.motion = (7, -3.5e-6, drives)
    bench = started.bench()
    bench.open()
    assert started.beaten.wait(SOON_S)
    bench.close()
    (supervisor,) = started.all
    assert set(supervisor.told[:-1]) == {f"7 -0.000003500 {int(drives)}\n"}
    assert supervisor.told[-1] == "end\n"
    assert supervisor.has_ended


def test_a_supervisor_that_is_gone_is_started_again(start):
    started = start(lives=1)
    bench = started.bench()
    bench.open()
    assert started.beaten.wait(SOON_S)
    started.beaten.clear()
    assert started.beaten.wait(SOON_S)
    bench.close()
    first, second = started.all
    assert second.watch == first.watch
    assert len(first.told) == 1
    assert second.told


def test_a_supervisor_whose_next_does_not_start_is_replaced_once_one_does(start):
    started = start(lives=1, failing=(2, 3, 4))
    bench = started.bench()
    bench.open()
    deadline = time.monotonic() + SOON_S
    while (len(started.all) < 5 or not started.all[-1].told) and time.monotonic() < deadline:
        time.sleep(0.01)
    bench.close()
    assert len(started.all) == 5
    assert started.all[-1].told


def test_a_supervisor_of_which_nobody_can_be_told_watches_all_the_same(start):
    started = start(lives=1, unknown=(2,))
    bench = started.bench()
    bench.open()
    assert started.beaten.wait(SOON_S)
    deadline = time.monotonic() + SOON_S
    while (len(started.all) < 2 or not started.all[-1].told) and time.monotonic() < deadline:
        time.sleep(0.01)
    bench.close()
    assert len(started.all) == 2
    assert started.all[-1].told[-1] == "end\n"
    assert len(started.all[-1].told) > 1


@pytest.mark.skipif(sys.platform == "win32", reason="pipes of POSIX")
def test_a_supervisor_that_is_suspended_is_replaced_and_holds_up_nothing(start, monkeypatch):
    started = start()
    monkeypatch.setattr(Process, "is_suspended", True)
    bench = started.bench()
    bench.open()
    begun = time.monotonic()
    while len(started.all) < 2 and time.monotonic() < begun + SOON_S:
        time.sleep(0.01)
    assert len(started.all) > 1
    bench.close()  # the second does not end, either
    for supervisor in started.all[:2]:
        assert supervisor.is_killed
        assert supervisor.is_closed
        assert supervisor.has_ended
    if sys.platform == "linux":
        assert 100 < len(started.all[0].told) < 300  # by default it is 64 kB


def test_a_bench_whose_supervisor_does_not_start_is_closed_again(start):
    started = start(failing=(1,))
    with pytest.raises(ProcessFailed, match="it did not begin"):
        started.bench().open()
    assert started.closed


def test_a_bench_whose_supervisor_cannot_be_made_known_is_closed_again(start):
    started = start(unknown=(1,))
    with pytest.raises(UserError, match="no room"):
        started.bench().open()
    assert started.closed
