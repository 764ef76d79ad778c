"""Displacement fields between plain images in one HDF5 file, in the style of NeXus: the group
``/entry/fields`` is an NXdata with the axes (frame, y, x).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from itertools import count
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np

from analysis.arrays import F64, floats
from app.records.record_types import DisplacementField
from app.records.schema import Column, columns_of
from app.session.checked import NUMBER, CheckedFile
from app.session.columns import label, mark, new_hdf5, write
from app.session.dimension_scales import name_sides
from app.session.layout import FORMAT_ATTRIBUTE, Group
from app.session.results_layout import RESULTS_ATTRIBUTE
from app.system.errors import UserError

_GROUP, _SIDES = "/entry/fields", ("fields", "ny", "nx")
_COLUMNS = (
    *columns_of(DisplacementField),
    Column(
        f"{_GROUP}/iterations",
        _SIDES,
        "uint8",
        "1",
        "iterations of the correlation",
        attribute="iterations",
    ),
)
_AXES = (
    Column(f"{_GROUP}/frame", ("fields",), "int64", "1", "image after the reference"),
    Column(
        f"{_GROUP}/y",
        ("ny",),
        "float64",
        "px",
        "y of the box centre; 0 is the centre of the top row of pixels",
    ),
    Column(
        f"{_GROUP}/x",
        ("nx",),
        "float64",
        "px",
        "x of the box centre; 0 is the centre of the left column of pixels",
    ),
)


@contextmanager
def fields_file(
    path: Path,
    images: Sequence[str],
    x_px: F64,
    y_px: F64,
    status_names: Sequence[str],
    settings: Mapping[str, int | float | str],
    units: Mapping[str, str],
) -> Iterator[Callable[[Any], None]]:
    """A new file for the fields of a series of images: a function that writes the field of the next
    image, an `analysis.dic.Field`. All of it is on the disk when the block ends.

    Frame 1 is the first image after the reference.

    Parameters
    ----------
    path : Path
        The file, which must not exist.
    images : sequence of str
        Names of the images, in order; one field of each follows.
    x_px, y_px : ndarray, shape (nx,) and (ny,)
        Centres of the boxes.
    status_names : sequence of str
        What each value of the status means.
    settings : mapping
        How the fields were measured: name -> value; `reference` is the name of that image.
    units : mapping
        Name -> unit of the settings that are numbers.

    Raises
    ------
    OSError
        The disk did not take it.
    """
    with new_hdf5(path, default="entry") as (file, check):
        entry = file.create_group("entry")
        entry.attrs["default"] = "fields"
        entry["title"] = f"displacement from {settings['reference']}"
        source = entry.create_group("settings")
        source["images"] = np.array(list(images), dtype=h5py.string_dtype())
        for name, value in settings.items():
            source[name] = value
            if not isinstance(value, str):
                source[name].attrs["units"] = units[name]
        others = tuple(column.name for column in _COLUMNS if column.name != "ux")
        axes = tuple(column.name for column in _AXES)
        mark(entry, Group("/entry", "NXentry"))
        mark(source, Group("/entry/settings"))
        mark(entry.create_group("fields"), Group(_GROUP, "NXdata", "ux", others, axes))
        numbers = np.arange(1, len(images) + 1)
        for axis, values in zip(_AXES, (numbers, y_px, x_px), strict=True):
            label(write(file, axis.path, values, axis.dtype), axis)
        shape = (len(images), len(y_px), len(x_px))
        meanings = ", ".join(f"{n}: {name}" for n, name in enumerate(status_names))
        for column in _COLUMNS:
            dataset = file.create_dataset(column.path, shape, column.dtype, chunks=(1, *shape[1:]))
            label(dataset, column)
            if column.name == "status":
                dataset.attrs["long_name"] = f"status: {meanings}"
        shapes = {column.path: column.shape for column in (*_AXES, *_COLUMNS)}
        name_sides(file, shapes, {str(axis.shape[0]): axis.path for axis in _AXES})
        check()
        rows = count()

        def append(field: Any) -> None:
            row = next(rows)
            for column in _COLUMNS:
                file[column.path][row] = getattr(field, column.attribute)
            check()

        yield append


class FieldsHeld(NamedTuple):
    """The fields of u_x in a file, in pixels, NaN where not measured.

    `ux_px` and its standard uncertainty `sd_px` have the shape (frames, ny, nx).
    """

    x_px: F64
    y_px: F64
    frames: tuple[int, ...]
    ux_px: F64
    sd_px: F64


def read_fields_file(path: Path) -> FieldsHeld:
    """The fields of u_x in a file that `fields_file` wrote.

    Raises
    ------
    UserError
        The file cannot be read, or holds no such fields.
    """
    shapes = {c.name: c.shape for c in reversed(_AXES)} | dict.fromkeys(("ux", "ux_errors"), _SIDES)
    with CheckedFile(path, "file of displacement fields") as file:
        if not file.has(_GROUP):
            raise UserError(
                f"{path}: an HDF5 file without displacement fields; give a session, or a file that"
                " `slipscope dic` wrote"
            )
        datasets = [
            file.dataset(f"{_GROUP}/{name}", shape, NUMBER) for name, shape in shapes.items()
        ]
        x, y, frame, ux, sd = (floats(file.read(data)) for data in datasets)
    if ux.shape != (len(frame), len(y), len(x)) or sd.shape != ux.shape:
        raise UserError(
            f"{path}: fields of shape {ux.shape} found for {len(frame)} frames of {len(x)} x"
            f" {len(y)} points; correlate again"
        )
    if not all((np.diff(axis) > 0).all() and (abs(axis) < 1e9).all() for axis in (x, y, frame)):
        raise UserError(f"{path}: its grid or its frames do not increase; correlate again")
    return FieldsHeld(x, y, tuple(int(n) for n in frame), ux, sd)


def is_session(path: Path) -> bool:
    """Whether a file is a SlipScope session; False where it cannot be read."""
    return _says(path, FORMAT_ATTRIBUTE)


def is_results(path: Path) -> bool:
    """Whether a file holds results of `slipscope analyze`; False where it cannot be read."""
    return _says(path, RESULTS_ATTRIBUTE)


def _says(path: Path, attribute: str) -> bool:
    try:
        with CheckedFile(path, "session") as file:
            return file.format(attribute) is not None
    except UserError:
        return False
