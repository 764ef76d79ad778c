"""What the parts of the window share: the settings of the next run, and what they ask of the
window.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple, Protocol

from PySide6.QtCore import QObject, Signal

from app.gui.campaign_lines import CampaignLines
from app.gui.source import RunSource, Setup
from app.gui.view_state import ViewState
from app.records.bench_view import BenchPreview
from app.report.side_by_side import Entry, Recorded
from app.settings.sections import Config
from app.system.stopping import StopAnswer


class ExportKind(NamedTuple):
    """What of a session can be written: its name, the ending of the file (none: a folder), and its
    meaning for people.
    """

    what: str
    ending: str
    meaning: str


class Archive(Protocol):
    """Reads recorded sessions, analyses them again, and writes them for other programs.

    As of a `Workshop`, all of it is called in a thread of its own, and an exception is a sentence.
    """

    exports: tuple[ExportKind, ...]

    def sessions_in(self, folder: Path) -> list[Path]:
        """The files of a folder that may be sessions, the newest first."""

    def entry(self, path: Path) -> Entry:
        """What a list says of a file; raises nothing."""

    def recorded(self, path: Path) -> Recorded:
        """What a comparison needs of a session."""

    def analysis_of(self, session: Path) -> Path:
        """A free name for a further analysis of a session."""

    def repair(self, session: Path, on_progress: Callable[[float], None]) -> tuple[Path, str]:
        """Bring back what there is of a session that was cut short: a new file, and a sentence
        about it.
        """

    def reanalysis(self, session: Path, overrides: Sequence[str], output: Path) -> RunSource:
        """A further analysis with other settings, ``table.key=value``, not yet begun."""

    def export(
        self,
        session: Path,
        destination: Path,
        what: str,
        frames: str,
        on_progress: Callable[[str, float], None],
    ) -> str:
        """Write something of a session; one sentence about it. Nothing is ever replaced."""


class Workshop(Protocol):
    """Makes what the window shows; the command that opens the window gives it.

    All of it may take a second or more, so the window calls it in a thread of its own. An
    exception is a sentence for the operator.
    """

    def run(self, config: Config, session: Path | None) -> RunSource:
        """A run with these settings, not yet begun; a free name is chosen where `session` is None
        or taken.
        """

    def replay(self, session: Path) -> RunSource:
        """A recorded run, to be played."""

    def runs_under_way(self) -> list[tuple[str, str]]:
        """Name and words of each run of this user that goes on, whoever has begun it."""

    def attach(self, name: str) -> RunSource:
        """A run that is under way, to be shown."""

    def stop_others(self, own: RunSource | None) -> StopAnswer | None:
        """Stop the motion of every run of this user but `own`; what became of that, None where
        there is no other.
        """

    def settings_of(self, session: Path) -> Config:
        """The settings of a recorded run."""

    def campaigns(self) -> list[str]:
        """Names of the campaigns that come with the program."""

    def campaign(self, file: Path) -> CampaignLines:
        """The runs of a campaign, as their sessions say."""

    def campaign_taken(self, file: Path, number: int) -> CampaignLines:
        """Make way for a run of it: what there was of the run is kept aside."""

    def campaign_renewed(self, file: Path) -> CampaignLines:
        """The runs after one of them, with the campaign's page as of now."""

    def preview(self, config: Config) -> BenchPreview:
        """The bench of these settings, connecting, to be looked at without a run; `run` lets go of
        it before it opens the same devices.
        """

    @property
    def archive(self) -> Archive:
        """Recorded sessions."""


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
    workshop : Workshop
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
    answer_asked = Signal(str)  # to the question of the step under way
    shown = Signal(object)  # show this RunSource from now on, in place of what is shown
    session_asked = Signal(object)  # open this recorded run (Path)
    ended = Signal(object)  # a run or replay has ended (its RunSource)

    def __init__(self, workshop: Workshop, config: Config, session: Path | None = None) -> None:
        super().__init__()
        self.workshop, self.config, self.session = workshop, config, session
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
