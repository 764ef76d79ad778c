"""Texts of an HDF5 file from anywhere, read from its bytes.

HDF5 keeps texts of any length in global heap collections, the one part of its metadata without a
checksum, and trusts what they say: a collection whose length or objects are damaged makes its
library take gigabytes or never come back. Here every length is held against what is there before it
is used. See the HDF5 file format specification, III.E, "Global heap".
"""

from __future__ import annotations

import re
import struct
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

LARGEST_BYTES = 1 << 25  # of all texts of a dataset: a run of hours has less than a tenth of it
_COLLECTION = struct.Struct("<4sB3xQ")  # signature, version, size
_OBJECT = struct.Struct("<H6xQ")  # number, size
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x0d\x0e-\x1f\x7f-\x9f]")  # could steer a terminal


def texts_of(references: NDArray[np.void], file: BinaryIO, size: int) -> NDArray[Any]:
    """The UTF-8 texts that are in these places of a file of `size` bytes, an array of their shape;
    control characters are spelled out.

    Raises
    ------
    ValueError
        They are not there, or claim more than `LARGEST_BYTES`.
    """
    rows = references.reshape(-1)
    if max(2 * rows.nbytes, int(rows["length"].sum(dtype=np.uint64))) > LARGEST_BYTES:
        raise ValueError(f"its texts claim more than {LARGEST_BYTES} bytes")
    collections: dict[int, dict[int, bytes]] = {}
    texts, left = np.full(rows.size, "", dtype=object), LARGEST_BYTES
    for n in np.flatnonzero(rows["length"]):
        length, place, number = (int(part) for part in rows[n])
        if place not in collections:
            collections[place], used = _objects(file, place, min(left, size - place))
            left -= used
        content = collections[place].get(number, b"")
        if len(content) != length:
            raise ValueError(f"a text of {length} bytes is not where it should be")
        text = content.partition(b"\0")[0].decode("utf-8")
        texts[n] = _CONTROL.sub(lambda found: f"\\x{ord(found[0]):02x}", text)
    return texts.reshape(references.shape)


def _objects(file: BinaryIO, place: int, most: int) -> tuple[dict[int, bytes], int]:
    """The objects of a collection by their numbers, and its size, at most `most` bytes."""
    if most < _COLLECTION.size:
        raise ValueError("its texts lie beyond the end of the file")
    file.seek(place)
    signature, version, size = _COLLECTION.unpack(file.read(_COLLECTION.size))
    if (signature, version) != (b"GCOL", 1) or not _COLLECTION.size <= size <= most:
        raise ValueError("the place of a text holds something else")
    content = file.read(size - _COLLECTION.size)
    found, at = {}, 0
    while at + _OBJECT.size <= len(content):
        number, length = _OBJECT.unpack_from(content, at)
        start, at = at + _OBJECT.size, at + _OBJECT.size + -(-length // 8) * 8
        if number == 0:  # the free space at the end
            break
        if at > len(content):
            raise ValueError("a text reaches beyond its place")
        found[number] = content[start : start + length]
    return found, size
