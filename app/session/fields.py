"""Displacement fields of plain images in one HDF5 file, NeXus style: ``/entry/fields`` is an NXdata of (frame, y, x)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]


class FieldsWriter:
    """Writes the fields of a series of images, one after the other; frame 1 is the first image after the reference.

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
        How the fields were measured, kept as scalars.
    """

    def __init__(
        self,
        path: Path,
        reference: str,
        images: Sequence[str],
        x_px: NDArray[np.float64],
        y_px: NDArray[np.float64],
        status_names: Sequence[str],
        settings: Mapping[str, int | float],
    ) -> None:
        self._next = 0
        self._file = h5py.File(path, "w")
        self._file.attrs.update({"NX_class": "NXroot", "default": "entry", "creator": "SlipScope"})
        entry = self._group(self._file, "entry", "NXentry", default="fields")
        self._dataset(entry, "title", f"displacement from {reference}")
        source = self._group(entry, "settings", "NXcollection")
        self._dataset(source, "reference", reference)
        self._dataset(source, "images", np.array(list(images), dtype=h5py.string_dtype()))
        for name, value in settings.items():
            self._dataset(source, name, value, units="px" if name in {"box", "step", "search"} else "1")
        data = self._group(entry, "fields", "NXdata", signal="ux", axes=["frame", "y", "x"], auxiliary_signals=["uy", "zncc", "status"])
        self._dataset(data, "frame", np.arange(1, len(images) + 1), units="1", long_name="image after the reference")
        self._dataset(data, "y", y_px, units="px", long_name="y of the box centre; 0 is the centre of the top row of pixels")
        self._dataset(data, "x", x_px, units="px", long_name="x of the box centre; 0 is the centre of the left column of pixels")
        shape = (len(images), len(y_px), len(x_px))
        meanings = ", ".join(f"{n}: {name}" for n, name in enumerate(status_names))
        self._columns = [
            data.create_dataset(name, shape, dtype, chunks=(1, *shape[1:]))
            for name, dtype in zip(_NAMES, ("f4", "f4", "f4", "u1"), strict=True)
        ]
        texts = ("displacement along x", "displacement along y", "zero-mean normalised cross-correlation", f"status: {meanings}")
        for column, unit, text in zip(self._columns, ("px", "px", "1", "1"), texts, strict=True):
            column.attrs.update({"units": unit, "long_name": text})

    def append(self, ux_px: F32, uy_px: F32, zncc: F32, status: NDArray[np.uint8]) -> None:
        """Write the field of the next image; arrays of shape (ny, nx)."""
        for column, values in zip(self._columns, (ux_px, uy_px, zncc, status), strict=True):
            column[self._next] = values
        self._next += 1

    def close(self) -> None:
        """Close the file. May be called twice."""
        self._file.close()

    def __enter__(self) -> FieldsWriter:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None) -> None:
        self.close()

    @staticmethod
    def _group(parent: Any, name: str, nx_class: str, **attributes: Any) -> Any:
        group = parent.create_group(name)
        group.attrs.update({"NX_class": nx_class, **attributes})
        return group

    @staticmethod
    def _dataset(parent: Any, name: str, value: Any, **attributes: str) -> None:
        parent.create_dataset(name, data=value).attrs.update(attributes)


_NAMES = ("ux", "uy", "zncc", "status")
