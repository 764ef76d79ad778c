"""Makes a session of what was recorded: the file of images becomes the session, by what HDF5 writes
before and behind the images. None of them is copied, unless they are compressed or few.
"""

from __future__ import annotations

import logging
import math
import os
import zlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, BinaryIO
from zlib import crc32

import numpy as np

from app.records.quantities import counted
from app.records.record_types import ContactResult, Gap, Header, Outcome, Record, Samples, Snapshot
from app.session.checks import channels_of, check_missing, check_snapshot
from app.session.files import has_images, images_of, results_of, unfinished_of
from app.session.journal import (
    JournalDamage,
    JournalRecord,
    StoredFrame,
    encode,
    has_journal,
    journal_of,
    read_journal,
)
from app.session.reader import UNREADABLE_IMAGE
from app.session.receipt import NotAsRecordedError, Receipt, RecordedContents
from app.session.recorder import HEAD_BYTES
from app.session.writer import ElsewhereError, SessionWriter
from app.system.errors import UserError
from app.system.progress import ShareDone, unheard
from drivers.protocols import LostFrame

LOG = logging.getLogger(__name__)
FEWEST_BYTES = 1 << 16  # least size of images that stay in place; HDF5 aligns no less
FLUSH_EVERY = 256  # records; those of small tables wait in memory until then
_MOST_TRIGGERS = 1 << 16  # most triggers lost by damage: a few bytes could ask for billions
WITHOUT_MAP = (
    "the map of the pixels cannot be read and is left out: the pictures are as they came from the"
    " camera, the results were computed with the map"
)
JOURNAL = "its journal"
_DAMAGED = "its record in the journal is damaged"


@dataclass
class FoundRecording:
    """What of a recording was found, and what was not.

    Attributes
    ----------
    frames : int
        Images that are there.
    torn, unread : int
        Frames and samples that were recorded and are not there.
    damaged_bytes : int
        Of journal and results, that hold no record, or none of this session.
    altered : int
        Records that do not follow from the one before: somebody has changed the journal.
    results : int
        Analysed frames whose results are there.
    origin : str
        What it is brought back from; empty of a recording that is closed in good order.
    lacks_map : bool
        Whether the map of the pixels, with which results were computed, cannot be read.
    lost_results : int
        Analysed frames that are there and whose results are not.
    lacking : list of str
        What cannot be read at all, such as "events".
    """

    frames: int = 0
    torn: int = 0
    unread: int = 0
    damaged_bytes: int = 0
    altered: int = 0
    results: int = 0
    origin: str = ""
    lacks_map: bool = False
    lost_results: int = 0
    lacking: list[str] = field(default_factory=list)
    torn_frames: set[int] = field(default_factory=set)

    @property
    def is_whole(self) -> bool:
        """Whether it is sure that nothing that was recorded is missing."""
        lost = (self.torn, self.unread, self.damaged_bytes, self.altered, self.lacks_map)
        return not any((*lost, self.lost_results, self.lacking))

    def __str__(self) -> str:
        """What is missing, in words."""
        words = (
            f"{self.torn} of {self.frames + self.torn} recorded images and "
            f"{counted(self.unread, 'sample')} could not be brought back"
        )
        if self.lost_results:
            words += f", nor could the results of {counted(self.lost_results, 'frame')}"
        if self.lacking:
            words += f"; what cannot be read at all: {', '.join(self.lacking)}"
        if self.damaged_bytes:
            words += f"; {self.damaged_bytes} bytes of the journal are damaged"
        if self.altered:
            words += f"; {self.altered} records of the journal do not follow from those before"
            words += " them: somebody has changed it"
        return f"{words}; {WITHOUT_MAP}" if self.lacks_map else words


def make_session(session: Path) -> tuple[Path, Receipt]:
    """Make a session of what was recorded for that path: the file in which it is, and what was read
    back. The file of images becomes that file, if it can.

    Raises
    ------
    UserError
        What was read back is not what was recorded.
    OSError
        The session cannot be written. Journal, images and results are as they were in both cases.
    """
    images = images_of(session)
    outlined = header, end = outline(session, images)
    if is_in_place(header, end):
        os.truncate(images, end)
        with suppress(ElsewhereError):
            return images, _made(session, images, outlined)
        LOG.warning("%s: HDF5 does not leave the images where they are; they are copied", session)
    output = unfinished_of(session)
    try:
        return output, _made(session, output, outlined)
    except BaseException:
        output.unlink(missing_ok=True)
        raise


def _made(session: Path, output: Path, outlined: tuple[Header, int]) -> Receipt:
    """What was read back of a session that is all that was recorded."""
    found = FoundRecording()
    receipt = write(session, images_of(session), output, found, outlined=outlined)
    if not found.is_whole:
        raise NotAsRecordedError(
            f"{session}: {found}; what was recorded stays beside it, `slipscope repair {session} -o"
            " REPAIRED.h5` makes a session of the rest"
        )
    return receipt


def outline(session: Path, images: Path) -> tuple[Header, int]:
    """The header in the journal of a session, and where the last of its images ends that can be in
    the file of images.

    Raises
    ------
    UserError
        There is none.
    """
    header, end, size = None, HEAD_BYTES, images.stat().st_size
    room, frames = size, set()
    for record in read_journal(journal_of(session)):
        if isinstance(record, Header):
            header = header or record
        elif isinstance(record, StoredFrame) and record.place + record.nbytes <= size:
            end = max(end, record.place + record.nbytes)
            room -= 0 if record.index in frames else record.nbytes
            frames.add(record.index)
    if header is None:
        raise UserError(
            f"{journal_of(session)}: a journal without a beginning, nothing can be made of it; use"
            " a copy of it if there is one"
        )
    if room < 0:
        raise ValueError("it names more images than there is room for")
    return header, end


def account_of(session: Path) -> RecordedContents | None:
    """What the journal beside a session says that the session was given; None where there is none,
    or where it belongs to a recording that has not become a session.
    """
    if has_images(session) or not has_journal(session):
        return None
    header, _ = outline(session, session)
    given = RecordedContents(channels=channels_of(header))
    for record in recorded(session, FoundRecording()):
        given.add(record)
    return given


def image_bytes(header: Header) -> int:
    """Size of an image in memory."""
    return math.prod(header.frame_shape) * np.dtype(header.frame_dtype).itemsize


def is_in_place(header: Header, end: int) -> bool:
    """Whether images that lie there can stay where they are in a session."""
    return header.compression == "none" and end - HEAD_BYTES >= FEWEST_BYTES


def write(
    session: Path,
    images: Path,
    output: Path,
    found: FoundRecording,
    progress: ShareDone = unheard,
    *,
    outlined: tuple[Header, int] | None = None,
) -> Receipt:
    """Write the session at `output`, which may be the file of images itself or a new file; what was
    read back. `progress` is called with the share of the images that is there; `outlined` is the
    outline of the session, if it is known.
    """
    header, end = outlined or outline(session, images)
    there = (end - HEAD_BYTES) // image_bytes(header) if images == output else None
    writer = SessionWriter.create(output, header, images_there=there)
    with images.open("rb") as file:

        def append(record: Record | StoredFrame) -> None:
            if not isinstance(record, StoredFrame):
                writer.append(record)
                return
            content = None if there else image_at(file, record, header)
            if there or content is not None:
                found.frames += 1
                row = (record.place - HEAD_BYTES) // record.nbytes if there else None
                writer.append_stored(record, row, content)
            else:
                found.torn += 1
                found.torn_frames.add(record.index)
                span = record.first, record.last
                writer.append(LostFrame(record.index, record.sample, UNREADABLE_IMAGE, *span))
            progress(record.place / end)

        return rebuild(writer, append, recorded(session, found), found)


def rebuild(
    writer: SessionWriter,
    append: Callable[[Any], None],
    records: Iterable[Record | StoredFrame],
    found: FoundRecording,
) -> Receipt:
    """Write a session of records, whose end says what of it is missing; what was read back. What is
    written is let go of where it cannot be completed.
    """
    outcome: Outcome | None = None
    try:
        for n, record in enumerate(records, 1):
            if isinstance(record, Outcome):
                outcome = record
                continue
            append(record)
            if n % FLUSH_EVERY == 0:
                writer.flush()
        if outcome is None:
            writer.explain(
                f"the run was cut short; brought back from {found.origin or JOURNAL},"
                f" {counted(found.frames, 'frame')} kept, {counted(found.torn, 'image')} lost"
            )
        else:
            writer.append(_as_found(outcome, found, writer.given.present))
        return writer.close()
    except BaseException:
        writer.discard()
        raise


def _as_found(outcome: Outcome, found: FoundRecording, samples: int) -> Outcome:
    """How a run ended, with the account of what was brought back, so many samples among it, and
    words for what was not.
    """
    counts = outcome.counts
    images = max(0, counts.frames_recorded - found.frames)
    lost = {
        "samples": max(0, counts.samples - samples),
        "results": counts.frames_analysed - found.results - images,  # of images that are there
    }
    is_all_there = found.is_whole and max(lost.values()) <= 0
    if not found.origin or (found.origin == JOURNAL and is_all_there):
        return outcome
    words = "".join(f", {count} {name}" for name, count in lost.items() if count > 0)
    words += "".join(f", {name}" for name in found.lacking if name not in lost)
    return replace(
        outcome,
        reason=f"{outcome.reason}; repaired, {images} images{words} were lost",
        counts=replace(
            counts,
            frames_recorded=found.frames,
            frames_lost=counts.frames_lost + images,
            frames_analysed=found.results,
            frames_skipped=found.frames - found.results,
            samples=samples,
            samples_lost=counts.samples_lost + lost["samples"],
        ),
    )


def image_at(file: BinaryIO, frame: StoredFrame, header: Header) -> bytes | None:
    """The bytes that were recorded for a frame; None where they are not there any more."""
    longest = image_bytes(header)
    if frame.nbytes > longest + (1 << 16):
        return None
    file.seek(frame.place)
    content = file.read(frame.nbytes)
    image = content
    if header.compression == "gzip":
        try:
            image = zlib.decompressobj().decompress(content, longest)
        except zlib.error:
            return None
    return content if len(image) == longest and crc32(image) == frame.checksum else None


def recorded(session: Path, found: FoundRecording) -> Iterator[Record | StoredFrame]:
    """What was recorded for a session, each record once but its header, measurements before
    results. What is damaged is counted, and stands there as lost.

    Raises
    ------
    ValueError
        Records that no recorder has made.
    """
    reading = _JournalRecords(found)
    for record in read_journal(journal_of(session)):
        yield from reading.of(record)
    if results_of(session).is_file():
        for record in read_journal(results_of(session)):
            if isinstance(record, JournalDamage):
                found.damaged_bytes += record.nbytes
            elif isinstance(record, ContactResult | Snapshot):
                yield from reading.of_results(record)


class _JournalRecords:
    """The records of a journal, one after the other."""

    def __init__(self, found: FoundRecording) -> None:
        self._found = found
        self._header: Header | None = None
        self._triggers: set[int] = set()
        self._frames: set[int] = set()
        self._next_trigger = self._end = self._missing = 0
        # damage since the last record of that kind
        self._lacks_samples = self._lacks_triggers = False
        self._has_contact = False

    def of_results(self, record: Snapshot | ContactResult) -> Iterator[Snapshot | ContactResult]:
        """The record, if it can belong to this session."""
        if isinstance(record, ContactResult):
            if not self._has_contact:
                yield record
            self._has_contact = True
            return
        try:
            assert self._header is not None
            check_snapshot(record, self._header)
        except ValueError:
            self._found.damaged_bytes += len(encode(record))
            return
        if record.frame in self._frames and record.frame not in self._found.torn_frames:
            self._found.results += 1
            yield record

    def of(self, record: JournalRecord | JournalDamage) -> Iterator[Record | StoredFrame]:
        """What a record comes to."""
        match record:
            case JournalDamage(nbytes):
                self._found.damaged_bytes += nbytes
                self._found.altered += nbytes == 0
                self._lacks_samples = self._lacks_triggers = True
            case Header():
                self._header = self._header or record
                if encode(record) != encode(self._header):
                    raise ValueError("it begins twice")
            case Samples(first, volts):
                yield from self._up_to(first)
                self._end = first + len(volts)
                yield record
            case Gap(first, count):
                yield from self._up_to(first)
                self._end = first + count
                self._count_missing(count)
                yield record
            case StoredFrame(index) | LostFrame(index):
                if index not in self._triggers:
                    yield from self._triggers_up_to(index)
                    self._triggers.add(index)
                    if isinstance(record, StoredFrame):
                        self._frames.add(index)
                    yield record
            case _:
                yield record

    def _up_to(self, first: int) -> Iterator[Gap]:
        """The gap before a sample, where damage has made it; any other is told by the samples."""
        missing = first - self._end
        self._count_missing(max(0, missing))
        if self._lacks_samples and missing > 0:
            self._found.unread += missing
            yield Gap(self._end, missing, _DAMAGED)
        self._lacks_samples = False

    def _count_missing(self, count: int) -> None:
        self._missing += count
        check_missing(self._missing)

    def _triggers_up_to(self, index: int) -> Iterator[LostFrame]:
        """The triggers before that one of which damage has taken all records."""
        header, missing = self._header, range(self._next_trigger, index)
        if self._lacks_triggers and header is not None and len(missing) < _MOST_TRIGGERS:
            for lost in missing:
                self._found.torn += 1
                sample = header.first_trigger + lost * header.divisor
                yield LostFrame(lost, sample, _DAMAGED)
        self._lacks_triggers, self._next_trigger = False, index + 1
