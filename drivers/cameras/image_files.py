"""PNG, TIFF and BMP files, whose headers are read before anything is decoded: a file of a few
kilobytes can claim to hold gigabytes.
"""

from __future__ import annotations

import struct
from functools import lru_cache
from pathlib import Path
from typing import Any, BinaryIO

import cv2
import numpy as np

from analysis.arrays import Array

MOST_BYTES = 1 << 28  # largest image, in the file and decoded
MOST_PAGES, _MOST_ENTRIES, _LONGEST = 1_000_000, 4096, 1 << 20
_FARTHEST = 1 << 44  # largest offset in a file: systems refuse to go further
_PNG, _BMP = b"\x89PNG\r\n\x1a\n", b"BM"
# byte order, then the formats of a place in the file, a number of entries, an entry
_TIFF = ("I", "H", "HHI4s")
_BIG_TIFF = ("Q", "Q", "HHQ8s")
_KINDS = {
    b"II*\0": ("<", *_TIFF),
    b"MM\0*": (">", *_TIFF),
    b"II+\0": ("<", *_BIG_TIFF),
    b"MM\0+": (">", *_BIG_TIFF),
}
_MAGIC = {kind[0]: magic for magic, kind in _KINDS.items() if kind[1:] == _TIFF}
# types of TIFF that what is needed here can have: byte, short, long, bytes, long of BigTIFF
_FORMS = {1: "B", 3: "H", 4: "I", 7: "B", 16: "Q"}
_WIDTH, _HEIGHT, _BITS, _SAMPLES, _TILE_WIDTH, _TILE_HEIGHT = 256, 257, 258, 277, 322, 323
_PIECES = (273, 279), (324, 325)  # places and lengths of strips, of tiles
# the others that decoding a picture needs, among them Predictor, fax options and JPEG tables
_OTHERS = 259, 262, 266, 278, 284, 292, 293, 317, 320, 338, 339, 347
_SEVERAL = "several images in one file; save each as a file of its own"
_UNREADABLE = struct.error, LookupError, OverflowError, StopIteration


def decoded(path: Path, most_bytes: int = MOST_BYTES, page: int | None = None) -> Array:
    """The picture in a file, as stored: shape (rows, columns), or with channels.

    Parameters
    ----------
    page : int, optional
        Which picture of a TIFF that may hold several, from 0 on; None: there must be one only.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        It is no PNG, TIFF or BMP, holds several pictures, or one that takes more than
        `most_bytes`; the message goes on from the name of the file.
    """
    image = None
    try:
        with path.open("rb") as file:
            head = file.read(len(_PNG)) if page is None else b""
            if head == _PNG:
                content = _png(file, most_bytes)
            elif head.startswith(_BMP):
                content = _bmp(head + file.read(MOST_BYTES), most_bytes)
            else:
                content = _tiff(path, page, most_bytes)
        # OpenCV 5 has moved the functions that set how much it writes of damage
        log: Any = getattr(cv2.utils, "logging", cv2)
        level = log.getLogLevel()
        log.setLogLevel(0)
        try:
            image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
            if image is not None and _is_of_os2(content):  # OpenCV has made grey levels of colours
                colours = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
                image = image if np.all(colours == image[..., None]) else colours
        finally:
            log.setLogLevel(level)
    except (*_UNREADABLE, cv2.error):
        pass
    if image is None:
        raise ValueError("not an image that can be read; give a PNG, TIFF or BMP file")
    return np.asarray(image)


def page_count(path: Path) -> int:
    """How many pictures a file holds: those of a TIFF, 1 for any other file.

    Raises
    ------
    OSError
        The file cannot be read.
    """
    try:
        return len(_directories(path))
    except _UNREADABLE:
        return 1


def _png(file: BinaryIO, most_bytes: int) -> bytes:
    content = _PNG + file.read(MOST_BYTES)
    width, height, bits, colour = struct.unpack(">IIBB", content[16:26])
    if 0 <= content.find(b"acTL") < content.find(b"IDAT"):  # animated
        raise ValueError(_SEVERAL)
    nbytes = width * height * max(1, bits // 8) * (1 if colour == 0 else 4)
    _check(width, height, nbytes, most_bytes if len(content) <= MOST_BYTES else 0)
    return content


def _is_of_os2(content: bytes) -> bool:
    """Whether it is a BMP with the short header, of 12 bytes."""
    return content.startswith(_BMP) and content[14:18] == b"\x0c\0\0\0"


def _bmp(content: bytes, most_bytes: int) -> bytes:
    width, height = struct.unpack_from("<HH" if _is_of_os2(content) else "<ii", content, 18)
    nbytes = 4 * width * abs(height)
    _check(width, abs(height), nbytes, most_bytes if len(content) <= MOST_BYTES else 0)
    return content


def _tiff(path: Path, page: int | None, most_bytes: int) -> bytes:
    places = _directories(path)
    if page is None and len(places) > 1:
        raise ValueError(_SEVERAL)
    with path.open("rb") as file:
        return _TiffFile(file).alone(places[page or 0], most_bytes)


def _check(width: int, height: int, nbytes: int, most_bytes: int) -> None:
    if nbytes > most_bytes:
        raise ValueError(
            f"an image of {width} x {height} px, which takes {nbytes / 1e6:.0f} MB, more than the"
            f" {most_bytes / 1e6:.0f} MB that are read"
        )


def _directories(path: Path) -> tuple[int, ...]:
    """The places of the directories of a TIFF, one for each of its pictures."""
    status = path.stat()
    return _directories_in(path, status.st_mtime_ns, status.st_size)


@lru_cache(maxsize=16)
def _directories_in(path: Path, modified: int, size: int) -> tuple[int, ...]:
    with path.open("rb") as file:
        return _TiffFile(file).directories()


class _TiffFile:
    """A TIFF that is open, in either byte order, also one with places beyond 4 GB (BigTIFF)."""

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._order, self._place, self._count, self._entry = _KINDS[file.read(4)]
        file.seek(struct.calcsize(self._place))  # 4, or 8 behind more about the format
        self._first = self._read(self._place)[0]

    def directories(self) -> tuple[int, ...]:
        """The places of all directories, in order."""
        places: dict[int, None] = {}
        place = self._first
        while place and place not in places and len(places) < MOST_PAGES:
            places[place] = None
            self._entries(place)
            (place,) = self._read(self._place)
        return tuple(places)

    def alone(self, place: int, most_bytes: int) -> bytes:
        """A TIFF of one picture of the file, its pixels as they are stored."""
        held = self._needed(place)
        tags = {_BITS: [1], _SAMPLES: [1], _TILE_WIDTH: [0], _TILE_HEIGHT: [0]}
        for tag, (kind, value) in held.items():
            tags[tag] = [n for (n,) in struct.iter_unpack(self._order + _FORMS[kind], value)]
        width, height, bits = tags[_WIDTH][0], tags[_HEIGHT][0], tags[_BITS][0]
        # a picture is decoded by whole tiles
        area = max(width * height, tags[_TILE_WIDTH][0] * tags[_TILE_HEIGHT][0])
        _check(width, height, area * max(1, bits // 8) * tags[_SAMPLES][0], most_bytes)
        starts, lengths = next(pair for pair in _PIECES if {*pair} <= tags.keys())
        most_bytes = min(2 * most_bytes + (1 << 20), MOST_BYTES)
        if len(tags[starts]) != len(tags[lengths]) or sum(tags[lengths]) > most_bytes:
            raise OverflowError
        content, begins = bytearray(8), []
        for start, length in zip(tags[starts], tags[lengths], strict=True):
            begins.append(len(content))
            self._seek(start)
            content += self._file.read(length)
        for tag, numbers in ((starts, begins), (lengths, tags[lengths])):
            held[tag] = 4, struct.pack(f"{self._order}{len(numbers)}I", *numbers)
        content += bytes(len(content) % 2)
        content[:8] = _MAGIC[self._order] + struct.pack(self._order + "I", len(content))
        beyond = bytearray()  # the directory, where what is longer than 4 bytes lies
        end = len(content) + 2 + 12 * len(held) + 4
        content += struct.pack(self._order + "H", len(held))
        for tag, (kind, value) in sorted(held.items()):
            count = len(value) // struct.calcsize(_FORMS[kind])
            content += struct.pack(self._order + "HHI", tag, kind, count)
            if len(value) <= 4:
                content += value.ljust(4, b"\0")
            else:
                content += struct.pack(self._order + "I", end + len(beyond))
                beyond += value + bytes(len(value) % 2)
        return bytes(content + bytes(4) + beyond)

    def _needed(self, place: int) -> dict[int, tuple[int, bytes]]:
        """Tag -> type and value, of what decoding a picture needs."""
        needed = {_WIDTH, _HEIGHT, _BITS, _SAMPLES, _TILE_WIDTH, _TILE_HEIGHT, *_OTHERS}
        held = {}
        for tag, kind, count, inside in self._entries(place):
            if tag in needed.union(*_PIECES):
                length = count * struct.calcsize(_FORMS[kind])
                if length > _LONGEST:
                    raise OverflowError
                if length > len(inside):
                    self._seek(struct.unpack(self._order + self._place, inside)[0])
                    held[tag] = kind, self._file.read(length)
                else:
                    held[tag] = kind, inside[:length]
        return held

    def _entries(self, place: int) -> list[tuple[int, int, int, bytes]]:
        """Tag, type, count, and value or its place, of all in a directory."""
        self._seek(place)
        (count,) = self._read(self._count)
        if count > _MOST_ENTRIES:
            raise OverflowError
        form = self._order + self._entry
        return list(struct.iter_unpack(form, self._file.read(count * struct.calcsize(form))))

    def _seek(self, place: int) -> None:
        if place > _FARTHEST:
            raise OverflowError
        self._file.seek(place)

    def _read(self, form: str) -> tuple[Any, ...]:
        form = self._order + form
        return struct.unpack(form, self._file.read(struct.calcsize(form)))
