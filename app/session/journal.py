"""The journal beside a session while it is recorded: what the writer was told, in order, each
record with its own checksum.

It outlives what HDF5 does not, a power cut in the middle of a write: it only grows, and a record
that is torn is the last one. Images are named by their place in the session file and their CRC-32;
the force samples are held themselves. Results are not: the same analysis of the same images gives
them again. A session that was closed and verified has no journal any more.
"""

from __future__ import annotations

import errno
import json
import os
import struct
from collections.abc import Iterator
from io import FileIO
from pathlib import Path
from typing import Any
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

SUFFIX = ".journal"
_MAGIC = b"SlipScope journal 1\n"
_HEAD = struct.Struct("<cII")  # kind, bytes of the payload, CRC-32 of the payload
_FIRST = struct.Struct("<q")
_LONGEST_WORDS = 1 << 24  # bytes; the settings and the grid of a session have a hundredth of it
# a JSON list: what, values...; or a number, volts and newtons in binary
_WORDS, _SAMPLES = b"W", b"S"


def journal_of(session: Path) -> Path:
    """Where the journal of a session lies."""
    return session.with_name(session.name + SUFFIX)


def has_journal(session: Path) -> bool:
    """Whether beside a session lies a journal that `slipscope repair` can begin with."""
    return journal_of(session).is_file() and next(records(journal_of(session)))[0] == "session"


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
        self._append(_MAGIC)

    def note(self, what: str, *values: Any) -> None:
        """Add a record of a few numbers and words."""
        self._add(_WORDS, json.dumps([what, *values]).encode())

    def samples(self, first: int, volts: NDArray[np.float64], forces: NDArray[np.float64]) -> None:
        """Add the samples from number `first` on: readings in volts and forces in newtons, both (n,
        2).
        """
        self._add(
            _SAMPLES, _FIRST.pack(first) + np.concatenate([volts, forces]).astype("<f8").tobytes()
        )

    def sync(self) -> None:
        """Bring everything so far to the disk."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Let go of the file. May be called twice."""
        self._file.close()

    def _add(self, kind: bytes, payload: bytes) -> None:
        self._append(_HEAD.pack(kind, len(payload), crc32(payload)) + payload)

    def _append(self, record: bytes) -> None:
        try:
            if self._file.write(record) != len(record):
                raise OSError(errno.ENOSPC, f"{self.path}: the disk is full; make room")
        except OSError:
            self._file.truncate(self._end)
            self._file.seek(self._end)
            raise
        self._end += len(record)


def records(path: Path) -> Iterator[tuple[Any, ...]]:
    """What a journal holds, in order, up to the first record that is torn: (what, value, ...) each.

    Samples come as ("samples", first, volts, forces). The last one is ("end", bytes that were left
    out because they are torn).
    """
    size = path.stat().st_size
    with path.open("rb") as file:
        at = len(_MAGIC) if file.read(len(_MAGIC)) == _MAGIC else size + 1
        while at + _HEAD.size <= size:
            kind, length, checksum = _HEAD.unpack(file.read(_HEAD.size))
            if length > size - at - _HEAD.size:
                break
            payload = file.read(length)
            if crc32(payload) != checksum or (record := _decoded(kind, payload)) is None:
                break
            yield record
            at += _HEAD.size + length
    yield "end", max(0, size - at) if at <= size else size


def _decoded(kind: bytes, payload: bytes) -> tuple[Any, ...] | None:
    """A record as `records` gives it; None where it is none."""
    try:
        if kind == _WORDS and len(payload) <= _LONGEST_WORDS:
            words = json.loads(payload)
            return (
                tuple(words)
                if isinstance(words, list) and words and isinstance(words[0], str)
                else None
            )
        if kind == _SAMPLES:
            volts, forces = np.frombuffer(payload, "<f8", offset=_FIRST.size).reshape(2, -1, 2)
            return "samples", _FIRST.unpack_from(payload)[0], volts, forces
    except (ValueError, TypeError, RecursionError):
        pass
    return None
