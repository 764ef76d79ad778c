"""What the parts of the window share: the settings of the next run, and what they ask of the
window.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

from PySide6.QtCore import QObject, Signal

from app.gui.run_factory import RunFactory
from app.gui.source import Setup
from app.gui.view_state import ViewState
from app.settings.sections import Config


class Part(Protocol):
    """A part of the window that shows a run: a widget with these methods."""

    def show_setup(self, setup: Setup) -> None:
        """Empty the part for a run that begins, or a replay."""

    def isVisible(self) -> bool:
        """Whether it can be seen; else it need not be drawn."""

    @property
    def parts(self) -> tuple[Callable[[ViewState], None], ...]:
        """Functions that each draw one thing of a view if it has changed; they are called one by
        one, so that a key waits for no more than one of them.
        """


class Desk(QObject):
    """The settings of the next run, and the ways from the parts to the window.

    Attributes
    ----------
    factory : RunFactory
        Makes runs, replays and analyses.
    config : Config
        Settings of the next run; set by `set_config`.
    session : Path or None
        The file that it will record; None: named by date and time.
    is_busy : bool
        Whether a run is going on or being made: settings that are changed now are for the next.
        A replay counts as one.
    is_live : bool
        Whether it is a run on a bench, no replay.
    """

    settings_changed = Signal()  # config or session is another
    busy_changed = Signal(bool)
    said = Signal(str, bool)  # a sentence for the line under the controls; whether it is an alarm
    noted = Signal(str)  # a sentence for the log
    begin_asked = Signal()
    stop_pressed = Signal()  # STOP MOTION, or an end of the run, by the operator
    answer_asked = Signal(str)  # to the question of the step under way
    session_asked = Signal(object)  # open this recorded run (Path)
    ended = Signal(object)  # a run or replay has ended (its RunSource)

    def __init__(self, factory: RunFactory, config: Config, session: Path | None = None) -> None:
        super().__init__()
        self.factory, self.config, self.session = factory, config, session
        self.is_busy = self.is_live = False

    def set_config(self, config: Config) -> None:
        """Let the next run have these settings."""
        if config != self.config:
            self.config = config
            self.settings_changed.emit()

    def set_session(self, session: Path | None) -> None:
        """Let the next run record this file."""
        if session != self.session:
            self.session = session
            self.settings_changed.emit()

    def set_busy(self, is_busy: bool, *, is_live: bool = False) -> None:
        """Say whether a run is going on, and whether on a bench."""
        self.is_live = is_live
        if is_busy != self.is_busy:
            self.is_busy = is_busy
            self.busy_changed.emit(is_busy)
