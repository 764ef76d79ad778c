"""Axes of plots, drawn once and kept as pixels until they change."""

from __future__ import annotations

import pyqtgraph as pg
from PySide6.QtCore import QRectF
from PySide6.QtWidgets import QGraphicsItem, QGraphicsSceneResizeEvent

from app.gui.cells import localized

CACHED, NOT_CACHED = (
    QGraphicsItem.CacheMode.DeviceCoordinateCache,
    QGraphicsItem.CacheMode.NoCache,
)
OVERHANG = 15  # px
OPAQUE = 255  # Qt takes far longer for grid lines that are not
TICKS = 1.6  # times as many as pyqtgraph has by itself, for only the major ones are drawn


class CachedAxis(pg.AxisItem):  # type: ignore[misc]
    """An axis whose drawing is kept: texts and grid cost more than all curves of a plot.

    Without SI prefixes, for the labels have their units in them, and without minor ticks.
    """

    def __init__(self, side: str, box: pg.ViewBox) -> None:
        self._room: QRectF | None = None  # None: not known
        super().__init__(side, linkView=box)
        self.setGrid(OPAQUE)
        self.setZValue(box.zValue() - 1)  # its grid is below the curves
        self.enableAutoSIPrefix(False)
        self.setStyle(maxTickLevel=0, hideOverlappingLabels=False)
        self.setTickDensity(TICKS)
        self.setCacheMode(CACHED)
        for part in (self, box):
            part.geometryChanged.connect(self._forget_room)

    def _forget_room(self) -> None:
        self._room = None

    def setGrid(self, grid: int | bool) -> None:
        """Draw lines across the box, so opaque of 255, or none."""
        self._forget_room()
        super().setGrid(grid)

    def setLabel(self, text: str | None = None) -> None:
        """Name the axis, in its middle: pyqtgraph leaves another name where the one before was."""
        super().setLabel(text)
        self.resizeEvent()

    def resizeEvent(self, event: QGraphicsSceneResizeEvent | None = None) -> None:
        """Keep nothing of the size before: Qt would draw only what is new of it."""
        super().resizeEvent(event)
        mode = self.cacheMode()
        self.setCacheMode(NOT_CACHED)
        self.setCacheMode(mode)

    def boundingRect(self) -> QRectF:
        """With room for the numbers at both ends, which pyqtgraph leaves out beside a grid."""
        if self._room is None:  # Qt asks several times at each redraw
            room: QRectF = super().boundingRect()
            self._room = room.adjusted(-OVERHANG, -OVERHANG, OVERHANG, OVERHANG)
        return self._room

    def tickStrings(self, values: list[float], scale: float, spacing: float) -> list[str]:
        """As `tick_strings`."""
        return tick_strings(self, values, scale, spacing)


def tick_strings(axis: pg.AxisItem, values: list[float], scale: float, spacing: float) -> list[str]:
    """The numbers of an axis, with a true minus sign and the decimal sign of the language."""
    texts = pg.AxisItem.tickStrings(axis, values, scale, spacing)
    return [localized(text).replace("-", "−") for text in texts]
