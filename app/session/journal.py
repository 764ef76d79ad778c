"""The journal beside a session while it is recorded: the records that the writer was given, in
their order, each with its own checksum.

It survives what HDF5 does not, a power cut in the middle of a write: the file only grows, and a
torn record can only be its last. An image is named by its place in the session file and its CRC-32;
force samples are held themselves. Results are not in it: the same analysis of the same images gives
them again. A session that was closed and verified has no journal any more.
"""

from __future__ import annotations

import errno
import os
import struct
from collections.abc import Iterator
from dataclasses import dataclass, fields, is_dataclass, replace
from io import FileIO
from pathlib import Path
from typing import Any, cast
from zlib import crc32

import msgspec
import numpy as np

from app.errors import UserError
from app.records import (
    Checksum,
    Event,
    Gap,
    Header,
    Index,
    LostTrigger,
    Position,
    Samples,
    SourceFrame,
)

SUFFIX = ".journal"
_MAGIC = b"SlipScope journal 2\n"
_OLD_MAGIC = b"SlipScope journal 1\n"
_MARK = b"\xb5rec"  # where a record begins
_LONGEST = 1 << 24  # bytes of a payload other than samples; the header has a hundredth of it
_HEAD = struct.Struct("<4sBII")  # mark, type, bytes of the payload, CRC-32 of the payload


@dataclass(frozen=True, slots=True)
class StoredFrame:
    """The image of a trigger by its place in the session file, its bytes there, and the CRC-32 of
    the image.
    """

    index: Index
    sample: Index
    place: Index
    nbytes: Index
    checksum: Checksum
    span: tuple[Index, Index] | None = None


@dataclass(frozen=True, slots=True)
class Torn:
    """Bytes of a journal that hold no record."""

    nbytes: int


JournalRecord = Header | Samples | Gap | StoredFrame | SourceFrame | LostTrigger | Position | Event
# the place of a type in this list is in the file
_TYPES = (Header, Samples, Gap, StoredFrame, SourceFrame, LostTrigger, Position, Event)


def _encoded(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.shape, value.astype("<f8").tobytes()
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"journal: a {type(value).__name__} can not be written")


def _decoded(_kind: Any, value: Any) -> Any:
    shape, content = value
    return np.frombuffer(content, "<f8").reshape(shape)


_ENCODER = msgspec.msgpack.Encoder(enc_hook=_encoded)
_DECODERS = [msgspec.msgpack.Decoder(kind, dec_hook=_decoded) for kind in _TYPES]


def journal_of(session: Path) -> Path:
    """Where the journal of a session lies."""
    return session.with_name(session.name + SUFFIX)


def has_journal(session: Path) -> bool:
    """Whether beside a session lies a journal that `slipscope repair` can begin with."""
    path = journal_of(session)
    return path.is_file() and isinstance(next(read_journal(path), None), Header)


class Journal:
    """The journal of a session, open for more records.

    Every record goes to the operating system at once, so that a program that is killed loses none;
    `sync` brings them to the disk. A record that can not be written raises OSError and leaves the
    journal as it was.
    """

    def __init__(self, path: Path, *, overwrite: bool) -> None:
        self.path = path
        self._file = FileIO(path, "w" if overwrite else "x")
        self._end = 0
        self._write(_MAGIC)

    def append(self, record: JournalRecord) -> None:
        """Add a record."""
        try:
            payload = _ENCODER.encode(record)
        except UnicodeEncodeError:
            payload = _ENCODER.encode(_spelled_out(record))
        kind = _TYPES.index(type(record))
        self._write(_HEAD.pack(_MARK, kind, len(payload), crc32(payload)) + payload)

    def sync(self) -> None:
        """Bring everything so far to the disk."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Let go of the file. May be called twice."""
        self._file.close()

    def _write(self, content: bytes) -> None:
        try:
            if self._file.write(content) != len(content):
                raise OSError(errno.ENOSPC, f"{self.path}: the disk is full; make room")
        except OSError:
            self._file.truncate(self._end)
            self._file.seek(self._end)
            raise
        self._end += len(content)


def read_journal(path: Path) -> Iterator[JournalRecord | Torn]:
    """The records of a journal in their order, up to the first that is torn or is none; the bytes
    from there on come last.

    Raises
    ------
    UserError
        It was written by an earlier SlipScope, which alone can read it.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        magic = file.read(len(_MAGIC))
        if magic == _OLD_MAGIC:
            raise UserError(
                f"{path}: a journal of format 1, this SlipScope reads format 2; repair the session"
                " with the SlipScope that recorded it, 0.1.0 of November 2026 or earlier"
            )
        at = len(_MAGIC) if magic == _MAGIC else size + 1
        while at + _HEAD.size <= size:
            mark, kind, length, checksum = _HEAD.unpack(file.read(_HEAD.size))
            payload = file.read(length) if length <= size - at - _HEAD.size else b""
            if (mark, crc32(payload)) != (_MARK, checksum):
                break
            record = _record(kind, payload)
            if record is None:
                break
            yield record
            at += _HEAD.size + length
    if rest := size - at if at <= size else size:
        yield Torn(rest)


def _record(kind: int, payload: bytes) -> JournalRecord | None:
    """The record of that type, None where it is none."""
    if kind >= len(_TYPES) or (_TYPES[kind] is not Samples and len(payload) > _LONGEST):
        return None
    try:
        return cast(JournalRecord, _DECODERS[kind].decode(payload))
    except (msgspec.MsgspecError, OverflowError, RecursionError):
        return None


def _spelled_out(value: Any) -> Any:
    """A record in which halves of surrogate pairs, which UTF-8 can not hold, are spelled out."""
    if isinstance(value, str):
        return value.encode("utf-8", "backslashreplace").decode()
    if isinstance(value, dict):
        return {key: _spelled_out(item) for key, item in value.items()}
    if is_dataclass(value) and not isinstance(value, type):
        held = {one.name: _spelled_out(getattr(value, one.name)) for one in fields(value)}
        return replace(value, **held)
    return value
