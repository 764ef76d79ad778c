"""Single changes to an HDF5 file, each as a function of its path, for lists of cases."""

from __future__ import annotations

import functools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py

Change = Callable[[Path], None]


def changing(change: Callable[[h5py.File], None]) -> Change:
    """What is done to an open file, as something done to the file of a path."""

    @functools.wraps(change)
    def changed(path: Path) -> None:
        with h5py.File(path, "r+") as file:
            change(file)

    return changed


def put(dataset: str, value: Any, at: Any = ()) -> Change:
    """A value of a dataset, or of its rows `at`."""
    return changing(lambda file: file[dataset].__setitem__(at, value))


def attribute(name: str, value: Any) -> Change:
    """An attribute of the file."""
    return changing(lambda file: file.attrs.__setitem__(name, value))


def removed(path: str) -> Change:
    """Without a dataset or group."""
    return changing(lambda file: file.__delitem__(path))


def replaced(path: str, **made: Any) -> Change:
    """A dataset or group that became another dataset."""

    @changing
    def change(file: h5py.File) -> None:
        del file[path]
        file.create_dataset(path, **made)

    return change


def linked(path: str, link: object) -> Change:
    """A dataset or group that became a link."""

    @changing
    def change(file: h5py.File) -> None:
        del file[path]
        file[path] = link

    return change
