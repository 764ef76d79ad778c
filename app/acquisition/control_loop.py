"""The loop that moves a stage by what is measured: forces block by block, decisions, and what they
ask for, done. A run records what it says; `slipscope check --move` only moves.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from app.acquisition.ending import Ending
from app.acquisition.force_reader import BenchDevices, ForceReader
from app.acquisition.stage import Stage
from app.acquisition.watchdog import Watchdog
from app.evaluation.history import History
from app.experiment.course import Go, Halt
from app.experiment.decisions import Answered, Begin, Experiment, Noted, Order, Zeroed
from app.records.record_types import NOTE, STEP, ZERO, Event, Phase
from app.settings.sections import Config


class ControlLoop:
    """What decides on a bench and carries it out; a stop wins over each order.

    Parameters
    ----------
    history : History
        Where the forces and phases go.
    pace : float or None
        Seconds of the board per second; None where the sources wait for us.
    on_drive : callable
        Called before the stage moves for the first time.

    Attributes
    ----------
    experiment, ending, watchdog, stage, reader
        Each as its class says.
    """

    def __init__(
        self,
        config: Config,
        bench: BenchDevices,
        history: History,
        *,
        pace: float | None,
        on_drive: Callable[[], None] = lambda: None,
    ) -> None:
        self.history, self.experiment = history, Experiment(config)
        self.ending = Ending(lambda: self.stage.stop())  # noqa: PLW0108 - made below
        self.watchdog = Watchdog(self.ending, config.limits.age, is_direct=pace is None)
        self.stage = Stage(config, bench.actuator, self.watchdog)
        self.reader = ForceReader(config, bench, self.stage, history, self.watchdog, pace=pace)
        self._bench, self._on_drive = bench, on_drive

    def begin_phase(self, phase: Phase, sample: int) -> None:
        """From `sample` on the experiment is in `phase`."""
        self.history.begin(phase, sample)
        self.reader.record(Event(sample, "phase", str(phase)))

    def carry_out(self, sample: int) -> None:
        """Do what was ordered with the block that ends at `sample`."""
        for order in self.experiment.orders():
            self._do(order, sample)

    def _do(self, order: Order, sample: int) -> None:
        match order:
            case Begin():
                self._begin(order, sample)
            case Go():
                if order.is_turn:
                    leg = f"leg {self.experiment.leg}"
                    self.reader.record(Event(self.now(), "reversal", leg))
                self._move(partial(self.stage.go, order))
            case Halt():
                self._ask_stage(self.stage.halt)
            case Zeroed():
                self.reader.set_zero(order.volts)
                self.reader.record(
                    Event(sample, ZERO, " ".join(map(repr, order.volts)), -1, *order.volts)
                )
            case Answered():
                self.reader.record(Event(sample, "answer", order.text or "none"))
            case Noted():
                self.reader.record(Event(sample, NOTE, order.text))

    def _begin(self, order: Begin, sample: int) -> None:
        phase = order.phase
        if phase is Phase.DRIVE:
            self._ask_stage(self.stage.aim)
        # the stage moves on the board's newest sample, which may be ahead of those that were read
        if phase in (Phase.DRIVE, Phase.END) or self.experiment.is_moving:
            sample = self.now()
        if phase is not None:
            self.begin_phase(phase, sample)
        if phase is Phase.DRIVE:
            self._on_drive()
        if order.text:
            self.history.begin_step(order.number, sample)
            self.reader.record(Event(sample, STEP, order.text, order.number))

    def _move(self, move: Callable[[], None]) -> None:
        if not self.ending.is_called.is_set():
            self._ask_stage(move)
        if self.ending.is_called.is_set():  # a stop that came between the two lines above wins
            self._ask_stage(self.stage.halt)

    def _ask_stage(self, step: Callable[[], None]) -> None:
        self.watchdog.ask(self.stage.name, step)

    def now(self) -> int:
        """The board's newest sample."""
        return self.watchdog.ask(self._bench.forces.name, self.reader.now)
