"""What a session holds as arrays for NumPy and MATLAB."""

from __future__ import annotations

import math
import zipfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import scipy.io
from numpy.typing import NDArray

from analysis.dic import Status
from app.errors import UserError
from app.numbers import NUMBERS
from app.records import (
    DisplacementField,
)
from app.schema import columns_of
from app.session.reader import SessionReader

MAT_BYTES = 2**31  # largest array of a MATLAB 5 file


@dataclass(frozen=True, slots=True)
class _Array:
    """An array to write: its name with the unit, and its values in consecutive blocks of the first
    axis.
    """

    name: str
    shape: tuple[int, ...]
    dtype: np.dtype[Any]
    blocks: Iterable[NDArray[Any]]


def _arrays(
    reader: SessionReader, rows: list[int], tell: Callable[[str, float], None]
) -> Iterator[_Array]:
    """Forces, stage, results and fields of these rows of results, each when it is its turn."""
    header, samples, results = reader.header, reader.forces(), reader.results()[rows]
    stage_sample, stage_m = reader.positions()
    has_field = reader.have_fields()[rows]
    further = {}
    if header.auxiliary is not None and samples.auxiliary is not None:
        named = zip(header.auxiliary.labels, samples.auxiliary.T, strict=True)
        further = {f"auxiliary_{label}": values for label, values in named}
    whole = {
        "sample_rate_hz": header.sample_rate_hz,
        "pixel_m": header.pixel_m,
        "force_P_N": samples.forces[:, 0],
        "force_Q_N": samples.forces[:, 1],
        "normal_sensor_V": samples.volts[:, 0],
        "shear_sensor_V": samples.volts[:, 1],
        **further,
        "stage_sample": stage_sample,
        "stage_m": stage_m,
        # through lists: the phases are texts, as long as the longest of them
        **{f"result_{name}": results[name].tolist() for name in NUMBERS},
        "field_frame": results["frame"][has_field],
        "field_x_px": header.grid_x_px,
        "field_y_px": header.grid_y_px,
        "field_status_names": [status.label for status in Status],
    }
    for name, values in whole.items():
        array = np.asarray(values)
        yield _Array(name, array.shape, array.dtype, [array])
    measured = [row for row, has in zip(rows, has_field, strict=True) if has]
    shape = len(measured), len(header.grid_y_px), len(header.grid_x_px)
    for column in columns_of(DisplacementField):
        planes = _planes(reader, measured, column.attribute, tell)
        yield _Array(f"field_{column.attribute}", shape, np.dtype(column.dtype), planes)


def _planes(
    reader: SessionReader, rows: list[int], name: str, tell: Callable[[str, float], None]
) -> Iterator[NDArray[Any]]:
    for n, row in enumerate(rows):
        tell(f"fields of {name}", n / len(rows))
        yield getattr(reader.snapshot(row).field, name)[np.newaxis]


def write_npz(
    path: Path, reader: SessionReader, rows: list[int], tell: Callable[[str, float], None]
) -> int:
    """Write a file that ``numpy.load`` reads; the number of arrays.

    Fields have the shape (field_frame, y, x); one is in memory at a time.
    """
    count = 0
    with zipfile.ZipFile(path, "x") as archive:
        for array in _arrays(reader, rows, tell):
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


def write_mat(
    path: Path, reader: SessionReader, rows: list[int], tell: Callable[[str, float], None]
) -> int:
    """Write a file for MATLAB's ``load``; the number of arrays. One of them at a time is in memory.

    Raises
    ------
    UserError
        An array is larger than the format allows.
    """
    count = 0
    with path.open("xb") as file:
        for array in _arrays(reader, rows, tell):
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
            # a file that is open: each array is added to those before
            scipy.io.savemat(cast(Any, file), {array.name: values}, oned_as="column")
    return count
