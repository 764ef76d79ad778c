"""PNG and TIFF files, whose headers are read before anything is decoded: a file of a few kilobytes
can claim to hold gigabytes.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

MOST_BYTES = 1 << 28  # of an image, in the file and decoded
_PNG = b"\x89PNG\r\n\x1a\n"
_TIFF = {b"II*\0": "<", b"MM\0*": ">"}
_BIG_TIFF = {b"II+\0": "<", b"MM\0+": ">"}
MOST_PAGES, _MOST_ENTRIES = 1_000_000, 4096
_SIZES = {1: 1, 2: 1, 3: 2, 4: 4, 5: 8, 6: 1, 7: 1, 8: 2, 9: 4, 10: 8, 11: 4, 12: 8, 16: 8}
_PLACES, _LENGTHS = (273, 324), (279, 325)  # of strips, of tiles
# what decoding a picture needs, beside the places of its pixels; Predictor and JPEG tables, too
_NEEDED = (256, 257, 258, 259, 262, 266, 277, 278, 284, 317, 320, 322, 323, 338, 339, 347)
_WIDTH, _HEIGHT, _BITS, _SAMPLES, _TILE = 256, 257, 258, 277, (322, 323)
_VALUES = {1: "B", 3: "H", 4: "I"}  # types of TIFF: byte, short, long


class _ImageHeader(NamedTuple):
    width: int
    height: int
    nbytes: int  # decoded
    pages: int


def decoded(path: Path, most_bytes: int = MOST_BYTES, page: int | None = None) -> NDArray[Any]:
    """The picture in a file, as stored: shape (rows, columns), or with channels.

    Parameters
    ----------
    page : int, optional
        Which picture of a TIFF that may hold several, from 0 on; None: there must be one only.

    Raises
    ------
    OSError
        The file can not be read.
    ValueError
        It is no PNG or TIFF, holds several pictures, or one that takes more than `most_bytes`; the
        message goes on from the name of the file.
    """
    with path.open("rb") as file:
        content = file.read(4)
        if page is None and content not in _BIG_TIFF:
            content += file.read(MOST_BYTES + 1)
    if page is not None or content in _BIG_TIFF:
        if page is None and page_count(path) > 1:
            raise ValueError("several images in one file; save each as a file of its own")
        content = _one_page(path, page or 0, most_bytes)
    try:
        header = _png(content) if content.startswith(_PNG) else _tiff(content)
    except (struct.error, LookupError, OverflowError):
        raise ValueError("not an image that can be read; give a PNG or TIFF file") from None
    if header.pages > 1:
        raise ValueError("several images in one file; save each as a file of its own")
    if header.nbytes > most_bytes or len(content) > MOST_BYTES:
        raise ValueError(
            f"an image of {header.width} x {header.height} px, which takes"
            f" {header.nbytes / 1e6:.0f} MB, more than the {most_bytes / 1e6:.0f} MB that are read"
        )
    # OpenCV 5 has moved the functions that set how much it writes of damage
    log: Any = getattr(cv2.utils, "logging", cv2)
    level = log.getLogLevel()
    log.setLogLevel(0)
    try:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        image = None
    finally:
        log.setLogLevel(level)
    if image is None:
        raise ValueError("not an image that can be read; give a PNG or TIFF file")
    return np.asarray(image)


def page_count(path: Path) -> int:
    """How many pictures a file holds: those of a TIFF, 1 for any other file.

    Raises
    ------
    OSError
        The file can not be read.
    """
    try:
        return len(_directories_in(path))
    except (struct.error, LookupError, OverflowError):
        return 1


@dataclass(frozen=True, slots=True)
class _TiffKind:
    """How a TIFF counts: byte order, and the formats of a place, a number of entries, an entry."""

    order: str
    place: str
    count: str
    entry: str


def _kind(head: bytes) -> tuple[_TiffKind, int]:
    """The kind of a TIFF, and the place of its first directory."""
    if head[:4] in _TIFF:
        order = _TIFF[head[:4]]
        return _TiffKind(order, "I", "H", "HHI4s"), struct.unpack_from(order + "I", head, 4)[0]
    order = _BIG_TIFF[head[:4]]
    return _TiffKind(order, "Q", "Q", "HHQ8s"), struct.unpack_from(order + "Q", head, 8)[0]


def _directories_in(path: Path) -> tuple[int, ...]:
    """The places of the directories of a TIFF, one for each of its pictures."""
    told = path.stat()
    return _places(path, told.st_mtime_ns, told.st_size)


@lru_cache(maxsize=16)
def _places(path: Path, modified: int, size: int) -> tuple[int, ...]:
    with path.open("rb") as file:
        return tuple(_directories(file))


def _directories(file: BinaryIO) -> list[int]:
    kind, place = _kind(file.read(16))
    places: list[int] = []
    seen = set()
    while place and place not in seen and len(places) < MOST_PAGES:
        seen.add(place)
        places.append(place)
        _, place = _entries(file, kind, place)
    return places


_Entry = tuple[int, int, int, bytes]  # tag, type, count, value or its place


def _entries(file: BinaryIO, kind: _TiffKind, place: int) -> tuple[list[_Entry], int]:
    """The entries of a directory, and the place of the next one."""
    file.seek(place)
    size = struct.calcsize(kind.order + kind.count)
    (count,) = struct.unpack(kind.order + kind.count, file.read(size))
    if count > _MOST_ENTRIES:
        raise OverflowError
    step = struct.calcsize(kind.order + kind.entry)
    entries = list(struct.iter_unpack(kind.order + kind.entry, file.read(count * step)))
    (after,) = struct.unpack(
        kind.order + kind.place, file.read(struct.calcsize(kind.order + kind.place))
    )
    if len(entries) != count:
        raise LookupError
    return entries, after


def _one_page(path: Path, page: int, most_bytes: int) -> bytes:
    """A TIFF of one picture of a file of many, its pixels as they are stored."""
    try:
        place = _directories_in(path)[page]
        with path.open("rb") as file:
            kind, _ = _kind(file.read(16))
            return _alone(file, kind, place, most_bytes)
    except (struct.error, LookupError, OverflowError, StopIteration):
        raise ValueError("not an image that can be read; give a PNG or TIFF file") from None


def _alone(file: BinaryIO, kind: _TiffKind, place: int, most_bytes: int) -> bytes:
    entries, _ = _entries(file, kind, place)
    held = len(struct.pack(kind.order + kind.place, 0))

    def values(entry: _Entry) -> bytes:
        _, type_, count, value = entry
        length = _SIZES[type_] * count
        if length <= held:
            return value[:length]
        if length > 1 << 20:
            raise OverflowError
        file.seek(struct.unpack(kind.order + kind.place, value)[0])
        return file.read(length)

    kept: dict[int, tuple[int, int, bytes]] = {}
    pieces: dict[int, list[int]] = {}
    for entry in entries:
        tag, type_, count, _ = entry
        if tag in _PLACES or tag in _LENGTHS:
            form = {3: "H", 4: "I", 16: "Q"}[type_]
            pieces[tag] = list(struct.unpack(f"{kind.order}{count}{form}", values(entry)))
        elif tag in _NEEDED:
            kept[tag] = type_, count, values(entry)
    at = next(tag for tag in _PLACES if tag in pieces)
    lengths = next(tag for tag in _LENGTHS if tag in pieces)
    if sum(pieces[lengths]) > min(2 * most_bytes + (1 << 20), MOST_BYTES):
        raise OverflowError
    data, begin = bytearray(), []
    for start, length in zip(pieces[at], pieces[lengths], strict=True):
        begin.append(8 + len(data))
        file.seek(start)
        data += file.read(length)
    order, count = kind.order, len(begin)
    kept[at] = 4, count, struct.pack(f"{order}{count}I", *begin)
    kept[lengths] = 4, count, struct.pack(f"{order}{count}I", *pieces[lengths])
    directory = bytearray(struct.pack(order + "H", len(kept)))
    data += bytes(len(data) % 2)
    beyond, extra = 8 + len(data) + 2 + 12 * len(kept) + 4, bytearray()
    for tag, (type_, count, value) in sorted(kept.items()):
        directory += struct.pack(order + "HHI", tag, type_, count)
        if len(value) <= 4:
            directory += value.ljust(4, b"\0")
        else:
            directory += struct.pack(order + "I", beyond + len(extra))
            extra += value + bytes(len(value) % 2)
    magic = next(magic for magic, one in _TIFF.items() if one == order)
    head = magic + struct.pack(order + "I", 8 + len(data))
    return bytes(head + data + directory + bytes(4) + extra)


def _png(content: bytes) -> _ImageHeader:
    width, height, bits, colour = struct.unpack(">IIBB", content[16:26])
    each = max(1, bits // 8) * (1 if colour == 0 else 4)
    is_animated = 0 <= content.find(b"acTL") < content.find(b"IDAT")
    return _ImageHeader(width, height, width * height * each, 2 if is_animated else 1)


def _tiff(content: bytes) -> _ImageHeader:
    order = _TIFF[content[:4]]
    tags, after = _directory(content, order, *struct.unpack(order + "I", content[4:8]))
    width, height = tags[_WIDTH], tags[_HEIGHT]
    # a picture is decoded by whole tiles
    area = max(width * height, tags.get(_TILE[0], 0) * tags.get(_TILE[1], 0))
    nbytes = area * max(1, tags.get(_BITS, 1) // 8) * tags.get(_SAMPLES, 1)
    return _ImageHeader(width, height, nbytes, 2 if after else 1)


def _directory(content: bytes, order: str, place: int) -> tuple[dict[int, int], int]:
    """The first number of each tag of a picture in a TIFF, and the place of the next picture."""
    (count,) = struct.unpack_from(order + "H", content, place)
    tags = {}
    for n in range(count):
        at = place + 2 + 12 * n
        tag, kind, number = struct.unpack_from(order + "HHI", content, at)
        if value := _VALUES.get(kind):
            at += 8
            if number * struct.calcsize(value) > 4:
                (at,) = struct.unpack_from(order + "I", content, at)
            (tags[tag],) = struct.unpack_from(order + value, content, at)
    (after,) = struct.unpack_from(order + "I", content, place + 2 + 12 * count)
    return tags, after
