"""Short names for the types of the arrays in signatures."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[Any]
Bool = NDArray[np.bool_]
U8 = NDArray[np.uint8]
U16 = NDArray[np.uint16]
I32 = NDArray[np.int32]
I64 = NDArray[np.int64]
F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
Rows = NDArray[np.void]  # of a table


def as_grid(x: ArrayLike, y: ArrayLike) -> tuple[F64, F64]:
    """Coordinates x[j, i] and y[j, i] of the points of a grid, which is given so, or by its axes
    x[i] and y[j].
    """
    x, y = np.asarray(x, dtype=np.float64), np.asarray(y, dtype=np.float64)
    return tuple(np.meshgrid(x, y)) if x.ndim == y.ndim == 1 else (x, y)
