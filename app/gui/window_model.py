"""What the parts of the window share: the settings of the next run, and what they ask of the
window.
"""

from __future__ import annotations

import logging
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from threading import Lock
from typing import Protocol

from PySide6.QtCore import QObject, Signal

from app.gui.background import BackgroundWork
from app.gui.form import PRESET_KEY, Base, Form
from app.gui.memory import WindowMemory
from app.gui.run_factory import RunFactory
from app.gui.view_state import ViewState
from app.runs.run_source import RunSource
from app.settings.config import to_toml
from app.settings.sections import Config

LOG = logging.getLogger(__name__)


class RunDisplay(Protocol):
    """What shows one thing of a run: a widget with these methods."""

    def isVisible(self) -> bool:
        """Whether it can be seen; else it need not be drawn."""

    def show_view(self, view: ViewState) -> None:
        """Draw it, if it has changed."""


class WindowModel(QObject):
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
    restored : str
        When the settings were kept, if they are those of an earlier evening; else empty.
    recorded : Path or None
        The session of the run or replay that ended last.
    zeros : set of (float, float)
        Readings of the sensors without force (V) that Zero has measured in this window.
    """

    settings_changed = Signal()  # config or session is another
    busy_changed = Signal(bool)
    said = Signal(str, bool)  # a sentence for the line under the controls; whether it is an alarm
    noted = Signal(str)  # a sentence for the log
    # a question for the line under the controls: what is asked, the words for yes, what is done
    # then, and the words for no
    asked = Signal(str, str, object, str)
    begin_asked = Signal()
    stop_pressed = Signal()  # STOP MOTION, or an end of the run, by the operator
    # an order to the run that is shown, and what is said where it cannot be given: str, and a
    # function of a RunSource
    ordered = Signal(str, object)
    session_asked = Signal(object)  # open this recorded run (Path)
    ended = Signal(object)  # a run or replay has ended (its RunSource)
    not_begun = Signal()  # a run that was asked for was refused, or could not be made

    def __init__(self, factory: RunFactory, config: Config, session: Path | None = None) -> None:
        super().__init__()
        self.factory, self.config, self.session = factory, config, session
        self.is_busy = self.is_live = False
        self.restored = ""
        self.recorded: Path | None = None
        self.zeros: set[tuple[float, float]] = set()
        self._background, self._keeping = BackgroundWork(self), Lock()
        self._kept = config, session  # for the next evening
        self.ended.connect(self._remember)
        self._own: tuple[Config, Path | None] | None = (
            None  # of the operator, while others are lent
        )

    @property
    def is_lent(self) -> bool:
        """Whether the settings and the file are for the next run alone."""
        return self._own is not None

    @property
    def own(self) -> tuple[Config, Path | None]:
        """The operator's own settings and file of the next run, also while others are lent."""
        return self._own or (self.config, self.session)

    def zeroed(self, config: Config) -> Config:
        """These settings with the operator's own zero, if it was measured on the same sensors."""
        forces = self.own[0].forces
        is_same = replace(config.forces, zero=forces.zero) == forces
        return replace(config, forces=forces) if is_same and forces.zero in self.zeros else config

    def set_config(self, config: Config) -> None:
        """Let the next run have these settings; what is changed in those of one run alone holds for
        the operator's own as well.
        """
        if self._own is not None:
            self._own = _with_changes(self._own[0], self.config, config), self._own[1]
        self._put(config, self.session)

    def set_session(self, session: Path | None) -> None:
        """Let the next run record this file."""
        self._put(self.config, session)

    def lend(self, config: Config, session: Path) -> None:
        """Let the next run alone have these settings and this file; the operator's own are back
        once it is made.
        """
        self._own = self._own or (self.config, self.session)
        self._put(config, session)

    def give_back(self) -> None:
        """Let the next run have the operator's own settings and file, if others are lent."""
        if self._own is not None:
            own, self._own = self._own, None
            self._put(*own)

    def _put(self, config: Config, session: Path | None) -> None:
        if (config, session) != (self.config, self.session):
            self.config, self.session = config, session
            self.settings_changed.emit()
            if not self.is_lent:
                self._keep(config, session)

    def _remember(self, source: RunSource) -> None:
        """Remember which session was recorded last."""
        self.recorded = getattr(source, "session", None)
        if self.recorded is not None:
            WindowMemory().remember("session", self.recorded)

    def _keep(self, config: Config, session: Path | None) -> None:
        """Keep the set-up for the next evening, beside the window."""
        if (config, session) == self._kept:
            return
        self._kept = config, session

        def keep() -> None:
            place = str(session.absolute()) if session else ""
            when = f"{datetime.now():%Y-%m-%d %H:%M}"
            with self._keeping:
                if self._kept == (config, session):  # else there is a newer one
                    WindowMemory().keep_set_up(to_toml(config, comments=False), place, when)

        self._background.start(keep, lambda _: None, LOG.warning)

    def set_busy(self, is_busy: bool, *, is_live: bool = False) -> None:
        """Say whether a run is going on, and whether on a bench."""
        self.is_live = is_live
        if is_busy != self.is_busy:
            self.is_busy = is_busy
            self.busy_changed.emit(is_busy)
            if is_busy and is_live:
                self.give_back()


def _with_changes(own: Config, before: Config, now: Config) -> Config:
    """Settings with what has changed from `before` to `now`, as far as that goes with them."""
    form, others = Form(own), Form(now)
    others.base = Base("", before)
    for key, (value, _) in others.changed().items():
        if key != PRESET_KEY:  # whose settings are others, too
            form.put(key, value, "")
    return form.config
