"""Makes a whole session of one that was cut short or damaged: from its journal where there is one,
else from what can be read of it.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, BinaryIO
from zlib import crc32

import numpy as np

from app.errors import UserError
from app.records import (
    UNFINISHED,
    Gap,
    Header,
    LostTrigger,
    ReceivedFrame,
    Samples,
    SourceFrame,
)
from app.session.files import check_new_session, new_session
from app.session.journal import StoredFrame, Torn, journal_of, read_journal
from app.session.reader import UNREADABLE_IMAGE, Altered, SessionReader
from app.session.receipt import Receipt, verify
from app.session.writer import SessionWriter

FLUSH_EVERY = 256  # records; those of small tables wait in memory until then
# samples that the gaps of a journal may have together: a few bytes could ask for terabytes of NaN
_MOST_MISSING = 1 << 22
# what a journal from elsewhere may lead to
_NONSENSE = (ValueError, TypeError, LookupError, AttributeError, ArithmeticError)


@dataclass(frozen=True, slots=True)
class Repaired:
    """What came of a repair.

    Attributes
    ----------
    output : Path or None
        None where the session is whole and nothing had to be written.
    source : str
        "journal" or "file".
    torn, unread : int
        Frames and samples that were recorded and could not be brought back.
    cut_bytes : int
        Of the torn end of the journal, which was left out.
    results : int
        Analysed frames whose results were brought back.
    receipt : Receipt
        Of the repaired session, or of the one that is whole.
    """

    session: Path
    output: Path | None
    source: str
    torn: int
    unread: int
    cut_bytes: int
    results: int
    receipt: Receipt

    def __str__(self) -> str:
        """One sentence."""
        if self.output is None:
            return (
                f"{self.session}: the session is whole, nothing is to be repaired: {self.receipt}"
            )
        torn = f"{self.torn} images and {self.unread} samples could not be read"
        cut = "; what came after the torn end of the journal is lost" if self.cut_bytes else ""
        results = (
            f"results of {self.results} frames"
            if self.results
            else "no results, the images must be analysed again"
        )
        return (
            f"{self.output}: brought back from the {self.source}: {self.receipt}; {torn}{cut};"
            f" {results}"
        )


def repair(
    session: Path,
    output: Path,
    *,
    overwrite: bool = False,
    progress: Callable[[float], None] = lambda share: None,
) -> Repaired:
    """A whole session at `output` of everything that `session`, which is only read, still holds.

    `progress` is called with the share that is done.

    Raises
    ------
    UserError
        There is nothing to repair from, or the output can not be written.
    """
    if not session.is_file():
        raise UserError(f"{session}: there is no such session; check the name")
    check_new_session(output, overwrite, read=[session], has_picture=False)
    journal, has_journal = journal_of(session), False
    if journal.is_file():
        has_journal = isinstance(next(read_journal(journal), None), Header)
    source = "journal" if has_journal else "file"
    with suppress(UserError), SessionReader(session) as reader:
        if reader.outcome.state != UNFINISHED or not has_journal:
            receipt = verify(session, journal if has_journal else None)
            whole = len(reader.analysed_frames())
            return Repaired(session, None, source, 0, 0, 0, whole, receipt)
    try:
        found = _journal_of(session, progress) if has_journal else _file_of(session, progress)
        with new_session(output, overwrite) as unfinished:
            repaired = _write(session, unfinished, source, found)
        return replace(repaired, output=output)
    except _NONSENSE as error:
        raise UserError(
            f"{session}: what its {source} holds makes no session: {error}; use a copy of it if"
            " there is one"
        ) from error


def _write(session: Path, output: Path, source: str, found: Iterator[Any]) -> Repaired:
    """Give a new writer every record that was found."""
    writer = SessionWriter.create(output, next(found))
    frames: set[int] = set()
    torn = unread = cut = 0
    try:
        for n, record in enumerate(found, 1):
            match record:
                case Torn():
                    cut += record.nbytes
                    continue
                case Altered(LostTrigger() as record):
                    torn += 1
                case Altered(Gap() as record):
                    unread += record.count
                case ReceivedFrame() | SourceFrame():
                    frames.add(record.index)
                case Header():
                    raise ValueError("it begins twice")
            writer.append(record)
            if n % FLUSH_EVERY == 0:
                writer.flush()
        results = _copy_results(session, writer, frames, torn)
        writer.close()
    except BaseException:
        writer.discard()
        raise
    assert writer.receipt is not None
    return Repaired(session, output, source, torn, unread, cut, results, writer.receipt)


def _journal_of(session: Path, progress: Callable[[float], None]) -> Iterator[Any]:
    """The records of a session's journal, with the images from their places in the session, whether
    HDF5 can open that or not.
    """
    size = room = session.stat().st_size
    end = missing = 0
    records = read_journal(journal_of(session))
    header = next(records)
    assert isinstance(header, Header)
    yield header
    with session.open("rb") as file:
        for record in records:
            match record:
                case StoredFrame():
                    progress(min(1.0, record.place / max(1, size)))
                    frame = _frame(file, record, header, size)
                    room -= record.nbytes if isinstance(frame, ReceivedFrame) else 0
                    if room < 0:
                        raise ValueError("it names more images than the session has room for")
                    yield frame
                    continue
                case Samples(first, volts):
                    missing, end = missing + first - end, first + len(volts)
                case Gap(first, count):
                    missing, end = missing + first - end + count, first + count
            if missing > _MOST_MISSING:
                raise ValueError(f"{missing} samples are missing")
            yield record


def _frame(
    file: BinaryIO, stored: StoredFrame, header: Header, size: int
) -> ReceivedFrame | Altered:
    """The frame whose image is at a place of a session file of `size` bytes, if it is the one that
    was recorded.
    """
    image = b""
    if stored.place + stored.nbytes <= size:
        file.seek(stored.place)
        image = file.read(stored.nbytes)
    if header.compression == "gzip":
        longest = math.prod(header.frame_shape) * np.dtype(header.frame_dtype).itemsize
        with suppress(zlib.error):
            image = zlib.decompressobj().decompress(image, longest)
    if crc32(image) != stored.checksum or not image:
        return Altered(LostTrigger(stored.index, stored.sample, UNREADABLE_IMAGE, stored.span))
    pixels = np.frombuffer(image, header.frame_dtype).reshape(header.frame_shape)
    return ReceivedFrame(stored.index, stored.sample, pixels, stored.checksum, stored.span)


def _file_of(session: Path, progress: Callable[[float], None]) -> Iterator[Any]:
    """The records of a session without a journal, as far as they can be read."""
    with SessionReader(session) as reader:
        yield reader.header
        triggers = max(1, len(reader.triggers()))
        for record in reader.records():
            if isinstance(record, ReceivedFrame | SourceFrame):
                progress(min(1.0, record.index / triggers))
            yield record


def _copy_results(session: Path, writer: SessionWriter, frames: set[int], torn: int) -> int:
    """Copy the results of the frames that were brought back, and how the run ended; the number of
    snapshots, which is 0 where HDF5 can not read them any more.
    """
    copied, outcome = 0, None
    # ValueError: results that do not fit the images
    with suppress(UserError, ValueError), SessionReader(session) as reader:
        for snapshot in reader.snapshots():
            if snapshot.frame in frames:
                writer.append(snapshot)
                copied += 1
        contact = reader.contact()
        if contact is not None:
            writer.append(contact)
        if reader.outcome.state != UNFINISHED:
            outcome = reader.outcome
    if outcome is not None:
        reason = f"{outcome.reason}; repaired, {torn} images were lost"
        writer.append(replace(outcome, reason=reason))
    else:
        writer.explain(
            f"the run was cut short; repaired from {session.name}, {len(frames)} frames kept,"
            f" {torn} images lost"
        )
    return copied
