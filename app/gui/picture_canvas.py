"""Draws an image of the interface, a field over it, and the circles of the contact."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import (
    QColor,
    QFontMetricsF,
    QImage,
    QPainter,
    QPaintEvent,
    QPen,
    QRegion,
    qRgb,
)

from app.gui import theme
from app.gui.canvas import GAP, TICK_ROOM, Canvas, polygon
from app.gui.cells import number
from app.gui.charts import Chart, Frame
from app.gui.frame_results import Circles, Field, ShownImage
from app.gui.lettering import advance, write
from app.gui.scales import Range, diverging, round_step, sequential, ticks
from app.gui.source import Rect
from app.gui.view_state import NOTHING_SEEN, Eyes

BAR, BAR_TEXT = 14.0, 7  # width of the colour bar in px, and of its numbers in characters
NO_PICTURE = (
    "The camera's image, and the displacements in it, appear here when a run begins (F5) or a"
    " recorded session is opened (Ctrl+O)."
)
SCALE_BAR = 0.2  # of the width of the picture, at least
MARGIN = 0.01  # about the image, of its width
_OPAQUE = QImage.Format.Format_RGB32
_HALO, _WHITE = QColor(0, 0, 0, 150), QColor("#ffffff")
_ANGLES = np.linspace(0.0, 2 * np.pi, 121)
_CIRCLE = np.column_stack([np.cos(_ANGLES), np.sin(_ANGLES)])


class PictureCanvas(Canvas):
    """The picture; its axes are in mm, with the same scale along both."""

    def __init__(self) -> None:
        super().__init__()
        self.opacity, self.has_cut = 1.0, False
        self._mm = 1.0  # of a pixel
        self._size = (1, 1)
        self._grid: Rect = (0.0, 0.0, 1.0, 1.0)
        self._image: tuple[QImage, Rect] | None = None
        self.field: tuple[Field, QImage] | None = None
        self._colours: tuple[NDArray[np.uint8], Range, str] | None = None  # of the colour bar
        self.circles: Circles | None = None
        self._shows_circles = True
        self._place = math.nan
        self.eyes = NOTHING_SEEN
        self._read_at_s: float | None = None  # of an image that is not painted yet
        self.chart = Chart("Interface", "", "", hint=NO_PICTURE)

    def sizeHint(self) -> QSize:
        """A size at which a picture is seen well."""
        return QSize(640, 480)

    def begin_run(self, size: tuple[int, int], mm: float, grid: Rect) -> None:
        """Empty the picture; `size` is that of images in pixels of `mm`, `grid` that of a field."""
        self._mm, self._size, self._grid = mm, size, grid
        self._image = self.field = self._colours = self.circles = None
        self.eyes, self._read_at_s = NOTHING_SEEN, None
        self.clear()
        width, height = size[0] * mm, size[1] * mm
        pad = MARGIN * width
        self.show_chart(
            Chart(
                "Interface",
                "x, driving direction → (mm)",
                "y (mm)",
                x_range=(-pad, width + pad),
                y_least=(-pad, height + pad),
                is_downward=True,
            )
        )
        self._held = ((-pad, width + pad), (-pad, height + pad))
        self._refresh()

    # ------------------------------------------------------------------ what is shown

    def show_image(self, image: ShownImage, levels: tuple[int, int]) -> None:
        """Show an image, black and white at these grey levels, saturated pixels in red."""
        low, high = levels
        grey = np.clip((np.arange(255) - low) * 255.0 / (high - low), 0, 255).astype(int)
        table = [*(qRgb(n, n, n) for n in grey.tolist()), QColor(theme.now().saturated).rgb()]
        self._image = (_coloured(image.pixels, table), image.rect_px)
        if self.field is None:
            self._colours = None
        self.update()

    def show_difference(self, pixels: NDArray[np.int16], rect: Rect, ends: Range) -> None:
        """Show the difference of two images, in grey levels."""
        self._image = (_coloured(_indices(pixels, ends), _table(diverging())), rect)
        self._colours = (diverging(), ends, "difference (grey levels)")
        self.update()

    def show_field(self, field: Field | None, ends: Range) -> None:
        """Show a field in the colours of a range; None: no field."""
        self.field = None
        if field is not None:
            colours = diverging() if field.is_diverging else sequential()
            indices = _indices(field.values, ends)
            holes = ~np.isfinite(field.values)
            self.field = (field, _coloured(indices, _table(colours), holes))
            self._colours = (colours, ends, field.label)
        elif self._colours is not None and self._colours[2][:4] != "diff":
            self._colours = None
        self.update()

    def note_image(self, read_at_s: float) -> None:
        """What will be painted next is an image that was read at that moment."""
        self._read_at_s = read_at_s

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw all, and note that an image was seen."""
        super().paintEvent(event)
        if self._read_at_s is not None:
            delay_s, self._read_at_s = time.monotonic() - self._read_at_s, None
            self.eyes = Eyes(self.eyes.shown + 1, delay_s)

    def show_circles(self, circles: Circles) -> None:
        """Draw the circles and the centre."""
        self.circles = circles
        self.update()

    def set_circles_visible(self, is_visible: bool) -> None:
        """Show or hide the circles."""
        self._shows_circles = is_visible
        self.update()

    def show_place(self, x: float) -> None:
        """Mark the place of the cut that is pointed at; NaN: none."""
        self._place = x
        self.update()

    def place(self, x_px: float, y_px: float) -> QPointF:
        """Where a place in the camera's image is in this widget."""
        return QPointF(*self.frame().place(x_px * self._mm, y_px * self._mm))

    def point(self, at: QPointF) -> tuple[float, float]:
        """Which place in the camera's image a place in this widget is, in px."""
        x_mm, y_mm = self.frame().point(at.x(), at.y())
        return x_mm / self._mm, y_mm / self._mm

    def table(self) -> str:
        """The field that is drawn as CSV, a row for each point that was measured."""
        if self.field is None:
            return "x_mm,y_mm\n"
        field, _ = self.field
        left, top, width, height = self._grid
        rows, cols = field.values.shape
        x = self._mm * (left + (np.arange(cols) + 0.5) * width / cols)
        y = self._mm * (top + (np.arange(rows) + 0.5) * height / rows)
        lines = [f"x_mm,y_mm,{field.kind.key}"]
        values = field.values + np.float32(field.offset)
        for row, col in np.argwhere(np.isfinite(values)):
            lines.append(f"{x[col]:.9g},{y[row]:.9g},{values[row, col]:.9g}")
        return "\n".join(lines) + "\n"

    # ------------------------------------------------------------------ drawing

    def _right(self, text: QFontMetricsF) -> float:
        """Room of the colour bar."""
        return BAR + BAR_TEXT * text.averageCharWidth() + 3 * GAP

    def _head(self, text: QFontMetricsF, width: float) -> float:
        return 2 * GAP + text.height()

    def _frame(self, room: QRectF) -> Frame:
        """With the same scale along x and y: the range of one of them grows."""
        frame = super()._frame(room)
        along, down = frame.width / _span(frame.x), frame.height / _span(frame.y)
        if self.is_zoomed:
            x = _widened(frame.x, along / down) if along > down else frame.x
            y = _widened(frame.y, down / along) if down > along else frame.y
            return Frame(frame.left, frame.top, frame.width, frame.height, x, y, True)
        scale = min(along, down)
        width, height = scale * _span(frame.x), scale * _span(frame.y)
        left = frame.left + (frame.width - width) / 2
        return Frame(left, frame.top, width, height, frame.x, frame.y, True)

    def _ground_key(self) -> tuple[Any, ...]:
        bar = self._colours and (self._colours[0][0].tobytes(), *self._colours[1:])
        return (*super()._ground_key(), bar)

    def _draw_ground(self, painter: QPainter, frame: Frame, room: QRectF) -> None:
        super()._draw_ground(painter, frame, room)
        if self._colours is None:
            return
        colours, (low, high), name = self._colours
        text = QFontMetricsF(self.font())
        left, top = frame.left + frame.width + 3 * GAP, frame.top + 1
        bar = QRectF(left, top, BAR, frame.height - 2)
        strip = _coloured(np.arange(255, -1, -1, dtype=np.uint8)[:, None], _table(colours))
        painter.drawImage(bar, strip)
        painter.setPen(QColor(theme.now().muted))
        most = max(2, min(8, int(frame.height / (TICK_ROOM[1] * text.height()))))
        for value, written in ticks(low, high, most):
            at = bar.bottom() - (value - low) / (high - low) * bar.height()
            painter.drawLine(QPointF(bar.right(), at), QPointF(bar.right() + 3, at))
            at = min(max(at, bar.top() + text.ascent() / 2), bar.bottom() - 1)
            painter.drawText(QPointF(bar.right() + 5, at + text.ascent() / 2 - 1), written)
        painter.setPen(QColor(theme.now().text))
        end = min(room.right() - GAP, bar.right() + BAR_TEXT * text.averageCharWidth())
        painter.drawText(
            QPointF(end - text.horizontalAdvance(name), room.top() + GAP + text.ascent()), name
        )

    def _draw_inside(self, painter: QPainter, frame: Frame) -> None:
        inside = QRectF(frame.left, frame.top, frame.width, frame.height)
        painter.save()
        painter.setClipRect(inside)
        covered = self._placed(frame, self._grid)
        if self._image is not None:
            image, rect = self._image
            if self.field is not None and self.opacity == 1 and self.field[1].format() == _OPAQUE:
                beside = QRegion(inside.toAlignedRect()) - QRegion(covered.toRect())
                painter.setClipRegion(beside)
            painter.drawImage(self._placed(frame, rect), image)
            painter.setClipRect(inside)
        if self.field is not None and self.opacity > 0:
            painter.setOpacity(self.opacity)
            painter.drawImage(covered, self.field[1])
            painter.setOpacity(1.0)
        if self.circles is not None and self._shows_circles:
            self._draw_circles(painter, frame, self.circles)
        if self.has_cut:
            self._draw_cut(painter, frame)
        if self._image is not None or self.field is not None:
            self._draw_scale_bar(painter, frame)
        painter.restore()

    def _placed(self, frame: Frame, rect: Rect) -> QRectF:
        """A rectangle of pixels on the screen: (0, 0) is the centre of the first pixel."""
        left, top = frame.place(*(self._mm * at for at in rect[:2]))
        along, down = frame.scale
        return QRectF(left, top, rect[2] * self._mm * along, rect[3] * self._mm * down)

    def _draw_circles(self, painter: QPainter, frame: Frame, circles: Circles) -> None:
        if circles.centre_px is None:
            return
        centre = QPointF(*frame.place(*(self._mm * at for at in circles.centre_px)))
        scale = frame.scale[0] * self._mm
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        for radius, style in (
            (circles.apparent_px, Qt.PenStyle.DashLine),
            (circles.hertz_px, Qt.PenStyle.DotLine),
            (circles.stick_px, Qt.PenStyle.SolidLine),
        ):
            if math.isfinite(radius):
                _draw_ring(painter, centre, radius * scale, style)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing, False)
        for pen in (QPen(_HALO, 3), QPen(_WHITE, 1)):
            painter.setPen(pen)
            painter.drawLine(centre - QPointF(7, 0), centre + QPointF(7, 0))
            painter.drawLine(centre - QPointF(0, 7), centre + QPointF(0, 7))
        used: list[QRectF] = []
        for radius, name in (
            (circles.stick_px, "c"),
            (circles.hertz_px, "a_H"),
            (circles.apparent_px, "a"),
        ):
            if math.isfinite(radius) and radius * scale > 8:
                self._name_circle(painter, frame, centre, radius * scale, name, used)

    def _name_circle(
        self,
        painter: QPainter,
        frame: Frame,
        centre: QPointF,
        radius: float,
        name: str,
        used: list[QRectF],
    ) -> None:
        """Write a radius beside its circle, where no other name is."""
        text = QFontMetricsF(self.font())
        width, height = advance(self.font(), name) + 6, text.height()
        for degrees in (45, 20, 70, 135, 160, 110, -45, -135):
            way = math.radians(degrees)
            at = centre + QPointF(radius * math.cos(way), -radius * math.sin(way))
            room = QRectF(at.x() - width / 2, at.y() - height / 2, width, height)
            is_inside = frame.holds(room.left(), room.top()) and frame.holds(
                room.right(), room.bottom()
            )
            if is_inside and not any(room.intersects(other) for other in used):
                used.append(room)
                painter.fillRect(room, _HALO)
                painter.setPen(_WHITE)
                write(painter, room.topLeft() + QPointF(3, text.ascent()), name)
                return

    def _draw_cut(self, painter: QPainter, frame: Frame) -> None:
        centre = self.circles.centre_px if self.circles else None
        _, grid_top, _, grid_height = self._grid
        y_px = centre[1] if centre else grid_top + grid_height / 2
        left, top = frame.place(self._place, self._mm * y_px)
        for pen in (QPen(_HALO, 3), QPen(_WHITE, 1)):
            painter.setPen(pen)
            painter.drawLine(QPointF(frame.left, top), QPointF(frame.left + frame.width, top))
            if math.isfinite(left):
                painter.drawLine(QPointF(left, top - 10), QPointF(left, top + 10))

    def _draw_scale_bar(self, painter: QPainter, frame: Frame) -> None:
        text = QFontMetricsF(self.font())
        length = round_step(SCALE_BAR * _span(frame.x))
        is_fine = length < 0.1
        shown = f"{number(1e3 * length, 0)} µm" if is_fine else f"{length:g} mm"
        width = length * frame.scale[0]
        wide = max(width, text.horizontalAdvance(shown)) + 12
        high = text.height() + 12
        room = QRectF(frame.left + 8, frame.top + frame.height - high - 8, wide, high)
        painter.fillRect(room, _HALO)
        painter.fillRect(QRectF(room.center().x() - width / 2, room.bottom() - 8, width, 3), _WHITE)
        painter.setPen(_WHITE)
        painter.drawText(
            room.adjusted(0, 2, 0, -8),
            Qt.AlignmentFlag.AlignHCenter | Qt.AlignmentFlag.AlignTop,
            shown,
        )


def _draw_ring(painter: QPainter, centre: QPointF, radius: float, style: Qt.PenStyle) -> None:
    """A white circle between two dark ones: lines of one pixel, for thicker ones take Qt twenty
    times as long.
    """
    for inwards, colour, kind in (
        (1.0, _HALO, Qt.PenStyle.SolidLine),
        (-1.0, _HALO, Qt.PenStyle.SolidLine),
        (0.0, _WHITE, style),
    ):
        painter.setPen(QPen(colour, 1.0, kind))
        ring = (radius - inwards) * _CIRCLE + (centre.x(), centre.y())
        painter.drawPolyline(polygon(ring))


def _span(ends: Range) -> float:
    return ends[1] - ends[0]


def _widened(ends: Range, factor: float) -> Range:
    middle, half = sum(ends) / 2, factor * _span(ends) / 2
    return middle - half, middle + half


def _indices(values: NDArray[Any], ends: Range) -> NDArray[np.uint8]:
    """The colour of each value, of 256; NaN is any."""
    low, high = ends
    share = (np.asarray(values, np.float32) - np.float32(low)) * np.float32(256 / (high - low))
    return np.asarray(np.nan_to_num(np.clip(share, 0, 255)), np.uint8)


def _table(colours: NDArray[np.uint8]) -> list[int]:
    return [qRgb(*colour) for colour in colours.tolist()]


def _coloured(
    indices: NDArray[np.uint8], table: list[int], holes: NDArray[np.bool_] | None = None
) -> QImage:
    """An image that Qt draws without converting it, transparent in the holes."""
    rows, cols = indices.shape
    bound = np.ascontiguousarray(indices)
    shown = QImage(bound.data, cols, rows, cols, QImage.Format.Format_Indexed8)
    shown.setColorTable(table)
    if holes is None or not holes.any():
        return shown.convertToFormat(_OPAQUE)
    made = shown.convertToFormat(QImage.Format.Format_ARGB32_Premultiplied)
    pixels = np.frombuffer(made.bits(), np.uint32).reshape(rows, cols)
    pixels[holes] = 0
    return made
