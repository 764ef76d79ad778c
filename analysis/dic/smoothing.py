"""A field made smooth, and the control points of the spline that reads it anywhere."""

from __future__ import annotations

import numpy as np

from analysis.arrays import F32, F64
from analysis.kernels import compiled


@compiled
def extended(field: F64, pad: int) -> F64:
    """The rows of a field with `pad` more at both ends, mirrored through the first and the last, so
    that a slope goes on.
    """
    n = field.shape[0]
    out = np.empty((n + 2 * pad, field.shape[1]))
    out[pad : pad + n] = field
    for k in range(1, pad + 1):
        inside = min(k, n - 1)
        for j in range(field.shape[1]):
            out[pad - k, j] = 2.0 * field[0, j] - field[inside, j]
            out[pad + n - 1 + k, j] = 2.0 * field[n - 1, j] - field[n - 1 - inside, j]
    return out


@compiled
def averaged(field: F64, width: int) -> F64:
    """Moving averages over `width` rows; that many less one are left."""
    out = np.empty((field.shape[0] - width + 1, field.shape[1]))
    total = np.zeros(field.shape[1])
    for i in range(field.shape[0]):
        for j in range(total.size):
            total[j] += field[i, j]
        if i >= width - 1:
            for j in range(total.size):
                out[i - width + 1, j] = total[j] / width
                total[j] -= field[i - width + 1, j]
    return out


@compiled
def smooth(u: F64, width: int, pad: int, control: F32, centre: F64) -> None:
    """Control points, shape (ny + 2 pad, nx + 2 pad), of a cubic B-spline at the moving averages of
    u, (ny, nx), and its values there.

    The average is over `width` x `width` points (odd); at the edges the field is continued by its
    slope.
    """
    down = averaged(extended(u, pad + width // 2), width)
    points = averaged(extended(np.ascontiguousarray(down.T), pad + width // 2), width)
    control[:] = points.T
    end, last = points.shape[0] - pad + 1, points.shape[1] - pad + 1
    rows = points[pad - 1 : -pad - 1] + 4.0 * points[pad:-pad] + points[pad + 1 : end]
    values = rows[:, pad - 1 : -pad - 1] + 4.0 * rows[:, pad:-pad] + rows[:, pad + 1 : last]
    centre[:] = values.T / 36.0


@compiled
def widen(field: F32, pad: int, out: F32) -> None:
    """A field, shape (ny, nx), with its outermost values repeated `pad` times on all sides."""
    ny, nx = field.shape
    for i in range(out.shape[0]):
        row, source = out[i], field[min(max(i - pad, 0), ny - 1)]
        row[:pad] = source[0]
        row[pad : pad + nx] = source
        row[pad + nx :] = source[nx - 1]
