"""Roughly where the boxes have moved to: a search in images reduced four and two times."""

from __future__ import annotations

import cv2
import numpy as np

from analysis.arrays import F64, Array, Bool
from analysis.dic.neighbours import filled
from analysis.dic.searching import DirectSearch
from analysis.dic.status import LOW_CONTRAST
from analysis.dic.tracker import ReferenceImage
from analysis.grid import Grid

BOX, STEP = 16, 8  # box and step on the reduced images
FACTORS = (4, 2, 1)  # tried in this order, until one of them finds the points
ENOUGH = 0.5  # share of the points with contrast that must be found


class CoarseSearch:
    """A search for large displacements, prepared for one reference when it is first needed.

    Parameters
    ----------
    reference : Reference
        Its grid has the points that are wanted.
    search : int
        Largest displacement along each axis that must be found, px.
    """

    def __init__(self, reference: ReferenceImage, search: int) -> None:
        self._reference, self._search = reference, search
        self._levels: dict[int, tuple[Grid, DirectSearch]] = {}

    def find(self, image: Array) -> F64:
        """Displacement of every point of the grid, shape (2, ny, nx), px: right to a fraction of a
        pixel, or wrong altogether where nothing was recognised; 0 if that is everywhere.
        """
        for factor in FACTORS:
            if not self._is_possible(factor):
                continue
            grid, u, ok, textured = self._searched(image, factor, None)
            if ok.sum() >= ENOUGH * max(1, textured.sum()):
                break
        else:
            return np.zeros((2, *self._reference.grid.shape))
        if factor > 2:
            finer, _ = self._level(2)
            start = 2 * _at(grid, u, ok, finer, 2 / factor)
            grid, u, ok, _ = self._searched(image, 2, start)
            factor = 2
        return factor * _at(grid, u, ok, self._reference.grid, 1 / factor)

    def _searched(
        self, image: Array, factor: int, start: F64 | None
    ) -> tuple[Grid, F64, Bool, Bool]:
        """Grid and displacement of the reduced images, which points are OK, and which have
        contrast.
        """
        grid, method = self._level(factor)
        method.start_from(start)
        found = method.measure(_reduced(image, factor))
        return grid, found.u.astype(np.float64), found.is_ok, found.status != LOW_CONTRAST

    def _box(self, factor: int) -> int:
        return BOX if factor > 1 else self._reference.grid.box_px

    def _is_possible(self, factor: int) -> bool:
        """Whether the reduced images are large enough for a few boxes."""
        boxes = 4 if factor > 1 else 1
        rows, columns = self._reference.image.shape
        return bool(min(rows, columns) // factor >= boxes * self._box(factor) + 2)

    def _level(self, factor: int) -> tuple[Grid, DirectSearch]:
        """The search in images reduced by a factor."""
        if factor not in self._levels:
            reduced = _reduced(self._reference.image, factor)
            step = STEP if factor > 1 else self._reference.grid.step_px
            grid = Grid.cover(reduced.shape, self._box(factor), step)
            search = min(max(3, -(-self._search // factor)), 32 if factor > 1 else 16)
            level = ReferenceImage(reduced, grid, self._reference.threads)
            self._levels[factor] = (
                grid,
                DirectSearch(level, search=search, states_uncertainty=False),
            )
        return self._levels[factor]


def _reduced(image: Array, factor: int) -> Array:
    """The image averaged over factor x factor pixels; rows and columns that do not fill a pixel are
    left out.
    """
    if factor == 1:
        return image
    rows, columns = (size // factor for size in image.shape)
    part = np.asarray(image[: rows * factor, : columns * factor], np.float32)
    return np.asarray(cv2.resize(part, (columns, rows), interpolation=cv2.INTER_AREA))


def _at(grid: Grid, field: F64, valid: Bool, other: Grid, scale: float) -> F64:
    """A field, shape (2, ny, nx), read linearly at the points of another grid, whose pixels are
    `scale` of its own wide.
    """
    x, y = (
        (((p + 0.5) * scale - 0.5) - q[0]) / grid.step_px
        for p, q in ((other.x_px, grid.x_px), (other.y_px, grid.y_px))
    )
    map_x, map_y = (m.astype(np.float32) for m in np.meshgrid(x, y))
    edges = {"interpolation": cv2.INTER_LINEAR, "borderMode": cv2.BORDER_REPLICATE}
    return np.stack([cv2.remap(plane, map_x, map_y, **edges) for plane in filled(field, valid)])
