"""What the steps of an experiment ask for, done: phases and steps to the history and the disk,
motions of the stage, zeros of the sensors.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

from app.acquisition.ending import Ending
from app.acquisition.force_reader import ForceReader, Takes
from app.acquisition.stage import Stage
from app.evaluation.history import History
from app.experiment.course import Go, Halt
from app.experiment.decisions import Answered, Begin, Experiment, Order, Zeroed
from app.records.record_types import STEP, ZERO, Event, Phase
from drivers.protocols import ForceSource


class OrderExecution:
    """Carries out the orders of an experiment; a stop wins over each of them.

    Parameters
    ----------
    ask : callable
        Asks a device, as `Watchdog.ask` does.
    on_drive : callable
        Called before the stage moves for the first time.
    """

    def __init__(
        self,
        experiment: Experiment,
        stage: Stage,
        force_reader: ForceReader,
        history: History,
        ending: Ending,
        ask: Callable[..., Any],
        forces: Callable[[], ForceSource],
        on_drive: Callable[[], None],
    ) -> None:
        self._experiment, self._stage, self._force_reader = experiment, stage, force_reader
        self._history, self._ending, self._ask = history, ending, ask
        self._forces, self._on_drive = forces, on_drive

    def begin_phase(self, recorder: Takes, phase: Phase, sample: int) -> None:
        """From `sample` on the experiment is in `phase`."""
        self._history.begin(phase, sample)
        recorder.append(Event(sample, "phase", str(phase)))

    def carry_out(self, recorder: Takes, sample: int) -> None:
        """Do what was ordered with the block that ends at `sample`."""
        for order in self._experiment.orders():
            self._do(recorder, order, sample)

    def _do(self, recorder: Takes, order: Order, sample: int) -> None:
        match order:
            case Begin():
                self._begin(recorder, order, sample)
            case Go():
                if order.is_turn:
                    leg = f"leg {self._experiment.leg}"
                    recorder.append(Event(self.now(), "reversal", leg))
                self._move(partial(self._stage.go, order))
            case Halt():
                self._ask(self._stage.name, self._stage.stop)
            case Zeroed():
                self._force_reader.zero(order.volts)
                recorder.append(
                    Event(sample, ZERO, " ".join(map(repr, order.volts)), -1, *order.volts)
                )
            case Answered():
                recorder.append(Event(sample, "answer", order.text or "none"))

    def _begin(self, recorder: Takes, order: Begin, sample: int) -> None:
        phase = order.phase
        if phase is Phase.DRIVE:
            self._ask(self._stage.name, self._stage.aim)
        # the stage moves on the board's newest sample, which may be ahead of those that were read
        if phase in (Phase.DRIVE, Phase.END) or self._experiment.is_moving:
            sample = self.now()
        if phase is not None:
            self.begin_phase(recorder, phase, sample)
        if phase is Phase.DRIVE:
            self._on_drive()
        if order.text:
            self._history.begin_step(order.number, sample)
            recorder.append(Event(sample, STEP, order.text, order.number))

    def _move(self, move: Callable[[], None]) -> None:
        if not self._ending.is_called.is_set():
            self._ask(self._stage.name, move)
        if self._ending.is_called.is_set():  # a stop that came between the two lines above wins
            self._ask(self._stage.name, self._stage.stop)

    def now(self) -> int:
        """The board's newest sample."""
        newest: int = self._ask(self._forces().name, self._force_reader.now)
        return newest
