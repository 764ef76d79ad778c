"""Benches in other processes, with the methods that the window and the terminal use of one in their
own.
"""

from __future__ import annotations

import logging
import math
import shutil
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, BinaryIO, cast

import numpy as np

from app.evaluation.series import Series
from app.evaluation.setup import grid_of
from app.processes.bench_client import POLL_S, BenchClient
from app.processes.calls import ANSWER_S, Caller, Gone, Silent
from app.processes.folder import (
    LOG_FILE,
    RUN,
    RunningBench,
    new_folder,
    refreshed,
    root,
    shared_image,
)
from app.processes.starting import (
    Launch,
    Process,
    RunOrder,
    end,
    start_process,
    wait_until_ready,
)
from app.records.bench_view import BenchView
from app.records.record_types import End, Outcome
from app.records.run_view import RunView
from app.settings.sections import Config
from app.system import logs
from app.system.stopping import Stop, StopAnswer, failed, not_connected
from app.system.threads import start_thread
from drivers.errors import DeviceError
from drivers.sources import DRIVERS

LOG = logging.getLogger(__name__)
CLOSES_S = 8.0  # time that all devices and the process have to close
ZEROES_S = 10.0


def launched(module: str, order: Any) -> tuple[RunningBench, Process]:
    """A bench that was started for it, as the `main` of a module, and its process.

    Raises
    ------
    UserError, DeviceError
        It cannot be made.
    ProcessFailed
        Its process cannot begin.
    """
    folder, is_verbose = new_folder(), logs.is_on_terminal()
    log = None if is_verbose else folder / LOG_FILE
    process: Process | None = None
    try:
        process = start_process(module, Launch(order, folder, is_verbose), log, folder=folder)
        # it is reaped whenever it ends, which may be long after this program
        start_thread("reaper", process.wait)
        with cast(BinaryIO, process.stdin), cast(BinaryIO, process.stdout):
            return wait_until_ready(process, log), process
    except BaseException:
        if process is not None:  # after Ctrl-C it is still under way to a bench that nobody wants
            process.terminate()
        shutil.rmtree(folder, ignore_errors=True)
        raise


class RemoteRun(BenchClient):
    """A run on a bench in another process; whatever reads it may be called from any thread.

    Once it has ended everything is held here, and the other process is let go. If that dies, the
    run has failed, by name.

    Attributes
    ----------
    title, config, grid_x_px, grid_y_px
        As of `app.evaluation.observed_run.ObservedRun`.
    session : Path
        The file that it records.
    stays : bool
        Whether the run goes on when the window that shows it is closed.
    """

    stays = True

    def __init__(self, bench: RunningBench) -> None:
        super().__init__(bench)
        self.session = Path(bench.session)
        # who wants to know the state does not wait for all that a window shows
        self.looks, self._states = self.new_caller(), self.new_caller()
        # a stop waits for nothing, an end for no other order
        self._ends, self._others = self.new_caller(), self.new_caller()
        config, self.title, health = self.answered(self.looks, "about")
        self.config: Config = config
        grid = grid_of(config)
        self.grid_x_px, self.grid_y_px = grid.x_px, grid.y_px
        self._lock = threading.Lock()
        self._view, self._series = RunView(health), Series()  # the newest, all snapshots
        self._is_dead = False  # the bench has ended without a word
        self._is_silent = False  # it has not answered the newest look

    def start(self) -> None:
        """Begin, unless it has begun; returns at once."""
        self._order("start")

    def _order(self, name: str, *arguments: Any) -> None:
        if self._view.outcome is None:
            self.answered(self._others, name, *arguments)

    def stop_motion(self) -> StopAnswer:
        """Stop the actuator, then end the run; what the actuator answered, or the supervisor if the
        bench is gone.
        """
        if self._view.outcome is None:
            try:
                return super().stop_motion()
            except Silent as error:
                answer = failed(f"bench: {error}; {self.why_silent()}", is_final=False)
                return self.look().stop or answer
            except Gone as error:
                self._has_died(error)
        known = self._view.stop
        if known is not None and (known.has_failed or self._is_dead):
            return known
        return not_connected("the run has ended and its bench is closed")

    def request_stop(self, reason: str) -> None:
        """End the run in good order; once the stop was sent."""
        if self._view.outcome is None:
            try:
                self._ends("request_stop", reason)
            except Silent as error:
                LOG.warning("bench: %s; %s", error, self.why_silent())
            except Gone as error:
                self._has_died(error)

    def answer(self, text: str, question: str = "") -> None:
        """Answer a question, if it is that of the step under way."""
        self._order("answer", text, question)

    def pause(self) -> None:
        """Wait for the operator's answer before the next step."""
        self._order("pause")

    def cancel_pause(self) -> None:
        """Withdraw a pause that has not begun."""
        self._order("cancel_pause")

    def note(self, text: str) -> None:
        """Record a note of the operator."""
        self._order("note", text)

    def look(self, seen: int = -1, *, is_shown: bool = False) -> RunView:
        """What it shows now; see `app.evaluation.observed_run.ObservedRun.look`."""
        is_whole, answer = seen >= 0, None
        if self._view.outcome is None:
            answer = self._ask(is_whole=is_whole, is_shown=is_shown)
            is_slow = is_whole and answer is None  # its state comes sooner than all
            is_over = not is_whole and answer is not None and answer[0].outcome is not None
            if is_slow or is_over:
                answer = self._ask(is_whole=not is_whole, is_shown=is_shown) or answer
            if answer is not None:
                self._hold(*answer)
        snapshots = tuple(self._series.since(seen)) if is_whole else ()
        view = self._view
        # of a stop that was pressed meanwhile an older word is no answer
        stop = view.stop if answer is not None or view.outcome is not None else None
        return replace(view, snapshots=snapshots, stop=stop)

    def wait(self, timeout: float | None = None) -> Outcome | None:
        """The outcome, or None if there is none after `timeout` seconds."""
        give_up = math.inf if timeout is None else time.monotonic() + timeout
        while (outcome := self.look().outcome) is None:
            if time.monotonic() > give_up:
                return None
            time.sleep(POLL_S)
        return outcome

    def _ask(self, *, is_whole: bool, is_shown: bool) -> tuple[RunView, dict[str, Any], int] | None:
        """What the bench shows, all of it or its state; what is new of it, and after how many
        snapshots. None where it does not answer.
        """
        caller, seen = (self.looks, len(self._series)) if is_whole else (self._states, -1)
        try:
            answer = (*caller("look", seen, is_shown), seen)
        except Silent:
            if not self._is_silent:  # each look fails until it answers
                self._is_silent = True
                LOG.warning(
                    "bench: what is shown of %s stands still, as it has not answered within %g s;"
                    " %s",
                    self.session.name,
                    ANSWER_S,
                    self.why_silent(),
                )
        except Gone as error:
            self._has_died(error)
        else:
            self._is_silent = False
            return answer
        return None

    def _hold(self, view: RunView, new: dict[str, Any], seen: int) -> None:
        """Keep what the bench has answered; it is let go once the run has ended."""
        with self._lock:
            before = self._view
            if before.outcome is not None:  # somebody else has looked meanwhile
                return
            if seen >= 0:
                for snapshot in view.snapshots[len(self._series) - seen :]:
                    self._series.append(snapshot)
            self._view = replace(
                view,
                snapshots=(),
                contact=new.get("contact", before.contact),
                forces=view.forces if seen >= 0 else before.forces,
                image=self._shared(new["image"]) if "image" in new else before.image,
                reference=(
                    self._shared(new["reference"]) if "reference" in new else before.reference
                ),
            )
            if view.outcome is not None:
                for caller in (self.looks, self._states, self.orders, self._ends, self._others):
                    caller.close(waits=False)

    def _shared(self, name: str) -> Any:
        camera = self.config.camera
        path = root() / self.bench.name / name
        return shared_image(path, camera.shape, np.dtype(camera.dtype))

    def _has_died(self, error: Exception) -> None:
        with self._lock:
            if self._view.outcome is None:
                LOG.debug("the bench has died", exc_info=error)
                self._is_dead, stop = True, self._answer_from_outside()
                stage = "a stop was sent to its stage from outside"
                if stop.kind is not Stop.SENT:
                    stage = "nothing was sent to its stage from outside"
                kept = "it had recorded nothing yet"
                if self._may_have_moved:
                    kept = (
                        f"what was recorded is safe, `slipscope repair {self.session} -o"
                        " REPAIRED.h5` gives it back"
                    )
                reason = (
                    f"bench: its process (number {self.bench.pid}) has ended, and {stage}; {kept}"
                )
                health = replace(self._view.health, state="failed", reason=reason)
                outcome = Outcome(End.FAILED, reason, health.counts, None)
                self._view = replace(self._view, health=health, outcome=outcome, stop=stop)

    @property
    def _may_have_moved(self) -> bool:
        health = self._view.health
        # one that was stopped before its first sample never moves
        return health.state not in ("idle", "armed") and (
            health.state != "stopping" or health.sample > 0
        )

    def _answer_from_outside(self) -> StopAnswer:
        has_ended = f"bench: its process (number {self.bench.pid}) has ended"
        if not self._may_have_moved:
            return not_connected(f"{has_ended} before anything could move")
        # of the program's own drivers: the class of any other may not be loaded here
        own = DRIVERS["actuator"].get(self.config.actuator.source)
        if own is not None and own.own_nature in ("simulated", "stored"):
            return not_connected(f"{has_ended}, and with it its stage, which was no real one")
        if not refreshed(self.bench).supervisor_pid:
            return failed(f"{has_ended}, and no supervisor watches its stage")
        return self.supervisor_answer() or failed(
            f"{has_ended}, and its supervisor says nothing of the stage"
        )


class LaunchedRun(RemoteRun):
    """A run on a bench that was started for it; raises as `launched`."""

    stays = False

    def __init__(
        self,
        config: Config,
        output: Path,
        *,
        pace: float,
        overwrite: bool,
        module: str = RUN,
    ) -> None:
        super().__init__(launched(module, RunOrder(config, output, pace, overwrite))[0])


class LaunchedPreview(BenchClient):
    """A bench that is connected in a process that was started for it; see
    `app.records.bench_view.BenchPreview`. Raises as `launched`.
    """

    def __init__(self, config: Config) -> None:
        self.config = config
        bench, self.process = launched("app.processes.preview", config)
        super().__init__(bench)
        self._closing = threading.Lock()
        self._is_closed = False
        self._last_answer: StopAnswer | None = None
        self._look, self._jog, self._zero = (self.new_caller() for _ in range(3))

    def look(self, known: int = -1) -> BenchView:
        """What it shows now."""
        view: BenchView = self._call(self._look, "look", known)
        return view

    def jog(self, direction: int, velocity_m_s: float) -> None:
        """Begin to move, or go on."""
        self._call(self._jog, "jog", direction, velocity_m_s)

    def move(self, goal_m: float, velocity_m_s: float) -> None:
        """Begin to move to a place."""
        self._call(self._jog, "move", goal_m, velocity_m_s)

    def home(self) -> None:
        """Begin to search the origin."""
        self._call(self._jog, "home")

    def go_on(self) -> None:
        """Let a move, or a search, go on."""
        self._call(self._jog, "go_on")

    def let_go(self) -> StopAnswer:
        """Stop the stage that is held no more; what became of that."""
        return self._stopped("let_go")

    def stop_motion(self) -> StopAnswer:
        """Stop the stage, whoever holds it; what became of that."""
        return self._stopped("stop_motion")

    def _stopped(self, order: str) -> StopAnswer:
        if self._is_closed:
            return not_connected("the bench is disconnected")
        try:
            answer: StopAnswer = self.orders(order)
        except Silent as error:
            return failed(f"bench: {error}; {self.why_silent()}", is_final=False)
        except Gone:
            return self.supervisor_answer() or failed(self._is_gone())
        return answer

    def zero(self, *, under_load: bool = False) -> tuple[float, float]:
        """The readings without a force, volts."""
        volts: tuple[float, float] = self._call(self._zero, "zero", under_load, answer_s=ZEROES_S)
        return volts

    def set_zero(self, volts: tuple[float, float]) -> None:
        """Show the forces with these readings without a force."""
        self._call(self._zero, "set_zero", volts)

    def adjust_camera(self, exposure_s: float, gain_db: float) -> bool:
        """Take pictures with this exposure and gain from now on."""
        is_adjusted: bool = self._call(self._zero, "adjust_camera", exposure_s, gain_db)
        return is_adjusted

    def close(self) -> StopAnswer | None:
        """Let go of every device; returns once the process has ended, which frees them all. What
        became of the newest stop of the stage.
        """
        with self._closing:
            if self._is_closed:
                return self._last_answer
            self._is_closed = True
            try:
                self._last_answer = self.orders("close", answer_s=CLOSES_S)
            except (Gone, Silent) as error:
                LOG.debug("the preview does not close", exc_info=error)
            end(self.process, CLOSES_S / 4)
            known = self._last_answer
            if known is None or known.has_failed:
                self._last_answer = self.supervisor_answer() or known
            for caller in (self._look, self._jog, self.orders, self._zero):
                caller.close(waits=False)
            shutil.rmtree(root() / self.bench.name, ignore_errors=True)
            return self._last_answer

    def _call(self, caller: Caller, name: str, *arguments: Any, answer_s: float = 5.0) -> Any:
        try:
            return self.answered(caller, name, *arguments, answer_s=answer_s)
        except Gone:
            raise DeviceError(self._is_gone()) from None

    def _is_gone(self) -> str:
        if self._is_closed:
            return "bench: it is disconnected; connect it again"
        return (
            f"bench: its process (number {self.bench.pid}) has ended, and its devices are free;"
            " connect it again, or begin a run"
        )
