"""Groups, columns and stacks of images in an HDF5 file, made as the layout says, growing by rows
that are all there or not at all.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping, Sequence
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from app.session import layout
from app.session.layout import GROWING, Group, Item


class Table:
    """The growing columns of one group, which lengthen together.

    Rows wait in memory until `flush`; one that fails leaves them waiting and the columns as they
    were. A column of shape (rows, width) is as wide as its longest row; shorter ones end in NaN.
    """

    def __init__(self, file: h5py.File, group: str) -> None:
        columns = [
            item
            for item in layout.items_of(group)
            if item.shape and item.shape[0] in GROWING and item.rows > 1
        ]
        self._columns = {item.name: file[item.path] for item in columns}
        self._waiting: dict[str, list[Sequence[Any]]] = {name: [] for name in self._columns}
        self._written = 0
        self._length = 0

    def __len__(self) -> int:
        """Rows so far, written or waiting."""
        return self._length

    def append(self, **row: Any) -> None:
        """Add one row, a value for each column."""
        self.extend(**{name: [value] for name, value in row.items()})

    def extend(self, **block: Any) -> None:
        """Add rows, a sequence of one length for each column."""
        if block.keys() != self._columns.keys():
            raise TypeError(
                f"session: columns {list(self._columns)} are needed, {list(block)} were given"
            )
        for name, values in block.items():
            self._waiting[name].append(values)
        self._length += len(values)

    def flush(self) -> None:
        """Write the waiting rows."""
        if self._length == self._written:
            return
        try:
            for name, column in self._columns.items():
                _lengthen(column, self._written, self._length, self._waiting[name])
        except BaseException:
            for column in self._columns.values():
                column.resize(self._written, axis=0)
            raise
        self._written = self._length
        for blocks in self._waiting.values():
            blocks.clear()


def _lengthen(column: h5py.Dataset, start: int, end: int, blocks: list[Sequence[Any]]) -> None:
    """Write `blocks` into rows `start` to `end` of a column."""
    if column.ndim == 2:
        rows = [row for block in blocks for row in block]
        width = max(column.shape[1], *(len(row) for row in rows))
        values = np.full((len(rows), width), np.nan)
        for n, row in enumerate(rows):
            values[n, : len(row)] = row
        column.resize((end, width))
    elif column.dtype.kind == "O":
        values = np.array([storable(text) for block in blocks for text in block], dtype=object)
        column.resize(end, axis=0)
    else:
        values = np.concatenate(blocks)
        column.resize(end, axis=0)
    column[start:end] = values


GZIP_LEVEL = 1


def stored(dataset: h5py.Dataset, array: NDArray[Any]) -> bytes | NDArray[Any]:
    """A chunk as it lies in the file: as it is, or deflated where the dataset is compressed."""
    array = np.ascontiguousarray(array)
    if dataset.compression is None:
        return array
    # most of an image is noise, in which little repeats: to look for it takes longer than all the
    # rest
    deflate = zlib.compressobj(GZIP_LEVEL, strategy=zlib.Z_HUFFMAN_ONLY)
    return deflate.compress(array.data) + deflate.flush()


def append_image(images: h5py.Dataset, image: NDArray[Any]) -> tuple[int, NDArray[np.uint8]]:
    """Row at which an image was added, written at once as one chunk, and the bytes of that; on
    failure it was not added.
    """
    _check_fits(images, image)
    row, chunk = int(images.shape[0]), np.frombuffer(stored(images, image), np.uint8)
    try:
        images.resize(row + 1, axis=0)
        images.id.write_direct_chunk((row, 0, 0), chunk)
    except BaseException:
        images.resize(row, axis=0)
        raise
    return row, chunk


def append_fields(columns: list[h5py.Dataset], fields: list[NDArray[Any]]) -> int:
    """Row at which the fields were added, one to each dataset; on failure none of them was."""
    for column, field in zip(columns, fields, strict=True):
        _check_fits(column, field)
    row = int(columns[0].shape[0])
    try:
        for column, field in zip(columns, fields, strict=True):
            column.resize(row + 1, axis=0)
            column[row] = field
    except BaseException:
        for column in columns:
            column.resize(row, axis=0)
        raise
    return row


def _check_fits(dataset: h5py.Dataset, array: NDArray[Any]) -> None:
    if array.shape != dataset.shape[1:] or array.dtype != dataset.dtype:
        raise ValueError(
            f"session: {dataset.name} takes {dataset.shape[1:]} {dataset.dtype}, but {array.shape}"
            f" {array.dtype} was given"
        )


def make_group(
    file: h5py.File,
    group: Group,
    sizes: Mapping[str, int],
    values: Mapping[str, Any],
    image: np.dtype[Any] | None = None,
    compression: str = "none",
) -> None:
    """Make a group with all its datasets, growing ones empty, the others holding their values;
    `compression` is that of the images.
    """
    made = file.create_group(group.path)
    made.attrs["NX_class"] = group.nx_class
    if group.signal:
        made.attrs["signal"] = group.signal
        made.attrs["axes"] = group.axes
    if group.auxiliary_signals:
        made.attrs["auxiliary_signals"] = group.auxiliary_signals
    for item in layout.items_of(group.path):
        filters: dict[str, Any] = {}
        if item.dtype == layout.IMAGE:  # whose checksum is in triggers
            filters = (
                {"compression": "gzip", "compression_opts": GZIP_LEVEL}
                if compression == "gzip"
                else {}
            )
        elif item.dtype != layout.TEXT:
            filters = {"fletcher32": True}
        dataset = _make_dataset(file, item, sizes, values, image, filters)
        dataset.attrs["long_name"] = item.meaning
        if item.unit:
            dataset.attrs["units"] = item.unit
        if item.dtype == layout.IMAGE:
            dataset.attrs["interpretation"] = "image"


def _make_dataset(
    file: h5py.File,
    item: Item,
    sizes: Mapping[str, int],
    values: Mapping[str, Any],
    image: np.dtype[Any] | None,
    filters: Mapping[str, Any],
) -> h5py.Dataset:
    dtype: Any = (
        h5py.string_dtype()
        if item.dtype == layout.TEXT
        else image
        if item.dtype == layout.IMAGE
        else np.dtype(item.dtype)
    )
    growing = [side in GROWING for side in item.shape]
    shape = tuple(
        0 if grows else side if isinstance(side, int) else sizes[side]
        for side, grows in zip(item.shape, growing, strict=True)
    )
    if not any(growing):
        value = values[item.path]
        if item.dtype == layout.TEXT:
            value = (
                storable(value)
                if isinstance(value, str)
                else np.array([storable(text) for text in value], dtype=object)
            )
        return file.create_dataset(item.path, shape, dtype, data=value)
    maxshape = tuple(None if grows else side for side, grows in zip(shape, growing, strict=True))
    chunks = (item.rows, *(side or 32 for side in shape[1:]))
    fill = np.nan if np.issubdtype(dtype, np.floating) else None
    return file.create_dataset(
        item.path, shape, dtype, maxshape=maxshape, chunks=chunks, fillvalue=fill, **filters
    )


def storable(text: str) -> str:
    """The text as HDF5 can hold it: no null character, no half of a surrogate pair."""
    return text.replace("\0", "\\0").encode("utf-8", "backslashreplace").decode()
