"""Which points of a picture are measured."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from analysis.arrays import F64, Bool
from analysis.settings import Polygon


def measured(polygons: Sequence[Polygon], x_px: F64, y_px: F64) -> Bool:
    """Whether points of the picture are measured: those in a polygon to measure, or everywhere if
    there is none, that lie in no polygon to leave out.
    """
    wanted = [one for one in polygons if one.is_measured]
    shape = np.broadcast_shapes(np.shape(x_px), np.shape(y_px))
    found = np.full(shape, not wanted)
    for one in wanted:
        found |= _within(one, x_px, y_px)
    for one in polygons:
        if not one.is_measured:
            found &= ~_within(one, x_px, y_px)
    return found


def _within(polygon: Polygon, x_px: F64, y_px: F64) -> Bool:
    """Whether points lie within, by the number of edges to their right."""
    within = np.zeros(np.broadcast_shapes(np.shape(x_px), np.shape(y_px)), np.bool_)
    corners = polygon.corners
    for (x0, y0), (x1, y1) in zip(corners, (*corners[1:], corners[0]), strict=True):
        if y0 == y1:
            continue
        crosses = (y_px < y0) != (y_px < y1)
        within ^= crosses & (x_px < x0 + (y_px - y0) * (x1 - x0) / (y1 - y0))
    return within
