"""A run in another process, with the methods that the window and the terminal use of one in their
own.
"""

from __future__ import annotations

import logging
import shutil
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np
from numpy.typing import NDArray

from app.evaluation.series import Series
from app.evaluation.setup import grid_of
from app.processes.bench import Order
from app.processes.calls import Caller, Gone, Silent
from app.processes.folder import RunningBench, known, new_folder, root, shared_image, told
from app.processes.starting import hello_of, started
from app.records.bench_view import Health
from app.records.record_types import ContactResult, Counts, End, Outcome, Snapshot
from app.settings.sections import Config
from app.system import logs
from app.system.stopping import Stop, StopAnswer, failed, not_connected

LOG = logging.getLogger(__name__)
POLL_S = 0.05
SUPERVISED_S = 3.0  # until the supervisor of a bench that is gone has stopped its stage
POINTS = 4000  # of the forces that are kept once the run has ended


class RemoteRun:
    """A run on a bench in another process; whatever reads it may be called from any thread.

    Once it has ended everything is held here, and the other process is let go. If that dies, the
    run has failed, by name.

    Attributes
    ----------
    title, config, pixel_m, sample_rate_hz, grid_x_px, grid_y_px
        As of `app.evaluation.observed_run.ObservedRun`.
    session : Path
        The file that it records.
    stays : bool
        Whether the run goes on when the window that shows it is closed.
    """

    stays = True

    def __init__(self, bench: RunningBench) -> None:
        self.bench, self.session = bench, Path(bench.session)
        key = bytes.fromhex(bench.key)
        # orders go a way of their own, on which nothing else is asked
        self._ask, self._order = Caller(bench.address, key), Caller(bench.address, key)
        config, self.title = self._ask("config")
        self.config: Config = config
        self.pixel_m, self.sample_rate_hz = config.camera.pixel, float(config.forces.sample_rate)
        grid = grid_of(config)
        self.grid_x_px, self.grid_y_px = grid.x_px, grid.y_px
        self._lock = threading.RLock()
        self._series = Series()
        self._contact: ContactResult | None = None
        self._image: NDArray[Any] | None = None
        self._reference: NDArray[Any] | None = None
        self._forces: tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]] | None
        self._forces = None
        self._health = Health("idle", "", "", Counts(), 0.0, 0.0, -1, 0, 0.0)
        self._outcome: Outcome | None = None
        self._stopped: StopAnswer | None = None
        self._is_dead = False  # the bench has ended without a word

    # ------------------------------------------------------------------ orders

    def start(self) -> None:
        """Begin, unless it has begun; returns at once."""
        if self._outcome is None and self._ask("health").state == "idle":
            self._order("start")

    def stop_motion(self) -> StopAnswer:
        """Stop the actuator, then end the run; what the actuator answered, or the supervisor if the
        bench is gone.
        """
        if self._outcome is None:
            try:
                answer: StopAnswer = self._order("stop_motion")
                return answer
            except Silent as error:
                return self.stop_answer() or failed(f"bench: {error}", is_final=False)
            except Gone as error:
                self._has_died(error)
        known = self._stopped
        if known is not None and (known.kind is Stop.FAILED or self._is_dead):
            return known
        return not_connected("the run has ended and its bench is closed")

    def stop_answer(self) -> StopAnswer | None:
        """What became of the newest stop, whoever called for it; None where none was sent."""
        with self._lock:
            if self._outcome is None:
                self._stopped = self._read("stop_answer", self._stopped)
            return self._stopped

    def _from_outside(self) -> StopAnswer:
        """What the supervisor answers for a bench that is gone, as soon as it does."""
        has_ended = f"bench: its process (number {self.bench.pid}) has ended"
        if self._health.state in ("idle", "armed"):
            return not_connected(f"{has_ended} before anything could move")
        if not known(self.bench).supervisor_pid:
            return failed(f"{has_ended}, and no supervisor watches its stage")
        give_up = time.monotonic() + SUPERVISED_S
        while (answer := told(self.bench.name)) is None and time.monotonic() < give_up:
            time.sleep(POLL_S)
        return answer or failed(f"{has_ended}, and its supervisor says nothing of the stage")

    def request_stop(self, reason: str) -> None:
        """End the run in good order; once the stop was sent."""
        if self._outcome is None:
            try:
                self._order("request_stop", reason)
            except Silent as error:
                LOG.warning("%s", error)
            except Gone as error:
                self._has_died(error)

    def answer(self, text: str) -> None:
        """Answer the question of the step under way."""
        if self._outcome is None:
            self._order("answer", text)

    # ------------------------------------------------------------------ reading

    def health(self) -> Health:
        """The state of the run at a glance."""
        self._look_for_end()
        if self._outcome is None:
            self._health = self._read("health", self._health)
        if self._outcome is not None:
            return _ended(self._health, self._outcome)
        return self._health

    def outcome(self) -> Outcome | None:
        """How the run ended; None while it has not."""
        self._look_for_end()
        return self._outcome

    def wait(self, timeout: float | None = None) -> Outcome | None:
        """The outcome, or None if there is none after `timeout` seconds."""
        give_up = None if timeout is None else time.monotonic() + timeout
        while (outcome := self.outcome()) is None:
            if give_up is not None and time.monotonic() > give_up:
                return None
            time.sleep(POLL_S)
        return outcome

    def snapshots_since(self, n: int, *, is_shown: bool = False) -> list[Snapshot]:
        """The snapshots after the first `n`; only the newest holds all its parts."""
        with self._lock:
            if self._outcome is None:
                for snapshot in self._read("snapshots_since", [], len(self._series), is_shown):
                    self._series.append(snapshot)
            return self._series.since(n)

    def contact(self) -> ContactResult | None:
        """The apparent contact, once the reference was taken."""
        if self._contact is None and self._outcome is None:
            self._contact = self._read("contact", None)
        return self._contact

    def force_history(
        self, n: int
    ) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
        """About `n` points of the run so far: samples, P and Q in newtons."""
        if self._outcome is None:
            self._forces = self._read("force_history", self._forces, n)
        if self._forces is None:
            return np.empty(0, np.int64), np.empty(0), np.empty(0)
        every = max(1, len(self._forces[0]) // max(1, n))
        samples, normal, shear = self._forces
        return samples[::every], normal[::every], shear[::every]

    def latest_image(self) -> NDArray[Any] | None:
        """The newest frame's image, which holds until the next but one is asked for; the same
        object until there is a newer one.
        """
        with self._lock:
            if self._outcome is None:
                name = self._read("image", None)
                if name is not None:
                    self._image = self._shared(name)
            return self._image

    def reference_image(self) -> NDArray[Any] | None:
        """The image from which displacements are measured; None before it was taken."""
        with self._lock:
            if self._reference is None and self._outcome is None:
                name = self._read("reference", None)
                if name is not None:
                    self._reference = self._shared(name)
            return self._reference

    def _shared(self, name: str) -> NDArray[Any]:
        camera = self.config.camera
        path = root() / self.bench.name / name
        return shared_image(path, camera.shape, np.dtype(camera.dtype))

    def _read(self, name: str, otherwise: Any, *arguments: Any) -> Any:
        """What the bench answers; `otherwise` where it does not yet, or has died, which ends the
        run.
        """
        try:
            return self._ask(name, *arguments)
        except Silent as error:
            LOG.warning("%s", error)
            return otherwise
        except Gone as error:
            self._has_died(error)
            return otherwise

    def _look_for_end(self) -> None:
        with self._lock:
            if self._outcome is not None:
                return
            outcome: Outcome | None = self._read("outcome", None)
            if outcome is None:
                return
            self.snapshots_since(0)
            self.contact()
            self.force_history(POINTS)
            self.latest_image()
            self.reference_image()
            self.stop_answer()
            self._health = self._read("health", self._health)
            self._outcome = self._outcome or outcome
            self._ask.close()
            self._order.close()

    def _has_died(self, error: Exception) -> None:
        with self._lock:
            if self._outcome is None:
                LOG.debug("the bench has died", exc_info=error)
                self._is_dead, self._stopped = True, self._from_outside()
                stage = "a stop was sent to its stage from outside"
                if self._stopped.kind is not Stop.SENT:
                    stage = "nothing was sent to its stage from outside"
                reason = (
                    f"bench: its process (number {self.bench.pid}) has ended, and {stage}; what was"
                    f" recorded is safe, slipscope repair {self.session.name} gives it back"
                )
                self._outcome = Outcome(End.FAILED, reason, self._health.counts, None)


class LaunchedRun(RemoteRun):
    """A run on a bench that was started for it, as the `main` of a module.

    Raises
    ------
    UserError, DeviceError
        The run can not be made.
    ProcessFailed
        Its process can not begin.
    """

    stays = False

    def __init__(
        self,
        config: Config,
        output: Path,
        *,
        pace: float,
        overwrite: bool,
        module: str = "app.processes.bench",
    ) -> None:
        folder = new_folder()
        is_verbose = logs.is_on_terminal()
        order = Order(config, output, pace, overwrite, folder, is_verbose)
        log = None if is_verbose else folder / "bench.log"
        try:
            process = started(module, order, log)
            # it is reaped whenever it ends, which may be long after this program
            threading.Thread(target=process.wait, name="slipscope-reaper", daemon=True).start()
            with cast(BinaryIO, process.stdin), cast(BinaryIO, process.stdout):
                bench = hello_of(process, log)
            super().__init__(bench)
        except BaseException:
            shutil.rmtree(folder, ignore_errors=True)
            raise


def _ended(last: Health, outcome: Outcome) -> Health:
    """The last health of a run that has ended so."""
    return replace(last, state=outcome.state, reason=outcome.reason, counts=outcome.counts)
