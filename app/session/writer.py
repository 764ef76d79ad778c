"""Writes a session while it happens: images at once, everything small in batches at each flush.

Write, then count: an image goes to the file before the row that says it is there, and a write that
fails is taken back, so that a full disk leaves a session without phantom rows. After `flush` the
file is complete in itself and on the disk. Beside it grows a journal (`journal`), with which
`repair` brings back what a killed program or a power cut left of the rest. `close` reads the
session back, compares it with the journal, and removes the journal only where both agree.
"""

from __future__ import annotations

import datetime
import json
import logging
import os
import re
from array import array
from bisect import bisect_left
from contextlib import ExitStack
from dataclasses import replace
from io import FileIO
from pathlib import Path
from typing import Any, Self, assert_never
from zlib import crc32

import h5py
import numpy as np
from numpy.typing import NDArray

from app.records import (
    UNFINISHED,
    ContactResult,
    DisplacementField,
    Event,
    Gap,
    Header,
    LostTrigger,
    Outcome,
    Position,
    ReceivedFrame,
    Record,
    Samples,
    Snapshot,
    SourceFrame,
)
from app.schema import columns_of
from app.session import layout
from app.session.columns import Table, append_field, append_image, make_group, storable, stored
from app.session.files import abandon, check_room, new_files
from app.session.journal import Journal, StoredFrame
from app.session.layout import LATER, NO_ROW, ResultRow, Texts, TriggerRow, Versions
from app.session.receipt import Receipt, verify

LOG = logging.getLogger(__name__)
LOOK_BYTES = 4096  # of each end of an image
# missing samples are written as NaN; more than this is a wrong sample number, not a gap
LONGEST_GAP_S = 3600.0
# in the order in which they are flushed: the results refer to the tables before them
TABLES = (
    *("gaps", "forces", "triggers", "instrument/actuator", "events"),
    *("rings", "stress", "fields", "results"),
)


class SessionWriter:
    """One session being recorded; made by `create`, used from one thread at a time.

    Attributes
    ----------
    receipt : Receipt or None
        After `close`: what was read back.
    """

    def __init__(self, path: Path, file: h5py.File, journal: Journal, header: Header) -> None:
        self.receipt: Receipt | None = None
        self._path = path
        self._file = file
        self._journal = journal
        # the same file once more, to have it brought to the disk
        self._on_disk = FileIO(path, "r+")
        self._images = file[layout.IMAGES.path]
        self._fields = {c.path: file[c.path] for c in columns_of(DisplacementField)}
        self._channels = len(header.auxiliary.name) if header.auxiliary else 0
        tables = ["auxiliary", *TABLES] if self._channels else TABLES
        self._tables = {name: Table(file, f"/entry/{name}") for name in tables}
        self._longest_gap = int(LONGEST_GAP_S * header.sample_rate_hz)
        # trigger numbers of the frames received, increasing, and their rows in triggers
        self._received, self._received_rows = array("q"), array("q")
        self._analysed: set[int] = set()  # rows of triggers, marked at the next flush

    @classmethod
    def create(cls, path: Path, header: Header, *, overwrite: bool = False) -> Self:
        """A new session at `path`, ready to record.

        Raises
        ------
        UserError
            A session of that name exists and may not be overwritten, or the file can not be made
            there.
        """
        texts = Texts(
            title="SlipScope loading experiment",
            program="SlipScope",
            ended="",
            state=UNFINISHED,
            reason="the session was not closed: the program ended before the run;"
            " `slipscope repair` brings back the rest",
            resources="{}",
        )
        header = header if header.started else replace(header, started=_now())
        versions = Versions(tuple(header.versions), tuple(header.versions.values()))
        values = stored(texts, versions, header)
        journal, file = new_files(path, overwrite)
        try:
            file.attrs.update(
                {
                    "NX_class": "NXroot",
                    "default": "entry",
                    "creator": "SlipScope",
                    layout.FORMAT_ATTRIBUTE: layout.FORMAT_VERSION,
                }
            )
            for group in layout.GROUPS:
                asked = {"/entry/source": header.source, "/entry/auxiliary": header.auxiliary}
                if group.path not in LATER or asked.get(group.path):
                    make_group(file, group.path, values, header)
            file["/entry"].attrs["default"] = "results"
            journal.append(header)
            writer = cls(path, file, journal, header)
            writer.flush()
            return writer
        except BaseException:
            file.close()
            journal.close()
            path.unlink(missing_ok=True)
            journal.path.unlink(missing_ok=True)
            raise

    def append(self, record: Record) -> None:
        """Record something; an image, and the field of a snapshot, are written at once.

        Samples missing before a block of samples become a gap and NaN. A snapshot comes after the
        frame of which it is the result; an outcome ends the record.

        Raises
        ------
        ValueError
            The record can not belong to this session: samples that were recorded already or lie
            absurdly far ahead, an image of another shape or type, results of a frame that is not
            here.
        OSError
            It could not be written, or the disk is all but full. The session is as it was before
            and can still be finished.
        """
        match record:
            case ReceivedFrame():
                self._append_frame(record)
            case SourceFrame():
                check_room(self._path, 0)
                self._journal.append(record)
                self._add_frame(record, record.row, record.checksum)
            case Samples():
                self._check_place(record.first)
                self._journal.append(record)
                self._add_samples(record)
            case Gap():
                self._check_place(record.first)
                self._check_place(record.first + record.count)
                self._journal.append(record)
                self._add_gap(record)
            case LostTrigger(index, sample, reason, span):
                self._journal.append(record)
                span = span or (index, index)
                self._add("triggers", TriggerRow(index, sample, NO_ROW, reason, 0, 0, *span))
            case Position():
                self._journal.append(record)
                self._add("instrument/actuator", record)
            case Event():
                self._journal.append(record)
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

    def _add(self, table: str, *records: Any) -> None:
        self._tables[table].append(stored(*records))

    def _check_place(self, sample: int) -> None:
        expected = len(self._tables["forces"])
        if not 0 <= sample - expected <= self._longest_gap:
            raise ValueError(
                f"session: samples from {sample} on can not be placed, the next one is {expected}"
            )

    def _add_samples(self, block: Samples) -> None:
        expected = len(self._tables["forces"])
        if missing := block.first - expected:
            self._add("gaps", Gap(expected, missing, ""))
            self._extend(_missing(expected, missing))
        self._extend(block)

    def _extend(self, block: Samples) -> None:
        if self._channels:
            shape, values = (len(block.volts), self._channels), block.auxiliary
            if values is None:
                values = np.full(shape, np.nan)
            if values.shape != shape:
                raise ValueError(f"session: further channels {values.shape} instead of {shape}")
            self._tables["auxiliary"].extend({layout.AUXILIARY.path: values})
        self._tables["forces"].extend(stored(block))

    def _add_gap(self, gap: Gap) -> None:
        self._add_samples(_missing(gap.first, gap.count))
        self._add("gaps", gap)
        self._add("events", Event(gap.first, "gap", f"{gap.count} samples lost: {gap.reason}"))

    def _append_frame(self, frame: ReceivedFrame) -> None:
        check_room(self._path, frame.image.nbytes)
        image = np.ascontiguousarray(frame.image)
        checksum = crc32(image.data) if frame.checksum is None else frame.checksum
        end = self._file.id.get_filesize()
        row, chunk = append_image(self._images, image)
        try:
            place = self._place_of(row, chunk, end)
            self._journal.append(
                StoredFrame(frame.index, frame.sample, place, chunk.nbytes, checksum, frame.span)
            )
        except BaseException:
            self._images.resize(row, axis=0)
            raise
        self._add_frame(frame, row, checksum)

    def _place_of(self, row: int, chunk: NDArray[np.uint8], end: int) -> int:
        """Where in the file an image lies: at the former end of the file, as a look shows. HDF5
        would go through all images to say so.
        """
        if all(
            self._lies_at(end + at, chunk[at : at + LOOK_BYTES])
            for at in (0, max(0, chunk.nbytes - LOOK_BYTES))
        ):
            return end
        return int(self._images.id.get_chunk_info_by_coord((row, 0, 0)).byte_offset)

    def _lies_at(self, place: int, part: NDArray[np.uint8]) -> bool:
        self._on_disk.seek(place)
        return self._on_disk.read(part.nbytes) == part.tobytes()

    def _add_frame(self, frame: ReceivedFrame | SourceFrame, row: int, checksum: int) -> None:
        self._received.append(frame.index)
        self._received_rows.append(len(self._tables["triggers"]))
        span = frame.span or (frame.index, frame.index)
        self._add("triggers", TriggerRow(frame.index, frame.sample, row, "", 0, checksum, *span))

    def _append_snapshot(self, snapshot: Snapshot) -> None:
        place = bisect_left(self._received, snapshot.frame)
        if self._received[place : place + 1] != array("q", [snapshot.frame]):
            raise ValueError(
                f"session: frame {snapshot.frame} has results, but it was not recorded"
            )
        values, row = stored(snapshot), NO_ROW
        if snapshot.field is not None:
            row = append_field(self._fields, values)
            self._tables["fields"].append({layout.FIELD_FRAMES.path: snapshot.frame})
        radii, rings = (
            0 if profile is None else len(profile.radius_m)
            for profile in (snapshot.stress, snapshot.rings)
        )
        values |= stored(ResultRow(radii, rings, row))
        for table in ("rings", "stress", "results"):
            self._tables[table].append(values)
        self._analysed.add(self._received_rows[place])

    def _finish(self, outcome: Outcome) -> None:
        if not self._file:
            raise OSError(
                f"{self._path}: it could not be written to its end; `slipscope repair` brings back"
                " everything"
            )
        self._make("counts", outcome.counts)
        if outcome.summary is not None:
            self._make("summary", outcome.summary)
        self._write_text("run/resources", json.dumps(outcome.resources, default=str))
        self._write_text("run/reason", outcome.reason)
        self._write_text("end_time", _now())
        self.flush()
        self._write_text("run/state", outcome.state)
        self.flush()

    def explain(self, reason: str) -> None:
        """Record why a session is not the account of a whole run."""
        self._write_text("run/reason", reason)

    def flush(self) -> None:
        """Bring everything recorded so far to the disk; from there on the file can be read,
        whatever happens to the program.

        The images come before the journal that names them, so that what the journal on the disk
        promises is there.

        Raises
        ------
        OSError
            It could not be written. The session is closed then, as it is, because HDF5 may spoil
            what is there if it goes on; the journal and the images hold everything.
        """
        try:
            for table in self._tables.values():
                table.flush()
            if self._analysed:
                self._file["/entry/triggers/analysed"][sorted(self._analysed)] = 1
                self._analysed.clear()
            self._file.flush()
        except (OSError, RuntimeError) as error:
            cause = re.search("error message = '([^']*)'", str(error))  # HDF5 writes many lines
            abandon(self._file, self._on_disk, self._journal)
            raise OSError(
                f"{self._path}: it can not be written:"
                f" {cause[1] if cause else ' '.join(str(error).split())};"
                " `slipscope repair` brings back everything"
            ) from error
        os.fsync(self._on_disk.fileno())
        self._journal.sync()

    def close(self) -> None:
        """Flush, let go of the file, read it back, remove the journal. May be called twice; a
        session that was not finished says so.

        Raises
        ------
        OSError
            The last rows could not be written.
        UserError
            What was read back is not what was recorded. The journal is kept in both cases.
        """
        if not self._file:
            return
        with ExitStack() as closing:
            for thing in (self._journal, self._on_disk, self._file):
                closing.callback(thing.close)
            self.flush()
        self.receipt = verify(self._path, self._journal.path)
        LOG.info("%s: %s", self._path.name, self.receipt)
        self._journal.path.unlink()

    def discard(self) -> None:
        """Let go of the session and remove it, with its journal."""
        with ExitStack() as closing:
            for path in (self._journal.path, self._path):
                closing.callback(path.unlink, missing_ok=True)
            closing.callback(abandon, self._file, self._on_disk, self._journal)

    def _make(self, group: str, record: Any) -> None:
        make_group(self._file, f"/entry/{group}", stored(record))

    def _write_text(self, path: str, text: str) -> None:
        self._file[f"/entry/{path}"][()] = storable(text)


def _missing(first: int, count: int) -> Samples:
    nothing = np.full((count, 2), np.nan)
    return Samples(first, nothing, nothing)


def _now() -> str:
    return datetime.datetime.now(datetime.UTC).astimezone().isoformat(timespec="seconds")
