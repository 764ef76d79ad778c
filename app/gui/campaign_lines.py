"""A campaign as the window shows it, as plain values."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from app.gui.cells import Tone
from app.settings.sections import Config

DONE, RUNNING, FAILED = "done", "under way", "failed"
TONES = {
    DONE: Tone.GOOD,
    RUNNING: Tone.BUSY,
    FAILED: Tone.BAD,
    "stopped": Tone.WARN,
    "cut short": Tone.WARN,
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
    state, reason : str
        What its session says has become of it, and why it ended.
    seconds : float
        That it takes as planned.
    """

    number: int
    orders: str
    session: Path
    config: Config
    state: str
    reason: str
    seconds: float

    @property
    def name(self) -> str:
        """Of its session, without the ending."""
        return self.session.stem

    @property
    def tone(self) -> Tone:
        """How its state is coloured."""
        return TONES.get(self.state, Tone.NEUTRAL)

    @property
    def is_due(self) -> bool:
        """Whether it is still to be done; one that failed is repeated only if that is asked for."""
        return self.state not in (DONE, RUNNING, FAILED)


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
        failed = f", {states.count(FAILED)} failed" if FAILED in states else ""
        told = f"{states.count(DONE)} of {len(states)} runs done{failed}"
        seconds = sum(run.seconds for run in self.runs if run.is_due)
        if not seconds:
            return told
        return f"{told}, about {duration(seconds)} and the operator's time left"


def duration(seconds: float) -> str:
    """A time in words, ``12 min``."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"
