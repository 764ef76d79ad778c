"""What a closed session holds when it is read back, and that this is what the writer was given."""

from __future__ import annotations

import hashlib
import math
import struct
import time
from dataclasses import dataclass, field
from pathlib import Path
from zlib import crc32

import numpy as np

from analysis.arrays import F64
from app.records.quantities import counted
from app.records.record_types import ACCOUNT, Event, Gap, Position, Samples, TriggerRow
from app.records.schema import TEXT
from app.session import legacy
from app.session.checks import channels_of
from app.session.datasets import uncertain_triggers
from app.session.journal import StoredFrame
from app.session.layout import FORMAT_VERSION, GROUPS, GROWING, IMAGE, LATER, columns_in
from app.session.reader import SessionReader
from app.system.errors import UserError
from drivers.protocols import Frame, LostFrame

_SLAB = 1 << 20  # values read at a time


class NotAsRecordedError(UserError):
    """A session that can be read, but does not hold what was recorded."""


@dataclass(frozen=True, slots=True)
class Receipt:
    """The account of a session that was read back to the last byte.

    `checksum` is a SHA-256, in 32 digits, of all that was measured, the same at any later time: who
    has written it down can tell whether somebody changed the file. `seconds` is how long the
    reading took. `checked` is False for a session of format 3 or older, which has no
    checksums to compare with. `uncertain` triggers may be others; `account` is the equality of
    triggers, exposures and images, if the camera's driver makes one.
    """

    frames: int
    frames_lost: int
    samples: int
    gaps: int
    bytes: int
    checksum: str
    seconds: float
    checked: bool
    uncertain: int = 0
    account: str = ""

    def __str__(self) -> str:
        """One sentence for the person at the bench."""
        how = "as they were written" if self.checked else "without checksums to hold them against"
        return (
            f"{counted(self.frames, 'frame')}, {self.frames_lost} lost,"
            f" {counted(self.samples, 'sample')}, {counted(self.gaps, 'gap')},"
            f" {self.bytes / 1e6:.1f} MB read back {how} in {self.seconds:.1f} s;"
            f" checksum {self.checksum}"
            + f"; {self.uncertain} triggers are uncertain" * bool(self.uncertain)
            + f"; {self.account}" * bool(self.account)
        )


@dataclass
class RecordedContents:
    """What a stream of records amounts to: the frames by trigger, the number of everything else,
    and the bits of the forces.
    """

    channels: int = 0  # beside the forces
    version: int = FORMAT_VERSION  # of the format
    frames: dict[int, int] = field(default_factory=dict)  # CRC-32, -1 where it was lost
    digests: dict[int, bytes] = field(default_factory=dict)  # SHA-256, where the image is here
    stamps: dict[int, float] = field(default_factory=dict)  # seconds, where it has one
    samples: int = 0
    present: int = 0  # of them, those that are not missing
    gaps: int = 0
    positions: int = 0
    events: int = 0

    def __post_init__(self) -> None:
        # of the columns of the forces, of the further channels, and of all that happened
        self._columns = [hashlib.sha256() for _ in range(4 + self.channels)]
        self._happened = hashlib.sha256()

    @property
    def forces(self) -> list[bytes]:
        """SHA-256 of each column of the forces, and of the further channels."""
        return [column.digest() for column in self._columns]

    def add(self, record: object) -> None:
        """Count a record; one that is not measured is passed over."""
        match record:
            case Samples():
                self._skip(record.first)
                further = record.auxiliary
                if further is None:
                    further = np.full((len(record.volts), self.channels), np.nan)
                self._add(np.concatenate([record.volts.T, record.forces.T, further.T]))
                self.present += len(record.volts)
            case Gap():
                self._skip(record.first)
                self._skip(record.first + record.count)
                self.events += 1
            case Frame(index, image=image):
                content = np.ascontiguousarray(image).data
                self.frames[index] = crc32(content)
                self.digests[index] = hashlib.sha256(content).digest()
                self._stamp(record)
            case StoredFrame() | TriggerRow():
                self.frames[record.index] = record.checksum
                self._stamp(record)
            case LostFrame():
                self.frames[record.index] = -1
            case Position():
                self.positions += 1
                self._happened.update(struct.pack("<qd", record.sample, record.position_m))
            case Event():
                self.events += 1
                text = legacy.happened(record, self.version)
                self._happened.update(text.encode("utf-8", "backslashreplace"))

    def _stamp(self, frame: Frame | StoredFrame | TriggerRow) -> None:
        if math.isfinite(frame.stamp_s):
            self.stamps[frame.index] = frame.stamp_s

    def _add(self, columns: F64) -> None:
        for column, bits in zip(columns, self._columns, strict=True):
            bits.update(np.ascontiguousarray(column).data)
        self.samples += columns.shape[1]

    def _skip(self, end: int) -> None:
        """Count the samples before `end` as missing, if there are any."""
        if end > self.samples:
            self._add(np.full((len(self._columns), end - self.samples), np.nan))
            self.gaps += 1

    def checksum(self) -> str:
        """Of everything."""
        whole = hashlib.sha256(b"".join(self.forces) + self._happened.digest())
        for index, crc in sorted(self.frames.items()):
            whole.update(struct.pack("<qq", index, crc) + self.digests.get(index, b""))
        for index, stamp_s in sorted(self.stamps.items()):
            whole.update(struct.pack("<qd", index, stamp_s))
        return whole.hexdigest()[:32]


def verify(session: Path, given: RecordedContents | None = None) -> Receipt:
    """Read a session back, every image and sample, and compare it with its checksums and, where
    they are given, with the records that it was made of.

    Raises
    ------
    NotAsRecordedError
        The session does not hold what was written; the sentence says where.
    UserError
        It cannot be read.
    """
    began = time.monotonic()
    with SessionReader(session) as reader:
        found = RecordedContents(channels_of(reader.header), reader.format)
        checked = _read_columns(reader)
        uncertain, account = len(uncertain_triggers(reader)), ""
        for record in reader.records():
            if isinstance(record, Event) and record.kind == ACCOUNT:
                account = record.text
            found.add(record)
    if altered := [getattr(lost, "index", 0) for lost in reader.altered]:
        raise NotAsRecordedError(
            f"{session}: {_numbered('image', altered)} not as recorded; `slipscope repair` makes a"
            " session of the others"
        )
    if given is not None and (difference := _difference(found, given)):
        raise NotAsRecordedError(f"{session}: {difference}")
    lost = sum(crc < 0 for crc in found.frames.values())
    return Receipt(
        frames=len(found.frames) - lost,
        frames_lost=lost,
        samples=found.samples,
        gaps=found.gaps,
        bytes=session.stat().st_size,
        checksum=found.checksum(),
        seconds=round(time.monotonic() - began, 2),
        checked=checked,
        uncertain=uncertain,
        account=account,
    )


def _read_columns(reader: SessionReader) -> bool:
    """Read the map of the pixels, the contact, how the run ended, and all that grew but images and
    texts, which HDF5 compares with its checksums; whether it has one for all of it.
    """
    checked = reader.format >= 4
    _ = reader.pattern(), reader.contact(), reader.outcome
    for group in GROUPS:
        if group.path in LATER and not reader.file.has(group.path):
            continue
        columns = [
            reader.dataset(column.path)
            for column in columns_in(group.path)
            if column.shape
            and column.shape[0] in GROWING
            and column.dtype not in (TEXT, IMAGE)
            and reader.has(column)
        ]
        # a program that was killed may have lengthened only some
        rows = min(map(len, columns), default=0)
        for column in columns:
            checked = checked and column.fletcher32
            step = max(1, _SLAB // max(1, math.prod(column.shape[1:])))
            try:
                with reader.file.reading(column.name):
                    column.check_claim((rows, *column.shape[1:]))
                    for first in range(0, rows, step):
                        column[first : min(first + step, rows)]
            except UserError as error:
                raise NotAsRecordedError(
                    f"{reader.path}: {column.name} is not as recorded; `slipscope repair` makes a"
                    " session of what can be read"
                ) from error
    return checked


def _difference(found: RecordedContents, given: RecordedContents) -> str:
    """The first difference between what a session holds and what it was given, in words; empty
    where there is none.
    """
    wrong = [
        index
        for index in given.frames.keys() | found.frames.keys()
        if given.frames.get(index) != found.frames.get(index)
    ]
    if wrong:
        return f"{_numbered('frame', sorted(wrong))} not as recorded"
    for name in ("samples", "gaps", "positions", "events"):
        there, recorded = getattr(found, name), getattr(given, name)
        if there != recorded:
            return f"{recorded} {name} were recorded, {there} are in the file"
    if found.stamps != given.stamps:
        return "the times of the camera's clock are not as recorded"
    return "" if found.forces == given.forces else "the forces are not as recorded"


def _numbered(what: str, numbers: list[int]) -> str:
    shown = ", ".join(map(str, numbers[:5]))
    if len(numbers) > 5:
        shown += f" and {len(numbers) - 5} more"
    return f"{what} {shown} is" if len(numbers) == 1 else f"{what}s {shown} are"
