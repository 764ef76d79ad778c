"""Reads a session back, also one that was cut short, and refuses whatever is not a session with a
sentence that says why.

A file may come from anywhere: what it says is checked (`app.session.checked`) before it is used.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from itertools import pairwise
from pathlib import Path
from typing import Any, TypeVar
from zlib import crc32

import msgspec
import numpy as np

from analysis.arrays import F64, I64, Array, Bool, Rows
from app.records.analog_channels import Channels
from app.records.effort import Resources
from app.records.pixel_pattern import PixelPattern
from app.records.record_types import (
    Acquired,
    ContactResult,
    Counts,
    DisplacementField,
    Event,
    Gap,
    Header,
    Outcome,
    Phase,
    Position,
    RingProfile,
    Samples,
    Snapshot,
    SourceSession,
    StressProfile,
    TriggerRow,
)
from app.records.schema import Column, build, columns_of
from app.records.snapshot_numbers import NUMBERS, ROW, snapshot_of
from app.records.summary import Summary
from app.session import layout, legacy
from app.session.checked import CheckedFile, Closable
from app.session.dataset_bytes import Dataset
from app.session.datasets import counted_in, samples_of
from app.session.layout import FORCES_CHUNK, LATER, NO_ROW
from app.system.errors import MissingFile, UserError
from drivers.protocols import Frame, LostFrame

T = TypeVar("T")
MOST_CHANNELS = 64  # beside the forces, as many as the settings allow
UNREADABLE_IMAGE = "its image cannot be read, the bytes are not those that were recorded"
UNREADABLE_SAMPLES = "they cannot be read, the bytes are not those that were recorded"


class SessionReader(Closable):
    """A session on disk; use it in a ``with`` statement. Nothing but small tables is kept in
    memory.

    Parameters
    ----------
    is_whole : bool
        Whether a session that lacks a dataset, or of which one cannot be read, is refused at once;
        else only what needs that dataset is.

    Attributes
    ----------
    format : int
        Version of the format in which it was written.
    altered : list of LostFrame or Gap
        What `records` gave as lost, because it is not what was recorded.

    Raises
    ------
    UserError
        From here and from every method: no such file, not a session, cut short, damaged, or written
        by a newer SlipScope.
    """

    def __init__(self, path: Path, *, is_whole: bool = True) -> None:
        self.path = Path(path)
        self.file = CheckedFile(self.path, "session")
        self.altered: list[LostFrame | Gap] = []
        try:
            self.format = self.file.checked_format(layout.FORMAT_ATTRIBUTE)
            for column in layout.COLUMNS if is_whole else ():
                if column.group not in LATER and self.has(column):
                    self.dataset(column.path)
        except BaseException:
            self.file.close()
            raise

    def close(self) -> None:
        """Let go of the file. May be called twice."""
        self.file.close()
        if (images := self.__dict__.get("_images", self)) is not self:
            images.close()

    @cached_property
    def header(self) -> Header:
        """What was known of the session from its beginning, without the `pattern`."""
        images = self.dataset(layout.IMAGES.path)
        for axis, side in zip("yx", images.shape[1:], strict=True):
            grid = self._read(path := f"/entry/fields/{axis}")
            if not ((np.diff(grid) > 0).all() and (grid >= 0).all() and (grid < side).all()):
                raise self.file.damaged(path, f"it is no grid of boxes in an image of {side} px")
        names, versions = self._read("/entry/versions/name"), self._read("/entry/versions/version")
        return self._single(
            Header,
            frame_shape=tuple(map(int, images.shape[1:])),
            frame_dtype=str(images.dtype),
            versions=dict(zip(names.tolist(), versions.tolist(), strict=False)),
            source=self._optional(SourceSession),
            auxiliary=self._optional(Channels),
            compression="gzip" if images.is_deflated else "none",
        )

    @cached_property
    def outcome(self) -> Outcome:
        """How the run ended; of a session cut short ("unfinished"), with the account of what is in
        the file.
        """
        with self.file.reading("/entry/run/resources"):
            resources = msgspec.json.decode(self._read("/entry/run/resources"), type=Resources)
        state, reason = self._read("/entry/run/state"), self._read("/entry/run/reason")
        with self.file.reading("/entry/run/state"):
            end = legacy.end_of(state, reason, self.format)
        return Outcome(
            end,
            reason,
            self._optional(Counts) or counted_in(self),
            self._optional(Summary),
            dict(resources),
        )

    @cached_property
    def ended(self) -> str:
        """Time of day when the run ended, ISO 8601; empty if it was not finished."""
        return str(self._read("/entry/end_time"))

    def pattern(self) -> PixelPattern | None:
        """What was undone in the pictures before they were correlated; None: nothing."""
        if (pattern := self._optional(PixelPattern)) is None:
            return None
        for name, held in (("gain", pattern.gain), ("dark", pattern.dark)):
            if held.shape != self.header.frame_shape:
                raise self.file.damaged(f"/entry/pattern/{name}", f"its shape is {held.shape}")
        return pattern

    def contact(self) -> ContactResult | None:
        """The apparent contact; None where it was not measured."""
        return self._optional(ContactResult)

    def events(self) -> list[Event]:
        """What happened, in order."""
        table = self._table("/entry/events")
        held = (table[one.name].tolist() for one in columns_of(Event) if one.name in table)
        return [legacy.typed(Event(*row), self.format) for row in zip(*held, strict=True)]

    def positions(self) -> tuple[I64, F64]:
        """Samples at which the stage was read, and its positions in metres."""
        table = self._table("/entry/instrument/actuator")
        return table["sample"], table["position"]

    # ------------------------------------------------------------------ forces

    def forces(self) -> Samples:
        """All samples; those that are missing are NaN."""
        table = self._table("/entry/forces")
        return samples_of(0, table, self._auxiliary(0, len(table["normal_force"])))

    def gaps(self) -> list[tuple[int, int]]:
        """First sample and length of each gap in the forces."""
        table = self._table("/entry/gaps")
        return list(zip(table["first"].tolist(), table["count"].tolist(), strict=True))

    def _stretches(self) -> Iterator[tuple[int, int]]:
        """First sample and end of each block: no gap is in it, and all of it in one chunk."""
        start, rows = 0, min(len(column) for column in self._force_columns().values())
        for gap, count in [*self.gaps(), (rows, 0)]:
            end = min(gap, rows)
            if not start <= end:
                raise self.file.damaged("/entry/gaps/first", f"{gap} lies in the gap before it")
            chunks = range(start - start % FORCES_CHUNK + FORCES_CHUNK, end, FORCES_CHUNK)
            yield from pairwise((start, *chunks, end))
            start = min(end + count, rows)

    def _block(self, first: int, end: int) -> Samples:
        with self.file.reading("/entry/forces"):
            block = {name: column[first:end] for name, column in self._force_columns().items()}
            for column in columns_of(Samples):
                column.check(block[column.name])
        return samples_of(first, block, self._auxiliary(first, end))

    def _auxiliary(self, first: int, end: int) -> F64 | None:
        """Values of the further channels on these samples; NaN where the file ends before them."""
        if self.header.auxiliary is None:
            return None
        path, channels = layout.AUXILIARY.path, len(self.header.auxiliary.name)
        dataset = self.dataset(path)
        found = {dataset.shape[1], len(self.header.auxiliary.unit)}
        if found != {channels} or channels > MOST_CHANNELS:
            raise self.file.damaged(path, f"{dataset.shape[1]} channels, {channels} have a name")
        with self.file.reading(path):
            held = dataset[first:end]
        return np.concatenate([held, np.full((end - first - len(held), channels), np.nan)])

    def _force_columns(self) -> dict[str, Dataset]:
        return {c.name: self.dataset(c.path) for c in columns_of(Samples)}

    # ------------------------------------------------------------------ triggers and their images

    def triggers(self) -> Rows:
        """Every trigger and its fate: fields index, sample, received, analysed, reason (why it was
        lost), first and last (the triggers that it can be; both are index where it is certain), and
        stamp (the camera's own time of its image, seconds; NaN where it is not known).
        """
        kinds = {"index": "i8", "sample": "i8", "received": "?", "analysed": "?", "reason": object}
        kinds |= {"first": "i8", "last": "i8", "stamp": "f8"}
        lacking = dict.fromkeys(("first", "last"), self._triggers["index"]) | {"stamp": np.nan}
        table = lacking | self._triggers | {"received": self._triggers["image"] != NO_ROW}
        rows = np.empty(len(table["index"]), dtype=list(kinds.items()))
        for name in kinds:
            rows[name] = table[name]
        return rows

    def lost_frames(self) -> list[tuple[int, int, str]]:
        """Index, sample and reason of each trigger without an image."""
        lost = self.triggers()[self._triggers["image"] == NO_ROW]
        rows: list[tuple[int, int, str]] = lost[["index", "sample", "reason"]].tolist()
        return rows

    def frames(self) -> Iterator[tuple[int, int, Array]]:
        """Index, sample and image of each frame received, in the order of the triggers."""
        yield from map(self.frame, self._frame_rows)

    def frame(self, index: int) -> tuple[int, int, Array]:
        """Index, sample and image of the frame of trigger `index`, as it was recorded."""
        if index not in self._frame_rows:
            raise UserError(
                f"{self.path}: there is no image of trigger {index} in this session; `slipscope"
                " info` lists what there is"
            )
        row = self._frame_rows[index]
        image = self._images._row(layout.IMAGES.path, self.image_row(index))
        if self.format >= 4 and crc32(image.data) != self._triggers["checksum"][row]:
            known, remedy = "analysed", "use a whole copy of it"
            if self._images is self:
                known, remedy = "recorded", "`slipscope repair` makes a session of the others"
            said = f"the image of trigger {index} is not the one that was {known}; {remedy}"
            raise UserError(f"{self._images.path}: {said}")
        return index, int(self._triggers["sample"][row]), image

    @property
    def images_path(self) -> Path:
        """The file that holds the images: this one, or the source."""
        return self._images.path

    def image_row(self, index: int) -> int:
        """Row of the image of trigger `index` in the file that holds the images."""
        return int(self._triggers["image"][self._frame_rows[index]])

    # ------------------------------------------------------------------ results

    def analysed_frames(self) -> list[int]:
        """Trigger numbers of the frames analysed during the run, in that order."""
        frames: list[int] = self._results["frame"].tolist()
        return frames

    def results(self) -> Rows:
        """The numbers of every snapshot, in order, by their names; NaN where this session is too
        old to have them.
        """
        rows = np.empty(len(self._results["frame"]), ROW)
        for name, column in NUMBERS.items():
            held: Any = self._results.get(column.name, column.default)
            with self.file.reading(column.path):
                rows[name] = [*map(column.restored, held)] if column.kind is Phase else held
        return rows

    def have_fields(self) -> Bool:
        """Which snapshots have a displacement field."""
        return np.asarray(self._results["field"] != NO_ROW)

    def snapshots(self) -> Iterator[Snapshot]:
        """The results of each analysed frame, in order."""
        yield from map(self.snapshot, range(len(self._results["frame"])))

    def snapshot(self, i: int) -> Snapshot:
        """The results of the `i`-th analysed frame."""
        n = len(self._results["frame"])
        if not 0 <= i < n:
            raise UserError(
                f"{self.path}: there is no result {i} in this session; it has {n}, counted from 0"
            )
        row = {name: column[i].item() for name, column in self._results.items()}
        with self.file.reading("/entry/results"):
            numbers = {
                column.attribute: column.restored(row.get(column.name, column.default))
                for column in NUMBERS.values()
            }
        return replace(
            snapshot_of(numbers),
            field=self._field(row["field"]),
            rings=self._profile(RingProfile, i, "ring_count", row["ring_count"]),
            stress=self._profile(StressProfile, i, "stress_count", row.get("stress_count", 0)),
        )

    def _field(self, row: int) -> DisplacementField | None:
        if row == NO_ROW:
            return None
        header, shape = self.header, self.dataset("/entry/fields/ux").shape[1:]
        if shape != (len(header.grid_y_px), len(header.grid_x_px)):
            raise self.file.damaged("/entry/fields/ux", f"its fields are {shape}, the grid is not")
        return build(
            DisplacementField,
            lambda column: (
                self._row(column.path, row)
                if column.since <= self.format
                else np.full(shape, np.nan, column.dtype)
            ),
        )

    def _profile(self, kind: type[T], i: int, counter: str, count: int) -> T | None:
        """The profile of the `i`-th result, in which `count` values are its own."""

        def value_of(column: Column) -> Array:
            values = self._row(column.path, i)
            if not 0 <= count <= len(values):
                raise self.file.damaged(f"/entry/results/{counter}", f"{count} values are claimed")
            return values[:count]

        return build(kind, value_of) if count else None

    def records(self) -> Iterator[Acquired | Event]:
        """Everything measured, as the records that make another session of it."""
        for part in self.parts().values():
            yield from part()

    def parts(self) -> dict[str, Callable[[], Iterable[Acquired | Event]]]:
        """The same in parts by what they are, each of which is read without the others."""
        self.altered.clear()
        if len(self.dataset("/entry/triggers/index")):
            _ = self._images  # an analysis without its session cannot be read at all
        return {
            "forces": self._blocks,
            "triggers and images": self._fates,
            "places of the stage": lambda: map(Position, *(c.tolist() for c in self.positions())),
            "events": self.events,
        }

    def _blocks(self) -> Iterator[Samples | Gap]:
        for first, end in self._stretches():
            try:
                yield self._block(first, end)
            except UserError:
                self.altered.append(lost := Gap(first, end - first, UNREADABLE_SAMPLES))
                yield lost

    def _fates(self) -> Iterator[Acquired]:
        for index, sample, received, _, reason, *span in self.triggers().tolist():
            if received:
                yield self._fate(index, sample, *span)
            else:
                yield LostFrame(index, sample, reason, *span[:2])

    def _fate(
        self, index: int, sample: int, first: int, last: int, stamp_s: float
    ) -> Frame | TriggerRow | LostFrame | Gap:
        """The frame of a trigger that was received, unless it is not what was recorded."""
        with suppress(UserError):
            image = self.frame(index)[2]
            if self.header.source is None:
                return Frame(index, sample, image, first, last, stamp_s)
            row, checksum = self.image_row(index), crc32(image.data)
            return TriggerRow(index, sample, row, "", 0, checksum, first, last, stamp_s)
        self.altered.append(LostFrame(index, sample, UNREADABLE_IMAGE, first, last))
        return self.altered[-1]

    @cached_property
    def _images(self) -> SessionReader:
        """The session that holds the images: this one, or the one beside it that was analysed once
        more.
        """
        source = self.header.source
        if source is None:
            return self
        with self.file.reading("/entry/source/session"):
            path = self.path.with_name(source.session)
        if not path.is_file():
            raise MissingFile(
                f"{self.path}: its images are in {path.name}, which does not lie beside it; put"
                " both into one folder"
            )
        held, own = SessionReader(path), self.header
        its = held.header
        known = (its.source, its.started, its.frame_shape, its.frame_dtype)
        if known != (None, source.started, own.frame_shape, own.frame_dtype):
            held.close()
            raise UserError(
                f"{self.path}: {path.name} is not the session that was analysed; put that one"
                " beside it"
            )
        return held

    @cached_property
    def _triggers(self) -> dict[str, Array]:
        table = self._table("/entry/triggers")
        received = table["index"][table["image"] != NO_ROW]
        if not ((np.diff(received) > 0).all() and (table["sample"] >> 62 == 0).all()):
            raise self.file.damaged(
                "/entry/triggers", "its frames are in no order, or at no sample"
            )
        return table

    @cached_property
    def _frame_rows(self) -> dict[int, int]:
        """Trigger number -> row of triggers, of the frames received."""
        received = np.flatnonzero(self._triggers["image"] != NO_ROW)
        return {int(self._triggers["index"][row]): int(row) for row in received}

    @cached_property
    def _results(self) -> dict[str, Array]:
        return self._table("/entry/results")

    # ------------------------------------------------------------------ datasets

    def dataset(self, path: str) -> Dataset:
        """A dataset of the layout, checked."""
        column = layout.BY_PATH[path]
        return self.file.dataset(path, column.shape, column.dtype)

    def has(self, column: Column) -> bool:
        """Whether a session of this format has a dataset, and this one if it is optional."""
        is_there = column.path not in layout.OPTIONAL or self.file.has(column.path)
        return column.since <= self.format and is_there

    def _read(self, path: str) -> Any:
        column = layout.BY_PATH[path]
        return self.file.values(column, path, column.shape)

    def _single(self, kind: type[T], **others: Any) -> T:
        """The record of a type of which a session has one."""

        def value_of(column: Column) -> Any:
            if column.since > self.format:
                return None
            with self.file.reading(column.path):
                return column.restored(self._read(column.path))

        return build(kind, value_of, **others)

    def _optional(self, kind: type[T]) -> T | None:
        """The record of a type that a session may lack."""
        return self._single(kind) if self.file.has(columns_of(kind)[0].group) else None

    def _row(self, path: str, row: int) -> Array:
        dataset = self.dataset(path)
        if not 0 <= row < dataset.shape[0]:
            raise self.file.damaged(path, f"row {row} is needed, it has {dataset.shape[0]}")
        with self.file.reading(path):
            values: Array = dataset[row]
            layout.BY_PATH[path].check(values)
            return values

    def _table(self, group: str) -> dict[str, Array]:
        """The columns of a group, cut to the shortest: a program that was killed may have
        lengthened only some.
        """
        columns = {
            column.name: self._read(column.path)
            for column in layout.columns_in(group)
            if len(column.shape) == 1 and column.path not in layout.DERIVED and self.has(column)
        }
        rows = min(len(values) for values in columns.values())
        return {name: values[:rows] for name, values in columns.items()}
