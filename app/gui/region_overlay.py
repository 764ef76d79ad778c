"""Polygons over a picture, whose corners the mouse moves."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

from PySide6.QtCore import QEvent, QObject, QPointF, QRectF, Qt, Signal
from PySide6.QtGui import QColor, QMouseEvent, QPainter, QPaintEvent, QPen, QPolygonF
from PySide6.QtWidgets import QWidget

from analysis.settings import MOST_CORNERS, Polygon
from app.gui import theme
from app.gui.cells import Tone
from app.gui.image_view import InterfaceView

NEAR = 9.0  # of the pointer to a corner, logical px
CLOSE = 5.0  # and to an edge
CORNER, HANDLE = 4.0, 6.0  # half the sides of what is drawn
LEAST_CORNERS = 3


@dataclass(frozen=True, slots=True)
class PlacedPicture:
    """A picture in a widget, and where its pixels are there.

    Attributes
    ----------
    widget : QWidget
    place : callable
        From a place in the picture (px) to one in the widget.
    point : callable
        And back.
    """

    widget: QWidget
    place: Callable[[float, float], QPointF]
    point: Callable[[QPointF], tuple[float, float]]


def picture_of(view: InterfaceView) -> PlacedPicture:
    """The picture of the interface."""
    canvas = view.canvas
    return PlacedPicture(canvas, canvas.place, canvas.point)


@dataclass(frozen=True, slots=True)
class _Grip:
    """What is held by the mouse: a corner of a polygon, or all of it where `corner` is below 0."""

    polygon: int
    corner: int


class RegionOverlay(QWidget):
    """Draws polygons over a picture, and lets their corners be dragged.

    A click on an edge makes a corner there, a double click on a corner removes it, and the square
    in the middle moves the polygon. All else is left to the picture.
    """

    changed = Signal(int, object)  # number of the polygon, and the Polygon that it is now

    def __init__(self, picture: PlacedPicture) -> None:
        super().__init__(picture.widget)
        self._picture = picture
        self.polygons: list[Polygon] = []
        self._grip: _Grip | None = None
        self._start: tuple[QPointF, Polygon] | None = None
        self.setMouseTracking(True)
        self.setGeometry(picture.widget.rect())
        picture.widget.installEventFilter(self)
        self.hide()

    def show_polygons(self, polygons: tuple[Polygon, ...]) -> None:
        """Show these."""
        self.polygons = list(polygons)
        self._grip = self._start = None
        self.update()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Cover the picture whatever size it gets."""
        if event.type() == QEvent.Type.Resize:
            self.setGeometry(self._picture.widget.rect())
        return False

    # ------------------------------------------------------------------ drawing

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the polygons and their handles."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        for one in self.polygons:
            colour = QColor(theme.TONES[Tone.GOOD if one.is_measured else Tone.BAD])
            places = self._places(one)
            tint = QColor(colour)
            tint.setAlpha(0 if one.is_measured else 60)
            painter.setPen(QPen(colour, 2))
            painter.setBrush(tint)
            painter.drawPolygon(QPolygonF(places))
            painter.setBrush(colour)
            for place in places:
                painter.drawEllipse(place, CORNER, CORNER)
            middle = _middle(places)
            painter.drawRect(
                QRectF(middle.x() - HANDLE, middle.y() - HANDLE, 2 * HANDLE, 2 * HANDLE)
            )

    def _places(self, polygon: Polygon) -> list[QPointF]:
        return [self._picture.place(*corner) for corner in polygon.corners]

    # ------------------------------------------------------------------ mouse

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Take hold of a corner, an edge or a polygon."""
        at = event.position()
        grip = self._gripped(at) if event.button() is Qt.MouseButton.LeftButton else None
        if grip is None and event.button() is Qt.MouseButton.LeftButton:
            grip = self._new_corner(at)
        if grip is None:
            event.ignore()
            return
        self._grip, self._start = grip, (at, self.polygons[grip.polygon])

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        """Move what is held."""
        if self._grip is None or self._start is None:
            is_over = self._gripped(event.position()) is not None
            self.setCursor(Qt.CursorShape.SizeAllCursor if is_over else Qt.CursorShape.ArrowCursor)
            event.ignore()
            return
        began, polygon = self._start
        (x0, y0), (x1, y1) = (self._picture.point(at) for at in (began, event.position()))
        moved = [
            (round(x + x1 - x0), round(y + y1 - y0))
            if self._grip.corner in (n, -1)
            else (x, y)
            for n, (x, y) in enumerate(polygon.corners)
        ]  # fmt: skip
        self.polygons[self._grip.polygon] = polygon._replace(corners=tuple(moved))
        self.update()

    def mouseReleaseEvent(self, event: QMouseEvent) -> None:
        """Let go of it."""
        grip, self._grip, self._start = self._grip, None, None
        if grip is None:
            event.ignore()
        else:
            self.changed.emit(grip.polygon, self.polygons[grip.polygon])

    def mouseDoubleClickEvent(self, event: QMouseEvent) -> None:
        """Remove a corner."""
        grip = self._gripped(event.position())
        if grip is None or grip.corner < 0:
            event.ignore()
            return
        polygon = self.polygons[grip.polygon]
        if len(polygon.corners) > LEAST_CORNERS:
            corners = polygon.corners[: grip.corner] + polygon.corners[grip.corner + 1 :]
            self.changed.emit(grip.polygon, polygon._replace(corners=corners))

    def _gripped(self, at: QPointF) -> _Grip | None:
        """What is there to be held; the polygon drawn last is on top."""
        for number in reversed(range(len(self.polygons))):
            places = self._places(self.polygons[number])
            for corner, place in enumerate(places):
                if math.dist(place.toTuple(), at.toTuple()) <= NEAR:
                    return _Grip(number, corner)
            if math.dist(_middle(places).toTuple(), at.toTuple()) <= NEAR:
                return _Grip(number, -1)
        return None

    def _new_corner(self, at: QPointF) -> _Grip | None:
        """Make a corner on the edge that is there."""
        for number in reversed(range(len(self.polygons))):
            polygon = self.polygons[number]
            places = self._places(polygon)
            for edge, (start, end) in enumerate(
                zip(places, [*places[1:], places[0]], strict=True), 1
            ):
                if _distance(at, start, end) <= CLOSE and len(places) < MOST_CORNERS:
                    x, y = self._picture.point(at)
                    corner = (round(x), round(y))
                    corners = (*polygon.corners[:edge], corner, *polygon.corners[edge:])
                    self.polygons[number] = polygon._replace(corners=corners)
                    self.update()
                    return _Grip(number, edge)
        return None


def _middle(places: list[QPointF]) -> QPointF:
    """The mean of the corners."""
    x, y = (sum(axis) / len(places) for axis in zip(*(p.toTuple() for p in places), strict=True))
    return QPointF(x, y)


def _distance(at: QPointF, start: QPointF, end: QPointF) -> float:
    """From a place to an edge."""
    way, off = end - start, at - start
    length = QPointF.dotProduct(way, way)
    share = min(1.0, max(0.0, QPointF.dotProduct(off, way) / length)) if length else 0.0
    return math.dist(at.toTuple(), (start + way * share).toTuple())
