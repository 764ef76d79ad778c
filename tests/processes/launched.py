"""Runs in processes of their own, and an emulated controller outside them that sees what reaches
the stage.
"""

import os
import signal
import subprocess
import sys
import time
from contextlib import contextmanager, suppress
from pathlib import Path
from shutil import rmtree

from free_stage import FreeStage
from short_run import BLIND, SMALL

from app.processes.client import LaunchedRun, RemoteRun
from app.processes.folder import root, running
from app.session.reader import SessionReader
from app.settings import config
from drivers.emulators.newport import Controller
from drivers.emulators.serial_line import SerialLine

SETTINGS = (*SMALL, "limits.age=10")  # a busy computer may be late
PATIENT_S = 2e-3 * int(os.environ.get("PATIENCE_MS", "240000"))  # as of a window, and a start
ROOT = Path(__file__).parents[2]


def wait_until(condition, what="it"):
    """Return what a condition gives as soon as that holds."""
    deadline = time.monotonic() + PATIENT_S
    while not (found := condition()):
        assert time.monotonic() < deadline, f"{what} never came"
        time.sleep(0.005)
    return found


@contextmanager
def launched(path, *overrides, pace=1.0):
    """A run on a bench of its own; nothing of it is left behind."""
    run = LaunchedRun(config.load(None, [*SETTINGS, *overrides]), path, pace=pace, overwrite=False)
    try:
        yield run
    finally:
        outcome = run.look().outcome
        if outcome is None or outcome.state != "done":
            kill(run.bench.pid)
        wait_until(lambda: not run.bench.is_alive, "its end")
        rmtree(root() / run.bench.name, ignore_errors=True)  # of a dead one


def kill(pid, number=signal.SIGKILL):
    """Send a process a signal, if it is still there."""
    with suppress(OSError):
        os.kill(pid, number)


def bench_of(path):
    """The bench that records that session, as its folder says now."""
    return next((b for b in running() if Path(b.session) == path.resolve()), None)


def drives(run, travel_um=5.0):
    """Whether the stage has gone so far."""
    health = run.look().health
    assert health.state not in ("done", "failed"), health.reason
    return health.phase == "drive" and health.progress > 0.1 + 0.9 * travel_um / 60


class Program:
    """`slipscope run` as a user starts it in a terminal."""

    def __init__(self, path, *overrides, headless=True):
        settings = [word for o in (*SETTINGS, *overrides) for word in ("--set", o)]
        command = ["-m", "app", "run", *["--headless"] * headless, "-o", str(path), *settings]
        self.process = subprocess.Popen(
            [sys.executable, *command],
            cwd=ROOT,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        self.path = path

    def run(self):
        """Its run, once it can be called."""
        return RemoteRun(wait_until(lambda: bench_of(self.path), "the bench"))

    def end(self, number=None):
        """What it has said, and its exit code, after a signal."""
        if number is not None:
            kill(self.process.pid, number)
        said = self.process.communicate(timeout=PATIENT_S)[1]
        return said, self.process.returncode


class OutsideStage:
    """A stage on an emulated controller that lives in the process of the test; its settings are for
    runs of whose pictures nothing is asked.
    """

    def __init__(self, over="tcp"):
        self.stage = FreeStage()
        self.line = SerialLine(Controller(self.stage, "smc100", is_referenced=True), over)
        source = "actuator.source=processes.patient_stage:PatientSmc100"
        self.settings = (*BLIND, source, f"actuator.port={self.line.start()}")

    def stops(self):
        """Times at which the command to stop arrived."""
        return [when for when, command in list(self.line.arrivals) if command == b"1ST"]


def whole(path):
    """The session, which was closed in good order: its outcome and its events."""
    with SessionReader(path) as session:
        frames = len(list(session.frames()))
        assert frames == session.outcome.counts.frames_recorded
        return session.outcome, session.events()
