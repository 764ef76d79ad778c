"""Where the boxes have gone to, roughly: a search in images reduced four and two times."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from analysis.dic.field import filled
from analysis.dic.grid import Grid
from analysis.dic.tracker import DirectTracker

F64 = NDArray[np.float64]
BOX, STEP = 16, 8  # of the reduced images
FACTORS = (4, 2, 1)  # the search is tried in this order, until it finds something
ENOUGH = 0.5  # share of the points with contrast that must be found


class CoarseSearch:
    """A search for large displacements, prepared for one reference when it is first needed.

    Parameters
    ----------
    reference : ndarray, shape (rows, columns)
    grid : Grid
        The points that are asked for.
    search : int
        Largest displacement along each axis that must be found, px.
    threads : int
    """

    def __init__(self, reference: NDArray[Any], grid: Grid, search: int, threads: int) -> None:
        self._reference, self._grid, self._search, self._threads = reference, grid, search, threads
        self._levels: dict[int, DirectTracker] = {}

    def find(self, image: NDArray[Any]) -> F64:
        """Displacement of every point of the grid, shape (2, ny, nx), px, right to a fraction of a
        pixel where it is right.
        """
        for factor in FACTORS:
            tracker = self._level(factor)
            if tracker is None:
                continue
            tracker.reset()
            field = tracker.track(_reduced(image, factor))
            found, textured = field.status == 0, field.status != 1
            if found.sum() >= ENOUGH * max(1, textured.sum()):
                break
        else:
            return np.zeros((2, *self._grid.shape))
        finer = self._level(2)
        if factor > 2 and finer is not None:
            start = 2 * _at(
                tracker.grid,
                np.array([field.ux_px, field.uy_px], np.float64),
                found,
                finer.grid,
                2 / factor,
            )
            finer.start_from(*start)
            field, tracker, factor = finer.track(_reduced(image, 2)), finer, 2
            found = field.status == 0
        return factor * _at(
            tracker.grid,
            np.array([field.ux_px, field.uy_px], np.float64),
            found,
            self._grid,
            1 / factor,
        )

    def close(self) -> None:
        """End the threads. May be called twice."""
        for tracker in self._levels.values():
            tracker.close()

    def _level(self, factor: int) -> DirectTracker | None:
        """The tracker for images reduced by a factor; None where they would be too small."""
        if factor not in self._levels:
            reduced = _reduced(self._reference, factor)
            box = BOX if factor > 1 else self._grid.box_px
            if min(reduced.shape) < (4 if factor > 1 else 1) * box + 2:
                return None
            search = min(max(3, -(-self._search // factor)), 32 if factor > 1 else 16)
            self._levels[factor] = DirectTracker(
                reduced,
                box,
                STEP if factor > 1 else self._grid.step_px,
                search=search,
                threads=self._threads,
                uncertainty=False,
            )
        return self._levels[factor]


def _reduced(image: NDArray[Any], factor: int) -> NDArray[Any]:
    """The image averaged over factor x factor pixels; rows and columns that do not fill a pixel are
    left out.
    """
    if factor == 1:
        return image
    rows, columns = (size // factor for size in image.shape)
    part = np.asarray(image[: rows * factor, : columns * factor], np.float32)
    return np.asarray(cv2.resize(part, (columns, rows), interpolation=cv2.INTER_AREA))


def _at(grid: Grid, field: F64, valid: NDArray[np.bool_], other: Grid, scale: float) -> F64:
    """A field, shape (2, ny, nx), read linearly at the points of another grid, whose pixels are
    `scale` of its own wide.
    """
    u = filled(field, valid)
    x, y = (
        (((p + 0.5) * scale - 0.5) - q[0]) / grid.step_px
        for p, q in ((other.x_px, grid.x_px), (other.y_px, grid.y_px))
    )
    map_x, map_y = (m.astype(np.float32) for m in np.meshgrid(x, y))
    return np.stack(
        [
            cv2.remap(plane, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            for plane in u
        ]
    )
