"""The stage stops when the bench does not: killed, frozen, without forces, too far."""

import math
import queue
import signal
import subprocess
import sys
from types import SimpleNamespace

import pytest
from processes.file_stop import FileStop
from processes.launched import PATIENT_S, OutsideStage, bench_of, drives, kill, launched, wait_until

from app.processes import supervisor
from app.processes.starting import start_process, wait_until_ready
from app.processes.supervisor import Watch

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")


class Supervised:
    """A supervisor, and a bench that is the test; `kill` is sent to a process that sleeps."""

    def __init__(self, path):
        self.path = path
        path.touch()
        self.victim = subprocess.Popen(["sleep", "600"])
        watch = Watch(FileStop(str(path)), self.victim.pid, 0.5, 100e-6, path.parent / "stop.json")
        self.process = start_process("app.processes.supervisor", watch)
        wait_until_ready(self.process)

    def beat(self, sample, travel_m=0.0, drives=1):
        self.process.stdin.write(f"{sample} {travel_m:.9f} {drives}\n".encode())
        self.process.stdin.flush()

    def stops(self):
        return self.path.read_text(encoding="utf-8").count("ST")

    def end(self):
        self.process.stdin.close()
        self.process.stdout.close()
        for process in (self.process, self.victim):
            process.kill()
            process.wait()


@pytest.fixture
def supervised(tmp_path):
    made = Supervised(tmp_path / "stops")
    yield made
    made.end()


class Watched:
    """The supervisor in this process, on a clock that goes on to the next beat when there is none.

    Attributes
    ----------
    stops : list of float
        When the stage was stopped.
    killed : bool
        Whether the bench was.
    """

    def __init__(self, monkeypatch, answer):
        self.now, self.beats, self.stops, self.killed = 0.0, [], [], False
        watch = Watch(self, 4711, 0.45, 100e-6, answer)
        for name, other in (
            ("payload", lambda: watch),
            ("report_ready", lambda said: None),
            ("time", SimpleNamespace(monotonic=lambda: self.now, sleep=lambda seconds: None)),
            ("queue", SimpleNamespace(SimpleQueue=lambda: self, Empty=queue.Empty)),
            ("start_thread", lambda *_: None),
            ("signal", SimpleNamespace(SIGTERM=15, SIG_IGN=None, signal=lambda *_: None)),
            ("os", SimpleNamespace(kill=lambda *_: setattr(self, "killed", True))),
        ):
            monkeypatch.setattr(supervisor, name, other)

    def get(self, timeout=math.inf):
        wait_s, beat = self.beats.pop(0)
        if beat == "suspended":
            self.now += wait_s
            raise queue.Empty
        self.now += min(wait_s, timeout)
        if wait_s > timeout:
            self.beats.insert(0, (wait_s - timeout, beat))
            raise queue.Empty
        return beat

    def stop(self):
        self.stops.append(round(self.now, 3))

    def beat(self, sample, travel_um=0.0, drives=1, after_s=0.1):
        self.beats.append((after_s, f"{sample} {travel_um * 1e-6:.9f} {drives}"))

    def suspend(self, seconds):
        """This process; its next look at the beats has taken so long."""
        self.beats.append((seconds, "suspended"))

    def watch(self):
        """Until the bench has ended in good order, or was ended."""
        self.beats.append((0.1, "end"))
        supervisor.main()


@pytest.fixture
def watched(monkeypatch, tmp_path):
    return Watched(monkeypatch, tmp_path / "stop.json")


def test_forces_that_stand_still_while_the_stage_drives_stop_it(watched):
    for sample in (*range(10), *[9] * 10):
        watched.beat(sample)
    watched.watch()
    assert watched.stops == [1.5]  # 0.45 s after the last new sample, at the next beat
    assert not watched.killed


def test_every_stall_is_guarded(watched):
    for sample in (1, 2, *[3] * 9, 4, 5, *[6] * 9, 7, 8, *[9] * 9):
        watched.beat(sample)
    watched.watch()
    assert watched.stops == [0.8, 1.9, 3.0]
    assert not watched.killed


def test_a_stall_that_goes_on_is_stopped_again(watched):
    """The line may have lost the command, and the stage is still said to drive."""
    for _ in range(60):
        watched.beat(1)
    watched.watch()
    assert watched.stops == pytest.approx([0.6, 2.7, 4.8], abs=0.11)
    assert not watched.killed


def test_a_stop_that_can_not_be_noted_is_no_end_of_the_watch(monkeypatch, tmp_path):
    watched = Watched(monkeypatch, tmp_path / "gone" / "stop.json")
    for sample, travel_um in enumerate((101, 0, 101)):
        watched.beat(sample, travel_um)
    watched.watch()
    assert watched.stops == [0.1, 0.3]


def test_forces_may_wait_while_nothing_drives(watched):
    for _ in range(10):
        watched.beat(9, drives=0)
    watched.watch()
    assert not watched.stops


@pytest.mark.parametrize("travel_um", [101, -101])
def test_a_stage_beyond_its_limit_is_stopped(watched, travel_um):
    for sample in range(10):
        watched.beat(sample, travel_um)  # neither silent nor without forces
    watched.watch()
    assert watched.stops == [0.1]
    assert not watched.killed


@pytest.mark.parametrize("sign", [1, -1])
def test_a_stage_that_goes_on_beyond_its_limit_is_stopped_again(watched, sign):
    for sample, travel_um in enumerate((99, 102, 103, 104, 90, 99, 0)):
        watched.beat(sample, sign * travel_um, drives=0)
    watched.beat(11, sign * 103)  # the next time, as on its way back it was let go
    watched.beat(12, sign * 112)
    watched.watch()
    assert watched.stops == [0.2, 0.8, 0.9]


def test_a_bench_that_says_nothing_while_nothing_moves_is_not_ended(watched):
    watched.beat(1, drives=0)
    watched.beat(2, after_s=2.5)
    watched.beat(3, after_s=2.5)
    watched.watch()
    # the first because it may have begun to move before it fell silent
    assert watched.stops == [0.9, 3.4, 3.4]
    assert watched.killed


def test_a_supervisor_that_was_suspended_leaves_a_sound_bench_alone(watched):
    """It ended the bench, whose beats lay before it unread."""
    for sample in range(10):
        if sample == 5:
            watched.suspend(20.0)
        watched.beat(sample, after_s=0.0 if sample > 5 else 0.1)
    watched.watch()
    assert not watched.stops
    assert not watched.killed


def test_a_bench_that_says_nothing_is_ended(supervised):
    supervised.beat(1)
    wait_until(lambda: supervised.stops() == 2, "the stop")
    assert supervised.victim.wait(PATIENT_S) == -signal.SIGKILL


def test_a_bench_that_has_ended_in_good_order_needs_no_stop(supervised):
    supervised.beat(1)
    supervised.process.stdin.write(b"end\n")
    supervised.process.stdin.flush()
    assert supervised.process.wait(PATIENT_S) == 0
    assert supervised.stops() == 0


def test_what_ends_other_programs_does_not_end_the_supervisor(supervised):
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        kill(supervised.process.pid, number)
    supervised.beat(1, 101e-6, drives=0)
    wait_until(supervised.stops, "the stop of a stage beyond its limit")
    assert supervised.process.poll() is None


def test_a_killed_supervisor_is_started_again_and_the_run_goes_on(tmp_path):
    outside = OutsideStage()
    path = tmp_path / "a.h5"
    with launched(path, *outside.settings, "run.travel=40") as run:
        run.start()
        wait_until(lambda: drives(run), "the drive")
        first = bench_of(path).supervisor_pid
        kill(first)
        wait_until(lambda: bench_of(path).supervisor_pid != first, "a new supervisor")
        outcome = run.wait(PATIENT_S)
    assert (outcome.state, outcome.reason) == ("done", "the drive of 40 um is complete")
    outside.line.cut()
