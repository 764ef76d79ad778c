"""The grid of a displacement field: even, square, its columns along x."""

from __future__ import annotations

import numpy as np

from analysis.arrays import F64

UNEVEN = 1e-3  # points may lie off a regular grid by this share of a pitch


def grid_pitch(x: F64, y: F64, who: str) -> float:
    """Distance between neighbouring points, metres, of a grid with coordinates `x` and `y`, both of
    shape (ny, nx); either may fall along its axis.

    Raises
    ------
    ValueError
        There are fewer than two points each way, x does not change along the rows only and y along
        the columns only, or the steps differ; `who` begins the message.
    """
    known = np.isfinite(x).all() and np.isfinite(y).all()
    if x.ndim != 2 or min(x.shape) < 2 or x.shape != y.shape or not known:
        raise ValueError(
            f"{who}: a grid of shapes {x.shape} and {y.shape} was given; two or more points each"
            " way are needed, all of them finite"
        )
    along, across = np.diff(x[0]), np.diff(y[:, 0])
    pitch = abs(float(np.median(along)))
    if not 0 < pitch < np.inf:
        raise ValueError(
            f"{who}: x does not grow along the rows of the grid; give x[j, i] and y[j]"
        )
    other = abs(float(np.median(across)))
    if not abs(other / pitch - 1) < UNEVEN:
        raise ValueError(
            f"{who}: the points lie at {pitch:.4g} m along x and at {other:.4g} m along y;"
            " interpolate them on a square grid"
        )
    even_x = x[0, 0] + np.sign(along[0]) * pitch * np.arange(x.shape[1])
    even_y = y[0, 0] + np.sign(across[0]) * pitch * np.arange(x.shape[0])
    off = max(float(np.abs(x - even_x).max()), float(np.abs(y - even_y[:, None]).max()))
    if not off < 10 * UNEVEN * pitch * max(x.shape):
        raise ValueError(f"{who}: the points lie off an even grid by {off:.2g} m; interpolate them")
    return pitch
