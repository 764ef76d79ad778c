"""The bench's side of its supervisor: a bench that is watched from when it is open until it is
closed.
"""

from __future__ import annotations

import logging
import os
import subprocess
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from app.acquisition.force_reader import BenchDevices
from app.processes.starting import Process, ProcessFailed, start_process, wait_until_ready
from app.processes.supervisor import Watch
from app.settings.sections import Limits
from app.system.errors import UserError
from app.system.threads import start_thread

if sys.platform == "linux":
    from fcntl import F_SETPIPE_SZ, fcntl

LOG = logging.getLogger(__name__)
BEAT_S = 0.1
UNREAD_BYTES = 4096  # of beats: a supervisor that leaves more, some 20 s on Linux, is suspended
ENDS_S = 5.0
MARGIN_S = 0.4  # the run itself has stopped the stage before, if it can
MARGIN_M = 5e-6

Motion = tuple[int, float, bool]  # newest sample, travel (m), whether the stage drives


class SupervisedBench:
    """A bench whose stage is stopped from outside should this process fail.

    A stage that has no way from outside (a simulated one) has no supervisor.

    Parameters
    ----------
    bench : BenchDevices
    limits : Limits
    motion : callable
        How the run stands.
    on_start : callable
        Told the number of each process that is started.
    answer : Path
        File in which the supervisor says what became of its stop.

    Attributes
    ----------
    forces, camera, actuator
        The devices of the bench.
    """

    def __init__(
        self,
        bench: BenchDevices,
        limits: Limits,
        motion: Callable[[], Motion],
        on_start: Callable[[int], None],
        answer: Path,
    ) -> None:
        self._bench, self._limits = bench, limits
        self.forces, self.camera, self.actuator = bench.forces, bench.camera, bench.actuator
        self._motion, self._on_start = motion, on_start
        self._answer = answer
        self._process: Process | None = None
        self._over = threading.Event()
        self._thread: threading.Thread | None = None

    def open(self) -> None:
        """Open the devices, and have them watched.

        Raises
        ------
        DeviceError
            A device is not there, or the supervisor does not start: nothing moves without it.
        """
        self._bench.open()
        try:
            self.begin_watch()
        except BaseException:
            self._bench.close()
            raise

    def close(self) -> None:
        """Close the devices; the supervisor goes when nothing can move any more."""
        try:
            self._bench.close()
        finally:
            self.end_watch()

    def begin_watch(self) -> None:
        """Have the stage of a bench that is open watched.

        Raises
        ------
        ProcessFailed
            The supervisor does not start.
        """
        # one that is wrapped for a simulated world has the method as well
        make_stopper = getattr(self.actuator, "stopper", None)
        if make_stopper is None:
            return
        watch = Watch(
            make_stopper(),
            os.getpid(),
            self._limits.age + MARGIN_S,
            self._limits.travel + MARGIN_M,
            self._answer,
        )
        self._supervise(watch)
        self._thread = start_thread("beat", self._beat, watch)

    def end_watch(self) -> None:
        """Let the supervisor go: nothing can move any more."""
        self._over.set()
        if self._thread is not None:
            self._thread.join()

    def _supervise(self, watch: Watch) -> None:
        if self._process is not None:  # one that is suspended would stop the stage when it goes on
            _end(self._process)
            self._process = None
        process = start_process("app.processes.supervisor", watch)
        wait_until_ready(process)
        self._process = process
        assert process.stdin is not None
        if sys.platform != "win32":  # one that reads nothing must not hold up the end of the run
            os.set_blocking(process.stdin.fileno(), False)
        if sys.platform == "linux":
            with suppress(OSError):  # a longer pipe costs time only
                fcntl(process.stdin, F_SETPIPE_SZ, UNREAD_BYTES)
        self._on_start(process.pid)

    def _beat(self, watch: Watch) -> None:
        while not self._over.wait(BEAT_S):
            sample, travel_m, drives = self._motion()
            if not self._say(f"{sample} {travel_m:.9f} {int(drives)}\n"):
                LOG.warning("the supervisor is gone, or reads nothing, and is started again")
                try:
                    self._supervise(watch)
                except (ProcessFailed, UserError) as error:
                    LOG.error("%s", error)
        self._say("end\n")
        if self._process is not None:
            try:
                self._process.wait(ENDS_S)
            except subprocess.TimeoutExpired:
                _end(self._process)

    def _say(self, beat: str) -> bool:
        if self._process is None:  # the last one was ended, and the next did not start
            return False
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(beat.encode())
            self._process.stdin.flush()
        except OSError:
            return False
        return True


def _end(process: Process) -> None:
    """End a supervisor, and forget what it has not read."""
    process.kill()
    assert process.stdin is not None
    with suppress(OSError):
        process.stdin.close()
    with suppress(subprocess.TimeoutExpired):
        process.wait(ENDS_S)
