"""A field made smooth, and the control points of the spline that reads it anywhere."""

from __future__ import annotations

import numpy as np

from analysis.arrays import F32, F64
from analysis.kernels import compiled


@compiled
def nearest(i: int, n: int) -> tuple[int, int]:
    """Of n places that one nearest to place i, and the mirror image of i in it: beyond the ends,
    twice the value there less that of the mirror image goes on with the slope.
    """
    end = min(max(i, 0), n - 1)
    return end, min(max(2 * end - i, 0), n - 1)


@compiled
def average_down(field: F64, width: int, pad: int, out: F64) -> None:
    """Moving averages over `width` rows (odd) of a field, shape (n, m), continued by `pad` rows at
    both ends, shape (n + 2 pad, m).
    """
    half, (n, m) = width // 2, field.shape
    total = np.zeros(m)
    for i in range(-pad - half, n + pad + half):
        end, mirrored = nearest(i, n)
        for j in range(m):
            total[j] += 2.0 * field[end, j] - field[mirrored, j]
        if i >= half - pad:
            end, mirrored = nearest(i - width + 1, n)
            for j in range(m):
                out[i + pad - half, j] = total[j] / width
                total[j] -= 2.0 * field[end, j] - field[mirrored, j]


@compiled
def smooth(u: F64, width: int, work: tuple[F64, F64], control: F32, centre: F64) -> None:
    """Control points of a cubic B-spline at the moving averages of u, (ny, nx), and its values
    there.

    The average is over `width` x `width` points (odd); at the edges the field is continued by its
    slope. `control` extends beyond u by the same number of points on each side; `work`, of the
    shapes (rows of `control`, nx) and that of `control`, is overwritten.
    """
    down, points = work
    pad = (control.shape[0] - u.shape[0]) // 2
    average_down(u, width, pad, down)
    average_down(down.T, width, pad, points.T)  # along the rows
    for i in range(points.shape[0]):
        for j in range(points.shape[1]):
            control[i, j] = points[i, j]
    for i in range(u.shape[0]):
        above, row, below = points[pad + i - 1], points[pad + i], points[pad + i + 1]
        for j in range(u.shape[1]):
            k = pad + j
            value = above[k - 1] + 4.0 * above[k] + above[k + 1]
            value += 4.0 * (row[k - 1] + 4.0 * row[k] + row[k + 1])
            value += below[k - 1] + 4.0 * below[k] + below[k + 1]
            centre[i, j] = value / 36.0


@compiled
def widen(field: F32, pad: int, out: F32) -> None:
    """A field, shape (ny, nx), with its outermost values repeated `pad` times on all sides."""
    ny, nx = field.shape
    for i in range(out.shape[0]):
        for j in range(out.shape[1]):
            out[i, j] = field[min(max(i - pad, 0), ny - 1), min(max(j - pad, 0), nx - 1)]


def cubic(t: F64) -> tuple[F64, F64]:
    """The cubic B-spline on 0 to 4, 0 elsewhere, and its derivative."""
    s = np.abs(t - 2)
    near = s < 1
    value = np.where(near, 4 - 6 * s**2 + 3 * s**3, np.clip(2 - s, 0, None) ** 3) / 6
    slope = np.where(near, 1.5 * s**2 - 2 * s, -0.5 * np.clip(2 - s, 0, None) ** 2) * np.sign(t - 2)
    return value, slope
