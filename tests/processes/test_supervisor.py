"""The stage stops when the bench does not: killed, frozen, without forces, too far."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from itertools import count

import pytest
from processes.launched import PATIENT_S, OutsideStage, bench_of, drives, kill, launched, wait_until

from app.processes.starting import start_process, wait_until_ready
from app.processes.supervisor import Watch

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
PROMPT_S = 3.0  # on a busy machine; benchmarks.kills says how long it takes


@dataclass
class FileStop:
    """Leaves a mark where a stop would have been sent."""

    path: str

    def stop(self):
        with open(self.path, "a", encoding="utf-8") as file:
            file.write("ST\n")


class Supervised:
    """A supervisor, and a bench that is the test; `kill` is sent to a process that sleeps."""

    def __init__(self, path, age_s=0.5, answer=None):
        self.path = path
        path.touch()
        self.victim = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
        watch = Watch(
            FileStop(str(path)),
            self.victim.pid,
            age_s,
            100e-6,
            answer or path.parent / "stop.json",
        )
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


def test_forces_that_stand_still_while_the_stage_drives_stop_it(supervised):
    for n in range(10):
        supervised.beat(n)
        time.sleep(0.1)
    assert supervised.stops() == 0
    for _ in range(10):
        supervised.beat(9)
        time.sleep(0.1)
    assert supervised.stops() == 1
    assert supervised.victim.poll() is None


def test_every_stall_is_guarded(supervised):
    sample = 0
    for stall in (1, 2, 3):
        for _ in range(3):
            sample += 1
            supervised.beat(sample)
            time.sleep(0.1)
        for _ in range(8):
            supervised.beat(sample)
            time.sleep(0.1)
        wait_until(lambda stall=stall: supervised.stops() == stall, f"stop {stall}")
    assert supervised.victim.poll() is None


def test_a_stall_that_goes_on_is_stopped_again(supervised):
    """The line may have lost the command, and the stage is still said to drive."""
    for _ in range(28):
        supervised.beat(1)
        time.sleep(0.1)
    wait_until(lambda: supervised.stops() >= 2, "the second stop")
    assert supervised.victim.poll() is None


def test_a_stop_that_can_not_be_noted_is_no_end_of_the_watch(tmp_path):
    supervised = Supervised(tmp_path / "stops", answer=tmp_path / "gone" / "stop.json")
    try:
        for stall in (1, 2):
            supervised.beat(stall, 101e-6 * (stall % 2))
            wait_until(lambda: supervised.stops() == 1, "the stop")
        supervised.beat(3, 101e-6)
        wait_until(lambda: supervised.stops() == 2, "the second stop")
    finally:
        supervised.end()


def test_forces_may_wait_while_nothing_drives(supervised):
    for _ in range(10):
        supervised.beat(9, drives=0)
        time.sleep(0.1)
    assert supervised.stops() == 0


@pytest.mark.parametrize("travel_m", [101e-6, -101e-6])
def test_a_stage_beyond_its_limit_is_stopped(supervised, travel_m):
    samples = count()

    def is_stopped():
        supervised.beat(next(samples), travel_m)  # neither silent nor without forces
        return supervised.stops()

    wait_until(is_stopped, "the stop")
    assert supervised.stops() == 1
    assert supervised.victim.poll() is None


@pytest.mark.parametrize("sign", [1, -1])
def test_a_stage_that_goes_on_beyond_its_limit_is_stopped_again(supervised, sign):
    for sample, travel_um in enumerate((99, 102, 103, 104, 90, 99)):
        supervised.beat(sample, sign * travel_um * 1e-6, drives=0)
    supervised.beat(10, 0.0, drives=0)
    wait_until(supervised.stops, "the stop")
    time.sleep(0.3)
    assert supervised.stops() == 1  # on its way back it is let go
    supervised.beat(11, sign * 103e-6)
    wait_until(lambda: supervised.stops() == 2, "the stop of the next time")
    supervised.beat(12, sign * 112e-6)
    wait_until(lambda: supervised.stops() == 3, "the stop of one that went on")


def test_a_bench_that_says_nothing_while_nothing_moves_is_not_ended(supervised):
    supervised.beat(1, drives=0)
    time.sleep(2.5)
    assert supervised.victim.poll() is None
    assert supervised.stops() <= 1  # it may have begun to move before it fell silent
    supervised.beat(2)
    wait_until(lambda: supervised.victim.poll() is not None, "the end of one that drives")
    assert supervised.stops() >= 2


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


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_what_ends_other_programs_does_not_end_the_supervisor(supervised, number):
    kill(supervised.process.pid, number)
    supervised.beat(1)
    time.sleep(0.2)
    assert supervised.process.poll() is None


@pytest.mark.parametrize("over", ["pty", "tcp"])
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP])
def test_a_bench_that_is_killed_or_frozen_leaves_a_stage_that_stands(tmp_path, number, over):
    outside = OutsideStage(over)
    path = tmp_path / "a.h5"
    with launched(path, *outside.settings) as run:
        run.start()
        wait_until(lambda: drives(run, 10), "the drive")
        assert not outside.stops()
        began = time.monotonic()
        os.kill(run.bench.pid, number)
        wait_until(outside.stops, "the stop")
        assert outside.stops()[0] - began < PROMPT_S
        wait_until(lambda: not outside.stage.is_moving(), "the standstill")
        here = outside.stage.position()
        outcome = run.wait(PATIENT_S)
    assert outcome.state == "failed"
    time.sleep(0.3)
    assert outside.stage.position() == here < 12.5 + 0.060
    outside.line.cut()


def test_a_killed_supervisor_is_started_again_and_the_run_goes_on(tmp_path):
    outside = OutsideStage()
    path = tmp_path / "a.h5"
    with launched(path, *outside.settings) as run:
        run.start()
        wait_until(lambda: drives(run), "the drive")
        first = bench_of(path).supervisor_pid
        kill(first)
        wait_until(lambda: bench_of(path).supervisor_pid != first, "a new supervisor")
        outcome = run.wait(PATIENT_S)
    assert (outcome.state, outcome.reason) == ("done", "the drive of 60 um is complete")
    outside.line.cut()
