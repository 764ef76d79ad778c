"""What every run, replay and further analysis offers to the window and to the terminal."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Protocol

from analysis.arrays import F64, U8, U16
from app.records.record_types import Outcome
from app.records.run_view import RunView
from app.settings.sections import Config
from app.system.stopping import StopAnswer

Image = U8 | U16


class Kind(StrEnum):
    """What a source shows: a run that goes on, a recorded one, or a further analysis of it."""

    LIVE = "live"
    REPLAY = "replay"
    ANALYSIS = "analysis"


class RunSource(Protocol):
    """A live run or a replay: whoever shows it starts it, reads it, and asks it to stop.

    A source opens devices and files in `start`, not when it is constructed. Whatever only reads is
    called from one thread, which may be any.

    Attributes
    ----------
    title : str
        The name of the run, "simulated bench" or "replay of x.h5".
    config : Config
        The settings of this run.
    grid_x_px, grid_y_px : ndarray, shapes (nx,) and (ny,)
        Box centres along x and y, one every `config.dic.step`.
    stays : bool
        Whether it goes on when the window or the terminal that shows it is left.
    """

    stays: bool

    title: str
    config: Config
    grid_x_px: F64
    grid_y_px: F64

    def start(self) -> None:
        """Begin; returns at once."""

    def wait(self, timeout: float | None = None) -> Outcome | None:
        """How the run ended, once it has; None where that takes longer than `timeout` seconds."""

    def stop_motion(self) -> StopAnswer:
        """Stop the actuator at once, then end the run; from any thread, at any time. What the
        actuator answered.
        """

    def request_stop(self, reason: str) -> None:
        """Ask for an orderly end of the run; returns at once."""

    def answer(self, text: str, question: str = "") -> None:
        """Answer a question, if it is that of the step under way; by default whatever that asks."""

    def pause(self) -> None:
        """Wait, before the next step of the protocol, for an answer of the operator."""

    def cancel_pause(self) -> None:
        """Withdraw a pause that has not begun."""

    def note(self, text: str) -> None:
        """Record a note of the operator with the newest sample."""

    def look(self, seen: int = -1, *, is_shown: bool = False) -> RunView:
        """What it shows now: all snapshots but the first `seen`, and nothing but its state if that
        is negative; `is_shown` says that somebody sees them.
        """


def kind_of(source: object) -> Kind:
    """What a source shows."""
    return Kind(getattr(source, "kind", Kind.LIVE))


@dataclass(frozen=True, slots=True)
class PreparedSource:
    """A run, a replay or an analysis that has not begun.

    Attributes
    ----------
    session : callable
        The file that it has recorded at its end; None where there is none.
    warning : str
        What the operator should know before it begins; empty for nothing.
    """

    source: RunSource
    session: Callable[[], Path | None] = lambda: None
    warning: str = ""
