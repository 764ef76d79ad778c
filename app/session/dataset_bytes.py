"""The bytes of a dataset, taken from where they lie in the file: each length is held against what
is there before it is used, and nothing is inflated beyond its chunk.
"""

from __future__ import annotations

import math
import zlib
from functools import lru_cache
from io import FileIO
from typing import Any

import numpy as np

from analysis.arrays import I64, U8, Array
from app.records.schema import TEXT
from app.session.contents import ALTERED, Held
from app.system.disk import read_at

SLACK_BYTES = 1 << 24  # padding that a dataset may claim beyond what is stored of it
LARGEST_CHUNK_BYTES = 1 << 28  # a chunk is decompressed as a whole
DEFLATE, SHUFFLE, FLETCHER32 = 1, 2, 3
_TEXT = np.dtype("V16")  # how a text lies in its row


class Dataset:
    """A dataset of a file of `size` bytes: ``dataset[3]``, ``dataset[3:9]`` and ``dataset[()]`` are
    rows of it, all of it; of numbers only.

    Raises
    ------
    ValueError
        From here and from every method: it claims more than the file holds, or is damaged.
    """

    def __init__(self, file: FileIO, size: int, name: str, held: Held) -> None:
        self._file, self._size, self._held = file, size, held
        self.name, self.shape, self.chunks = name, held.shape, held.chunks
        self.dtype = _TEXT if held.dtype == TEXT else np.dtype(held.dtype)
        self._places = np.frombuffer(held.places, np.int64).reshape(-1, len(held.chunks) + 3)
        fill = np.frombuffer(held.fill, self.dtype)
        self._filling = fill[0] if len(fill) else np.zeros((), self.dtype)[()]
        starts, lengths = self._places[:, -2], self._places[:, -1]
        if (np.minimum(starts, lengths) < 0).any() or (starts > size - lengths).any():
            raise ValueError("its bytes lie beyond the end of the file")
        if held.chunks:
            are_large = self._bytes_of(held.chunks) > LARGEST_CHUNK_BYTES
            if are_large or len(held.chunks) != len(held.shape):
                raise ValueError(f"it claims chunks of {held.chunks}")
            self._places = self._places[np.argsort(self._places[:, 0], kind="stable")]
        # where the chunk that was read last lies, and it; other threads read and replace both
        self._last: tuple[int, Any] = -1, None
        self._most = SLACK_BYTES + (size if self.is_deflated else min(size, sum(lengths.tolist())))

    def __len__(self) -> int:
        return self.shape[0]

    @property
    def kind(self) -> str:
        """Type of its values: numpy's, or `TEXT`."""
        return self._held.dtype

    @property
    def fletcher32(self) -> bool:
        """Whether each chunk has a checksum."""
        return FLETCHER32 in self._held.filters

    @property
    def is_deflated(self) -> bool:
        """Whether it is compressed."""
        return DEFLATE in self._held.filters

    def check_claim(self, shape: tuple[int, ...]) -> None:
        """Refuse a part of that shape if it is more than the file holds of this dataset."""
        if self._bytes_of(shape) > self._most:
            raise ValueError(
                f"it claims the shape {self.shape} in a file of {self._size} bytes, which holds"
                f" {self._most - SLACK_BYTES} of it"
            )

    def __getitem__(self, rows: Any) -> Array:
        if isinstance(rows, tuple):
            return self._rows(0, len(self) if self.shape else 1)
        if isinstance(rows, slice):
            first, end, _ = rows.indices(len(self))
            return self._rows(first, max(first, end))
        at = int(rows)  # numpy's numbers too
        row: Array = self._rows(at, at + 1)[0]
        return row

    def _rows(self, first: int, end: int) -> Array:
        shape = (end - first, *self.shape[1:]) if self.shape else ()
        self.check_claim(shape)
        if not self.chunks:
            if not len(self._places):
                return np.full(shape, self._filling, self.dtype)
            _, place, held = self._places[0].tolist()
            start, length = first * self._bytes_of(self.shape[1:]), self._bytes_of(shape)
            if start + length > held:
                raise ValueError("its bytes lie beyond the end of their place")
            return self._at(place + start, length).view(self.dtype).reshape(shape)
        rows = np.full(shape, self._filling, self.dtype)
        near = np.searchsorted(self._places[:, 0], [first - self.chunks[0] + 1, end])
        for *corner, mask, place, length in self._places[slice(*near)].tolist():
            chunk: Array
            last, chunk = self._last
            if last != place:
                chunk = self._decoded(self._at(place, length), mask)
                self._last = -1, None
            corner[0] -= first
            if chunk.shape == shape and not any(corner):
                return chunk.copy() if last == place else chunk
            self._last = place, chunk
            # both as far as they lie on one another
            here = tuple(slice(max(0, -at), None) for at in corner)
            there = tuple(slice(max(0, at), None) for at in corner)
            both = tuple(map(min, chunk[here].shape, rows[there].shape))
            shared = tuple(slice(side) for side in both)
            rows[there][shared] = chunk[here][shared]
        return rows

    def _decoded(self, content: U8, mask: int) -> Array:
        """A chunk whose filters are undone, the last one first."""
        wanted = self._bytes_of(self.chunks)
        for n, code in reversed([*enumerate(self._held.filters)]):
            if mask >> n & 1:
                continue
            if code == FLETCHER32:
                content, checksum = content[:-4], content[-4:]
                if fletcher32(content).to_bytes(4, "little") != checksum.tobytes():
                    raise ValueError(ALTERED)
            elif code == DEFLATE:
                content = _inflated(content, wanted + 4)
            else:
                content = content.reshape(self.dtype.itemsize, -1).T.ravel()
        if content.nbytes != wanted:
            raise ValueError(ALTERED)
        chunk: Array = content.view(self.dtype).reshape(self.chunks)
        return chunk

    def _at(self, place: int, length: int) -> U8:
        content = np.empty(length, np.uint8)
        if not read_at(self._file, place, content.data):
            raise ValueError("its bytes lie beyond the end of the file")
        return content

    def _bytes_of(self, shape: tuple[int, ...]) -> int:
        return math.prod(shape) * self.dtype.itemsize


def _inflated(content: U8, most: int) -> U8:
    inflate = zlib.decompressobj()
    try:
        inflated = inflate.decompress(content.data, most)
    except zlib.error:
        raise ValueError(ALTERED) from None
    if not inflate.eof:
        raise ValueError(ALTERED)
    return np.frombuffer(bytearray(inflated), np.uint8)


def fletcher32(content: U8) -> int:
    """The checksum that HDF5 puts behind a chunk: sums of its 16-bit words and of these sums."""
    even = content if content.size % 2 == 0 else np.append(content, np.uint8(0))
    words = even.view(">u2").astype(np.int64)
    if not words.any():
        return 0
    sums = int(words.sum()), int(_weights(len(words)) @ words)
    first, second = ((total - 1) % 65535 + 1 for total in sums)
    return second << 16 | first


@lru_cache(maxsize=64)
def _weights(count: int) -> I64:
    return np.arange(count, 0, -1) % 65535  # so that no sum of products is too large
