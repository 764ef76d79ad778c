"""Short names for the types of the arrays in signatures, and what makes arguments such arrays."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[Any]
Bool = NDArray[np.bool_]
U8 = NDArray[np.uint8]
U16 = NDArray[np.uint16]
I16 = NDArray[np.int16]
I32 = NDArray[np.int32]
I64 = NDArray[np.int64]
F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
Rows = NDArray[np.void]  # of a table


def floats(values: ArrayLike) -> F64:
    """Numbers as an array of double precision, of their shape; an array of these is itself. What is
    masked, as in an array of `numpy.ma`, is NaN.

    Raises
    ------
    TypeError
        They are no real numbers.
    """
    if isinstance(values, list | tuple) and any(np.ma.isMaskedArray(one) for one in values):
        values = [floats(one) for one in values]
    if np.ma.isMaskedArray(values):
        values = np.ma.filled(np.ma.asarray(values).astype(np.float64), np.nan)
    given = np.asarray(values)
    if given.dtype.kind not in "fiubO" or values is None:
        what = "None" if values is None else f"values of the type {given.dtype}"
        raise TypeError(f"real numbers are needed, a value or an array; found {what}")
    return given.astype(np.float64, copy=False)


def all_floats(*values: ArrayLike) -> tuple[F64, ...]:
    """Each of them as such an array."""
    return tuple(map(floats, values))


def as_grid(x: ArrayLike, y: ArrayLike) -> tuple[F64, F64]:
    """Coordinates x[j, i] and y[j, i] of the points of a grid, which is given so, or by its axes
    x[i] and y[j].
    """
    given = floats(x), floats(y)
    across, down = np.meshgrid(*given) if given[0].ndim == given[1].ndim == 1 else given
    return across, down


def in_step(name: str, **values: ArrayLike) -> tuple[F64, ...]:
    """Measured values that belong together, as arrays of one shape: a single number holds for all.
    What is infinite was not measured and is NaN.

    Raises
    ------
    ValueError
        They are of several shapes, or all of them are single numbers; the message begins with
        `name`.
    """
    given = {key: floats(one) for key, one in values.items()}
    shapes = {one.shape for one in given.values() if one.ndim}
    if len(shapes) != 1:
        found = ", ".join(f"{key} {one.shape}" for key, one in given.items())
        raise ValueError(f"{name}: arrays of one shape are needed; found {found}")
    (shape,) = shapes
    known = (np.where(np.isinf(v), np.nan, v) if np.isinf(v).any() else v for v in given.values())
    return tuple(np.broadcast_to(one, shape) for one in known)


def grey_pictures(name: str, images: Iterable[ArrayLike]) -> list[Array]:
    """Pictures of one shape (rows, columns), each of its own type of numbers.

    Raises
    ------
    ValueError
        They are no grey pictures of one shape, or a pixel is masked or not finite; the message
        begins with `name`. TypeError where they are no real numbers.
    """
    given = [np.ma.asarray(one) if np.ma.is_masked(one) else np.asarray(one) for one in images]
    found: list[Array] = [one if one.dtype.kind in "fiub" else floats(one) for one in given]
    shapes = {one.shape for one in found}
    if any(len(shape) != 2 or 0 in shape for shape in shapes) or len(shapes) > 1:
        raise ValueError(
            f"{name}: a grey image is needed, or several of one shape (rows, columns); found"
            f" {', '.join(map(str, sorted(shapes)))}"
        )
    if any(np.ma.is_masked(one) or not np.isfinite(one).all() for one in found):
        raise ValueError(
            f"{name}: pixels that are masked or not finite were found; give each a grey level"
        )
    return found
