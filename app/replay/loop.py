"""The loop that sends a recorded experiment through the analysis: replays, further analyses and
imports differ only in where the frames come from and where the results go.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, replace
from pathlib import Path

from analysis.arrays import F64, Array
from app.acquisition.recorder_thread import RecordSink
from app.evaluation.compiling import compile_analysis
from app.evaluation.frame_analysis import Analysis
from app.evaluation.history import History
from app.evaluation.quality import complete
from app.evaluation.setup import forces_of
from app.records.effort import Effort
from app.records.record_types import (
    RESTART,
    STEP,
    Counts,
    End,
    Event,
    Header,
    Outcome,
    Phase,
    Position,
    Samples,
    TriggerRow,
)
from app.session.datasets import revoked_from
from app.session.files import new_session
from app.session.writer import SessionWriter
from app.system.usage import Usage
from drivers.protocols import Frame, LostFrame

FLUSH_EVERY = 16  # frames

Read = tuple[int, int, Array]  # number, sample and image of a recorded frame
# a trigger as it is to be recorded, its image if there is one, and the frame after it if that is
# read already and will be analysed
Trigger = tuple[Frame | TriggerRow | LostFrame, Array | None, Read | None]


@dataclass(frozen=True, slots=True)
class Measurements:
    """A recorded experiment without its images.

    Attributes
    ----------
    volts : ndarray, shape (n, 2)
        Readings of the normal and the shear sensor from sample 0 on.
    gaps : list of (int, int)
        First sample and length of each stretch in which they are missing, and NaN.
    positions : list of Position
        At the end of each block of readings; the position is NaN where it is not known.
    events : list of Event
        What happened; those of kind "phase" say on which sample each phase began.
    """

    volts: F64
    gaps: list[tuple[int, int]]
    positions: list[Position]
    events: list[Event]


def analyse(
    analysis: Analysis,
    measured: Measurements,
    triggers: Iterable[Trigger],
    sink: RecordSink,
    ended: Callable[[], tuple[End, str]],
    efforts: Mapping[int, Effort] | None = None,
) -> Outcome:
    """How the analysis of a recorded experiment ended, after everything was handed to the sink.

    Parameters
    ----------
    analysis : Analysis
        A new one; it is closed at the end.
    triggers : iterable
        In their order; its end ends the analysis.
    sink : RecordSink
        Where measurements and results go.
    ended : callable
        Says how and why the analysis ended, once it has.
    efforts : mapping, optional
        Trigger number -> what is to be computed of that frame; else all that the settings name.
    """
    efforts, everything = efforts or {}, complete(analysis.config)
    usage = Usage()
    events = sorted(measured.events, key=lambda event: event.sample)
    forces = forces_of(analysis.config, measured.volts, events)
    feed = Feed(analysis.history, forces, measured, events)
    received = lost = 0
    with closing(analysis):
        compile_analysis(analysis.config)
        for block in _samples(measured, forces):
            sink.append(block)
        for position in measured.positions:
            sink.append(position)
        for record, image, after in triggers:
            while events and events[0].sample <= record.sample:
                event = events.pop(0)
                if event.kind == RESTART:
                    analysis.pipeline.restart()
                sink.append(event)
            sink.append(record)
            if image is None:
                lost += 1
                continue
            feed.up_to(record.sample)
            effort = efforts.get(record.index, everything)
            analysis.step(
                *(record.index, record.sample, image, sink.append, effort),
                is_certain=record.is_certain,
                following=after and (*after, efforts.get(after[0], everything)),
            )
            if received % FLUSH_EVERY == 0:
                sink.flush()
                usage.look()
            received += 1
        for event in events:
            sink.append(event)
        for first in revoked_from(measured.events):
            analysis.revoke(first)
    if analysis.pipeline.contact is not None:
        sink.append(analysis.pipeline.contact)
    missing = sum(count for _, count in measured.gaps)
    counts = Counts(
        triggers=received + lost,
        frames_received=received,
        frames_recorded=received,
        frames_lost=lost,
        frames_analysed=received,
        samples=len(measured.volts) - missing,
        samples_lost=missing,
    )
    summary = analysis.summary()
    outcome = Outcome(*ended(), counts, summary, usage.resources())
    sink.append(outcome)
    return outcome


def record_analysis(
    analysis: Analysis,
    measured: Measurements,
    triggers: Iterable[Trigger],
    header: Header,
    output: Path,
    ended: Callable[[], tuple[End, str]],
    *,
    overwrite: bool,
) -> Outcome:
    """As `analyse`, into a new session at `output`, which appears when it is complete.

    Raises
    ------
    UserError
        The session cannot be written; nothing is left of it.
    """
    with new_session(output, overwrite) as unfinished:
        writer = SessionWriter.create(unfinished, header)
        try:
            outcome = analyse(analysis, measured, triggers, writer, ended)
            receipt = writer.close()
        except BaseException:
            writer.discard()
            raise
    return replace(outcome, resources=outcome.resources | {"receipt": str(receipt)})


def _samples(measured: Measurements, forces: F64) -> Iterator[Samples]:
    """The readings between the gaps; an empty block between gaps that adjoin, and at the end."""
    volts, start = measured.volts, 0
    for first, count in (*measured.gaps, (len(volts), 0)):
        yield Samples(start, volts[start:first], forces[start:first])
        start = first + count


class Feed:
    """Gives a history what was measured, a block for each position of the stage, in the order in
    which a live run gives it.
    """

    def __init__(
        self,
        history: History,
        forces: F64,
        measured: Measurements,
        events: list[Event],
    ) -> None:
        self._history, self._forces = history, forces
        self._positions = iter(measured.positions)
        self._begins = [event for event in events if event.kind in ("phase", STEP)]

    def up_to(self, sample: int) -> None:
        """Give everything that was known when the exposure that began at `sample` had ended."""
        history = self._history
        while history.end < sample + history.exposure_samples:
            position = next(self._positions, None)
            # of readings that were lost, the phases are known
            known = math.inf if position is None else history.end
            while self._begins and self._begins[0].sample <= known:
                event = self._begins.pop(0)
                if event.kind == STEP:
                    history.begin_step(event.number, event.sample)
                else:
                    history.begin(Phase(event.text), event.sample)
            if position is None:
                return
            begin, end = history.end, position.sample
            history.append(begin, self._forces[begin:end], position.position_m, end)
