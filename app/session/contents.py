"""What lies where in an HDF5 file: the one place where HDF5 opens a file to read it.

HDF5 says here of each dataset of the layout its type and its shape, and of texts all, of numbers
the places of their bytes, which are read by `app.session.dataset_bytes`: HDF5 does not notice that
a chunk is shorter than it should be. HDF5 trusts what a file says of itself, and may crash, never
come back or take gigabytes: `app.session.vetting` has it do this for strangers' files in another
process.
"""

from __future__ import annotations

import math
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import h5py
import msgspec
import numpy as np

from app.records.schema import TEXT
from app.session import layout, results_layout
from app.system.disk import is_locked

_ANOTHER, COPY = "give a {} that SlipScope wrote", "use a copy of it if there is one"
_FILTERS = {h5py.h5z.FILTER_DEFLATE, h5py.h5z.FILTER_SHUFFLE, h5py.h5z.FILTER_FLETCHER32}
_UNLOCKED = "unable to lock"  # as HDF5 says it
ALTERED = "the bytes are not those that were written"
LARGEST_TEXTS = 1 << 25  # bytes of all texts of a dataset: a run of hours has less than a tenth
_TEXTS_AT_ONCE = 256  # rows
Size = Annotated[int, msgspec.Meta(ge=0, lt=1 << 62)]


class Refused(Exception):
    """A file that cannot be read: what was found, and what to do with it; ``{}`` stands for what
    it should be.
    """


class Held(msgspec.Struct, frozen=True):
    """A dataset, or why it cannot be read (`fault`).

    `dtype` is numpy's or `TEXT`; `chunks` is empty where the bytes lie in one piece. `places` are
    rows of 64-bit integers: the first element of a chunk, which filters were left out (bits), its
    place in the file and its length there. What has no place is `fill`. Texts are `texts`, one
    after the other.
    """

    shape: tuple[Size, ...] = ()
    dtype: Annotated[str, msgspec.Meta(pattern="^(text|[<>|][iuf][1248])$")] = "|u1"
    chunks: tuple[Annotated[int, msgspec.Meta(ge=1, lt=1 << 31)], ...] = ()
    filters: tuple[int, ...] = ()
    fill: bytes = b""
    places: bytes = b""
    texts: tuple[bytes, ...] = ()
    fault: str = ""


class Contents(msgspec.Struct, frozen=True):
    """The datasets of a file by their paths, its groups, and which format it says it has, by the
    names of the attributes that say so.
    """

    formats: dict[str, int]
    groups: tuple[str, ...]
    datasets: dict[str, Held]


def contents_of(path: Path) -> Contents:
    """What lies where in a file.

    Raises
    ------
    Refused
        It is not HDF5, is cut short, or not as SlipScope writes it.
    """
    with _opened(path) as file:
        if file.userblock_size or file.id.get_create_plist().get_sizes() != (8, 8):
            raise Refused("HDF5, but not as SlipScope writes it", _ANOTHER)
        formats = _formats(file)
        named, paths = [group.path for group in layout.GROUPS], [*layout.BY_PATH]
        if results_layout.RESULTS_ATTRIBUTE in formats:
            paths = [*results_layout.datasets_of(file)]
            inner = dict.fromkeys(path.rpartition("/")[0] for path in paths)
            named = [*inner, *filter(None, dict.fromkeys(g.rpartition("/")[0] for g in inner))]
        groups, datasets, opened = [], {}, {"": file.id}
        for group in named:
            try:
                place = _inside(group, opened)
            except Exception as error:  # whatever HDF5 throws while it reads damaged bytes
                datasets[group] = Held(fault=said_by(error))
                continue
            if isinstance(place, h5py.h5g.GroupID):
                groups.append(group)
        for dataset in paths:
            try:
                if (place := _inside(dataset, opened)) is not None:
                    datasets[dataset] = _held(place)
            except Exception as error:
                datasets[dataset] = Held(fault=said_by(error))
        return Contents(formats, tuple(groups), datasets)


def _formats(file: h5py.File) -> dict[str, int]:
    found = {}
    for name in (
        layout.FORMAT_ATTRIBUTE,
        results_layout.RESULTS_ATTRIBUTE,
        results_layout.RECORDS_ATTRIBUTE,
    ):
        if name not in file.attrs:
            continue
        about = file.attrs.get_id(name)
        if about.shape == () and about.dtype.kind in "iu":
            found[name] = int(file.attrs[name])
    return found


def _inside(path: str, opened: dict[str, h5py.h5g.GroupID]) -> Any:
    """What lies at a path; None for nothing. Only hard links are followed: they cannot leave the
    file. Groups that were `opened` are not looked for again, the root is one of them.
    """
    if path in opened:
        return opened[path]
    above, _, said = path.rpartition("/")
    place, name = _inside(above, opened), said.encode()
    if not isinstance(place, h5py.h5g.GroupID) or not place.links.exists(name):
        return None
    if place.links.get_info(name).type != h5py.h5l.TYPE_HARD:
        raise ValueError("it is a link to elsewhere")
    found = h5py.h5o.open(place, name)
    if isinstance(found, h5py.h5g.GroupID):
        opened[path] = found
    return found


def _held(dataset: Any) -> Held:
    how = dataset.get_create_plist() if isinstance(dataset, h5py.h5d.DatasetID) else None
    if how is None or how.get_layout() == h5py.h5d.VIRTUAL or how.get_external_count():
        raise ValueError("it is not a dataset of this file")
    if how.get_layout() == h5py.h5d.COMPACT:
        raise ValueError("its bytes lie in its header; repack the file with another layout")
    shape = dataset.shape
    if shape is None:
        raise ValueError("it is empty")
    filters = tuple(how.get_filter(n)[0] for n in range(how.get_nfilters()))
    if foreign := set(filters) - _FILTERS:
        raise ValueError(
            f"it is compressed by filter {min(foreign)}, which needs a plug-in; repack it without"
        )
    kind = dataset.dtype
    is_text = kind.kind == "O" and isinstance(dataset.get_type(), h5py.h5t.TypeStringID)
    if not is_text and (kind.kind not in "iuf" or kind.itemsize > 8):
        raise ValueError(f"it is {len(shape)}-dimensional {kind}")
    if is_text:
        return Held(shape, TEXT, texts=_texts(h5py.Dataset(dataset, readonly=True)))
    chunks = how.get_chunk() if how.get_layout() == h5py.h5d.CHUNKED else ()
    places = _chunks(dataset) if chunks else []
    if not chunks and dataset.get_offset() is not None:
        places = [(0, dataset.get_offset(), dataset.get_storage_size())]
    fill = np.zeros(1, kind)
    how.get_fill_value(fill)
    packed = np.array(places, np.int64).tobytes()
    return Held(shape, kind.str, chunks, filters, fill.tobytes(), packed)


def _texts(dataset: Any) -> tuple[bytes, ...]:
    found: list[bytes] = []
    nbytes = 32 * dataset.size  # of the rows themselves, in the file and here
    for first in range(0, max(1, dataset.size), _TEXTS_AT_ONCE):
        try:
            rows = dataset[first : first + _TEXTS_AT_ONCE] if dataset.shape else [dataset[()]]
        except OSError:
            raise ValueError(ALTERED) from None
        nbytes += sum(map(len, rows))
        if nbytes > LARGEST_TEXTS:
            raise ValueError(f"its texts claim more than {LARGEST_TEXTS} bytes")
        found.extend(rows)
    return tuple(found)


def _chunks(dataset: Any) -> list[tuple[int, ...]]:
    found: list[tuple[int, ...]] = []

    def add(chunk: Any) -> None:
        found.append((*chunk.chunk_offset, chunk.filter_mask, chunk.byte_offset, chunk.size))

    if math.prod(dataset.shape):
        dataset.chunk_iter(add)
    return found


@contextmanager
def _opened(path: Path) -> Iterator[h5py.File]:
    try:
        with path.open("rb") as opened:
            opened.read(1)
        try:
            file = h5py.File(path, "r")
        except OSError as error:
            if _UNLOCKED not in str(error) or is_locked(path):
                raise
            file = h5py.File(path, "r", locking=False)  # a file system without locks
    except OSError as error:
        cause = str(error)
        if "signature not found" in cause:
            raise Refused("cannot be read, it is not an HDF5 file", _ANOTHER) from None
        if "truncated file" in cause:
            again = "copy it again from where it came"
            found = "the file is cut short, as by a kill or a copy that was broken off"
            raise Refused(found, again) from None
        if _UNLOCKED in cause:
            wait = "wait for its end"
            raise Refused("another program is writing to it", wait) from None
        cause = os.strerror(error.errno) if error.errno else cause
        raise Refused(f"the {{}} cannot be read: {cause}", COPY) from None
    except Exception as error:
        raise Refused(f"the {{}} is damaged at its beginning: {said_by(error)}", COPY) from None
    with file:
        yield file


def said_by(error: Exception) -> str:
    """What an error says, in one line; its kind where it says nothing."""
    return " ".join(str(error).split()) or type(error).__name__
