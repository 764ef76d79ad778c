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
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from app.acquisition.force_reader import BenchDevices
from app.processes.calls import Methods, Server
from app.processes.folder import ANSWER, claim, publish
from app.processes.signals import acting_on_signals
from app.processes.starting import Launch, payload, report_ready
from app.processes.supervision import Motion, SupervisedBench
from app.settings.sections import Limits
from app.system import logs
from app.system.errors import UserError
from drivers.errors import DeviceError

LOG = logging.getLogger(__name__)
FIRST_CALL_S = 15.0  # until which whoever started the process has called
POLL_S = 0.05


class ServedBench(ABC):
    """A bench in this process, and what others may call of it.

    Attributes
    ----------
    bench : RunningBench
        What its folder says of it.
    has_ended : threading.Event
        Set once nothing is left to be served.
    """

    def __init__(self, launch: Launch) -> None:
        self.folder, self.bench = launch.folder, claim(launch.folder)
        self.has_ended = threading.Event()

    def publish(self, **changed: Any) -> None:
        """Tell in its folder what has changed of the bench."""
        self.bench = replace(self.bench, **changed)
        publish(self.folder, self.bench)

    def supervised(
        self, bench: BenchDevices, limits: Limits, motion: Callable[[], Motion]
    ) -> SupervisedBench:
        """The bench, watched from outside; `motion` says how it stands."""
        answer = self.folder / ANSWER
        return SupervisedBench(
            bench, limits, motion, lambda pid: self.publish(supervisor_pid=pid), answer
        )

    def start(self) -> None:  # noqa: B027 - a run waits for its order
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
    def close(self) -> None:
        """Let go of everything, and set `has_ended`."""


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
        key = secrets.token_bytes(32)
        server = Server(launch.folder, key, served.methods)
        served.publish(address=server.address, key=key.hex())
        report_ready(served.bench)
        try:
            served.start()
            _attend(served, server)
        finally:
            shutil.rmtree(launch.folder, ignore_errors=True)
    # threads that a device holds up do not keep the process
    threading.excepthook = lambda *_: None
    logging.shutdown()
    sys.stderr.flush()
    os._exit(0)


def _attend(served: ServedBench, server: Server) -> None:
    """Return when the bench has ended; let go of it when nobody calls any more."""
    alone_since, has_called = time.monotonic(), False
    while not served.has_ended.wait(POLL_S):
        has_called = has_called or server.connections > 0
        if server.connections or (lingers_s := served.lingers_s) == math.inf:
            alone_since = time.monotonic()
        elif time.monotonic() - alone_since > (lingers_s if has_called else FIRST_CALL_S):
            served.close()
    time.sleep(POLL_S)  # the answer to who has closed it is on its way
