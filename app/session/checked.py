"""An HDF5 file from anywhere, opened to be read: each dataset is looked at before a byte of it is
taken.

Links that lead elsewhere, data in other files, compression that needs a plug-in and sizes that the
file can not hold are refused.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from app.errors import UserError
from app.schema import TEXT
from app.session.journal import has_journal
from app.session.layout import IMAGE
from app.session.texts import read_texts

SLACK_BYTES = 1 << 24  # padding that a dataset may claim beyond the size of the file
LARGEST_CHUNK_BYTES = 1 << 28  # a chunk is decompressed as a whole
NUMBER = "number"  # any plain integer or float
_BUILT_IN = {
    h5py.h5z.FILTER_DEFLATE,
    h5py.h5z.FILTER_SHUFFLE,
    h5py.h5z.FILTER_FLETCHER32,
    h5py.h5z.FILTER_LZF,
}
_ALTERED = "the bytes are not those that were written"
_COPY = "use a copy of it if there is one"
_DAMAGE = (
    OSError,
    KeyError,
    ValueError,
    RuntimeError,
    TypeError,
    OverflowError,
    MemoryError,
    NotImplementedError,
)


class CheckedFile:
    """An HDF5 file open for reading.

    Parameters
    ----------
    what : str
        What it should be, for error sentences.

    Raises
    ------
    UserError
        From here and from every method: no such file, not HDF5, cut short, damaged, or made to do
        harm.
    """

    def __init__(self, path: Path, what: str) -> None:
        self.path, self._what = path, what
        self._file = _open(path, what)
        self._bytes = path.stat().st_size
        self._places: dict[str, Any] = {"": self._file}
        self._datasets: dict[str, h5py.Dataset] = {}

    def close(self) -> None:
        """Let go of the file. May be called twice."""
        self._file.close()

    def number(self, name: str) -> int | None:
        """The whole number in an attribute of the file; None where there is none."""
        with self.reading(f"its attribute {name}"):
            if name not in self._file.attrs:
                return None
            attribute = self._file.attrs.get_id(name)
            return (
                int(self._file.attrs[name])
                if attribute.shape == () and attribute.dtype.kind in "iu"
                else None
            )

    def has(self, path: str) -> bool:
        """Whether a group or dataset is in the file."""
        return self._place(path) is not None

    def dataset(self, path: str, shape: Sequence[str | int], dtype: str) -> h5py.Dataset:
        """The dataset, once it is sure that it lies in this file, is of that kind and claims no
        more than the file can hold.

        Parameters
        ----------
        shape : sequence of int or str
            Its sides; one that is named may have any length. One or none: it is read as a whole;
            more: by rows.
        dtype : str
            Of numpy, or `TEXT`, `IMAGE`, `NUMBER`.
        """
        if path in self._datasets:
            return self._datasets[path]
        place = self._place(path)
        with self.reading(path):
            if place is None:
                raise ValueError("it is missing")
            if not isinstance(place, h5py.Dataset) or place.is_virtual or place.external:
                raise ValueError("it is not a dataset of this file")
            if place.shape is None or place.ndim != len(shape) or not _is_of(place, dtype):
                raise ValueError(f"it is {place.ndim}-dimensional {place.dtype}")
            if any(
                isinstance(side, int) and side != found
                for side, found in zip(shape, place.shape, strict=True)
            ):
                raise ValueError(f"its shape is {place.shape}")
            filters = place.id.get_create_plist()
            if (
                unknown := {filters.get_filter(n)[0] for n in range(filters.get_nfilters())}
                - _BUILT_IN
            ):
                raise ValueError(
                    f"it is compressed by filter {min(unknown)}, which needs a plug-in; repack it"
                    " without"
                )
            if (
                place.chunks
                and math.prod(place.chunks) * place.dtype.itemsize > LARGEST_CHUNK_BYTES
            ):
                raise ValueError(f"it claims chunks of {place.chunks}")
            self.check_claim(place, place.shape if place.ndim < 2 else place.shape[1:])
        self._datasets[path] = place
        return place

    def read(self, dataset: h5py.Dataset) -> Any:
        """All that is in a dataset: an array, or a number or text where it has no shape."""
        with self.reading(dataset.name):
            self.check_claim(dataset, dataset.shape)
            if dataset.dtype.kind != "O":
                return dataset[()]
            with self.path.open("rb") as file:
                return read_texts(dataset, file, self._bytes)[()]

    @contextmanager
    def reading(self, path: str) -> Iterator[None]:
        """Whatever is thrown while damaged bytes are read, as one sentence."""
        try:
            yield
        except UserError:
            raise
        except _DAMAGE as error:
            found = " ".join(str(error).split()) or type(error).__name__
            raise self.damaged(
                path, _ALTERED if "filter returned failure" in found else found
            ) from error

    def damaged(self, path: str, found: str) -> UserError:
        """The error that says so."""
        return UserError(
            f"{self.path}: the {self._what} is damaged at {path}: {found};"
            f" {_remedy(self.path, _COPY)}"
        )

    def _place(self, path: str) -> Any:
        """What lies at a path; None for nothing.

        Only hard links are followed: they can not leave the file.
        """
        with self.reading(path):
            place, at = self._places[""], ""
            for part in path.strip("/").split("/"):
                at += f"/{part}"
                if at not in self._places:
                    self._places[at] = _inside(place, part)
                place = self._places[at]
            return place

    def check_claim(self, dataset: h5py.Dataset, shape: tuple[int, ...]) -> None:
        """Refuse a dataset of which a part of that shape would be more than the file can hold."""
        if math.prod(shape) * max(1, dataset.dtype.itemsize) > self._bytes + SLACK_BYTES:
            raise ValueError(
                f"it claims the shape {dataset.shape} in a file of {self._bytes} bytes"
            )


def _inside(group: Any, name: str) -> Any:
    if not isinstance(group, h5py.Group) or not group.id.links.exists(name.encode()):
        return None
    if group.id.links.get_info(name.encode()).type != h5py.h5l.TYPE_HARD:
        raise ValueError("it is a link to elsewhere")
    return group[name]


def _is_of(dataset: h5py.Dataset, wanted: str) -> bool:
    found = dataset.dtype
    if wanted == TEXT:
        kind = dataset.id.get_type()
        return (
            isinstance(kind, h5py.h5t.TypeStringID)
            and bool(kind.is_variable_str())
            and dataset.ndim <= 1
        )
    if wanted == IMAGE:
        return found in (np.dtype("u1"), np.dtype("<u2"))
    if wanted == NUMBER:
        return bool(found.kind in "iuf" and found.itemsize <= 8)
    return bool(found == np.dtype(wanted))


def _open(path: Path, what: str) -> h5py.File:
    if not path.is_file():
        raise UserError(f"{path}: there is no such {what} to read; check the name")
    another = _remedy(path, f"give a {what} that SlipScope wrote")
    try:
        with path.open("rb") as opened:
            opened.read(1)
        file = h5py.File(path, "r")
    except OSError as error:
        cause = str(error)
        if "signature not found" in cause:
            raise UserError(f"{path}: can not be read, it is not an HDF5 file; {another}") from None
        if "truncated file" in cause:
            again = _remedy(path, "copy it again from where it came")
            raise UserError(
                f"{path}: the file is cut short, as by a kill or a copy that was broken off;"
                f" {again}"
            ) from None
        if "lock" in cause:
            raise UserError(f"{path}: another program is writing to it; wait for its end") from None
        cause = os.strerror(error.errno) if error.errno else cause
        raise UserError(
            f"{path}: the {what} can not be read: {cause}; {_remedy(path, _COPY)}"
        ) from None
    except _DAMAGE as error:
        raise UserError(
            f"{path}: the {what} is damaged at its beginning: {error}; {_remedy(path, _COPY)}"
        ) from None
    if file.userblock_size or file.id.get_create_plist().get_sizes() != (8, 8):
        file.close()
        raise UserError(f"{path}: HDF5, but not as SlipScope writes it; {another}")
    return file


def _remedy(path: Path, otherwise: str) -> str:
    """What to do with a file that can not be read: its journal, where it has one, brings a session
    back.
    """
    return (
        f"`slipscope repair {path} -o REPAIRED.h5` brings back what its journal holds"
        if has_journal(path)
        else otherwise
    )
