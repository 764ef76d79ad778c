"""Draws a chart: axes once, into a picture that is kept, and curves when a pixel of them changes.

The wheel zooms about the pointer, over an axis along that one only; dragging moves, and a double
click or R shows all.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from PySide6.QtCore import QEvent, QPointF, QRectF, QSize, Qt, Signal
from PySide6.QtGui import (
    QAction,
    QColor,
    QFontMetricsF,
    QKeyEvent,
    QMouseEvent,
    QPaintEngine,
    QPainter,
    QPaintEvent,
    QPen,
    QPixmap,
    QPolygonF,
    QRegion,
    QResizeEvent,
    QWheelEvent,
)
from PySide6.QtWidgets import QSizePolicy, QWidget
from shiboken6 import VoidPtr

from app.gui import theme
from app.gui.charts import AxesFrame, Chart, Guide, Line, are_same, paths, spots
from app.gui.lettering import advance, free, write
from app.gui.scales import Range, ticks
from app.records.record_types import F64

GAP = 4.0  # between texts and axes, px
TICK_ROOM = (7.0, 2.2)  # width and height of a tick's room, in widths and heights of its text
ZOOM = 0.85  # of the range, for a step of the wheel
MOST_ZOOM = 1e-4  # of what was shown first
DOTTED = ("dots", "squares")
EMPTY = Chart("", "", "")


class Canvas(QWidget):
    """Shows one chart, and lets the operator zoom."""

    pointed = Signal(float, float)  # x and y under the pointer; NaN when it has left
    zoomed = Signal()

    def __init__(self) -> None:
        super().__init__()
        self.chart = EMPTY
        self._held: tuple[Range | None, Range | None] = (None, None)
        self._zoom: tuple[Range, Range] | None = None
        self._ground: tuple[Any, QPixmap] | None = None  # what it was made of, and what was drawn
        self._drawn: tuple[Any, ...] = ()
        self._axes: AxesFrame | None = None  # until the size or a range changes
        self._dragged: tuple[QPointF, AxesFrame] | None = None
        self.setMouseTracking(True)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Expanding)
        self.setMinimumSize(120, 80)
        self.setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent)

    def sizeHint(self) -> QSize:
        """A size at which a chart is read well."""
        return QSize(340, 240)

    # ------------------------------------------------------------------ what is shown

    def show_chart(self, chart: Chart) -> None:
        """Draw `chart`, if it differs by a pixel from what is drawn."""
        self.chart = chart
        self._held = chart.ranges(self._held)
        self._axes = None
        drawn = self._prepare(self.frame())
        if not are_same(drawn, self._drawn):
            self._drawn = drawn
            self.update()

    def clear(self) -> None:
        """Forget the ranges of the last run, and the zoom."""
        self._held, self._zoom = (None, None), None

    def reset(self) -> None:
        """Show all again."""
        self._zoom = None
        self._refresh()
        self.zoomed.emit()

    def table(self) -> str:
        """The numbers that are drawn, as CSV."""
        return self.chart.table()

    @property
    def is_zoomed(self) -> bool:
        """Whether the operator chose what is shown."""
        return self._zoom is not None

    def frame(self) -> AxesFrame:
        """The axes as they are shown now."""
        if self._axes is None:
            self._axes = self._frame(QRectF(self.rect()))
        return self._axes

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Fill the new size."""
        super().resizeEvent(event)
        self._refresh()

    def _frame(self, room: QRectF) -> AxesFrame:
        x, y = self._zoom or self._all()
        text = QFontMetricsF(self.font())
        widest = max((text.horizontalAdvance(t) for _, t in ticks(*y, 5)), default=0.0)
        left, top = room.left() + widest + 3 * GAP, room.top() + self._head(text, room.width())
        right, bottom = room.right() - 3 * GAP - self._right(text), room.bottom() - GAP
        bottom -= text.height() * (2 if self.chart.x_label else 1) + GAP
        width, height = max(20.0, right - left), max(20.0, bottom - top)
        return AxesFrame(left, top, width, height, x, y, self.chart.is_downward)

    def _all(self) -> tuple[Range, Range]:
        x, y = self._held
        return x or (0.0, 1.0), y or (0.0, 1.0)

    def _right(self, text: QFontMetricsF) -> float:
        """Room that is needed beside the axes."""
        return 0.0

    def _refresh(self) -> None:
        self._axes = None
        self._drawn = self._prepare(self.frame())
        self.update()

    # ------------------------------------------------------------------ drawing

    def paintEvent(self, _event: QPaintEvent) -> None:
        """Draw the axes that are kept, and what is in them."""
        frame = self.frame()
        ratio = self.devicePixelRatioF()
        key = (self.size(), ratio, frame, self.font().key(), *self._ground_key())
        if self._ground is None or self._ground[0] != key:
            pixmap = QPixmap(self.size() * ratio)
            pixmap.setDevicePixelRatio(ratio)
            painter = QPainter(pixmap)
            painter.setFont(self.font())
            self._draw_ground(painter, frame, QRectF(self.rect()))
            painter.end()
            self._ground = (key, pixmap)
        painter = QPainter(self)
        painter.setClipRegion(self._bare(frame))
        painter.drawPixmap(0, 0, self._ground[1])
        painter.setClipping(False)
        self._draw_inside(painter, frame)
        if self.hasFocus():
            painter.setPen(theme.ring())
            painter.drawRect(self.rect())

    def _bare(self, _frame: AxesFrame) -> QRegion:
        """Where the ground can be seen."""
        return QRegion(self.rect())

    @property
    def title(self) -> str:
        """Of the chart."""
        return self.chart.title

    def offer(self, actions: list[QAction]) -> None:
        """Put actions into the context menu."""
        self.addActions(actions)
        self.setContextMenuPolicy(Qt.ContextMenuPolicy.ActionsContextMenu)

    def paint(self, painter: QPainter, room: QRectF, _pen_ratio: float = 1.0) -> None:
        """Draw all of it in `room` of a page or a picture."""
        painter.setFont(self.font())
        frame = self._frame(room)
        self._draw_ground(painter, frame, room)
        self._draw_inside(painter, frame)

    def _ground_key(self) -> tuple[Any, ...]:
        chart = self.chart
        legend = tuple((line.name, line.role, line.style) for line in self._legend())
        faint = tuple(id(line.x) for line in chart.lines if line.is_faint)
        return theme.now().name, chart.x_label, chart.y_label, legend, faint

    def _legend(self) -> list[Line]:
        named = [line for line in self.chart.lines if line.name and len(line.x)]
        return list({line.name: line for line in named}.values())

    def _head(self, text: QFontMetricsF, width: float) -> float:
        """Height of the label of y and of the legend, above the axes."""
        return GAP + text.height() * (1.3 + self._legend_rows(text, width)[-1][0]) + GAP

    def _legend_rows(self, text: QFontMetricsF, width: float) -> list[tuple[int, float]]:
        """Row and left edge of each entry of the legend, and the last row."""
        row, left = 0, GAP + text.horizontalAdvance(self.chart.y_label) + 4 * GAP
        places = []
        for line in self._legend():
            needed = text.horizontalAdvance(line.name) + 10 * GAP
            if left + needed > width and left > 2 * GAP:
                row, left = row + 1, 2 * GAP
            places.append((row, left))
            left += needed
        return [*places, (row, 0.0)]

    def _draw_ground(self, painter: QPainter, frame: AxesFrame, room: QRectF) -> None:
        """Draw the axes, the legend, and what is behind the curves."""
        colours, text = theme.now(), QFontMetricsF(self.font())
        painter.fillRect(room, QColor(colours.panel))
        if not self.chart.x_label:  # nothing that axes would belong to
            return
        inside = QRectF(frame.left, frame.top, frame.width, frame.height)
        self._draw_ticks(painter, frame, text)
        painter.setPen(QPen(QColor(colours.grid), 1))
        painter.drawRect(inside)
        painter.setPen(QColor(colours.text))
        head = room.top() + GAP
        start = max(room.left() + GAP, frame.left - 10 * GAP)
        write(painter, QPointF(start, head + text.ascent()), self.chart.y_label)
        width = text.horizontalAdvance(self.chart.x_label)
        left = min(inside.center().x() - width / 2, room.right() - GAP - width)
        base = inside.bottom() + GAP + text.height() + GAP + text.ascent()
        painter.drawText(QPointF(max(room.left(), left), base), self.chart.x_label)
        for line, (row, left) in zip(
            self._legend(), self._legend_rows(text, room.width()), strict=False
        ):
            at = QPointF(room.left() + left, head + row * text.height() + text.ascent())
            swatch = at - QPointF(0, text.ascent() / 3)
            ends = (2.5,) if line.style in DOTTED else (0.0, 5.0)
            self._stroke(
                painter, line, [np.array([[swatch.x() + e * GAP, swatch.y()] for e in ends])]
            )
            painter.setPen(QColor(colours.muted))
            painter.drawText(at + QPointF(6 * GAP, 0), line.name)
        painter.save()
        painter.setClipRect(inside)
        for line in self.chart.lines:
            if line.is_faint:
                self._stroke(painter, line, list(paths(line.x, line.y, frame)))
        painter.restore()

    def _draw_ticks(self, painter: QPainter, frame: AxesFrame, text: QFontMetricsF) -> None:
        colours = theme.now()
        # neither see-through nor drawn as lines: for those Qt wakes its threads, which take far
        # longer where other work has the processor
        grid = QColor(theme.mixed(colours.grid, colours.panel, 60 / 255))
        most_x = max(2, int(frame.width / (TICK_ROOM[0] * text.averageCharWidth() * 1.5)))
        most_y = max(2, int(frame.height / (TICK_ROOM[1] * text.height())))
        bottom = frame.top + frame.height
        free = -math.inf
        for value, written in ticks(*frame.x, min(8, most_x)):
            left, _ = frame.place(value, 0.0)
            painter.fillRect(QRectF(left, frame.top, 1, frame.height), grid)
            half = text.horizontalAdvance(written) / 2
            if left - half > free:
                painter.setPen(QColor(colours.muted))
                painter.drawText(QPointF(left - half, bottom + GAP + text.ascent()), written)
                free = left + half + GAP
        for value, written in ticks(*frame.y, min(5, most_y)):
            _, top = frame.place(0.0, value)
            painter.fillRect(QRectF(frame.left, top, frame.width, 1), grid)
            painter.setPen(QColor(colours.muted))
            place = QPointF(frame.left - GAP - text.horizontalAdvance(written), top)
            painter.drawText(place + QPointF(0, text.ascent() / 2 - 1), written)

    def _prepare(self, frame: AxesFrame) -> tuple[Any, ...]:
        """All that is drawn inside the axes, in pixels."""
        chart = self.chart
        curves = []
        for line in chart.lines:
            if line.is_faint or not len(line.x):
                continue
            if line.style in DOTTED:
                pieces = [spots(line.x, line.y, frame)]
            else:
                pieces = list(paths(line.x, line.y, frame))
            band = []
            if line.sd is not None:
                sd = np.nan_to_num(line.sd)
                low, high = (list(paths(line.x, line.y + k * sd, frame)) for k in (-1, 1))
                band = [np.concatenate([a, b[::-1]]) for a, b in zip(low, high, strict=True)]
            curves.append((line.name, line.role, pieces, band, line))
        return frame, curves, chart.guides, chart.spans, chart.marks, self._ground_key()

    def _draw_inside(self, painter: QPainter, frame: AxesFrame) -> None:
        """Draw what is in the axes."""
        if self._drawn and self._drawn[0] == frame:
            curves = self._drawn[1]
        else:
            curves = self._prepare(frame)[1]
        axes = QRectF(frame.left, frame.top, frame.width, frame.height)
        self._draw_hint(painter, axes)
        painter.save()
        painter.setClipRect(axes)
        for span in self.chart.spans:
            self._tint(painter, span.role, _band(frame, span.low, span.high))
        for _, role, _, band, _ in curves:
            for piece in band:
                self._tint(painter, role, piece)
        for _, _, pieces, _, line in curves:
            self._stroke(painter, line, pieces)
        drawn = [piece for _, _, pieces, _, _ in curves for piece in pieces]
        used: list[QRectF] = []
        self._draw_guides(painter, frame, drawn, used)
        self._draw_marks(painter, frame, drawn, used)
        painter.restore()

    def _draw_hint(self, painter: QPainter, axes: QRectF) -> None:
        """Say what will be drawn, as long as there is nothing to draw."""
        if not (self.chart.hint and self.chart.is_empty):
            return
        room = axes if self.chart.x_label else QRectF(self.rect())
        painter.setPen(QColor(theme.now().muted))
        wrapped = Qt.AlignmentFlag.AlignCenter | Qt.TextFlag.TextWordWrap
        painter.drawText(room.adjusted(2 * GAP, 0, -2 * GAP, 0), wrapped, self.chart.hint)

    def _tint(self, painter: QPainter, role: str, outline: F64) -> None:
        colour = QColor(theme.now().role(role))
        colour.setAlpha(60)
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(colour)
        painter.drawPolygon(polygon(outline))
        painter.setBrush(Qt.BrushStyle.NoBrush)

    def _stroke(self, painter: QPainter, line: Line, pieces: list[F64]) -> None:
        colour = QColor(theme.now().role(line.role))
        if line.is_faint:
            colour.setAlpha(110)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        pen = QPen(colour, line.width)
        if line.style in DOTTED:
            pen.setWidthF(2.5 * line.width)
            is_round = line.style == "dots"
            pen.setCapStyle(Qt.PenCapStyle.RoundCap if is_round else Qt.PenCapStyle.SquareCap)
            painter.setPen(pen)
            for piece in pieces:
                painter.drawPoints(polygon(piece))
        else:
            is_drawing = painter.paintEngine().type() != QPaintEngine.Type.Raster
            if line.style == "dashed":
                pen.setDashPattern([5.0, 3.0])
            # on the screen two lines of a pixel, for a wider one takes Qt twenty times as long
            aside = 0.0 if is_drawing or line.width <= 1 else (line.width - 1) / 2
            pen.setWidthF(line.width if is_drawing else 1.0)
            painter.setPen(pen)
            for piece in pieces:
                for shift in {-aside, aside}:
                    painter.drawPolyline(polygon(piece + shift))
        painter.setRenderHint(QPainter.RenderHint.Antialiasing, False)

    def _draw_guides(
        self, painter: QPainter, frame: AxesFrame, drawn: list[F64], used: list[QRectF]
    ) -> None:
        right, bottom = frame.left + frame.width, frame.top + frame.height
        axes = QRectF(frame.left, frame.top, frame.width, frame.height)
        used += [  # a name is not written across another line
            QRectF(frame.place(guide.value, 0)[0], frame.top, 1, frame.height)
            for guide in self.chart.guides
            if guide.is_upright and math.isfinite(guide.value)
        ]
        for guide in self.chart.guides:
            left, top = frame.place(guide.value, guide.value)
            at = left if guide.is_upright else top
            low, length = (
                (frame.left, frame.width) if guide.is_upright else (frame.top, frame.height)
            )
            if not (math.isfinite(at) and low <= at <= low + length):
                continue
            colour = QColor(theme.now().role(guide.role))
            painter.setPen(QPen(colour, 1, Qt.PenStyle.DashLine))
            if guide.is_upright:
                painter.drawLine(QPointF(at, frame.top), QPointF(at, bottom))
            else:
                painter.drawLine(QPointF(frame.left, at), QPointF(right, at))
            rooms = self._rooms_beside(guide, at, frame)
            self._name(painter, guide.text, colour, free(rooms, axes, drawn, used))

    def _rooms_beside(self, guide: Guide, at: float, frame: AxesFrame) -> list[QRectF]:
        """Places for the name of a guide, the best first."""
        width, height = advance(self.font(), guide.text) + 2, QFontMetricsF(self.font()).height()
        if guide.is_upright:
            downwards = range(max(1, int((frame.height - 2) / height)))
            sides = (at + 3, at - 3 - width)
            places = [(x, frame.top + 2 + n * height) for n in downwards for x in sides]
        else:
            right = frame.left + frame.width
            leftwards = range(1, 1 + max(1, int(frame.width / (width + GAP))))
            sides = (at - height, at + 1)
            places = [(right - n * (width + GAP), y) for n in leftwards for y in sides]
        return [QRectF(*place, width, height) for place in places]

    def _draw_marks(
        self, painter: QPainter, frame: AxesFrame, drawn: list[F64], used: list[QRectF]
    ) -> None:
        colour, height = QColor(theme.now().text), QFontMetricsF(self.font()).height()
        axes = QRectF(frame.left, frame.top, frame.width, frame.height)
        for mark in self.chart.marks:
            left, top = frame.place(mark.x, mark.y)
            if not frame.holds(left, top):
                continue
            painter.setPen(QPen(colour, 1.5))
            painter.drawEllipse(QPointF(left, top), 4, 4)
            width = advance(self.font(), mark.text)
            corners = ((6, 2), (-6 - width, -2 - height), (6, -2 - height), (-6 - width, 2))
            rooms = [QRectF(left + x, top + y, width, height) for x, y in corners]
            self._name(painter, mark.text, colour, free(rooms, axes, drawn, used))

    def _name(self, painter: QPainter, text: str, colour: QColor, room: QRectF) -> None:
        """Write a name where it covers what is behind it."""
        painter.fillRect(room, QColor(theme.now().panel))
        painter.setPen(colour)
        write(painter, room.topLeft() + QPointF(1, QFontMetricsF(self.font()).ascent()), text)

    # ------------------------------------------------------------------ mouse and keyboard

    def wheelEvent(self, event: QWheelEvent) -> None:
        """Zoom about the pointer."""
        at = event.position()
        self._zoom_about(at, ZOOM ** (event.angleDelta().y() / 120))
        event.accept()

    def _zoom_about(self, at: QPointF, factor: float) -> None:
        frame = self.frame()
        over_x, over_y = at.y() > frame.top + frame.height, at.x() < frame.left
        factors = (1.0 if over_y else factor, 1.0 if over_x else factor)
        self._zoom_to(frame.zoomed(frame.point(at.x(), at.y()), factors))

    def _zoom_to(self, ranges: tuple[Range, Range]) -> None:
        for (low, high), (all_low, all_high) in zip(ranges, self._all(), strict=True):
            if not MOST_ZOOM < (high - low) / (all_high - all_low) < 1 / MOST_ZOOM:
                return
        self._zoom = ranges
        self._refresh()
        self.zoomed.emit()

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Begin to move what is shown."""
        if event.button() is Qt.MouseButton.LeftButton:
            self._dragged = (event.position(), self.frame())

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        """Move what is shown, or say where the pointer is."""
        at = event.position()
        if self._dragged is not None:
            moved = at - self._dragged[0]
            if self.is_zoomed or moved.manhattanLength() > 3:
                self._zoom_to(self._dragged[1].moved(moved.x(), moved.y()))
        frame = self.frame()
        is_inside = frame.holds(at.x(), at.y())
        self.pointed.emit(*(frame.point(at.x(), at.y()) if is_inside else (math.nan,) * 2))

    def mouseReleaseEvent(self, _event: QMouseEvent) -> None:
        """End the move."""
        self._dragged = None

    def mouseDoubleClickEvent(self, _event: QMouseEvent) -> None:
        """Show all again."""
        self.reset()

    def leaveEvent(self, event: QEvent) -> None:
        """Nothing is pointed at any more."""
        self.pointed.emit(math.nan, math.nan)
        super().leaveEvent(event)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """R shows all; + and - zoom."""
        keys: dict[int, Callable[[], None]] = {
            Qt.Key.Key_R: self.reset,
            Qt.Key.Key_Plus: lambda: self._zoom_in_middle(ZOOM),
            Qt.Key.Key_Minus: lambda: self._zoom_in_middle(1 / ZOOM),
        }
        if (act := keys.get(event.key())) is None:
            super().keyPressEvent(event)
        else:
            act()

    def _zoom_in_middle(self, factor: float) -> None:
        frame = self.frame()
        middle = QPointF(frame.left + frame.width / 2, frame.top + frame.height / 2)
        self._zoom_about(middle, factor)

    def changeEvent(self, event: QEvent) -> None:
        """Draw anew in other colours or another size of text."""
        if event.type() in (QEvent.Type.StyleChange, QEvent.Type.FontChange):
            self._ground = None
            self._refresh()
        super().changeEvent(event)


def polygon(points: F64) -> QPolygonF:
    """`points`, shape (n, 2), as Qt draws them."""
    made = QPolygonF()
    made.resize(len(points))
    if len(points):
        memory: Any = VoidPtr(made.data(), 16 * len(points), True)  # type: ignore[call-arg, arg-type]
        np.frombuffer(memory, np.float64).reshape(-1, 2)[:] = points
    return made


def _band(frame: AxesFrame, low: float, high: float) -> F64:
    left, right = frame.left, frame.left + frame.width
    _, bottom = frame.place(0.0, low)
    _, top = frame.place(0.0, high)
    return np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
