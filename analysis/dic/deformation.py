"""Strain from a displacement field by local least squares."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import F64, all_floats

FEWEST = 0.5  # share of the points of a window that must be measured
UNEVEN = 0.01  # of a step, by which another may differ from it


class Strain(NamedTuple):
    """Small strains, dimensionless, each of shape (ny, nx): du_x/dx, du_y/dy, and the tensor's
    shear (du_x/dy + du_y/dx) / 2; NaN where too little was measured.
    """

    xx: F64
    yy: F64
    xy: F64


def strain(x: ArrayLike, y: ArrayLike, ux: ArrayLike, uy: ArrayLike, points: int = 5) -> Strain:
    """Strain of the surface from its displacement, by least squares: the slopes of the plane that
    fits the measured points of a square window about each point.

    A field that is linear over the window is measured exactly, at the rim too. Waves are damped as
    by a mean over the window; noise of s per point becomes noise of about s sqrt(12) / (pitch
    points^2), more where correlation boxes overlap and so share their noise.

    Parameters
    ----------
    x, y : array_like, shape (nx,) and (ny,)
        Places of the points, evenly spaced, metres or pixels.
    ux, uy : array_like, shape (ny, nx)
        Displacement, in the same unit; NaN where not measured.
    points : int
        Side of the window, an odd number of points, 3 or more.

    Returns
    -------
    Strain
        NaN at points that were not measured, and where less than half of the window was.

    Raises
    ------
    ValueError
        The shapes do not fit, the points are not evenly spaced, or the window is no odd number from
        3 on.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> x, y = np.arange(0, 8e-4, 1e-4), np.arange(0, 6e-4, 1e-4)
    >>> ux = 2e-3 * x + 1e-3 * y[:, None]
    >>> xx, yy, xy = analysis.strain(x, y, ux, 0 * ux)
    >>> bool(np.allclose(xx, 2e-3)), bool(np.allclose(yy, 0)), bool(np.allclose(xy, 5e-4))
    (True, True, True)
    """
    x, y, ux, uy = all_floats(x, y, ux, uy)
    if not (ux.shape == uy.shape == (y.size, x.size)) or min(ux.shape) < 2:
        raise ValueError(
            f"strain: fields of shapes {ux.shape} and {uy.shape} on {x.size} x {y.size} points; two"
            " or more points each way are needed, and a field of shape (ny, nx)"
        )
    if points < 3 or points % 2 == 0:
        raise ValueError(f"strain: a window of {points} points; give an odd number from 3 on")
    dx, dy = (x[-1] - x[0]) / (x.size - 1), (y[-1] - y[0]) / (y.size - 1)
    for step, places in ((dx, x), (dy, y)):
        if not np.abs(np.diff(places) - step).max() < UNEVEN * abs(step):
            raise ValueError(
                "strain: the points are not evenly spaced, or not apart; interpolate them on an"
                " even grid"
            )
    (xx, ux_y), (uy_x, yy) = (_slopes(u, points, dx, dy) for u in (ux, uy))
    return Strain(xx, yy, (ux_y + uy_x) / 2)


def _slopes(u: F64, points: int, dx: float, dy: float) -> tuple[F64, F64]:
    """du/dx and du/dy of the plane about each point."""
    from scipy.ndimage import correlate1d

    there = np.isfinite(u)
    weight, offset = there.astype(np.float64), np.arange(points) - points // 2

    def moment(values: F64, along: int, across: int) -> F64:
        """Sum over the window of values, times powers of the distances from its middle."""
        inner = correlate1d(values, offset**along * 1.0, axis=1, mode="constant")
        sums: F64 = correlate1d(inner, offset**across * 1.0, axis=0, mode="constant")
        return sums

    powers = ((0, 0), (1, 0), (0, 1))
    known = np.where(there, u, 0.0)
    normal = np.array([[moment(weight, a + c, b + d) for c, d in powers] for a, b in powers])
    right = np.array([moment(known, a, b) for a, b in powers])
    # in numbers of points: a determinant of 1 or more, or the points lie on a line
    planes = there & (normal[0, 0] >= FEWEST * points**2 / 2)
    planes &= np.linalg.det(np.moveaxis(normal, (0, 1), (2, 3))) > 0.5
    found = np.full((3, *u.shape), np.nan)
    matrices, sides = normal[:, :, planes].transpose(2, 0, 1), right[:, planes].T[..., None]
    found[:, planes] = np.linalg.solve(matrices, sides)[..., 0].T
    return found[1] / dx, found[2] / dy
