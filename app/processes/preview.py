"""A bench that is connected and looked at without a run, in a process of its own: a device that
hurts its process hurts no window, and every device is free once the process has ended.
"""

from __future__ import annotations

import logging
import os
import secrets
import shutil
import subprocess
import sys
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, cast

from app.acquisition.connected_bench import Preview
from app.acquisition.force_reader import BenchDevices
from app.processes.calls import Caller, Gone, Methods, Server, Silent
from app.processes.folder import ANSWER, claim, new_folder, told
from app.processes.signals import acting_on_signals
from app.processes.starting import hello_of, payload, say_hello, started
from app.processes.supervision import SupervisedBench
from app.records.bench_view import BenchView
from app.runs import live
from app.settings.sections import Config
from app.system import logs
from app.system.errors import UserError
from app.system.stopping import StopAnswer, failed, not_connected
from drivers.errors import DeviceError
from drivers.protocols import Actuator, Camera, ForceSource

LOG = logging.getLogger(__name__)
LINGERS_S = 2.0  # while nobody calls
FIRST_CALL_S = 15.0
POLL_S = 0.05
CLOSES_S = 8.0  # for all devices, and the end of the process
ZEROES_S = 10.0
SUPERVISED_S = 3.0  # until the supervisor of a process that is gone has stopped its stage


@dataclass(frozen=True, slots=True)
class PreviewOrder:
    """A bench that is to be connected."""

    config: Config
    folder: Path
    verbose: bool = False


class _Opened(BenchDevices):
    """A bench whose devices somebody else opens and closes."""

    def __init__(self, bench: BenchDevices) -> None:
        self._bench = bench

    @property
    def forces(self) -> ForceSource:
        return self._bench.forces

    @property
    def camera(self) -> Camera:
        return self._bench.camera

    @property
    def actuator(self) -> Actuator:
        return self._bench.actuator

    def open(self) -> None:
        """Nothing."""

    def close(self) -> None:
        """Nothing."""


class _ServedPreview:
    """A preview, and what others may call of it."""

    def __init__(self, order: PreviewOrder) -> None:
        self.is_closed = threading.Event()
        self._folder = order.folder
        self._config = order.config
        self._supervised: SupervisedBench | None = None
        self.preview = live.make_preview(order.config, guard=self._guard)

    def methods(self) -> Methods:
        preview = self.preview
        return {
            "look": preview.look,
            "jog": preview.jog,
            "stop_motion": preview.stop_motion,
            "zero": lambda under_load: preview.zero(under_load=under_load),
            "set_zero": preview.set_zero,
            "close": self.close,
        }

    def close(self) -> None:
        """Let go of the devices; the process ends after that."""
        try:
            self.preview.close()
        except DeviceError as error:
            LOG.warning("%s", error)  # the end of the process frees them
        finally:
            # a stage that could not be stopped is the supervisor's once this process has ended
            if self._supervised is not None and not self.preview.motion()[2]:
                self._supervised.close()
            self.is_closed.set()

    def _guard(self, bench: BenchDevices, preview: Preview) -> None:
        """Have the stage stopped from outside should this process fail, as in a run."""
        supervised = SupervisedBench(
            _Opened(bench),
            self._config.limits,
            preview.motion,
            lambda pid: None,
            self._folder / ANSWER,
        )
        supervised.open()
        self._supervised = supervised


def main() -> None:
    """Connect the bench, serve it until it is closed or nobody calls any more."""
    order: PreviewOrder = payload()
    claim(order.folder)
    if order.verbose:
        logs.to_terminal()
    logs.tell_warnings(lambda sentence: LOG.warning("%s", sentence))
    sys.setswitchinterval(0.001)  # a stop waits for no more than that for the interpreter
    key = secrets.token_bytes(32)
    made: list[_ServedPreview] = []

    def stop(reason: str) -> None:
        LOG.info("%s", reason)
        if made:
            made[0].close()
        os._exit(1)

    with acting_on_signals(stop):
        # who started this process reads its log if it fails before it is ready, and then removes
        # the folder
        try:
            served = _ServedPreview(order)
        except (UserError, DeviceError) as error:
            say_hello(error)
            return
        made.append(served)
        server = Server(order.folder, key, served.methods)
        say_hello((server.address, key))
        try:
            served.preview.start()
            _attend(served, server)
        finally:
            shutil.rmtree(order.folder, ignore_errors=True)
    # threads that a device holds up do not keep the process
    threading.excepthook = lambda *_: None
    logging.shutdown()
    sys.stderr.flush()
    os._exit(0)


def _attend(served: _ServedPreview, server: Server) -> None:
    """Return when the devices were let go of; do that when nobody calls any more."""
    alone_since, patience_s = time.monotonic(), FIRST_CALL_S
    while not served.is_closed.wait(POLL_S):
        if server.connections:
            alone_since, patience_s = time.monotonic(), LINGERS_S
        if time.monotonic() - alone_since > patience_s:
            served.close()
    time.sleep(POLL_S)  # the answer to who has closed it is on its way


class LaunchedPreview:
    """A bench in a process that was started for it; see `app.records.bench_view.BenchPreview`.

    Raises
    ------
    UserError, DeviceError
        There is no such bench.
    ProcessFailed
        Its process can not begin.
    """

    def __init__(self, config: Config) -> None:
        self.config = config
        self._folder = new_folder()
        self._closing = threading.Lock()
        self._is_closed = False
        is_verbose = logs.is_on_terminal()
        log = None if is_verbose else self._folder / "preview.log"
        order = PreviewOrder(config, self._folder, is_verbose)
        self.process: subprocess.Popen[bytes] = started("app.processes.preview", order, log)
        try:
            with cast(BinaryIO, self.process.stdin), cast(BinaryIO, self.process.stdout):
                address, key = hello_of(self.process, log)
        except BaseException:
            self.process.kill()
            self.process.wait()
            shutil.rmtree(self._folder, ignore_errors=True)
            raise
        # each goes a way of its own: none waits for another
        self._look, self._jog, self._stop, self._zero = (Caller(address, key) for _ in range(4))

    def look(self, known: int = -1) -> BenchView:
        """What it shows now."""
        view: BenchView = self._call(self._look, "look", known)
        return view

    def jog(self, direction: int, velocity_m_s: float) -> None:
        """Begin to move, or go on."""
        self._call(self._jog, "jog", direction, velocity_m_s)

    def stop_motion(self) -> StopAnswer:
        """Stop the stage; what became of that."""
        if self._is_closed:
            return not_connected("the bench is disconnected")
        try:
            answer: StopAnswer = self._stop("stop_motion")
        except Silent as error:
            return failed(f"bench: {error}", is_final=False)
        except Gone:
            return self._from_outside()
        return answer

    def _from_outside(self) -> StopAnswer:
        """What the supervisor of a process that is gone has done, as soon as it tells."""
        give_up = time.monotonic() + SUPERVISED_S
        while (answer := told(self._folder.name)) is None and time.monotonic() < give_up:
            time.sleep(POLL_S)
        return answer or failed(self._is_gone())

    def zero(self, *, under_load: bool = False) -> tuple[float, float]:
        """The readings without a force, volts."""
        volts: tuple[float, float] = self._call(self._zero, "zero", under_load, answer_s=ZEROES_S)
        return volts

    def set_zero(self, volts: tuple[float, float]) -> None:
        """Show the forces with these readings without a force."""
        self._call(self._zero, "set_zero", volts)

    def close(self) -> None:
        """Let go of every device; returns once the process has ended, which frees them all."""
        with self._closing:
            if self._is_closed:
                return
            self._is_closed = True
            try:
                self._stop("close", answer_s=CLOSES_S)
            except (Gone, Silent) as error:
                LOG.debug("the preview does not close", exc_info=error)
            try:
                self.process.wait(CLOSES_S / 4)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
            for caller in (self._look, self._jog, self._stop, self._zero):
                threading.Thread(target=caller.close, daemon=True).start()  # one may be busy
            shutil.rmtree(self._folder, ignore_errors=True)

    def _call(self, caller: Caller, name: str, *arguments: Any, answer_s: float = 5.0) -> Any:
        try:
            return caller(name, *arguments, answer_s=answer_s)
        except Gone:
            raise DeviceError(self._is_gone()) from None

    def _is_gone(self) -> str:
        if self._is_closed:
            return "bench: it is disconnected; connect it again"
        return (
            f"bench: its process (number {self.process.pid}) has ended, and its devices are free;"
            " connect it again, or begin a run"
        )
