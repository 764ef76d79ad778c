"""Displacements at one time, from those of a rolling shutter, which exposes row after row."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import F64, floats


class RollingShutter:
    """Interpolates the fields of a stream of images between the times of each point's row, to the
    time at which the first row of each image is exposed.

    A point moves evenly between the images in which it is found, so that only a change of its
    velocity in between leaves an error, of at most that change times the time of its row.

    Parameters
    ----------
    y_px : ndarray, shape (ny,)
        Rows of the points in the reference.
    rows : int
        Of an image.
    readout : float
        Seconds from the exposure of the top row to that of the bottom row; negative: the bottom
        row comes first.
    shape : (ny, nx)
        Of a field.
    start : float
        When the first row of the reference is exposed, seconds. The block is at rest then.

    Examples
    --------
    >>> import numpy as np
    >>> from analysis.dic.rolling_shutter import RollingShutter
    >>> shutter = RollingShutter(np.array([0, 50, 100]), 101, 0.02, (3, 1), start=0.0)
    >>> seen = 2.0 * (1 + np.array([[0], [0.01], [0.02]]))  # 2 px/s since t = 0, seen at t = 1 s
    >>> shutter.at_one_time(seen - [[0], [0.02], [0.04]], 0 * seen, 1.0)[0].ravel().round(3)
    array([2.  , 1.98, 1.96])
    """

    def __init__(
        self, y_px: F64, rows: int, readout: float, shape: tuple[int, int], *, start: float
    ) -> None:
        self._y, self._last_row = floats(y_px)[:, None], rows - 1
        self._readout = readout
        self._u = np.zeros((2, *shape))
        self._when = np.broadcast_to(start + self._late(self._y), shape).copy()

    def _late(self, y: F64) -> F64:
        """Seconds from the exposure of the first row to that of a row."""
        return self._readout * (y / self._last_row - (self._readout < 0))

    def at_one_time(self, ux: ArrayLike, uy: ArrayLike, time: float) -> tuple[F64, F64]:
        """The displacements at the time (s) at which the first row of an image is exposed, from
        those that it shows, shape (ny, nx), pixels; NaN stays NaN. Images come in order.
        """
        u = np.stack([floats(v) for v in (ux, uy)])
        late = self._late(self._y + u[1])
        when = time + late
        passed = when - self._when  # 0, but for noise, if this is the reference itself
        is_later = passed > abs(self._readout) / 2
        share = np.divide(late, passed, out=np.zeros_like(passed), where=is_later)
        corrected = u - (u - self._u) * share
        known = np.isfinite(u).all(axis=0)
        self._u[:, known], self._when[known] = u[:, known], when[known]
        return corrected[0], corrected[1]
