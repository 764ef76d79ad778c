"""Writes a session as an HDF5 file. It is used where nothing is measured at the same time: by
`completing`, by imports and by further analyses.

Write, then count: an image goes to the file before the row that says it is there. All else is
written in batches, at each flush at the latest. `close` reads the session back and compares it with
all that the writer was given.
"""

from __future__ import annotations

import json
import logging
import os
from array import array
from bisect import bisect_left
from pathlib import Path
from typing import Any, Self, assert_never
from zlib import crc32

import h5py
import numpy as np

from app.records.quantities import counted
from app.records.record_types import (
    ContactResult,
    End,
    Event,
    Gap,
    Header,
    Outcome,
    Position,
    Record,
    Samples,
    Snapshot,
    TriggerRow,
)
from app.session import layout, trust
from app.session.checks import (
    channels_of,
    check_channels,
    check_image,
    check_place,
    check_snapshot,
)
from app.session.columns import (
    LIBVER,
    ColumnGroup,
    append_chunk,
    let_go,
    make_group,
    place_images,
    storable,
    stored,
)
from app.session.dimension_scales import name_sides
from app.session.files import check_room
from app.session.journal import StoredFrame
from app.session.layout import LATER, NO_ROW, ResultRow, Texts, Versions
from app.session.receipt import Receipt, RecordedContents, verify
from app.session.recorder import HEAD_BYTES, dated, deflated
from app.system.disk import SparedFile
from app.system.errors import UserError
from app.system.time_of_day import now
from drivers.protocols import Frame, LostFrame

LOG = logging.getLogger(__name__)
METADATA_BYTES = 1 << 19  # cache of HDF5, which would grow for hours
WAITING_FIELDS = 16  # written together, which costs HDF5 less
# in the order in which they are flushed: the results refer to the tables before them
TABLES = (
    *("gaps", "forces", "triggers", "instrument/actuator", "events"),
    *("rings", "stress", "fields", "results"),
)

_SHAPES = {column.path: column.shape for column in layout.COLUMNS}


class ElsewhereError(Exception):
    """HDF5 does not leave the images where they are."""


class SessionWriter:
    """One session being written; made by `create`, used from one thread at a time.

    Attributes
    ----------
    receipt : Receipt or None
        After `close`: what was read back.
    given : RecordedContents
        What it was given so far.
    """

    def __init__(self, path: Path, file: h5py.File, disk: SparedFile, header: Header) -> None:
        self.receipt: Receipt | None = None
        self._path, self._file, self._disk, self._header = path, file, disk, header
        self._images = file[layout.IMAGES.path]
        self._channels = channels_of(header)
        self.given = RecordedContents(channels=self._channels)
        tables = ["auxiliary", *TABLES] if self._channels else TABLES
        self._tables = {name: ColumnGroup(file, f"/entry/{name}") for name in tables}
        # trigger numbers of the frames received, increasing, and their rows in triggers
        self._received, self._received_rows = array("q"), array("q")
        self._analysed: set[int] = set()  # rows of triggers, marked at the next flush

    @classmethod
    def create(
        cls,
        path: Path,
        header: Header,
        *,
        images_there: int | None = None,
    ) -> Self:
        """A new session at `path`, a name that `app.session.files.new_session` has given, which
        removes what is left there.

        Parameters
        ----------
        images_there : int, optional
            So many images lie in the file already, one after the other from `HEAD_BYTES` on, and
            nothing behind them.

        Raises
        ------
        UserError
            The file cannot be made there.
        ElsewhereError
            HDF5 does not leave the images where they are.
        """
        texts = Texts(
            title="SlipScope loading experiment",
            program="SlipScope",
            ended="",
            state=str(End.UNFINISHED),
            reason="the session was not closed",
            resources="{}",
        )
        header = dated(header)
        versions = Versions(tuple(header.versions), tuple(header.versions.values()))
        values = stored(texts, versions, header)
        for column, side in zip((layout.IMAGE_Y, layout.IMAGE_X), header.frame_shape, strict=True):
            values[column.path] = np.arange(side)
        try:
            path.touch()
            disk = SparedFile(path)
        except OSError as error:
            raise UserError(
                f"{path}: the session cannot be made there: {os.strerror(error.errno or 0)};"
                " choose another folder or name"
            ) from None
        file = None
        try:
            file = _new_file(disk, path.stat().st_size - HEAD_BYTES if images_there else 0)
            if images_there:
                place_images(file, header, images_there)
                if file[layout.IMAGES.path].id.get_offset() != HEAD_BYTES:
                    raise ElsewhereError
            file.attrs.update(
                {
                    "NX_class": "NXroot",
                    "default": "entry",
                    "creator": "SlipScope",
                    layout.FORMAT_ATTRIBUTE: layout.FORMAT_VERSION,
                }
            )
            for group in layout.GROUPS:
                asked = {
                    "/entry/source": header.source,
                    "/entry/auxiliary": header.auxiliary,
                    "/entry/pattern": header.pattern,
                }
                if group.path not in LATER or asked.get(group.path):
                    make_group(file, group.path, values, header)
            file["/entry"].attrs["default"] = "results"
            return cls(path, file, disk, header)
        except BaseException:
            try:
                disk.check()
            finally:
                let_go(disk, file)
            raise

    def append(self, record: Record) -> None:
        """Add something; an image is written at once.

        Samples missing before a block of samples become a gap and NaN. A snapshot comes after the
        frame of which it is the result; an outcome ends the record.

        Raises
        ------
        ValueError
            The record cannot belong to this session: samples that are there already or lie
            absurdly far ahead, an image of another shape or type, results of a frame that is not
            here.
        """
        match record:
            case Frame():
                self._append_frame(record)
            case TriggerRow():
                self._add_frame(record)
            case Samples(first):
                check_place(first, len(self._tables["forces"]), self._header)
                check_channels(record, self._header)
                self._add_samples(record)
            case Gap(first, count):
                for sample in (first, first + count):
                    check_place(sample, len(self._tables["forces"]), self._header)
                self._add_samples(_missing(first, count))
                self._add("gaps", record)
                text = f"{counted(count, 'sample')} lost: {record.reason}"
                self._add("events", Event(first, "gap", text))
            case LostFrame(index, sample, reason, first, last):
                row = TriggerRow(index, sample, NO_ROW, reason, 0, 0, first, last)
                self._add("triggers", row)
            case Position():
                self._add("instrument/actuator", record)
            case Event():
                self._add("events", record)
            case Snapshot():
                self._append_snapshot(record)
            case ContactResult():
                self._make("profile", record)
                self._make("contact", record)
            case Outcome():
                self._finish(record)
            case _:
                assert_never(record)
        self.given.add(record)

    def append_stored(self, frame: StoredFrame, row: int | None, chunk: bytes | None) -> None:
        """Add a frame whose image lies in that row already, or is that chunk."""
        self.given.add(frame)
        if row is None:
            row = append_chunk(self._images, np.frombuffer(chunk or b"", np.uint8))
        self._add_frame(_row_of(frame, row, frame.checksum))

    def _add(self, table: str, *records: Any) -> None:
        self._tables[table].append(stored(*records))

    def _add_samples(self, block: Samples) -> None:
        expected = len(self._tables["forces"])
        if missing := block.first - expected:
            self._add("gaps", Gap(expected, missing, ""))
            self._extend(_missing(expected, missing))
        self._extend(block)

    def _extend(self, block: Samples) -> None:
        if self._channels:
            values = block.auxiliary
            if values is None:
                values = np.full((len(block.volts), self._channels), np.nan)
            self._tables["auxiliary"].extend({layout.AUXILIARY.path: values})
        first = len(self._tables["forces"])
        time_s = np.arange(first, first + len(block.volts)) / self._header.sample_rate_hz
        self._tables["forces"].extend(stored(block) | {layout.TIME.path: time_s})

    def _append_frame(self, frame: Frame) -> None:
        image = np.ascontiguousarray(frame.image)
        check_image(image, self._header)
        content = image if self._images.compression is None else deflated(image)
        row = append_chunk(self._images, np.frombuffer(content, np.uint8))
        self._add_frame(_row_of(frame, row, crc32(image.data)))

    def _add_frame(self, row: TriggerRow) -> None:
        self._received.append(row.index)
        self._received_rows.append(len(self._tables["triggers"]))
        self._add("triggers", row)

    def _append_snapshot(self, snapshot: Snapshot) -> None:
        place = bisect_left(self._received, snapshot.frame)
        if self._received[place : place + 1] != array("q", [snapshot.frame]):
            raise ValueError(
                f"session: frame {snapshot.frame} has results, but it was not recorded"
            )
        check_snapshot(snapshot, self._header)
        values, row = stored(snapshot), NO_ROW
        if snapshot.field is not None:
            fields = self._tables["fields"]
            row = len(fields)
            fields.append(values | {layout.FIELD_FRAMES.path: snapshot.frame})
            if len(fields) % WAITING_FIELDS == 0:
                fields.flush()
        radii, rings = (
            0 if profile is None else len(profile.radius_m)
            for profile in (snapshot.stress, snapshot.rings)
        )
        values |= stored(ResultRow(radii, rings, row))
        for table in ("rings", "stress", "results"):
            self._tables[table].append(values)
        self._analysed.add(self._received_rows[place])

    def _finish(self, outcome: Outcome) -> None:
        self._make("counts", outcome.counts)
        if outcome.summary is not None:
            self._make("summary", outcome.summary)
        self._write_text("run/resources", json.dumps(outcome.resources, default=str))
        self._write_text("run/reason", outcome.reason)
        self._write_text("end_time", now())
        self._write_text("run/state", outcome.end)

    def explain(self, reason: str) -> None:
        """Say why a session is not the account of a whole run."""
        self._write_text("run/reason", reason)

    def flush(self) -> None:
        """Write the rows that wait; OSError where anything so far could not be written, or the disk
        is all but full.
        """
        for table in self._tables.values():
            table.flush()
        if self._analysed:
            self._file["/entry/triggers/analysed"][sorted(self._analysed)] = 1
            self._analysed.clear()
        self._disk.check()
        check_room(self._path, 0)

    def close(self) -> Receipt:
        """Write the rest, bring it to the disk and read it back.

        Raises
        ------
        OSError
            It could not be written.
        UserError
            What was read back is not what the writer was given.
        """
        if self.receipt is None:
            self.flush()
            self._number_images()
            name_sides(self._file, _SHAPES, layout.COORDINATES)
            self._file.close()
            self._disk.sync()
            self._disk.close()
            trust.remember(self._path, "")  # our own, which needs no second look
            self.receipt = verify(self._path, self.given)
            trust.remember(self._path, self.receipt.checksum)
        return self.receipt

    def _number_images(self) -> None:
        """Say of each image which trigger it is of."""
        rows, triggers = (self._file[f"/entry/triggers/{name}"][()] for name in ("image", "index"))
        numbers = np.full(len(self._images), NO_ROW)
        if self._header.source is None:
            numbers[rows[rows != NO_ROW]] = triggers[rows != NO_ROW]
        column = self._file[layout.IMAGE_FRAMES.path]
        column.resize(len(numbers), axis=0)
        column[()] = numbers

    def discard(self) -> None:
        """Let go of the session as it is; OSError where the disk has not taken it, which HDF5 was
        not told and has told otherwise.
        """
        try:
            self._disk.check()
        finally:
            let_go(self._disk, self._file)

    def _make(self, group: str, record: Any) -> None:
        make_group(self._file, f"/entry/{group}", stored(record))

    def _write_text(self, path: str, text: str) -> None:
        self._file[f"/entry/{path}"][()] = storable(text)


def _row_of(frame: Frame | StoredFrame, row: int, checksum: int) -> TriggerRow:
    span = frame.first, frame.last, frame.stamp_s
    return TriggerRow(frame.index, frame.sample, row, "", 0, checksum, *span)


def _missing(first: int, count: int) -> Samples:
    nothing = np.full((count, 2), np.nan)
    return Samples(first, nothing, nothing)


def _new_file(disk: SparedFile, images_bytes: int) -> h5py.File:
    aligned = {"alignment_threshold": images_bytes, "alignment_interval": HEAD_BYTES}
    file = h5py.File(
        disk, "w", libver=LIBVER, rdcc_nbytes=0, **(aligned if images_bytes > 0 else {})
    )
    cache = file.id.get_mdc_config()
    cache.set_initial_size, cache.initial_size, cache.min_size, cache.max_size = (
        True,
        *3 * [METADATA_BYTES],
    )
    file.id.set_mdc_config(cache)
    return file
