"""What a session holds as arrays for NumPy and MATLAB."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray

from analysis.dic import Status
from app.files.tabular import Tables
from app.records.record_types import DisplacementField
from app.records.schema import columns_of
from app.session.reader import SessionReader
from app.session.tables import SESSION, AbsentError, of_frames, spelled
from app.system.errors import UserError
from app.system.progress import HowFar

MAT_BYTES = 2**31  # largest array of a MATLAB 5 file


@dataclass(frozen=True, slots=True)
class Array:
    """An array to write: its name with the unit, and its values in consecutive blocks of the first
    axis.
    """

    name: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    blocks: Iterable[NDArray[Any]]


def session_arrays(
    reader: SessionReader, frames: range | None, rows: Sequence[int], tell: HowFar
) -> Iterator[Array]:
    """The columns of every table, named ``TABLE_COLUMN``, those of profiles a row for each frame;
    and the fields of these rows of the results, each when it is its turn.
    """
    header = reader.header
    yield _whole("sample_rate_Hz", header.sample_rate_hz)
    yield _whole("pixel_m", header.pixel_m)
    for what, table in SESSION.items():
        columns = table.columns(reader)
        for name, values in (columns if frames is None else of_frames(columns, frames)).items():
            is_column = values.ndim == 2 and values.shape[1] == 1
            yield _whole(f"{what}_{name}", values[:, 0] if is_column else values)
    numbers = reader.analysed_frames()
    yield _whole("fields_frame", np.array([numbers[row] for row in rows], np.int64))
    yield _whole("fields_x_px", header.grid_x_px)
    yield _whole("fields_y_px", header.grid_y_px)
    yield _whole("fields_status_names", [status.label for status in Status])
    shape = len(rows), len(header.grid_y_px), len(header.grid_x_px)
    for column in columns_of(DisplacementField):
        planes = _planes(reader, rows, column.attribute, tell)
        yield Array(f"fields_{spelled(column.attribute)}", shape, np.dtype(column.dtype), planes)


def table_arrays(tables: Tables) -> Iterator[Array]:
    """The columns of every table that has something in it, named ``TABLE_COLUMN``."""
    for what in tables.names:
        try:
            columns = tables.make(what)
        except AbsentError:
            continue
        tables.tell(what, 0.0)
        for name, values in columns.items():
            yield _whole(f"{what}_{name}", values)


def _whole(name: str, values: Any) -> Array:
    array = np.asarray(values)
    return Array(name, array.shape, array.dtype, [array])


def _planes(
    reader: SessionReader, rows: Sequence[int], name: str, tell: HowFar
) -> Iterator[NDArray[Any]]:
    for n, row in enumerate(rows):
        tell(f"fields of {name}", n / len(rows))
        yield getattr(reader.snapshot(row).field, name)[np.newaxis]


def write_npz(path: Path, arrays: Iterable[Array]) -> int:
    """Write a file that ``numpy.load`` reads; the number of arrays.

    Fields have the shape (fields_frame, y, x); one is in memory at a time.
    """
    count = 0
    with zipfile.ZipFile(path, "x") as archive:
        for array in arrays:
            count += 1
            header = {
                "descr": np.lib.format.dtype_to_descr(array.dtype),
                "fortran_order": False,
                "shape": array.shape,
            }
            with archive.open(f"{array.name}.npy", "w", force_zip64=True) as file:
                np.lib.format.write_array_header_1_0(file, header)
                for block in array.blocks:
                    file.write(np.ascontiguousarray(block, array.dtype).tobytes())
    return count


def write_mat(path: Path, arrays: Iterable[Array]) -> int:
    """Write a file for MATLAB's ``load``; the number of arrays. One of them at a time is in memory.

    Raises
    ------
    UserError
        An array is larger than the format allows.
    """
    import scipy.io  # half of the imports of an export

    count = 0
    with path.open("xb") as file:
        for array in arrays:
            count += 1
            nbytes = math.prod(array.shape) * array.dtype.itemsize
            if nbytes >= MAT_BYTES:
                raise UserError(
                    f"export: {array.name} takes {nbytes / 1e9:.1f} GB, a .mat file holds arrays of"
                    " 2.1 GB; give fewer --frames, or .npz"
                )
            values, end = np.empty(array.shape or (1,), array.dtype), 0
            for block in map(np.atleast_1d, array.blocks):
                begin, end = end, end + len(block)
                values[begin:end] = block
            if array.dtype.kind == "U" and not (values != "").any():
                values[...] = " "  # SciPy writes none of texts that are all empty
            # a file that is open: each array is added to those before
            scipy.io.savemat(cast(Any, file), {array.name: values}, oned_as="column")
    return count
