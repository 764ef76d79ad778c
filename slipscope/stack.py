"""Images or fields of a file as an array of three dimensions, each plane read when it is used."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, SupportsIndex

import numpy as np
from numpy.typing import DTypeLike, NDArray

from analysis.arrays import Array, Bool

Chosen = slice | list[int] | NDArray[np.integer[Any]] | Bool  # along the time


class Stack:
    """An array of shape (t, y, x) that reads only the requested planes.

    ``stack[3]`` is a plane, ``stack[10:20, 5]`` a row of ten of them, shape (10, x); the first
    index may be a list or an array of numbers or of booleans too. `numpy.asarray` reads all of it,
    ``dask.array.from_array(stack, chunks=(1, -1, -1))`` nothing before it computes.

    Parameters
    ----------
    shape : (int, int, int)
    dtype : dtype
    plane : callable
        Reads the plane of a number, shape (y, x).
    """

    ndim = 3

    def __init__(
        self,
        shape: tuple[int, int, int],
        dtype: DTypeLike,
        plane: Callable[[SupportsIndex], Array],
    ) -> None:
        self.shape, self.dtype, self._plane = shape, np.dtype(dtype), plane

    def __repr__(self) -> str:
        return f"<{type(self).__name__} of shape {self.shape}, {self.dtype}>"

    def __len__(self) -> int:
        return self.shape[0]

    def __iter__(self) -> Iterator[Array]:
        return (self._plane(n) for n in range(len(self)))

    def __array__(self, dtype: DTypeLike | None = None, copy: bool | None = None) -> Array:
        if copy is False:
            raise ValueError(f"{type(self).__name__}: it is read from the file, which is a copy")
        return np.asarray(self[:], dtype)

    def __getitem__(self, key: Any, /) -> Array:
        wanted, *inner = key if isinstance(key, tuple) else (key,)
        if wanted is Ellipsis:  # the axes that are not named
            wanted, inner = slice(None), [*[slice(None)] * (2 - len(inner)), *inner]
        if isinstance(wanted, SupportsIndex) and not isinstance(wanted, np.ndarray):
            plane: Array = self._plane(wanted)[tuple(inner)]
            return plane
        planes = [self._plane(n)[tuple(inner)] for n in chosen(wanted, len(self))]
        if planes:
            return np.stack(planes)
        return np.empty((0, *self.shape[1:]), self.dtype)[(slice(None), *inner)]


def chosen(wanted: Chosen, count: int) -> list[int] | range:
    """The numbers that a slice, a list or an array chooses of so many."""
    if isinstance(wanted, slice):
        return range(count)[wanted]
    numbers: list[int] = np.arange(count)[np.asarray(wanted)].tolist()
    return numbers
