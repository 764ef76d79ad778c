"""The journal beside a session while it is recorded: the records that the recorder was given, in
their order.

The file only grows. Each record has a checksum, so that a damaged one is passed over and the next
is found, and a checksum of all contents so far, by which one that is missing, repeated or out of
its place is noticed. Both find accidental damage only: who rewrites the file can make them anew.
What cannot be measured again is there twice: the header, and each trigger once more with the next.
An image is named by its place in the file of images and its CRC-32; force samples are held
themselves. Results are in a file of the same kind beside it.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, cast, get_args
from zlib import crc32

import msgspec
import numpy as np

from app.records.record_types import (
    Checksum,
    ContactResult,
    Event,
    Gap,
    Header,
    Index,
    Outcome,
    Position,
    Samples,
    Snapshot,
)
from app.session import legacy
from app.system.disk import AppendedFile
from app.system.errors import UserError
from drivers.protocols import LostFrame

SUFFIX, IMAGES_SUFFIX, RESULTS_SUFFIX = ".journal", ".images", ".results"
MAGIC = b"SlipScope journal 4\n"
_FORMAT_3 = b"SlipScope journal 3\n"  # a hash in the place of the second checksum
_EARLIER = (b"SlipScope journal 1\n", b"SlipScope journal 2\n")
_MARK = b"\xb5re3"  # where a record begins
_LONGEST = 1 << 24  # bytes of a payload
_LONGEST_ARRAYS = 1 << 28  # bytes of a payload with arrays
_MOST_DAMAGE = 1 << 26  # bytes in which the next record is looked for
_LEAST_COST = 1 << 10  # bytes, as which a beginning of no record counts in what is looked at
_HEAD = struct.Struct("<4sI")  # mark, CRC-32 of all that follows
_ABOUT = struct.Struct("<BII12x")  # type, bytes of the payload, CRC-32 of all payloads so far


@dataclass(frozen=True, slots=True)
class StoredFrame:
    """The image of a trigger by its place and its bytes in the file of images, and the CRC-32 of
    the image. `first`, `last` and `stamp_s` are those of the frame.
    """

    index: Index
    sample: Index
    place: Index
    nbytes: Index
    checksum: Checksum
    first: Index
    last: Index
    stamp_s: float = math.nan


@dataclass(frozen=True, slots=True)
class JournalDamage:
    """Bytes of a journal that hold no record, or none that follows from the one before."""

    nbytes: int


JournalRecord = (
    Header
    | Samples
    | Gap
    | StoredFrame
    | LostFrame
    | Position
    | Event
    | Outcome
    | Snapshot
    | ContactResult
)
# the place of a type in this list is in the file
_TYPES = get_args(JournalRecord)
_ARRAYS = (Header, Samples, Snapshot)
_NUMBERS = ("<f8", "<f4", "|u1")
# what a record that no recorder has made may lead to
_UNDECODABLE = (msgspec.MsgspecError, ValueError, TypeError, OverflowError, RecursionError)


def _encoded(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        dtype = value.dtype.newbyteorder("<").str
        dtype = dtype if dtype in _NUMBERS else "<f8"
        return dtype, value.shape, value.astype(dtype, copy=False).tobytes()
    if isinstance(value, np.generic):
        return value.item()
    return str(value)  # of an outcome's resources


def _decoded(kind: Any, value: Any) -> Any:
    dtype, shape, content = value
    if dtype not in _NUMBERS:
        raise ValueError(f"an array of {dtype}")
    wanted = get_args(get_args(kind)[1])[0]
    return np.frombuffer(content, dtype).reshape(shape).astype(wanted, copy=False)


_ENCODER = msgspec.msgpack.Encoder(enc_hook=_encoded)
_DECODERS = [msgspec.msgpack.Decoder(kind, dec_hook=_decoded) for kind in _TYPES]


def journal_of(session: Path) -> Path:
    """Where the journal of a session lies."""
    return session.with_name(session.name + SUFFIX)


def session_of(path: Path) -> Path | None:
    """The session whose journal this path is the name of; None if it is another file's."""
    return path.with_name(path.name.removesuffix(SUFFIX)) if path.name.endswith(SUFFIX) else None


def has_journal(session: Path) -> bool:
    """Whether beside a session lies a journal that `slipscope repair` can begin with."""
    path = journal_of(session)
    return path.is_file() and any(isinstance(r, Header) for r in read_journal(path))


def encode(record: JournalRecord) -> bytes:
    """A record as bytes; what UTF-8 cannot hold is spelled out."""
    try:
        return _ENCODER.encode(record)
    except UnicodeEncodeError:
        plain = msgspec.to_builtins(record, enc_hook=_encoded, builtin_types=(bytes,))
        return _ENCODER.encode(_spelled_out(plain))


class Journal:
    """A file of records, open for more of them, from any thread.

    Every record goes to the operating system at once, so that a program that is killed loses none.
    """

    def __init__(self, file: AppendedFile) -> None:
        self.file = file
        self._chain = 0
        self._lock = file.lock
        file.append(MAGIC)

    def append(self, record: JournalRecord) -> None:
        """Add a record; OSError where it cannot be written, ValueError where it is so long that it
        would not be read again.
        """
        payload, kind = encode(record), _TYPES.index(type(record))
        if len(payload) > _longest(kind):
            raise ValueError(
                f"session: a {type(record).__name__} of {len(payload)} bytes cannot be recorded,"
                f" {_longest(kind)} is the most"
            )
        with self._lock:
            self._chain = crc32(payload, self._chain)
            about = _ABOUT.pack(kind, len(payload), self._chain)
            head = _HEAD.pack(_MARK, crc32(payload, crc32(about))) + about
            self.file.append(head, payload)

    def move_to(self, path: Path) -> None:
        """Go on in another file, which begins with all that is in this one."""
        with self._lock:
            self.file = self.file.copy_to(path)


def _longest(kind: int) -> int:
    return _LONGEST_ARRAYS if _TYPES[kind] in _ARRAYS else _LONGEST


def read_journal(path: Path) -> Iterator[JournalRecord | JournalDamage]:
    """The records of a journal in their order, each as often as it is there, and between them what
    is damaged.

    Raises
    ------
    UserError
        It was written by an earlier SlipScope, which alone can read it.
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        magic = file.read(len(MAGIC))
        if magic in _EARLIER:
            raise UserError(
                f"{path}: a journal of format {magic[-2:-1].decode()}, this SlipScope reads formats"
                " 3 and 4; repair the session with the SlipScope that recorded it, 0.1.0 of"
                " November 2026 or earlier"
            )
        at, is_3 = len(MAGIC) if magic in (MAGIC, _FORMAT_3) else 0, magic == _FORMAT_3
        damaged, left = 0, _MOST_DAMAGE + 4 * size
        chain: int | None = None if is_3 else 0  # None: that of the record before is not known
        while at < size and left > 0:
            record, looked_at, payload, its_chain = _record_at(file, at, size, is_3)
            if record is None:
                left -= max(looked_at, _LEAST_COST)
                following = _next_mark(file, at + 1, size)
                damaged, chain, at = damaged + following - at, None, following
                continue
            if damaged or (chain is not None and its_chain != crc32(payload, chain)):
                yield JournalDamage(damaged)
            yield record
            chain = None if is_3 else its_chain
            damaged, at = 0, at + looked_at
        if damaged or at < size:
            yield JournalDamage(damaged + size - at)


def _record_at(
    file: BinaryIO, at: int, size: int, is_3: bool
) -> tuple[JournalRecord | None, int, bytes, int]:
    """The record that begins at a place, None where there is none; the bytes that were looked at;
    its payload and the checksum of all so far.
    """
    file.seek(at)
    head = file.read(_HEAD.size + _ABOUT.size)
    if len(head) < _HEAD.size + _ABOUT.size or not head.startswith(_MARK):
        return None, len(head), b"", 0
    checksum = _HEAD.unpack_from(head)[1]
    kind, length, chain = _ABOUT.unpack_from(head, _HEAD.size)
    if kind >= len(_TYPES) or length > min(_longest(kind), size - at - len(head)):
        return None, len(head), b"", 0
    payload, record = file.read(length), None
    if crc32(payload, crc32(head[_HEAD.size :])) == checksum:
        with suppress(*_UNDECODABLE):
            record = _decode(kind, payload, is_typed=not is_3)
    return record, len(head) + length, payload, chain


def _decode(kind: int, payload: bytes, *, is_typed: bool) -> JournalRecord:
    if is_typed:
        record = _DECODERS[kind].decode(payload)
    else:
        plain = legacy.journalled(msgspec.msgpack.decode(payload))
        record = legacy.typed(msgspec.convert(plain, _TYPES[kind], dec_hook=_decoded))
    if isinstance(record, LostFrame):  # a driver's, which limits nothing
        msgspec.convert((record.index, record.sample, record.first, record.last), tuple[Index, ...])
    return cast(JournalRecord, record)


def _next_mark(file: BinaryIO, at: int, size: int) -> int:
    """Where a record may begin next, at most `_MOST_DAMAGE` on; the end of the file where none
    does.
    """
    file.seek(at)
    before, end, nbytes = b"", min(size, at + _MOST_DAMAGE), 1 << 8
    while at < end and (block := file.read(nbytes)):
        nbytes = 1 << 16
        place = (before + block).find(_MARK)
        if place >= 0:
            return at - len(before) + place
        before, at = (before + block)[1 - len(_MARK) :], at + len(block)
    return size


def _spelled_out(value: Any) -> Any:
    """A record as plain values, in which halves of surrogate pairs, which UTF-8 cannot hold, are
    spelled out.
    """
    match value:
        case str():
            return value.encode("utf-8", "backslashreplace").decode()
        case dict():
            return {_spelled_out(key): _spelled_out(item) for key, item in value.items()}
        case list() | tuple():
            return [*map(_spelled_out, value)]
    return value
