"""Displacement fields between plain images in one HDF5 file, in the style of NeXus: the group
``/entry/fields`` is an NXdata with the axes (frame, y, x).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np
from numpy.typing import NDArray

from app.records.record_types import DisplacementField
from app.records.schema import columns_of
from app.session.checked import NUMBER, CheckedFile
from app.session.layout import FORMAT_ATTRIBUTE
from app.session.results_layout import RESULTS_ATTRIBUTE
from app.system.errors import UserError

_COLUMNS = {  # dataset -> attribute of a field, type, unit, meaning
    **{c.name: (c.attribute, c.dtype, c.unit, c.meaning) for c in columns_of(DisplacementField)},
    "iterations": ("iterations", "uint8", "1", "iterations of the correlation"),
}
_AXES = {  # dataset -> unit, meaning
    "frame": ("1", "image after the reference"),
    "y": ("px", "y of the box centre; 0 is the centre of the top row of pixels"),
    "x": ("px", "x of the box centre; 0 is the centre of the left column of pixels"),
}


class FieldsWriter:
    """Writes the fields of a series of images, one after the other.

    Frame 1 is the first image after the reference. Use it with `contextlib.closing`.

    Parameters
    ----------
    path : Path
        The file, which must not exist.
    images : sequence of str
        Names of the images, in order; one field of each follows by `append`.
    x_px, y_px : ndarray, shape (nx,) and (ny,)
        Centres of the boxes.
    status_names : sequence of str
        What each value of the status means.
    settings : mapping
        How the fields were measured: name -> value; `reference` is the name of that image.
    units : mapping
        Name -> unit of the settings that are numbers.
    """

    def __init__(
        self,
        path: Path,
        images: Sequence[str],
        x_px: NDArray[np.float64],
        y_px: NDArray[np.float64],
        status_names: Sequence[str],
        settings: Mapping[str, int | float | str],
        units: Mapping[str, str],
    ) -> None:
        self._next = 0
        self._file = h5py.File(path, "x")
        self._file.attrs.update({"NX_class": "NXroot", "default": "entry", "creator": "SlipScope"})
        entry = self._group(self._file, "entry", "NXentry", default="fields")
        entry["title"] = f"displacement from {settings['reference']}"
        source = self._group(entry, "settings", "NXcollection")
        source["images"] = np.array(list(images), dtype=h5py.string_dtype())
        for name, value in settings.items():
            source[name] = value
            if not isinstance(value, str):
                source[name].attrs["units"] = units[name]
        others = [name for name in _COLUMNS if name != "ux"]
        data = self._group(
            entry, "fields", "NXdata", signal="ux", axes=list(_AXES), auxiliary_signals=others
        )
        for name, values in (("frame", np.arange(1, len(images) + 1)), ("y", y_px), ("x", x_px)):
            data[name] = values
            data[name].attrs["units"], data[name].attrs["long_name"] = _AXES[name]
        shape = (len(images), len(y_px), len(x_px))
        meanings = ", ".join(f"{n}: {name}" for n, name in enumerate(status_names))
        self._columns = {}
        for name, (attribute, dtype, unit, text) in _COLUMNS.items():
            column = data.create_dataset(name, shape, dtype, chunks=(1, *shape[1:]))
            long_name = f"status: {meanings}" if name == "status" else text
            column.attrs.update({"units": unit, "long_name": long_name})
            self._columns[attribute] = column

    def append(self, field: Any, /) -> None:
        """Write the field of the next image, an `analysis.dic.Field`."""
        for attribute, column in self._columns.items():
            column[self._next] = getattr(field, attribute)
        self._next += 1

    def close(self) -> None:
        """Close the file. May be called twice."""
        self._file.close()

    @staticmethod
    def _group(parent: Any, name: str, nx_class: str, **attributes: Any) -> Any:
        group = parent.create_group(name)
        group.attrs.update({"NX_class": nx_class, **attributes})
        return group


class FieldsHeld(NamedTuple):
    """The fields of u_x in a file, in pixels, NaN where not measured.

    `ux_px` and its standard uncertainty `sd_px` have the shape (frames, ny, nx).
    """

    x_px: NDArray[np.float64]
    y_px: NDArray[np.float64]
    frames: tuple[int, ...]
    ux_px: NDArray[np.float64]
    sd_px: NDArray[np.float64]


def read_fields_file(path: Path) -> FieldsHeld:
    """The fields of u_x in a file that `FieldsWriter` wrote.

    Raises
    ------
    UserError
        The file can not be read, or holds no such fields.
    """
    shapes = {
        "x": ("nx",),
        "y": ("ny",),
        "frame": ("frames",),
        "ux": ("frames", "ny", "nx"),
        "ux_errors": ("frames", "ny", "nx"),
    }
    with closing(CheckedFile(path, "file of displacement fields")) as file:
        datasets = [
            file.dataset(f"/entry/fields/{name}", shape, NUMBER) for name, shape in shapes.items()
        ]
        x, y, frame, ux, sd = (np.asarray(file.read(data), np.float64) for data in datasets)
    if ux.shape != (len(frame), len(y), len(x)) or sd.shape != ux.shape:
        raise UserError(
            f"{path}: fields of shape {ux.shape} found for {len(frame)} frames of {len(x)} x"
            f" {len(y)} points; correlate again"
        )
    if not all((np.diff(axis) > 0).all() and (abs(axis) < 1e9).all() for axis in (x, y, frame)):
        raise UserError(f"{path}: its grid or its frames do not increase; correlate again")
    return FieldsHeld(x, y, tuple(int(n) for n in frame), ux, sd)


def is_session(path: Path) -> bool:
    """Whether a file is a SlipScope session; False where it can not be read."""
    return _says(path, FORMAT_ATTRIBUTE)


def is_results(path: Path) -> bool:
    """Whether a file holds results of `slipscope analyze`; False where it can not be read."""
    return _says(path, RESULTS_ATTRIBUTE)


def _says(path: Path, attribute: str) -> bool:
    try:
        with closing(CheckedFile(path, "session")) as file:
            return file.format(attribute) is not None
    except UserError:
        return False
