"""The runs of a campaign for the window, which does them one by one, as plain values."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from app.campaigns.page import Progress, check_page, write_page
from app.campaigns.plan import Campaign, PlannedRun, orders, read_campaign
from app.campaigns.state import (
    COPY,
    FoundSession,
    RunState,
    alone_in,
    find_sessions,
    keep,
    keep_copy,
)
from app.gui.charts import Chart, Line
from app.records.quantities import Measurement
from app.report.card import card_quantities
from app.system.durations import duration
from app.system.errors import UserError


@dataclass(frozen=True, slots=True)
class CampaignRun:
    """A run of a campaign.

    Attributes
    ----------
    orders : str
        What is to be done at the bench for it.
    found : FoundSession
        What its session says has become of it.
    seconds : float
        That it takes as planned.
    """

    planned: PlannedRun
    orders: str
    found: FoundSession
    seconds: float

    @property
    def state(self) -> RunState:
        """What has become of it."""
        return self.found.state

    @property
    def is_due(self) -> bool:
        """Whether it is still to be done; one that failed is repeated only if that is asked for."""
        return self.state not in (RunState.DONE, RunState.RUNNING, RunState.FAILED)

    @property
    def measured(self) -> dict[str, Measurement]:
        """By their symbols, what came of it."""
        summary = self.found.summary
        return {q.symbol: q for q in card_quantities(summary)} if summary else {}


@dataclass(frozen=True, slots=True)
class CampaignLines:
    """The runs of a campaign, and how far it is."""

    plan: Campaign
    runs: tuple[CampaignRun, ...]

    @property
    def next(self) -> CampaignRun | None:
        """The first run that is due."""
        return next((run for run in self.runs if run.is_due), None)

    @property
    def progress(self) -> Progress:
        """How far it is, and the time left."""
        seconds = sum(run.seconds for run in self.runs if run.is_due)
        asks = " and the operator's time" * self.plan.pauses
        return Progress(
            self.plan,
            {run.planned.number: run.found for run in self.runs},
            f"about {duration(seconds)}{asks} left" if seconds else "",
        )

    @property
    def friction(self) -> Chart:
        """Static and dynamic friction against the normal force, of the runs that were measured."""
        lines = []
        for symbol, name, role, style in (
            ("mu_s", "μ static, Qₛ/P", "friction", "dots"),
            ("mu_d", "μ dynamic", "friction", "squares"),
        ):
            found = sorted(
                (held["P"].value, held[symbol].value, held[symbol].total)
                for held in (run.measured for run in self.runs)
                if held and math.isfinite(held[symbol].value)
            )
            loads, values, sds = np.array(found, float).reshape(-1, 3).T
            lines.append(Line(name, loads, values, role, ("P_N", symbol), sds, style))
        hint = "Static and dynamic friction against the load appear here as runs are done."
        return Chart("Friction against load", "P (N)", "μ", tuple(lines), hint=hint)


def look(file: Path) -> CampaignLines:
    """The runs of a campaign, as their sessions say; nothing is written."""
    plan = _plan(file)
    return _lines(plan, find_sessions(plan))


def renew(file: Path) -> CampaignLines:
    """The same, after a run of it: with its page."""
    plan = _plan(file)
    with alone_in(plan.folder):
        lines = _lines(plan, find_sessions(plan))
        write_page(lines.progress)
    return lines


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
        found = find_sessions(plan)
        state = found[number].state
        if state in (RunState.DONE, RunState.RUNNING):
            raise UserError(f"run {number}, {run.name}: it is {state}; choose another run")
        keep_copy(plan)
        if found[number].is_there:
            keep(run.session)
            found[number] = FoundSession(RunState.WAITING)
        lines = _lines(plan, found)
        write_page(lines.progress)
    return lines


def _plan(file: Path) -> Campaign:
    """The campaign of a file; that of the copy beside its sessions goes on with them."""
    return read_campaign(file, file.parent if file.name == COPY else None)


def _lines(plan: Campaign, found: dict[int, FoundSession]) -> CampaignLines:
    from app.runs.live import expected_seconds  # what it needs would hold up the window's start

    runs = (
        CampaignRun(run, orders(plan, run), found[run.number], expected_seconds(run.config))
        for run in plan.runs
    )
    return CampaignLines(plan, tuple(runs))
