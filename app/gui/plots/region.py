"""Rectangles, circles and polygons over a picture, which the mouse moves."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QObject, QPointF, QRectF, Qt, Signal
from PySide6.QtGui import QColor, QPainter, QPainterPath, QPolygonF

from analysis.settings import MOST_CORNERS, Polygon
from app.gui import theme
from app.gui.cells import Tone, number
from app.gui.plots.picture import PicturePlot
from app.records.record_types import F64

Corner = tuple[int, int]
Corners = tuple[Corner, ...]
CIRCLE_CORNERS = 32  # of the polygon that a circle is in the settings
_TURNS = 2 * np.pi * np.arange(CIRCLE_CORNERS) / CIRCLE_CORNERS
UNIT_CIRCLE = np.column_stack([np.cos(_TURNS), np.sin(_TURNS)])
LEAST_CORNERS = 3
CLOSE_PX = 6.0  # of a click to an edge, on the screen
TINT = 60  # of 255: opacity of what is left out


def rectangle(x: float, y: float, width: float, height: float) -> Corners:
    """The corners of a rectangle about (x, y)."""
    left, right = round(x - width / 2), round(x + width / 2)
    top, bottom = round(y - height / 2), round(y + height / 2)
    return (left, top), (right, top), (right, bottom), (left, bottom)


def circle(x: float, y: float, radius: float) -> Corners:
    """The corners of the polygon that stands for a circle about (x, y)."""
    return tuple(map(tuple, np.rint((x, y) + radius * UNIT_CIRCLE).astype(int).tolist()))


def is_rectangle(corners: Corners) -> bool:
    """Whether these are the corners of an upright rectangle."""
    (left, top), (right, bottom) = np.min(corners, axis=0), np.max(corners, axis=0)
    return left < right and top < bottom and set(corners) == {
        (left, top), (right, top), (right, bottom), (left, bottom)
    } and len(corners) == 4  # fmt: skip


def as_circle(corners: Corners) -> float | None:
    """The radius of the circle that these corners stand for; None where they do not."""
    radii = np.hypot(*(np.array(corners) - np.mean(corners, axis=0)).T)
    is_round = len(corners) == CIRCLE_CORNERS and np.ptp(radii) < 2.0 < radii.mean()
    return float(radii.mean()) if is_round else None


def described(polygon: Polygon, mm: float) -> str:
    """What a polygon is, and its size; `mm` is that of a pixel."""
    corners = polygon.corners
    if radius := as_circle(corners):
        return f"circle, radius {number(radius * mm, 2)} mm"
    width, height = np.ptp(corners, axis=0) * mm
    kind = "rectangle" if is_rectangle(corners) else f"{len(corners)} corners"
    return f"{kind}, {number(width, 2)} × {number(height, 2)} mm"


class RegionShapes(QObject):
    """Shows polygons on a picture as what they are: a rectangle, a circle, or by all corners.

    A corner or the rim is dragged to change a shape, and what is in it to move it. A click on an
    edge makes a corner there, a double click on a corner removes it.
    """

    changed = Signal(int, object)  # number of the polygon, and the Polygon that it is now

    def __init__(self, picture: PicturePlot) -> None:
        super().__init__(picture)
        self._picture, self._mm, self._is_visible = picture, 1.0, False
        self._shapes: list[_Shape] = []

    @property
    def polygons(self) -> tuple[Polygon, ...]:
        """Those that are drawn."""
        return tuple(shape.polygon for shape in self._shapes)

    def show_polygons(self, polygons: tuple[Polygon, ...], mm: float) -> None:
        """Show these; `mm` is that of a pixel."""
        if mm != self._mm or len(polygons) != len(self._shapes):
            self._mm = mm
            while self._shapes:
                self._remove(self._shapes.pop())
        for n, polygon in enumerate(polygons):
            if n == len(self._shapes):
                self._shapes.append(self._made(polygon))
            elif polygon != self._shapes[n].polygon:  # that which the mouse holds stays
                self._remove(self._shapes[n])
                self._shapes[n] = self._made(polygon)

    def set_visible(self, is_visible: bool) -> None:
        """Show them, or not."""
        self._is_visible = is_visible
        for shape in self._shapes:
            shape.setVisible(is_visible)

    def _made(self, polygon: Polygon) -> _Shape:
        kind: type[_Shape] = _Rectangle if is_rectangle(polygon.corners) else _Shape
        made = (_Circle if as_circle(polygon.corners) else kind)(polygon, self._mm)
        made.setVisible(self._is_visible)
        made.sigRegionChangeFinished.connect(self._take_move)
        made.asked.connect(self._take)
        self._picture.box.addItem(made, ignoreBounds=True)
        return made

    def _take_move(self, shape: _Shape) -> None:
        drawn = shape.drawn()
        if shape in self._shapes and drawn != shape.polygon:
            shape.polygon = drawn
            self._take(shape, drawn)

    def _take(self, shape: _Shape, polygon: Polygon) -> None:
        self.changed.emit(self._shapes.index(shape), polygon)

    def _remove(self, shape: _Shape) -> None:
        self._picture.box.removeItem(shape)
        self._picture.scene().lastHoverEvent = None  # it would be the one that a press goes to
        shape.deleteLater()  # not now: it may be handling an event


class _Shape(pg.ROI):  # type: ignore[misc]
    """A polygon of which each corner is moved by itself; its coordinates are those of the axes, mm.

    Not `pg.PolyLineROI`, whose edges share their ends: Qt cannot delete them in any order.
    """

    asked = Signal(object, object)  # the shape, and the Polygon that is to be in its place

    def __init__(
        self, polygon: Polygon, mm: float, place: QRectF | None = None, **options: Any
    ) -> None:
        self.polygon, self._mm, self._room = polygon, mm, QRectF()
        colour = QColor(theme.DARK.tones[Tone.GOOD if polygon.is_measured else Tone.BAD])
        self._tint = QColor(colour)
        self._tint.setAlpha(0 if polygon.is_measured else TINT)
        room = place or QRectF(0, 0, 1, 1)
        pens = dict.fromkeys(("pen", "handlePen"), pg.mkPen(colour, width=2))
        pens |= dict.fromkeys(("hoverPen", "handleHoverPen"), pg.mkPen("w", width=2))
        super().__init__(room.topLeft(), room.size(), antialias=True, **pens, **options)
        self.setAcceptedMouseButtons(Qt.MouseButton.LeftButton)
        self.sigClicked.connect(self._click_edge)
        self._add_handles()
        for handle in self.getHandles():
            handle.setAcceptedMouseButtons(Qt.MouseButton.LeftButton)
            handle.sigClicked.connect(self._click_corner)

    def _add_handles(self) -> None:
        for x, y in self.polygon.corners:
            self.addFreeHandle((x * self._mm, y * self._mm))

    def outline(self) -> list[QPointF]:
        """Its corners, in its own coordinates."""
        return [QPointF(handle.pos()) for handle in self.getHandles()]

    def drawn(self) -> Polygon:
        """The polygon that is drawn now, to whole pixels."""
        places = [self.mapToParent(corner) / self._mm for corner in self.outline()]
        return self.polygon._replace(corners=tuple((round(p.x()), round(p.y())) for p in places))

    # ------------------------------------------------------------------ what is drawn

    def shape(self) -> QPainterPath:
        """What takes the mouse."""
        path = QPainterPath()
        path.addPolygon(QPolygonF(self.outline()))
        path.closeSubpath()
        return path

    def boundingRect(self) -> QRectF:
        """What holds it."""
        return self._room

    def stateChanged(self, finish: bool = True) -> None:
        """Take the new outline: Qt must have been told before `boundingRect` is another."""
        self.prepareGeometryChange()
        self._room = self.shape().boundingRect()
        super().stateChanged(finish)

    def paint(self, painter: QPainter, *_: Any) -> None:
        """Draw the rim, and tint what is left out."""
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.setPen(self.currentPen)
        painter.setBrush(self._tint)
        painter.drawPolygon(QPolygonF(self.outline()))

    # ------------------------------------------------------------------ corners more and less

    def _click_edge(self, _: object, event: Any) -> None:
        places, at = self.outline(), QPointF(event.pos())
        ends = zip(places, [*places[1:], places[0]], strict=True)
        away = [_distance(at, *edge) for edge in ends]
        nearest = int(np.argmin(away))
        if away[nearest] < CLOSE_PX * self.getViewBox().viewPixelSize()[0]:
            there = self.mapToParent(at) / self._mm
            corners = list(self.polygon.corners)
            corners.insert(nearest + 1, (round(there.x()), round(there.y())))
            self._ask(corners)

    def _click_corner(self, handle: Any, event: Any) -> None:
        if event.double():
            corners = list(self.polygon.corners)
            corners.pop(self.getHandles().index(handle))
            self._ask(corners)

    def _ask(self, corners: list[Corner]) -> None:
        if LEAST_CORNERS <= len(corners) <= MOST_CORNERS:
            self.asked.emit(self, self.polygon._replace(corners=tuple(corners)))


class _Boxed(_Shape):
    """A shape that keeps its form: its corners are shares of the sides of its box."""

    def __init__(self, polygon: Polygon, mm: float, **options: Any) -> None:
        corners = mm * self._exact(polygon.corners)
        start, size = corners.min(axis=0), np.ptp(corners, axis=0)
        self._shares = ((corners - start) / size).tolist()
        super().__init__(polygon, mm, QRectF(*start, *size), **options)

    def _exact(self, corners: Corners) -> F64:
        """Its corners as they were before they were rounded to whole pixels."""
        return np.array(corners, np.float64)

    def outline(self) -> list[QPointF]:
        """Its corners, in its own coordinates."""
        width, height = self.size()
        return [QPointF(x * width, y * height) for x, y in self._shares]


class _Rectangle(_Boxed):
    """An upright rectangle, which stays one when a corner is moved."""

    def _add_handles(self) -> None:
        for x, y in self._shares:
            self.addScaleHandle((x, y), (1 - x, 1 - y))


class _Circle(_Boxed):
    """A circle, which is a polygon of many corners for the settings."""

    def __init__(self, polygon: Polygon, mm: float) -> None:
        super().__init__(polygon, mm, aspectLocked=True)

    def _exact(self, corners: Corners) -> F64:
        """Of a small circle that is made larger the rounding would grow, too."""
        centre: F64 = np.mean(corners, axis=0)
        return centre + (as_circle(corners) or 0.0) * UNIT_CIRCLE

    def _add_handles(self) -> None:
        for n in range(CIRCLE_CORNERS // 8, CIRCLE_CORNERS, CIRCLE_CORNERS // 4):
            self.addScaleHandle(self._shares[n], (0.5, 0.5))

    def _ask(self, corners: list[Corner]) -> None:
        """It has no corners that could be more or less."""


def _distance(at: QPointF, start: QPointF, end: QPointF) -> float:
    """From a place to an edge."""
    way, off = end - start, at - start
    length = QPointF.dotProduct(way, way)
    share = min(1.0, max(0.0, QPointF.dotProduct(off, way) / length)) if length else 0.0
    return math.dist(at.toTuple(), (start + way * share).toTuple())
