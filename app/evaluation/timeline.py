"""What a recorded run did and when, for its time line: frames, states and events."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple

import numpy as np

from analysis.arrays import I64, Bool, Rows
from app.records.record_types import NOTE, RESTART, STEP, Event, Phase
from app.records.snapshot_numbers import stick_radii
from app.records.summary import Summary

SLIDES = 0.97  # share of mu_d: after the first loading, Q/P above it is sliding
WITHIN_SD = 2.0  # sds of c by which it must be less than a before a rim counts as slipping
IN_A_ROW = 3  # frames: one may be told wrongly
MOVES_M = 0.2e-6  # travel between two analysed frames: less is rest
STOP = "stop"
LOSS = "loss"
# kinds of events
MARKED = {STEP: STEP, NOTE: NOTE, RESTART: RESTART, "gap": LOSS, "stop": STOP, "error": STOP}


class ContactState(StrEnum):
    """What the contact did: the phases before the drive, then how much of it slipped."""

    BACKGROUND = "background"
    CONTACT = "contact"
    REFERENCE = "reference"
    STICK = "stick"
    PARTIAL = "partial slip"
    SLIDE = "slide"
    END = "end"


class Stretch(NamedTuple):
    """From one sample to another (not included) the contact was in one state."""

    state: ContactState
    begin: int
    end: int


class Mark(NamedTuple):
    """Something that happened: a step, a restart of the analysis, a loss or a stop."""

    sample: int
    kind: str
    text: str


@dataclass(frozen=True, slots=True, eq=False)
class Timeline:
    """A recorded run from its first sample to its last.

    Attributes
    ----------
    frames, samples : ndarray, shape (n,)
        Numbers of the triggers that have an image, ascending, and the samples of their exposures.
    is_analysed : ndarray of bool, shape (n,)
        Whether the session has results of the frame.
    exposure : int
        Samples of an exposure.
    drive_start : int or None
        Sample on which the drive began.
    end : int
        Number of samples.
    """

    frames: I64
    samples: I64
    is_analysed: Bool
    sample_rate_hz: float
    exposure: int
    drive_start: int | None
    end: int
    stretches: tuple[Stretch, ...]
    marks: tuple[Mark, ...]

    @property
    def notes(self) -> list[Mark]:
        """What the operator has noted."""
        return [mark for mark in self.marks if mark.kind == NOTE]

    def row_of(self, frame: int) -> int:
        """Row of a frame, or of the nearest one that has an image."""
        return int(np.argmin(np.abs(self.frames - frame)))

    def row_at(self, sample: float) -> int:
        """Row of the last frame whose exposure began by then; the first row before that."""
        return max(0, int(np.searchsorted(self.samples, sample, "right")) - 1)

    def nearest(self, sample: float) -> int:
        """Number of the frame whose exposure began nearest to a sample."""
        return int(self.frames[np.argmin(np.abs(self.samples - sample))])

    def middle_of(self, frame: int) -> float:
        """Sample in the middle of a frame's exposure, to which its forces and travel belong."""
        return float(self.samples[self.row_of(frame)]) + self.exposure / 2

    def has_results(self, frame: int) -> bool:
        """Whether the session has results of that frame."""
        row = self.row_of(frame)
        return bool(self.frames[row] == frame and self.is_analysed[row])

    def time_s(self, sample: float) -> float:
        """Seconds from the start of the drive, or from sample 0 where there was none."""
        return (sample - (self.drive_start or 0)) / self.sample_rate_hz

    def state_at(self, sample: float) -> ContactState | None:
        """What the contact did at a sample; None where that is not known."""
        held = (one.state for one in self.stretches if one.begin <= sample < one.end)
        return next(held, None)

    def step_at(self, sample: float) -> str:
        """The step under way, ``3 of 6: hold for 10 s``; empty where there are none."""
        begun = [mark.text for mark in self.marks if mark.kind == STEP and mark.sample <= sample]
        return begun[-1] if begun else ""


def timeline_of(
    triggers: Rows,
    results: Rows,
    events: Iterable[Event],
    gaps: Iterable[tuple[int, int]],
    summary: Summary | None,
    *,
    sample_rate_hz: float,
    exposure: int,
    end: int,
) -> Timeline:
    """The time line of a run from the tables of its session (`app.session.reader`).

    The contact sticks until a stick radius c is told that is less than that of the contact by
    `WITHIN_SD`, slips partially until t_s, and slides from then on. Where the stage turned back
    after that, it slides while Q/P along the motion is that of sliding.
    """
    events, received = sorted(events, key=lambda event: event.sample), triggers["received"]
    frames, samples = (triggers[name][received].astype(np.int64) for name in ("index", "sample"))
    analysed = np.isin(frames, results["frame"])
    phases = [(event.sample, Phase(event.text)) for event in events if event.kind == "phase"]
    begins = [(at, ContactState(str(phase))) for at, phase in phases if phase is not Phase.DRIVE]
    drive_start = next((at for at, phase in phases if phase is Phase.DRIVE), None)
    if drive_start is not None:
        drive_end = min([at for at, _ in phases if at > drive_start], default=end)
        of_drive = results[results["phase"] == str(Phase.DRIVE)]
        begins += _states(of_drive, drive_start, drive_end, summary, sample_rate_hz)
    begins.sort(key=lambda one: one[0])
    ends = [*(at for at, _ in begins[1:]), end]
    stretches = [
        Stretch(state, at, until)
        for (at, state), until in zip(begins, ends, strict=False)
        if until > at
    ]
    marks = [Mark(e.sample, MARKED[e.kind], e.text) for e in events if e.kind in MARKED]
    lost = triggers[~received]
    marks += [Mark(int(t["sample"]), LOSS, f"frame {t['index']}: {t['reason']}") for t in lost]
    marked = {mark.sample for mark in marks if mark.kind == LOSS}
    marks += [
        Mark(first, LOSS, f"{count} force samples lost")
        for first, count in gaps
        if first not in marked
    ]
    return Timeline(
        frames,
        samples,
        analysed,
        sample_rate_hz,
        exposure,
        drive_start,
        end,
        tuple(_joined(stretches)),
        tuple(sorted(marks)),
    )


def _states(
    drive: Rows, start: int, end: int, summary: Summary | None, rate_hz: float
) -> list[tuple[int, ContactState]]:
    """Where each state of a drive begins."""
    begins = [(start, ContactState.STICK)]
    onset_s = summary.onset_time_s if summary else math.nan
    onset = start + onset_s * rate_hz if math.isfinite(onset_s) else math.inf
    slips = _slips(drive, summary)
    first = drive["sample"][slips]
    if len(first) and first[0] < min(onset, end):
        begins.append((int(first[0]), ContactState.PARTIAL))
    if onset >= end:
        return begins
    begins.append((round(onset), ContactState.SLIDE))
    travel = drive["travel_m"]
    furthest = np.maximum.accumulate(np.nan_to_num(travel)) if len(travel) else travel
    turned = np.flatnonzero((travel < furthest - 2 * MOVES_M) & (drive["sample"] > onset))
    if not len(turned) or summary is None or not math.isfinite(summary.mu_d):
        return begins
    later = drive[turned[0] :]
    way = np.append(0.0, np.diff(later["travel_m"]))
    moves = np.where(np.abs(way) > MOVES_M, np.sign(way), 0.0)
    ratio = moves * later["shear_force_n"] / later["normal_force_n"]
    slides = ratio >= SLIDES * summary.mu_d
    return [
        *begins,
        *(
            (int(sample), ContactState.SLIDE if is_sliding else ContactState.PARTIAL)
            for sample, is_sliding in zip(later["sample"], slides, strict=True)
        ),
    ]


def _slips(drive: Rows, summary: Summary | None) -> Bool:
    """From which frames of a drive on the stick radius was less than the contact's, `IN_A_ROW`
    times.
    """
    known = (summary.hertz_radius_m, summary.apparent_radius_m) if summary else ()
    whole = next((a for a in known if math.isfinite(a)), math.nan)
    c, sd = stick_radii(drive)
    below = c + WITHIN_SD * np.nan_to_num(sd) < whole
    after = (np.append(below[k:], np.zeros(min(k, len(below)), np.bool_)) for k in range(IN_A_ROW))
    slips: Bool = np.logical_and.reduce([*after])
    return slips


def _joined(stretches: Iterable[Stretch]) -> list[Stretch]:
    """Stretches of which none is of the same state as the one before."""
    joined: list[Stretch] = []
    for one in stretches:
        if joined and joined[-1].state is one.state:
            joined[-1] = joined[-1]._replace(end=one.end)
        else:
            joined.append(one)
    return joined


class ReplayVerdict(NamedTuple):
    """Whether a replay gave the recorded results, and the sentences that say so."""

    agrees: bool
    sentences: tuple[str, ...]
