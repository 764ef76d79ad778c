"""The main of a process that has a bench: made, told to whoever started it, then served to windows
and terminals that come and go.
"""

from __future__ import annotations

import logging
import math
import os
import secrets
import shutil
import sys
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

from app.acquisition.force_reader import BenchDevices
from app.processes.calls import Methods, Server
from app.processes.folder import (
    ANSWER,
    FILE,
    LOG_FILE,
    as_user_error,
    claim,
    is_open,
    new_folder,
    publish,
    root,
)
from app.processes.signals import acting_on_signals
from app.processes.starting import Launch, payload, report_ready
from app.processes.supervision import Motion, SupervisedBench
from app.settings.sections import Limits
from app.system import logs
from app.system.errors import UserError
from app.system.stopping import StopAnswer
from drivers.errors import DeviceError

LOG = logging.getLogger(__name__)
FIRST_CALL_S = 15.0  # until which whoever started the process has called
POLL_S = 0.05
SEEN_S = 60.0  # between the signs of life of a bench
LOG_BYTES = 1 << 20  # of a log in memory: what a driver prints has no end
LINGERS_AFTER_S = 1.0  # after its end, while somebody calls


class KnownBench:
    """A bench in this process that the other processes of its user find, and may call.

    Attributes
    ----------
    bench : RunningBench
        What its folder says of it.
    """

    def __init__(self, folder: Path) -> None:
        self.folder, self.bench = folder, claim(folder)
        self._server: Server | None = None
        self._has_warned, self._seen_at = False, -math.inf

    def publish(self, **changed: Any) -> None:
        """Tell in its folder what has changed of the bench."""
        self.bench = replace(self.bench, **changed)
        publish(self.folder, self.bench)

    def answer_calls(self, methods: Callable[[], Methods]) -> None:
        """Let others call it: `methods` gives what a new connection may call."""
        key = secrets.token_bytes(32)
        self._server = Server(self.folder, key, methods)
        self.publish(address=self._server.address, key=key.hex())

    @property
    def is_called(self) -> bool:
        """Whether another process is connected to it."""
        return self._server is not None and self._server.connections > 0

    def stay_known(self) -> None:
        """Make its folder again where that or its file is gone: Linux deletes what a user has in
        memory when the last of their sessions ends. What fails is tried again at the next call.
        Its file is never older than a minute, by which others tell how long ago it has died.
        """
        if self._server is None:
            return
        if os.path.exists(self.folder / FILE):
            if time.monotonic() - self._seen_at > SEEN_S:
                self._seen_at = time.monotonic()
                with suppress(OSError):  # somebody deletes it at this moment
                    os.utime(self.folder / FILE)
            return
        try:
            root()
            self.folder.mkdir(mode=0o700, exist_ok=True)
            # a pipe of Windows is no file of a folder, and still there
            if sys.platform != "win32" and not is_open(self._server.address):
                Path(self._server.address).unlink(missing_ok=True)
                self._server.listen()
            self.publish()
        except (OSError, UserError) as error:
            if not self._has_warned:
                self._has_warned = True
                LOG.warning(
                    "%s: the folder of the bench is gone and cannot be made again yet (%s); until"
                    " then no window and no slipscope stop finds this run",
                    self.folder,
                    error,
                )

    def forget(self) -> None:
        """Let nobody find it any more."""
        if self._server is not None:
            self._server.close()
        shutil.rmtree(self.folder, ignore_errors=True)


@contextmanager
def known_bench(
    title: str, methods: Callable[[Path], Methods], session: str = ""
) -> Iterator[None]:
    """Let the other processes of this user find and call a bench of this process meanwhile.

    Parameters
    ----------
    methods : callable
        Gives what a new connection may call, for the folder of the bench.
    session : str
        The file that it records; empty without a run.

    Raises
    ------
    UserError
        The folder of the benches cannot be written, or is not this user's alone.
    """
    folder, over = new_folder(), threading.Event()

    def stay() -> None:
        try:
            while not over.wait(POLL_S):
                bench.stay_known()
        finally:
            bench.forget()

    thread = threading.Thread(target=stay, name="slipscope-known")
    try:
        with as_user_error():
            bench = KnownBench(folder)
            bench.publish(title=title, session=session)
            bench.answer_calls(lambda: methods(folder))
        thread.start()
    except BaseException:
        over.set()
        shutil.rmtree(folder, ignore_errors=True)
        raise
    try:
        try:
            yield
        finally:
            give_up = time.monotonic() + LINGERS_AFTER_S
            while bench.is_called and time.monotonic() < give_up:  # it has not seen the end yet
                time.sleep(POLL_S)
    finally:
        over.set()
        thread.join()


class ServedBench(KnownBench, ABC):
    """A bench in a process of its own, and what others may call of it.

    Attributes
    ----------
    has_ended : threading.Event
        Set once nothing is left to be served.
    """

    def __init__(self, launch: Launch) -> None:
        super().__init__(launch.folder)
        self.has_ended = threading.Event()

    def supervised(
        self, bench: BenchDevices, limits: Limits, motion: Callable[[], Motion]
    ) -> SupervisedBench:
        """The bench, watched from outside; `motion` says how it stands."""
        answer = self.folder / ANSWER
        return SupervisedBench(
            bench, limits, motion, lambda pid: self.publish(supervisor_pid=pid), answer
        )

    def start(self) -> None:
        """Begin, now that it can be called."""

    @abstractmethod
    def methods(self) -> Methods:
        """What one connection may call."""

    @property
    @abstractmethod
    def lingers_s(self) -> float:
        """How long it goes on while nobody calls; infinite while something is under way."""

    @abstractmethod
    def stop(self, reason: str) -> None:
        """End what is under way, in good order; from any thread."""

    @abstractmethod
    def close(self) -> StopAnswer | None:
        """Let go of everything, and set `has_ended`; what became of a stop of the stage, if any."""


def serve(make: Callable[[Launch], ServedBench]) -> None:
    """Make a bench, serve it until it has ended and nobody asks any more, and end the process."""
    launch: Launch = payload()
    if launch.is_verbose:
        logs.to_terminal()
    logs.tell_warnings(lambda sentence: LOG.warning("%s", sentence))
    sys.setswitchinterval(0.001)  # a stop waits for no more than that for the interpreter
    # made while the signals are acted on already, so that none is lost
    made: list[ServedBench] = []

    def stop(reason: str) -> None:
        LOG.info("%s", reason)
        if made:
            made[0].stop(reason)
        else:
            os._exit(1)

    with acting_on_signals(stop):
        # who started this process reads its log if it fails before it is ready, and then removes
        # the folder
        try:
            served = make(launch)
        except (UserError, DeviceError) as error:
            report_ready(error)
            return
        made.append(served)
        served.answer_calls(served.methods)
        report_ready(served.bench)
        try:
            served.start()
            _attend(served)
        finally:
            served.forget()
    # threads that a device holds up do not keep the process
    threading.excepthook = lambda *_: None
    logging.shutdown()
    sys.stderr.flush()
    os._exit(0)


def _attend(served: ServedBench) -> None:
    """Return when the bench has ended; let go of it when nobody calls any more."""
    alone_since, has_called = time.monotonic(), False
    log = served.folder / LOG_FILE
    while not served.has_ended.wait(POLL_S):
        served.stay_known()
        with suppress(OSError):  # there is none where its lines go to the terminal
            if log.stat().st_size > LOG_BYTES:
                os.truncate(log, 0)  # who writes, appends to it
        has_called = has_called or served.is_called
        if served.is_called or (lingers_s := served.lingers_s) == math.inf:
            alone_since = time.monotonic()
        elif time.monotonic() - alone_since > (lingers_s if has_called else FIRST_CALL_S):
            served.close()
    time.sleep(POLL_S)  # the answer to who has closed it is on its way
