"""Displacement fields of plain images in one HDF5 file, NeXus style: ``/entry/fields`` is an NXdata
of (frame, y, x).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

from app.errors import UserError
from app.session.checked import NUMBER, CheckedFile
from app.session.layout import FORMAT_ATTRIBUTE


class FieldsWriter:
    """Writes the fields of a series of images, one after the other; frame 1 is the first image
    after the reference.

    Parameters
    ----------
    path : Path
        The file; one of that name is replaced.
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
        self._file = h5py.File(path, "w")
        self._file.attrs.update({"NX_class": "NXroot", "default": "entry", "creator": "SlipScope"})
        entry = self._group(self._file, "entry", "NXentry", default="fields")
        self._dataset(entry, "title", f"displacement from {settings['reference']}")
        source = self._group(entry, "settings", "NXcollection")
        self._dataset(source, "images", np.array(list(images), dtype=h5py.string_dtype()))
        for name, value in settings.items():
            self._dataset(
                source, name, value, **({} if isinstance(value, str) else {"units": units[name]})
            )
        others = [name for name in _COLUMNS if name != "ux"]
        data = self._group(
            entry,
            "fields",
            "NXdata",
            signal="ux",
            axes=["frame", "y", "x"],
            auxiliary_signals=others,
        )
        self._dataset(
            data,
            "frame",
            np.arange(1, len(images) + 1),
            units="1",
            long_name="image after the reference",
        )
        self._dataset(
            data,
            "y",
            y_px,
            units="px",
            long_name="y of the box centre; 0 is the centre of the top row of pixels",
        )
        self._dataset(
            data,
            "x",
            x_px,
            units="px",
            long_name="x of the box centre; 0 is the centre of the left column of pixels",
        )
        shape = (len(images), len(y_px), len(x_px))
        meanings = ", ".join(f"{n}: {name}" for n, name in enumerate(status_names))
        self._columns = {}
        for name, (attribute, dtype, unit, text) in _COLUMNS.items():
            self._columns[attribute] = data.create_dataset(
                name, shape, dtype, chunks=(1, *shape[1:])
            )
            long_name = f"{text}: {meanings}" if name == "status" else text
            self._columns[attribute].attrs.update({"units": unit, "long_name": long_name})

    def append(self, field: Any, /) -> None:
        """Write the field of the next image, an `analysis.dic.Field`."""
        for attribute, column in self._columns.items():
            column[self._next] = getattr(field, attribute)
        self._next += 1

    def close(self) -> None:
        """Close the file. May be called twice."""
        self._file.close()

    def __enter__(self) -> FieldsWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    @staticmethod
    def _group(parent: Any, name: str, nx_class: str, **attributes: Any) -> Any:
        group = parent.create_group(name)
        group.attrs.update({"NX_class": nx_class, **attributes})
        return group

    @staticmethod
    def _dataset(parent: Any, name: str, value: Any, **attributes: str) -> None:
        parent.create_dataset(name, data=value).attrs.update(attributes)


_COLUMNS = {  # dataset -> attribute of a field, type, unit, meaning
    "ux": ("ux_px", "f4", "px", "displacement along x"),
    "uy": ("uy_px", "f4", "px", "displacement along y"),
    "ux_errors": ("ux_std_px", "f4", "px", "standard uncertainty of ux"),
    "uy_errors": ("uy_std_px", "f4", "px", "standard uncertainty of uy"),
    "zncc": ("zncc", "f4", "1", "zero-mean normalised cross-correlation"),
    "status": ("status", "u1", "1", "status"),
    "iterations": ("iterations", "u1", "1", "steps taken to the place"),
}


@dataclass(frozen=True, slots=True)
class FieldsFile:
    """What `read_fields_file` found; pixels, NaN where not measured; `ux_px` and `sd_px` have the
    shape (frames, ny, nx).
    """

    x_px: NDArray[np.float64]
    y_px: NDArray[np.float64]
    ux_px: NDArray[np.float64]
    sd_px: NDArray[np.float64]
    frames: tuple[int, ...]


def read_fields_file(path: Path) -> FieldsFile:
    """The fields of u_x in a file that `FieldsWriter` wrote.

    Raises
    ------
    UserError
        The file can not be read, or holds no such fields.
    """
    shapes = {
        "x": ("nx",),
        "y": ("ny",),
        "ux": ("frames", "ny", "nx"),
        "ux_errors": ("frames", "ny", "nx"),
        "frame": ("frames",),
    }
    with closing(CheckedFile(path, "file of displacement fields")) as file:
        datasets = [
            file.dataset(f"/entry/fields/{name}", shape, NUMBER) for name, shape in shapes.items()
        ]
        found = [np.asarray(file.read(dataset), np.float64) for dataset in datasets]
    x, y, ux, sd, frame = found
    if ux.shape != (len(frame), len(y), len(x)) or sd.shape != ux.shape:
        raise UserError(
            f"{path}: fields of shape {ux.shape} found for {len(frame)} frames of {len(x)} x"
            f" {len(y)} points; correlate again"
        )
    return FieldsFile(x, y, ux, sd, tuple(int(n) for n in frame))


def is_session(path: Path) -> bool:
    """Whether a file is a SlipScope session; False where it can not be read."""
    try:
        with closing(CheckedFile(path, "session")) as file:
            return file.number(FORMAT_ATTRIBUTE) is not None
    except UserError:
        return False
