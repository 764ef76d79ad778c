"""What the columns of a session say of a sample or a frame."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from analysis.arrays import F64, Rows
from app.records.record_types import REVOKED, Counts, Event, Samples
from app.records.schema import columns_of

if TYPE_CHECKING:
    from app.session.reader import SessionReader


def samples_of(
    first: int,
    columns: Mapping[str, F64],
    auxiliary: F64 | None,
) -> Samples:
    """A block of samples from the columns of the forces."""
    volts = np.column_stack([columns["normal_sensor"], columns["shear_sensor"]])
    newtons = np.column_stack([columns["normal_force"], columns["shear_force"]])
    return Samples(first, volts, newtons, auxiliary)


def revoked_from(events: Iterable[Event]) -> list[int]:
    """The frame from which on nothing is certain, where the account of a run does not hold."""
    return [event.number for event in events if event.kind == REVOKED and event.number >= 0][:1]


def with_revocations(triggers: Rows, events: Iterable[Event]) -> Rows:
    """The table of all triggers (`SessionReader.triggers`), whose columns `first` and `last` say of
    each from the one on of which an event says that nothing is certain that it can be any from
    there on, or one after the last.
    """
    doubted = triggers.copy()
    for revoked in revoked_from(events):
        rows = doubted[doubted["index"] >= revoked]
        rows["first"] = np.minimum(rows["first"], revoked)
        rows["last"] = np.maximum(rows["last"], doubted["index"][-1:] + 1)
        doubted[doubted["index"] >= revoked] = rows
    return doubted


def uncertain_triggers(reader: SessionReader) -> list[int]:
    """Numbers of the triggers of which it is not certain that they took the image that they have,
    or that it is they who have none. Reads nothing but them and the events: all from the one on of
    which an event says that nothing is certain are uncertain.
    """
    paths = [f"/entry/triggers/{name}" for name in ("index", "first", "last")]
    if not reader.file.has(paths[-1]):
        return []
    columns = [reader.file.read(reader.dataset(path)) for path in paths]
    rows = min(map(len, columns))
    index, first, last = (column[:rows] for column in columns)
    is_uncertain = first != last
    for revoked in revoked_from(reader.events()):
        is_uncertain |= index >= revoked
    numbers: list[int] = index[is_uncertain].tolist()
    return numbers


def counted_in(reader: SessionReader) -> Counts:
    """The account of a session that was cut short, from what is in the file."""
    triggers = reader.triggers()
    frames, analysed = int(triggers["received"].sum()), len(set(reader.analysed_frames()))
    lost = sum(count for _, count in reader.gaps())
    return Counts(
        triggers=len(triggers),
        frames_received=frames,
        frames_recorded=frames,
        frames_lost=len(triggers) - frames,
        frames_analysed=analysed,
        frames_skipped=frames - analysed,
        samples=min(len(reader.dataset(column.path)) for column in columns_of(Samples)) - lost,
        samples_lost=lost,
    )
