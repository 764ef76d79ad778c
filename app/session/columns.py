"""Groups and datasets in an HDF5 file, made as the layout says; they grow by rows that are written
whole or not at all.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from analysis.arrays import U8
from app.records.record_types import Header
from app.records.schema import TEXT, Column, values
from app.session import layout
from app.session.checks import channels_of
from app.session.layout import CHUNK_ROWS, FORCES_CHUNK, GROWING, IMAGE
from app.session.recorder import GZIP_LEVEL
from app.system.disk import SparedFile

LIBVER = ("v108", "v108")  # checksummed headers, and no open-for-writing mark
_TEXT_TYPE = h5py.string_dtype()
_TEXT_ID, _ONE = h5py.h5t.py_create(_TEXT_TYPE, logical=True), h5py.h5s.create_simple(())


def stored(*records: Any) -> dict[str, Any]:
    """The values of records as the file holds them, by the paths of their datasets."""
    return {c.path: c.stored(value) for record in records for c, value in values(record)}


class ColumnGroup:
    """The columns of one group that grow together.

    Rows wait in memory until `flush`; if that fails they go on waiting, and the columns are as they
    were. A column of shape (rows, width) is as wide as its longest row; shorter rows end in NaN.
    """

    def __init__(self, file: h5py.File, group: str) -> None:
        self._columns = {
            column.path: file[column.path]
            for column in layout.columns_in(group)
            if column.shape and column.shape[0] in GROWING
        }
        self._waiting: dict[str, list[Any]] = {path: [] for path in self._columns}
        self._written = self._length = 0

    def __len__(self) -> int:
        """Rows so far, written or waiting."""
        return self._length

    def append(self, row: Mapping[str, Any]) -> None:
        """Add one row; of the values, those for columns of this table are taken."""
        self.extend({path: [row[path]] for path in self._columns})

    def extend(self, block: Mapping[str, Any]) -> None:
        """Add as many rows as each column is given values."""
        for path, waiting in self._waiting.items():
            waiting.append(block[path])
        self._length += len(block[path])

    def flush(self) -> None:
        """Write the waiting rows."""
        if self._length == self._written:
            return
        try:
            for path, column in self._columns.items():
                _lengthen(column, self._written, self._length, self._waiting[path])
        except BaseException:
            for column in self._columns.values():
                column.resize(self._written, axis=0)
            raise
        self._written = self._length
        for waiting in self._waiting.values():
            waiting.clear()


def _lengthen(column: h5py.Dataset, start: int, end: int, blocks: list[Any]) -> None:
    """Write `blocks` into rows `start` to `end` of a column."""
    if column.ndim == 2:
        rows = [row for block in blocks for row in block]
        width = max(column.shape[1], *(len(row) for row in rows))
        block = np.full((len(rows), width), np.nan)
        for n, row in enumerate(rows):
            block[n, : len(row)] = row
    elif column.dtype.kind == "O":
        block = np.array([storable(text) for block in blocks for text in block], _TEXT_TYPE)
    else:
        block = np.ascontiguousarray(np.concatenate(blocks))
    column.id.set_extent((end, *block.shape[1:]))
    rows = column.id.get_space()  # as `column[start:end] = block`, without what it looks up
    rows.select_hyperslab((start, *(0 for _ in block.shape[1:])), block.shape)
    column.id.write(h5py.h5s.create_simple(block.shape), rows, block)


def append_chunk(images: h5py.Dataset, chunk: U8) -> int:
    """Row at which an image was added, as it lies in the file: one chunk."""
    row = int(images.shape[0])
    images.resize(row + 1, axis=0)
    images.id.write_direct_chunk((row, 0, 0), chunk)
    return row


def place_images(file: h5py.File, header: Header, count: int) -> None:
    """Make a dataset of images that nothing is written to: they lie where it begins already."""
    created = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    created.set_layout(h5py.h5d.CONTIGUOUS)
    created.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    created.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
    kind = h5py.h5t.py_create(np.dtype(header.frame_dtype))
    space = h5py.h5s.create_simple((count, *header.frame_shape))
    group = file.create_group(layout.IMAGES.group)
    h5py.h5d.create(group.id, layout.IMAGES.name.encode(), kind, space, created)


def make_group(
    file: h5py.File, path: str, values: Mapping[str, Any], header: Header | None = None
) -> None:
    """Make a group with all its datasets, the growing ones empty, the others with their values.

    `header` is needed where the group has images or fields.
    """
    group = next(group for group in layout.GROUPS if group.path == path)
    made = file.require_group(path)  # once: for each full path HDF5 would look its groups up again
    mark(made, group)
    for column in layout.columns_in(path):
        if column.dtype == IMAGE and column.path in file:
            dataset = file[column.path]  # images that lay there already
        elif GROWING.isdisjoint(column.shape):
            value, how = values[column.path], {}
            if len(column.shape) > 1:  # as large as an image
                how = {"chunks": np.shape(value), "fletcher32": True}
            dataset = write(made, column.name, value, column.dtype, **how)
        else:
            dataset = _make_empty(made, column, header)
        label(dataset, column)
        if column.dtype == IMAGE:
            say(dataset, "interpretation", "image")


def mark(made: h5py.Group, group: layout.Group) -> None:
    """Say of a group what it is to a NeXus program."""
    say(made, "NX_class", group.nx_class)
    if group.signal:
        say(made, "signal", group.signal)
        made.attrs["axes"] = group.axes
    if group.auxiliary_signals:
        made.attrs["auxiliary_signals"] = group.auxiliary_signals


def write(group: h5py.Group, path: str, value: Any, dtype: str, **how: Any) -> h5py.Dataset:
    """Make a dataset of a number or text, or of an array or several of them."""
    if dtype != TEXT:
        return group.create_dataset(path, data=np.asarray(value, dtype), **how)
    texts = storable(value) if isinstance(value, str) else np.array([*map(storable, value)], object)
    return group.create_dataset(path, data=texts, dtype=_TEXT_TYPE)


def label(dataset: h5py.Dataset, column: Column) -> None:
    """Say in the file what a dataset means, and in which unit."""
    say(dataset, "long_name", column.meaning)
    if column.unit:
        say(dataset, "units", column.unit)


def say(made: h5py.Group | h5py.Dataset, name: str, text: str) -> None:
    """Give a group or dataset a new attribute, as `attrs` does, which first sees whether there is
    one of that name.
    """
    attribute = h5py.h5a.create(made.id, name.encode(), _TEXT_ID, _ONE)
    attribute.write(np.array(text, _TEXT_TYPE))


def _make_empty(group: h5py.Group, column: Column, header: Header | None) -> h5py.Dataset:
    sides: dict[str | int, int] = {}
    dtype: Any = _TEXT_TYPE if column.dtype == TEXT else column.dtype
    filters: dict[str, Any] = {} if column.dtype == TEXT else {"fletcher32": True}
    if header is not None:
        sides = {"nx": len(header.grid_x_px), "ny": len(header.grid_y_px)}
        sides["channels"] = channels_of(header)
        sides |= dict(zip(("rows", "columns"), header.frame_shape, strict=True))
        if column.dtype == IMAGE:  # the checksum of an image is in triggers
            dtype, filters = header.frame_dtype, {}
            if header.compression == "gzip":
                filters = {"compression": "gzip", "compression_opts": GZIP_LEVEL}
    rows = FORCES_CHUNK if column.shape[0] == "samples" else CHUNK_ROWS[len(column.shape)]
    rest = [0 if side in GROWING else sides[side] for side in column.shape[1:]]
    return group.create_dataset(
        column.name,
        (0, *rest),
        dtype,
        maxshape=(None, *(side or None for side in rest)),
        chunks=(rows, *(side or 32 for side in rest)),
        fillvalue=np.nan if np.issubdtype(dtype, np.floating) else None,
        **filters,
    )


def storable(text: str) -> str:
    """The text as HDF5 can hold it: no null character, no half of a surrogate pair."""
    return text.replace("\0", "\\0").encode("utf-8", "backslashreplace").decode()


@contextmanager
def new_hdf5(
    path: Path, *, libver: tuple[str, str] | None = None, **root: Any
) -> Iterator[tuple[h5py.File, Callable[[], None]]]:
    """A new file to fill, with more attributes of its root, and a function that raises the first
    failure of the disk. All of it is on the disk when the block ends.
    """
    path.touch(exist_ok=False)
    disk, file = SparedFile(path), None
    try:
        file = h5py.File(disk, "w", libver=libver)
        file.attrs.update({"NX_class": "NXroot", "creator": "SlipScope"} | root)
        yield file, disk.check
        file.close()
        disk.sync()
    finally:
        let_go(disk, file)


def let_go(disk: SparedFile, file: h5py.File | None) -> None:
    """Close a file as it is."""
    disk.spare()
    with suppress(Exception):
        if file is not None:
            file.close()
    disk.close()
