"""Short names for the types of the arrays in signatures, and what makes arguments such arrays."""

from __future__ import annotations

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
    """Numbers as an array of double precision, of their shape; an array of these is itself."""
    return np.asarray(values, dtype=np.float64)


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
