"""A stage that a command moves without a run, in its own process."""

from __future__ import annotations

import _thread
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from app.acquisition.stage import Stage
from app.acquisition.watchdog import PATIENCE_S
from app.processes.calls import Methods
from app.processes.serving import known_bench
from app.settings.sections import Config
from app.system.stopping import StopAnswer
from drivers.protocols import Actuator


@contextmanager
def stoppable(config: Config, actuator: Actuator, command: str) -> Iterator[None]:
    """Let `slipscope stop` and STOP of a window stop an open stage, and then end the command that
    moves it meanwhile, in the main thread, as Ctrl-C does.

    Raises
    ------
    UserError
        As of `known_bench`.
    KeyboardInterrupt
        The stage was stopped so; the message says it.
    """
    stage, stopping, is_left = Stage(config, actuator), threading.Lock(), threading.Event()
    stage.is_connected = stage.may_move = True

    def stop_motion() -> StopAnswer:
        with stopping:
            stage.stop_within()
            if not is_left.is_set():
                _thread.interrupt_main()
                is_left.wait(PATIENCE_S)  # it may be sending the stage on
            stage.confirm_stop()
            return stage.answer_to_stop("")

    def methods(_: object) -> Methods:
        return {"stop_motion": stop_motion, "stop_answer": lambda: stage.stop_answer}

    with known_bench(f"{command} with the {actuator.name}", methods):
        try:
            yield
        except KeyboardInterrupt:
            if stage.stops:
                stage.stop_within()  # what came between the first stop and here
                raise KeyboardInterrupt("STOP MOTION") from None
            raise
        finally:
            is_left.set()
            with stopping:  # the position is read before the device is closed
                pass
