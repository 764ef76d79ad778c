"""Places and displacements as a lens without distortion would show them.

A pixel at p from the middle of the picture shows what such a lens would show at
``p (1 + k |p|^2/R^2)``, R being half of the picture's diagonal (Brown 1971, to first order).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import F64, all_floats


def ideal_places(x: ArrayLike, y: ArrayLike, k: float, shape: tuple[int, int]) -> tuple[F64, F64]:
    """Where an ideal lens would show what is at (x, y) in a picture of (rows, columns); pixels."""
    x, y = all_floats(x, y)
    if not k:
        return x, y
    middle_x, middle_y = (shape[1] - 1) / 2, (shape[0] - 1) / 2
    dx, dy = x - middle_x, y - middle_y
    far = 1 + k * (dx * dx + dy * dy) / (middle_x**2 + middle_y**2)
    return middle_x + dx * far, middle_y + dy * far


def ideal_displacement(
    x: ArrayLike, y: ArrayLike, ux: ArrayLike, uy: ArrayLike, k: float, shape: tuple[int, int]
) -> tuple[F64, F64]:
    """Displacements as an ideal lens would show them, of points that are seen at (x, y); pixels."""
    ux, uy = all_floats(ux, uy)
    if not k:
        return ux, uy
    was_x, was_y = ideal_places(x, y, k, shape)
    is_x, is_y = ideal_places(np.add(x, ux), np.add(y, uy), k, shape)
    return is_x - was_x, is_y - was_y
