"""The result card of a run: every number with both parts of its uncertainty, what became of every
frame and sample, and whether the run came to its own end.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

from app.records.quantities import Measurement, doubts, summary_quantities
from app.records.record_types import Counts, End, Outcome
from app.records.summary import Summary
from app.report.summary_rows import Row, counts_rows, further_rows, resources_rows
from app.system.outputs import csv_text

RATIOS = ("mu_s", "mu_d", "mu")  # ratios of forces, uncertain by the calibration of the sensors
COLUMNS = ("quantity", "symbol", "value", "± noise", "± inputs", "unit")


class CardRow(NamedTuple):
    """One quantity as people read it; texts, empty where nothing is known."""

    name: str
    symbol: str
    value: str
    noise: str
    inputs: str
    unit: str


@dataclass(frozen=True, slots=True)
class Card:
    """All that a run came down to.

    Attributes
    ----------
    title : str
        Name of the run.
    verdict : End
        How it ended; `End.PLAYED` of a replay or a further analysis.
    reason : str
        Why it ended.
    quantities : tuple of Measurement
        None is there without a summary.
    further, account : tuple of Row
        What is told beside them; frames and samples.
    notes : tuple of str
        Why a quantity was not measured.
    """

    title: str
    verdict: End
    reason: str
    quantities: tuple[Measurement, ...]
    further: tuple[Row, ...]
    account: tuple[Row, ...]
    notes: tuple[str, ...]

    @property
    def rows(self) -> tuple[CardRow, ...]:
        """The quantities as people read them."""
        return tuple(CardRow(q.name, q.symbol, *q.parts, q.unit) for q in self.quantities)

    @property
    def doubts(self) -> tuple[str, ...]:
        """The notes that put the quantities in doubt."""
        return tuple(doubts(self.notes))

    def text(self) -> str:
        """The card for a laboratory notebook."""
        lines = [f"{self.title}: {self.verdict} ({self.reason})", "", "\t".join(COLUMNS)]
        lines += ["\t".join(row) for row in self.rows]
        for rows in (self.further, self.account):
            lines += ["", *("\t".join(filter(None, row)) for row in rows)]
        others = [note for note in self.notes if note not in self.doubts]
        lines += ["", *(f"WARNING: {note}" for note in self.doubts)]
        lines += [f"note: {note}" for note in others]
        return "\n".join(lines).rstrip() + "\n"

    def csv(self) -> str:
        """The quantities as a table, unrounded, in the units of people."""
        names = ("quantity", "symbol", "value", "sd_noise", "sd_inputs", "unit")
        rows = ((q.name, q.symbol, *q.in_unit, q.unit) for q in self.quantities)
        return csv_text([names, *rows])


def card_quantities(summary: Summary) -> tuple[Measurement, ...]:
    """What an experiment comes down to; of a ratio of forces without a budget, the part of its
    uncertainty by the inputs is that of the calibration.
    """

    def complete(q: Measurement) -> Measurement:
        if q.symbol in RATIOS and math.isnan(q.systematic):
            return replace(q, systematic=abs(q.value) * summary.calibration_sd)
        return q

    return tuple(map(complete, summary_quantities(summary)))


def card_of(title: str, outcome: Outcome, uncertain: int = 0, *, is_live: bool) -> Card:
    """The card of a run that has ended, in which the trigger of so many frames is uncertain."""
    summary = outcome.summary
    return Card(
        title,
        verdict_of(outcome, is_live=is_live),
        outcome.reason,
        card_quantities(summary) if summary else (),
        tuple(further_rows(summary)) if summary else (),
        (*account_rows(outcome.counts, uncertain), *resources_rows(outcome.resources)),
        outcome.measured.notes,
    )


def verdict_of(outcome: Outcome, *, is_live: bool = True) -> End:
    """How a run ended, in one word."""
    return outcome.end if is_live or outcome.ended_as != "done" else End.PLAYED


def account_rows(counts: Counts, uncertain: int) -> list[Row]:
    """What became of every trigger and sample, and how many frames are of a certain trigger."""
    certain = counts.frames_received - uncertain
    return [
        *counts_rows(counts),
        Row("trigger of the frame", "", f"{certain} certain, {uncertain} uncertain"),
    ]
