"""PNG and TIFF files, whose headers are read before anything is decoded: a file of a few kilobytes
can claim to hold gigabytes.
"""

from __future__ import annotations

import struct
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

MOST_BYTES = 1 << 28  # of an image, in the file and decoded
_PNG = b"\x89PNG\r\n\x1a\n"
_TIFF = {b"II*\0": "<", b"MM\0*": ">"}
_WIDTH, _HEIGHT, _BITS, _SAMPLES, _TILE = 256, 257, 258, 277, (322, 323)
_VALUES = {1: "B", 3: "H", 4: "I"}  # types of TIFF: byte, short, long


class _Header(NamedTuple):
    width: int
    height: int
    nbytes: int  # decoded
    pages: int


def decoded(path: Path, most_bytes: int = MOST_BYTES) -> NDArray[Any]:
    """The picture in a file, as stored: shape (rows, columns), or with channels.

    Raises
    ------
    OSError
        The file can not be read.
    ValueError
        It is no PNG or TIFF, holds several pictures, or one that takes more than `most_bytes`; the
        message goes on from the name of the file.
    """
    with path.open("rb") as file:
        content = file.read(MOST_BYTES + 1)
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
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)  # else it writes of damage
    try:
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        image = None
    finally:
        cv2.utils.logging.setLogLevel(level)
    if image is None:
        raise ValueError("not an image that can be read; give a PNG or TIFF file")
    return np.asarray(image)


def _png(content: bytes) -> _Header:
    width, height, bits, colour = struct.unpack(">IIBB", content[16:26])
    each = max(1, bits // 8) * (1 if colour == 0 else 4)
    is_animated = 0 <= content.find(b"acTL") < content.find(b"IDAT")
    return _Header(width, height, width * height * each, 2 if is_animated else 1)


def _tiff(content: bytes) -> _Header:
    order = _TIFF[content[:4]]
    tags, after = _directory(content, order, *struct.unpack(order + "I", content[4:8]))
    width, height = tags[_WIDTH], tags[_HEIGHT]
    # a picture is decoded by whole tiles
    area = max(width * height, tags.get(_TILE[0], 0) * tags.get(_TILE[1], 0))
    nbytes = area * max(1, tags.get(_BITS, 1) // 8) * tags.get(_SAMPLES, 1)
    return _Header(width, height, nbytes, 2 if after else 1)


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
