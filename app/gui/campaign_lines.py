"""The runs of a campaign for the window, which does them one by one, as plain values."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from app.campaigns.page import Progress, check_page, write_page
from app.campaigns.plan import Campaign, orders, read_campaign
from app.campaigns.state import (
    COPY,
    FoundSession,
    RunState,
    alone_in,
    find_session,
    keep,
    keep_copy,
)
from app.gui.cells import Tone
from app.settings.sections import Config
from app.system.durations import duration
from app.system.errors import UserError

TONES = {
    RunState.DONE: Tone.GOOD,
    RunState.RUNNING: Tone.BUSY,
    RunState.FAILED: Tone.BAD,
    RunState.STOPPED: Tone.WARN,
    RunState.CUT: Tone.WARN,
    RunState.WAITING: Tone.NEUTRAL,
}


@dataclass(frozen=True, slots=True)
class CampaignRun:
    """A run of a campaign.

    Attributes
    ----------
    number : int
        From 1.
    orders : str
        What is to be done at the bench for it.
    state, reason : RunState, str
        What its session says has become of it, and why it ended.
    seconds : float
        That it takes as planned.
    """

    number: int
    orders: str
    session: Path
    config: Config
    state: RunState
    reason: str
    seconds: float

    @property
    def name(self) -> str:
        """Of its session, without the ending."""
        return self.session.stem

    @property
    def is_due(self) -> bool:
        """Whether it is still to be done; one that failed is repeated only if that is asked for."""
        return self.state not in (RunState.DONE, RunState.RUNNING, RunState.FAILED)


@dataclass(frozen=True, slots=True)
class CampaignLines:
    """The runs of a campaign, and how far it is."""

    name: str
    file: Path
    folder: Path
    runs: tuple[CampaignRun, ...]

    @property
    def next(self) -> CampaignRun | None:
        """The first run that is due."""
        return next((run for run in self.runs if run.is_due), None)

    @property
    def sentence(self) -> str:
        """How far it is, and the time left."""
        states = [run.state for run in self.runs]
        failed = states.count(RunState.FAILED)
        told = f"{states.count(RunState.DONE)} of {len(states)} runs done"
        told += f", {failed} failed" if failed else ""
        return f"{told}, {left} left" if (left := self.left) else told

    @property
    def left(self) -> str:
        """How much time is left, in words; empty where nothing is due."""
        seconds = sum(run.seconds for run in self.runs if run.is_due)
        return f"about {duration(seconds)} and the operator's time" if seconds else ""


def look(file: Path) -> CampaignLines:
    """The runs of a campaign, as their sessions say; nothing is written."""
    plan = _plan(file)
    return _lines(plan, _found(plan))


def renew(file: Path) -> CampaignLines:
    """The same, after a run of it: with its page."""
    plan = _plan(file)
    with alone_in(plan.folder):
        found = _found(plan)
        _write_page(plan, found)
    return _lines(plan, found)


def claim(file: Path, number: int) -> CampaignLines:
    """Make way for a run: its folder is made, what there is of the run is kept, and the page says
    how far the campaign is.

    Raises
    ------
    UserError
        The run is done or under way, or its folder is somebody else's.
    """
    plan = _plan(file)
    run = plan.runs[number - 1]
    with alone_in(plan.folder):
        check_page(plan.folder)
        found = _found(plan)
        state = found[number].state
        if state in (RunState.DONE, RunState.RUNNING):
            raise UserError(f"run {number}, {run.name}: it is {state}; choose another run")
        keep_copy(plan)
        if found[number].is_there:
            keep(run.session)
            found[number] = FoundSession(RunState.WAITING)
        _write_page(plan, found)
    return _lines(plan, found)


def _plan(file: Path) -> Campaign:
    """The campaign of a file; that of the copy beside its sessions goes on with them."""
    return read_campaign(file, file.parent if file.name == COPY else None)


def _found(plan: Campaign) -> dict[int, FoundSession]:
    return {run.number: find_session(run) for run in plan.runs}


def _write_page(plan: Campaign, found: dict[int, FoundSession]) -> None:
    lines = _lines(plan, found)
    write_page(Progress(plan, found, f"{lines.left} left" if lines.left else ""))


def _lines(plan: Campaign, found: dict[int, FoundSession]) -> CampaignLines:
    from app.runs.live import expected_seconds  # what it needs would hold up the window's start

    runs = tuple(
        CampaignRun(
            run.number,
            orders(plan, run),
            run.session,
            run.config,
            found[run.number].state,
            found[run.number].reason,
            expected_seconds(run.config),
        )
        for run in plan.runs
    )
    return CampaignLines(plan.name, plan.file, plan.folder, runs)
