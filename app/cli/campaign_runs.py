"""The runs of a campaign for the window, which does them one by one."""

from __future__ import annotations

from pathlib import Path

from app.campaigns.page import Progress, check_page, write_page
from app.campaigns.plan import Campaign, planned
from app.campaigns.state import COPY, FoundSession, RunState, alone_in, copied, found_of, keep
from app.cli.campaign import orders
from app.gui.campaign_lines import CampaignLines, CampaignRun
from app.runs.live import expected_seconds
from app.system.errors import UserError


def look(file: Path) -> CampaignLines:
    """The runs of a campaign, as their sessions say; nothing is written."""
    plan = _plan(file)
    return _lines(plan, _found(plan))


def renewed(file: Path) -> CampaignLines:
    """The same, after a run of it: with its page."""
    plan = _plan(file)
    with alone_in(plan.folder):
        found = _found(plan)
        _write_page(plan, found)
    return _lines(plan, found)


def taken(file: Path, number: int) -> CampaignLines:
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
        copied(plan)
        if found[number].is_there:
            keep(run.session)
            found[number] = FoundSession(RunState.WAITING)
        _write_page(plan, found)
    return _lines(plan, found)


def _plan(file: Path) -> Campaign:
    """The campaign of a file; that of the copy beside its sessions goes on with them."""
    return planned(file, file.parent if file.name == COPY else None)


def _found(plan: Campaign) -> dict[int, FoundSession]:
    return {run.number: found_of(run) for run in plan.runs}


def _write_page(plan: Campaign, found: dict[int, FoundSession]) -> None:
    lines = _lines(plan, found)
    left = lines.sentence.partition(", ")[2] if lines.next else ""
    write_page(Progress(plan, found, left))


def _lines(plan: Campaign, found: dict[int, FoundSession]) -> CampaignLines:
    runs = tuple(
        CampaignRun(
            run.number,
            orders(plan, run),
            run.session,
            run.config,
            str(found[run.number].state),
            found[run.number].reason,
            expected_seconds(run.config),
        )
        for run in plan.runs
    )
    return CampaignLines(plan.name, plan.file, plan.folder, runs)
