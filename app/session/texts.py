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

import h5py
import numpy as np
from numpy.typing import NDArray

LARGEST_BYTES = 1 << 25  # of all texts of a dataset: a run of hours has less than a tenth of it
_REFERENCE = np.dtype([("length", "<u4"), ("collection", "<u8"), ("object", "<u4")])
_COLLECTION = struct.Struct("<4sB3xQ")  # signature, version, size
_OBJECT = struct.Struct("<H6xQ")  # number, size
_CONTROL = re.compile(r"[\x00-\x08\x0b-\x0d\x0e-\x1f\x7f-\x9f]")  # could steer a terminal


def read_texts(dataset: h5py.Dataset, file: BinaryIO, size: int) -> NDArray[Any]:
    """The texts of a dataset of variable-length UTF-8, an array of its shape; control characters
    are spelled out.

    Parameters
    ----------
    file : binary file
        The file that the dataset lies in, and its `size` in bytes.

    Raises
    ------
    ValueError
        They are not there, or claim more than `LARGEST_BYTES`.
    """
    references = np.frombuffer(_references(dataset, file, size), _REFERENCE)[: dataset.size]
    if int(references["length"].sum(dtype=np.uint64)) > LARGEST_BYTES:
        raise ValueError(f"its texts claim more than {LARGEST_BYTES} bytes")
    collections: dict[int, dict[int, bytes]] = {}
    texts, left = np.full(references.size, "", dtype=object), LARGEST_BYTES
    for n in np.flatnonzero(references["length"]):
        length, place, number = (int(part) for part in references[n])
        if place not in collections:
            collections[place], used = _objects(file, place, min(left, size - place))
            left -= used
        content = collections[place].get(number, b"")
        if len(content) != length:
            raise ValueError(f"a text of {length} bytes is not where it should be")
        text = content.partition(b"\0")[0].decode("utf-8")
        texts[n] = _CONTROL.sub(lambda found: f"\\x{ord(found[0]):02x}", text)
    return texts.reshape(dataset.shape)


def _references(dataset: h5py.Dataset, file: BinaryIO, size: int) -> bytes:
    """Where the texts of a dataset lie, as HDF5 wrote it: 16 bytes each, zero for an empty one."""
    wanted = dataset.size * _REFERENCE.itemsize
    if not wanted:
        return b""
    if wanted > min(size, LARGEST_BYTES):
        raise ValueError(f"it claims {dataset.size} texts in a file of {size} bytes")
    if dataset.chunks is None:
        return _bytes_at(file, dataset.id.get_offset(), wanted)
    pieces, chunk = [], dataset.chunks[0] * _REFERENCE.itemsize
    for row in range(0, dataset.shape[0], dataset.chunks[0]):
        place = dataset.id.get_chunk_info_by_coord((row,))
        pieces.append(
            bytes(chunk) if place.byte_offset is None else _bytes_at(file, place.byte_offset, chunk)
        )
    return b"".join(pieces)


def _objects(file: BinaryIO, place: int, most: int) -> tuple[dict[int, bytes], int]:
    """The objects of a collection by their numbers, and its size, at most `most` bytes."""
    signature, version, size = _COLLECTION.unpack(_bytes_at(file, place, _COLLECTION.size))
    if (signature, version) != (b"GCOL", 1) or not _COLLECTION.size <= size <= most:
        raise ValueError("the place of a text holds something else")
    content = _bytes_at(file, place, size)
    found, at = {}, _COLLECTION.size
    while at + _OBJECT.size <= size:
        number, length = _OBJECT.unpack_from(content, at)
        start, at = at + _OBJECT.size, at + _OBJECT.size + -(-length // 8) * 8
        if number == 0:  # the free space at the end
            break
        if at > size:
            raise ValueError("a text reaches beyond its place")
        found[number] = content[start : start + length]
    return found, size


def _bytes_at(file: BinaryIO, place: int | None, count: int) -> bytes:
    if place is None or place >= 1 << 62:
        raise ValueError("the place of its texts is not in the file")
    file.seek(place)
    content = file.read(count)
    if len(content) != count:
        raise ValueError("its texts lie beyond the end of the file")
    return content
