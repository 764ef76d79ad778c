"""The stage stops when the bench does not: killed, frozen, without forces, too far."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import dataclass

import pytest
from processes.launched import PATIENT_S, OutsideStage, bench_of, drives, kill, launched, wait_until

from app.processes.starting import hello_of, started
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

    def __init__(self, path, age_s=0.5):
        self.path = path
        path.touch()
        self.victim = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
        watch = Watch(
            FileStop(str(path)), self.victim.pid, age_s, 100e-6, path.parent / "stop.json"
        )
        self.process = started("app.processes.supervisor", watch)
        hello_of(self.process)

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


def test_forces_may_wait_while_nothing_drives(supervised):
    for _ in range(10):
        supervised.beat(9, drives=0)
        time.sleep(0.1)
    assert supervised.stops() == 0


@pytest.mark.parametrize("travel_m", [101e-6, -101e-6])
def test_a_stage_beyond_its_limit_is_stopped(supervised, travel_m):
    supervised.beat(1, travel_m)
    wait_until(supervised.stops, "the stop")


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
