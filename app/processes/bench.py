"""The bench as a process: devices, control and recorder of one run, served to windows and
terminals that come and go.
"""

from __future__ import annotations

import gc
import logging
import os
import secrets
import shutil
import sys
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import Any

import psutil

from app.acquisition.run import Run
from app.processes.calls import Methods, Server
from app.processes.folder import ANSWER, RunningBench, claim, publish, shown_images
from app.processes.making import made_in_a_process
from app.processes.pipeline_process import PipelineProcess
from app.processes.signals import acting_on_signals
from app.processes.starting import payload, say_hello
from app.processes.supervision import Motion, SupervisedBench
from app.runs import live
from app.settings.sections import Config
from app.system import logs
from app.system.errors import UserError
from drivers.errors import DeviceError

LOG = logging.getLogger(__name__)
# while nobody calls
LINGERS_BEFORE_S, LINGERS_AFTER_S = 10.0, 1.0
POLL_S = 0.05


@dataclass(frozen=True, slots=True)
class Order:
    """A run that is to be made."""

    config: Config
    output: Path
    pace: float
    overwrite: bool
    folder: Path
    verbose: bool = False


class _Served:
    """A run, and what others may call of it."""

    def __init__(self, order: Order) -> None:
        self.order, self.key = order, secrets.token_bytes(32)
        me = psutil.Process()
        self.bench = RunningBench(
            order.folder.name,
            "",
            str(order.output.resolve()),
            "",
            self.key.hex(),
            me.pid,
            me.create_time(),
        )
        self.pipeline = PipelineProcess(
            order.config, order.folder, lambda pid: self.tell(analysis_pid=pid)
        )
        self.pipeline.begin()  # it takes a while, and so do the devices
        self.run: Run = live.make_run(
            order.config,
            order.output,
            pace=order.pace,
            overwrite=order.overwrite,
            pipeline=self.pipeline,
            wrap=self.supervised,
            prepare_analysis=self._prepare_analysis,
            make=made_in_a_process,
        )
        self._numbers: Iterator[int] = count()

    def _prepare_analysis(self) -> None:
        self.pipeline.wait()
        # a look at all that was loaded takes 0.1 s with every thread at a stand, also the one
        # that stops the motion
        gc.collect()
        gc.freeze()

    def supervised(self, bench: Any) -> SupervisedBench:
        """The bench, watched from outside."""
        limits = self.order.config.limits
        return SupervisedBench(
            bench,
            limits,
            self._motion,
            lambda pid: self.tell(supervisor_pid=pid),
            self.order.folder / ANSWER,
        )

    def _motion(self) -> Motion:
        return self.run.motion()

    def tell(self, **changed: Any) -> None:
        """Publish what is known of the bench, once it can be called."""
        self.bench = replace(self.bench, **changed)
        if self.bench.address:
            publish(self.order.folder, self.bench)

    def methods(self) -> Methods:
        """What one connection may call."""
        run, number = self.run, next(self._numbers)
        share = shown_images(self.order.folder, number)
        share_reference = shown_images(self.order.folder, next(self._numbers))
        shown: list[Any] = [None]  # held, so that no newer image can be taken for it

        def reference() -> str | None:
            taken = run.reference_image()
            return None if taken is None else share_reference(taken)

        def image() -> str | None:
            newest = run.latest_image()
            if newest is None or newest is shown[0]:
                return None
            shown[0] = newest
            return share(newest)

        return {
            "config": lambda: (self.order.config, run.title),
            "start": run.start,
            "stop_motion": run.stop_motion,
            "request_stop": run.request_stop,
            "answer": run.answer,
            "stop_answer": run.stop_answer,
            "health": run.health,
            "outcome": run.outcome,
            "contact": run.contact,
            "snapshots_since": lambda n, is_shown: run.snapshots_since(n, is_shown=is_shown),
            "force_history": run.force_history,
            "image": image,
            "reference": reference,
            "threads": lambda: {t.native_id: t.name for t in threading.enumerate()},
        }


def main() -> None:
    """Make the run, serve it until it has ended and nobody asks any more."""
    order: Order = payload()
    claim(order.folder)
    if order.verbose:
        logs.to_terminal()
    logs.tell_warnings(lambda sentence: LOG.warning("%s", sentence))
    sys.setswitchinterval(0.001)  # a stop waits for no more than that for the interpreter
    # made while the signals are acted on already, so that none is lost
    made: list[_Served] = []

    def stop(reason: str) -> None:
        if made:
            made[0].run.request_stop(reason)
        else:
            os._exit(1)

    with acting_on_signals(stop):
        # who started this process reads its log if it fails before it is ready, and then removes
        # the folder
        try:
            served = _Served(order)
        except (UserError, DeviceError) as error:
            say_hello(error)
            return
        made.append(served)
        server = Server(order.folder, served.key, served.methods)
        served.tell(address=server.address, title=served.run.title)
        say_hello(served.bench)
        try:
            _attend(served.run, server)
            served.pipeline.end()
        finally:
            shutil.rmtree(order.folder, ignore_errors=True)
    # threads that a device holds up do not keep the process
    threading.excepthook = lambda *_: None
    logging.shutdown()
    sys.stderr.flush()
    os._exit(0)


def _attend(run: Run, server: Server) -> None:
    """Return when the run has ended, or never begins, and nobody asks."""
    alone_since = time.monotonic()
    while True:
        run.wait(POLL_S)
        time.sleep(POLL_S)
        state = run.health().state
        if server.connections or state not in ("idle", "done", "failed"):
            alone_since = time.monotonic()
        lingers_s = LINGERS_BEFORE_S if state == "idle" else LINGERS_AFTER_S
        if time.monotonic() - alone_since > lingers_s:
            return
