"""Axes of plots, drawn once and kept as pixels until they change."""

from __future__ import annotations

from typing import Any

import pyqtgraph as pg
from PySide6.QtWidgets import QGraphicsItem


class CachedAxis(pg.AxisItem):  # type: ignore[misc]
    """An axis whose drawing is kept: texts and grid cost more than all curves of a plot.

    Without SI prefixes, for the labels have their units in them.
    """

    def __init__(self, side: str, **options: Any) -> None:
        super().__init__(side, **options)
        self.enableAutoSIPrefix(False)
        self.set_cached(True)

    def set_cached(self, is_cached: bool) -> None:
        """Keep the drawing, or not: an export as a drawing needs texts and lines, no pixels."""
        mode = QGraphicsItem.CacheMode
        self.setCacheMode(mode.DeviceCoordinateCache if is_cached else mode.NoCache)


def cached_axes() -> dict[str, CachedAxis]:
    """Axes left and bottom, for the argument `axisItems` of a plot."""
    return {side: CachedAxis(side) for side in ("left", "bottom")}
