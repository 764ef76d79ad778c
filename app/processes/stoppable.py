"""A stage that a command moves without a run, in its own process."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

from app.acquisition.stage import Stage
from app.processes.calls import Methods
from app.processes.serving import known_bench
from app.settings.sections import Config
from app.system.stopping import SETTLES_S, MotionStopped, StopAnswer, not_connected, sent_to
from app.system.threads import start_thread
from drivers.bench import WrappedDevice
from drivers.protocols import Actuator

STOPPED = "STOP MOTION"  # the reason of the interrupt


class StoppableActuator(WrappedDevice):
    """An actuator that another thread may stop for good: whoever asks it for anything after that is
    interrupted, as by Ctrl-C.

    Parameters
    ----------
    config : Config
    actuator : Actuator
    has_stopped : threading.Event
        Set by whoever stops it, before it is stopped.
    """

    def __init__(self, config: Config, actuator: Actuator, has_stopped: threading.Event) -> None:
        super().__init__(actuator)
        self._stage, self._has_stopped = Stage(config, actuator), has_stopped
        self._ordering = threading.Lock()
        self._is_read = threading.Event()
        self._instead = {
            "open": self._open,
            "close": self._close,
            **dict.fromkeys(("home", "move_to"), self._order),
            **dict.fromkeys(("set_velocity", "make_ready", "position_m", "is_moving"), self._ask),
        }

    def __getattr__(self, name: str) -> Any:
        found = super().__getattr__(name)
        does = self._instead.get(name)
        return partial(does, found) if does else found

    def stop_for_good(self) -> StopAnswer:
        """Stop it; the answer is settled later, see `stop_answer`."""
        stage = self._stage
        if not stage.is_connected:
            return not_connected("its line is closed at this moment, and it is moved no more")
        stage.stop_within()
        start_thread("stop", self._read_at_rest)
        return stage.stop_answer or sent_to(stage.name)

    def stop_answer(self) -> StopAnswer | None:
        """What became of the stop; None where none was sent."""
        return self._stage.stop_answer

    def _read_at_rest(self) -> None:
        try:
            with self._ordering:  # a move that was on its way has been sent
                self._stage.stop_within()
            self._stage.confirm_stop()
        finally:
            self._is_read.set()

    def _ask(self, step: Callable[..., Any], *arguments: Any) -> Any:
        if self._has_stopped.is_set():
            raise MotionStopped(STOPPED)
        return step(*arguments)

    def _order(self, step: Callable[..., Any], *arguments: Any) -> None:
        with self._ordering:
            self._stage.may_move = True
            self._ask(step, *arguments)

    def _open(self, step: Callable[..., Any]) -> None:
        self._ask(step)
        self._stage.is_connected = True

    def _close(self, step: Callable[..., Any]) -> None:
        if self._has_stopped.is_set() and self._stage.is_connected:
            self._is_read.wait(SETTLES_S)
        self._stage.is_connected = False
        step()


@contextmanager
def stoppable(config: Config, command: str) -> Iterator[Callable[[Actuator], Any]]:
    """Let `slipscope stop` and STOP of a window stop the stage that a command moves, and end the
    command after that as Ctrl-C does. Gives what makes an actuator stoppable so: of several, one
    after another, the last.

    Raises
    ------
    UserError
        As of `known_bench`.
    MotionStopped
        The stage was stopped so; the message says it.
    """
    has_stopped, newest = threading.Event(), list[StoppableActuator]()

    def stoppable_actuator(actuator: Actuator) -> StoppableActuator:
        newest[:] = [StoppableActuator(config, actuator, has_stopped)]
        return newest[0]

    def stop_motion() -> StopAnswer:
        has_stopped.set()
        if not newest:
            return not_connected(f"{command} has not opened a stage yet, and will open none")
        return newest[0].stop_for_good()

    def methods(_: Path) -> Methods:
        return {
            "stop_motion": stop_motion,
            "stop_answer": lambda: newest[0].stop_answer() if newest else None,
        }

    with known_bench(command, methods):
        yield stoppable_actuator
        if has_stopped.is_set():
            raise MotionStopped(STOPPED)
