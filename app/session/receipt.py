"""What a closed session was found to hold when it was read back, and that this is what the writer
was told.
"""

from __future__ import annotations

import math
import time
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from zlib import crc32

import h5py
import numpy as np
from numpy.typing import NDArray

from app.errors import UserError
from app.session.checked import CheckedFile
from app.session.journal import records
from app.session.layout import GROUPS, GROWING, IMAGE, TEXT, items_of
from app.session.reader import SessionReader

_FORCES = ("normal_sensor", "shear_sensor", "normal_force", "shear_force")
_SLAB = 1 << 20  # values read at a time


class NotAsRecordedError(UserError):
    """A session that can be read, but does not hold what was recorded."""


@dataclass(frozen=True, slots=True)
class Receipt:
    """The account of a session that was read back to the last byte.

    `checksum` is one over all images and forces, the same at any later time; `seconds` is how long
    the reading took. `checked` is False of a session of format 3 or older: it has no checksums to
    be held against.
    """

    frames: int
    frames_lost: int
    samples: int
    gaps: int
    bytes: int
    checksum: str
    seconds: float
    checked: bool

    def __str__(self) -> str:
        """One sentence for the person at the bench."""
        how = "as they were written" if self.checked else "without checksums to hold them against"
        return (
            f"{self.frames} frames, {self.frames_lost} lost, {self.samples} samples, {self.gaps}"
            f" gaps, {self.bytes / 1e6:.1f} MB"
            f" read back {how} in {self.seconds:.1f} s; checksum {self.checksum}"
        )


@dataclass
class _Account:
    """Frames by trigger (CRC-32 of the image, None where it was lost), and how many of everything
    else; of the forces the bits.
    """

    frames: dict[int, int | None]
    samples: int = 0
    gaps: int = 0
    positions: int = 0
    events: int = 0
    forces: tuple[int, ...] = (0, 0, 0, 0)

    def add(self, columns: NDArray[np.float64]) -> None:
        """Count samples, four columns of them."""
        self.forces = tuple(
            crc32(np.ascontiguousarray(column).data, was)
            for column, was in zip(columns, self.forces, strict=True)
        )
        self.samples += columns.shape[1]

    def skip(self, end: int) -> None:
        """Count the samples before `end` as missing, if there are any."""
        if end > self.samples:
            self.add(np.full((4, end - self.samples), np.nan))
            self.gaps += 1


def verify(session: Path, journal: Path | None = None) -> Receipt:
    """Read a session back, every image and sample, and hold it against its checksums and, where it
    is given, the journal.

    Raises
    ------
    NotAsRecordedError
        What was found is not what was written; the sentence says where.
    UserError
        It can not be read.
    """
    began = time.monotonic()
    with SessionReader(session) as reader, closing(CheckedFile(session, "session")) as file:
        checked = _read_columns(reader, file)
        triggers = reader.triggers()
        found = _Account(dict.fromkeys(triggers["index"].tolist()))
        received = triggers["index"][triggers["received"]].tolist()
        if received:
            # an analysis without its session can not be read back; a single image that can not be
            # read is altered
            _ = reader.images_path
        images = {index: _checksum_of(reader, index) for index in received}
        found.frames |= images
        held = checksums(reader, file)
        if wrong := [
            index
            for index, checksum in images.items()
            if checksum is None or held.get(index, checksum) != checksum
        ]:
            raise NotAsRecordedError(
                f"{session}: {_numbered('image', wrong)} not as recorded; `slipscope repair` makes"
                " a session of the others"
            )
        for first in range(0, samples_in(file), _SLAB // 4):
            found.add(forces_of(file, first, first + _SLAB // 4))
        found.gaps, found.positions, found.events = (
            len(reader.gaps()),
            len(reader.positions()[0]),
            len(reader.events()),
        )
    told = _told(journal, found.samples) if journal else found
    if told != found:
        raise NotAsRecordedError(
            f"{session}: {_difference(found, told)}; the journal is kept, `slipscope repair` makes"
            " a whole session of both"
        )
    bits = np.array(
        [*(checksum or 0 for checksum in found.frames.values()), *found.forces], np.uint32
    )
    return Receipt(
        frames=sum(checksum is not None for checksum in found.frames.values()),
        frames_lost=sum(checksum is None for checksum in found.frames.values()),
        samples=found.samples,
        gaps=found.gaps,
        bytes=session.stat().st_size,
        checksum=f"{crc32(bits.data):08x}",
        seconds=round(time.monotonic() - began, 2),
        checked=checked,
    )


def checksums(reader: SessionReader, file: CheckedFile) -> dict[int, int]:
    """Trigger number -> CRC-32 of the image as it was recorded, of the frames received; none of a
    session of format 3 or older.
    """
    if reader.format < 4:
        return {}
    triggers, column = (
        reader.triggers(),
        file.read(file.dataset("/entry/triggers/checksum", ("triggers",), "uint32")),
    )
    return {
        int(t["index"]): int(checksum)
        for t, checksum in zip(triggers, column, strict=False)
        if t["received"]
    }


def image_of(reader: SessionReader, index: int) -> NDArray[Any] | None:
    """The image of trigger `index`, in one piece; None where it can not be read."""
    with suppress(UserError):
        return np.ascontiguousarray(reader.frame(index)[2])
    return None


def _checksum_of(reader: SessionReader, index: int) -> int | None:
    image = image_of(reader, index)
    return None if image is None else crc32(image.data)


def samples_in(file: CheckedFile) -> int:
    """Rows of the forces, by the shortest column."""
    return min(len(column) for column in _force_columns(file))


def forces_of(file: CheckedFile, first: int, end: int) -> NDArray[np.float64]:
    """The samples from `first` to before `end`, or the last one, as they are stored: rows normal
    and shear in volts, then in newtons.
    """
    with file.reading("/entry/forces"):
        return np.stack(
            [column[first : min(end, samples_in(file))] for column in _force_columns(file)]
        )


def _force_columns(file: CheckedFile) -> list[h5py.Dataset]:
    return [file.dataset(f"/entry/forces/{name}", ("samples",), "float64") for name in _FORCES]


def _read_columns(reader: SessionReader, file: CheckedFile) -> bool:
    """Read all that grew during the run, but images and texts, which HDF5 holds against its
    checksums; whether it all has some.
    """
    checked = reader.format >= 4
    for group in GROUPS:
        items = [
            item
            for item in items_of(group.path)
            if item.shape and item.shape[0] in GROWING and item.since <= reader.format
        ]
        columns = [
            file.dataset(item.path, item.shape, item.dtype)
            for item in items
            if item.dtype not in (TEXT, IMAGE)
        ]
        # a program that was killed may have lengthened only some
        rows = min(map(len, columns), default=0)
        for column in columns:
            checked = checked and column.fletcher32
            step = max(1, _SLAB // max(1, math.prod(column.shape[1:])))
            try:
                with file.reading(column.name):
                    file.check_claim(column, (rows, *column.shape[1:]))
                    for first in range(0, rows, step):
                        column[first : min(first + step, rows)]
            except UserError as error:
                remedy = "`slipscope repair` makes a session of what can be read"
                raise NotAsRecordedError(
                    f"{reader.path}: {column.name} is not as recorded; {remedy}"
                ) from error
    return checked


def _told(journal: Path, most: int) -> _Account:
    """What a session must hold that was told what is in the journal; of a gap that leads beyond
    `most` samples only the first one.
    """
    told = _Account({})
    for what, *values in records(journal):
        match what, values:
            case "samples", (int(first), np.ndarray() as volts, np.ndarray() as forces):
                told.skip(min(first, most + 1))
                told.add(np.concatenate([volts.T, forces.T]))
            case "gap", (int(first), int(count), _):
                told.skip(min(first, most + 1))
                told.skip(min(first + count, most + 1))
                told.events += 1
            case "frame", (int(index), _, _, _, int(checksum)):
                told.frames[index] = checksum
            case "source_frame", (int(index), _, _, int(checksum)):
                told.frames[index] = checksum
            case "lost_frame", (int(index), _, _):
                told.frames[index] = None
            case "position", _:
                told.positions += 1
            case "event", _:
                told.events += 1
    return told


def _difference(found: _Account, told: _Account) -> str:
    """The first difference between a session and its journal, in words."""
    wrong = [
        index
        for index in told.frames.keys() | found.frames.keys()
        if told.frames.get(index, -1) != found.frames.get(index, -1)
    ]
    if wrong:
        return f"{_numbered('frame', sorted(wrong))} not as recorded"
    for name in ("samples", "gaps", "positions", "events"):
        if getattr(found, name) != getattr(told, name):
            return (
                f"{getattr(told, name)} {name} were recorded, {getattr(found, name)} are in the"
                " file"
            )
    return "the forces are not as recorded"


def _numbered(what: str, numbers: list[Any]) -> str:
    shown = ", ".join(map(str, numbers[:5])) + (
        f" and {len(numbers) - 5} more" if len(numbers) > 5 else ""
    )
    return f"{what} {shown} is" if len(numbers) == 1 else f"{what}s {shown} are"
