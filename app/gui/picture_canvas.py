"""Draws an image of the interface, a field over it, and the circles of the contact."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from functools import cache, lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import (
    QColor,
    QFont,
    QFontMetricsF,
    QImage,
    QPainter,
    QPaintEvent,
    QPen,
    QPolygonF,
    QRegion,
    qRgb,
)

from app.gui import theme
from app.gui.canvas import GAP, TICK_ROOM, Canvas, polygon
from app.gui.cells import number
from app.gui.charts import AxesFrame, Chart
from app.gui.frame_results import Circles, FieldImage, ShownImage
from app.gui.lettering import advance, write
from app.gui.scales import Range, diverging, round_step, sequential, ticks
from app.gui.source import Rect
from app.gui.view_state import NOTHING_SEEN, Eyes
from app.system.outputs import csv_text

BAR, BAR_TEXT = 14.0, 7  # width of the colour bar in px, and of its numbers in characters
NO_PICTURE = (
    "The camera's image, and the displacements in it, appear here when a bench is connected, a run"
    " begins (F5), or a recorded session is opened (Ctrl+O)."
)
SCALE_BAR = 0.2  # of the width of the picture, at least
DIFFERENCE = "difference (grey levels)"
MARGIN = 0.01  # about the image, of its width
STYLES = (Qt.PenStyle.DashLine, Qt.PenStyle.DotLine, Qt.PenStyle.SolidLine)
NAMES = ("a", "a_H", "c")  # of the circles
LEAST_NAMED = 8.0  # radius on the screen
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
        self._image: _Picture | None = None
        self.field: tuple[FieldImage, QImage] | None = None
        # of the colour bar: whether the colours go both ways, its ends, and its name
        self._colours: tuple[bool, Range, str] | None = None
        self.circles: Circles | None = None
        self._rings: tuple[Any, _DrawnRings] | None = (
            None  # what they were made of, and what is drawn
        )
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
        table = _greys(*levels, theme.now().saturated)
        self._image = _Picture(image.pixels, table, image.rect_px)
        if self.field is None:
            self._colours = None
        self.update()

    def show_colours(self, rgb: NDArray[np.uint8], rect: Rect) -> None:
        """Show a picture whose colours are given, shape (rows, cols, 3)."""
        rows, cols, _ = rgb.shape
        bound = np.ascontiguousarray(rgb)
        whole = QImage(bound.data, cols, rows, 3 * cols, QImage.Format.Format_RGB888)
        self._image = _Picture(bound[..., 0], [], rect, whole.convertToFormat(_OPAQUE))
        self.update()

    def show_difference(self, pixels: NDArray[np.int16], rect: Rect, ends: Range) -> None:
        """Show the difference of two images, in grey levels."""
        self._image = _Picture(_indices(pixels, ends), _table(is_diverging=True), rect)
        self._colours = (True, ends, DIFFERENCE)
        self.update()

    def show_field(self, field: FieldImage | None, ends: Range) -> None:
        """Show a field in the colours of a range; None: no field."""
        self.field = None
        if field is not None:
            table = _table(is_diverging=field.is_diverging)
            indices = _indices(field.values, ends)
            holes = ~np.isfinite(field.values)
            self.field = (field, _coloured(indices, table, holes))
            self._colours = (field.is_diverging, ends, field.label)
        elif self._colours is not None and self._colours[2] != DIFFERENCE:
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
            return csv_text([("x_mm", "y_mm")])
        field, _ = self.field
        left, top, width, height = self._grid
        rows, cols = field.values.shape
        x = self._mm * (left + (np.arange(cols) + 0.5) * width / cols)
        y = self._mm * (top + (np.arange(rows) + 0.5) * height / rows)
        values = field.values + np.float32(field.offset)
        row, col = np.nonzero(np.isfinite(values))
        rows = zip(x[col], y[row], values[row, col].tolist(), strict=True)
        return csv_text([("x_mm", "y_mm", field.kind.key), *rows])

    # ------------------------------------------------------------------ drawing

    def _right(self, text: QFontMetricsF) -> float:
        """Room of the colour bar."""
        return BAR + BAR_TEXT * text.averageCharWidth() + 3 * GAP

    def _head(self, text: QFontMetricsF, width: float) -> float:
        return 2 * GAP + text.height()

    def _frame(self, room: QRectF) -> AxesFrame:
        """With the same scale along x and y: the range of one of them grows."""
        frame = super()._frame(room)
        along, down = frame.width / _span(frame.x), frame.height / _span(frame.y)
        if self.is_zoomed:
            x = _widened(frame.x, along / down) if along > down else frame.x
            y = _widened(frame.y, down / along) if down > along else frame.y
            return AxesFrame(frame.left, frame.top, frame.width, frame.height, x, y, True)
        scale = min(along, down)
        width, height = scale * _span(frame.x), scale * _span(frame.y)
        left = frame.left + (frame.width - width) / 2
        return AxesFrame(left, frame.top, width, height, frame.x, frame.y, True)

    def _ground_key(self) -> tuple[Any, ...]:
        return (*super()._ground_key(), self._colours)

    def _bare(self, frame: AxesFrame) -> QRegion:
        """Beside the image."""
        all_of_it = super()._bare(frame)
        if self._image is None:
            return all_of_it
        axes = QRectF(frame.left, frame.top, frame.width, frame.height)
        covered = self._placed(frame, self._image.rect).intersected(axes).toAlignedRect()
        return all_of_it - QRegion(covered.adjusted(1, 1, -1, -1))

    def _draw_ground(self, painter: QPainter, frame: AxesFrame, room: QRectF) -> None:
        super()._draw_ground(painter, frame, room)
        if self._colours is None:
            return
        is_diverging, (low, high), name = self._colours
        text = QFontMetricsF(self.font())
        left, top = frame.left + frame.width + 3 * GAP, frame.top + 1
        bar = QRectF(left, top, BAR, frame.height - 2)
        table = _table(is_diverging=is_diverging)
        strip = _coloured(np.arange(255, -1, -1, dtype=np.uint8)[:, None], table)
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

    def _draw_inside(self, painter: QPainter, frame: AxesFrame) -> None:
        inside = QRectF(frame.left, frame.top, frame.width, frame.height)
        self._draw_hint(painter, inside)
        painter.save()
        painter.setClipRect(inside)
        if self._image is not None:
            field = self.field and self.field[1]
            is_covered = field and self.opacity == 1 and field.format() == _OPAQUE
            for image, rect in self._image.pieces(self._grid if is_covered else None):
                painter.drawImage(self._placed(frame, rect), image)
        if self.field is not None and self.opacity > 0:
            painter.setOpacity(self.opacity)
            painter.drawImage(self._placed(frame, self._grid), self.field[1])
            painter.setOpacity(1.0)
        if self.circles is not None and self._shows_circles:
            self._draw_circles(painter, frame, self.circles)
        if self.has_cut:
            self._draw_cut(painter, frame)
        if self._image is not None or self.field is not None:
            self._draw_scale_bar(painter, frame)
        painter.restore()

    def _placed(self, frame: AxesFrame, rect: Rect) -> QRectF:
        """A rectangle of pixels on the screen: (0, 0) is the centre of the first pixel."""
        left, top = frame.place(*(self._mm * at for at in rect[:2]))
        along, down = frame.scale
        return QRectF(left, top, rect[2] * self._mm * along, rect[3] * self._mm * down)

    def _draw_circles(self, painter: QPainter, frame: AxesFrame, circles: Circles) -> None:
        if circles.centre_px is None:
            return
        scale = frame.scale[0] * self._mm
        radii = tuple(
            round(2 * px * scale) / 2 if math.isfinite(px) else 0.0
            for px in (circles.apparent_px, circles.hertz_px, circles.stick_px)
        )
        key = (frame, self.font().key(), circles.centre_px, radii)
        if self._rings is None or self._rings[0] != key:
            centre = QPointF(*frame.place(*(self._mm * at for at in circles.centre_px)))
            self._rings = (key, _DrawnRings(centre, radii, frame, self.font()))
        self._rings[1].draw(painter)

    def _draw_cut(self, painter: QPainter, frame: AxesFrame) -> None:
        centre = self.circles.centre_px if self.circles else None
        _, grid_top, _, grid_height = self._grid
        y_px = centre[1] if centre else grid_top + grid_height / 2
        left, top = frame.place(self._place, self._mm * y_px)
        for pen in (QPen(_HALO, 3), QPen(_WHITE, 1)):
            painter.setPen(pen)
            painter.drawLine(QPointF(frame.left, top), QPointF(frame.left + frame.width, top))
            if math.isfinite(left):
                painter.drawLine(QPointF(left, top - 10), QPointF(left, top + 10))

    def _draw_scale_bar(self, painter: QPainter, frame: AxesFrame) -> None:
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


class _DrawnRings:
    """The circles a, a_H and c about the centre, with their names, ready to be drawn; a radius of 0
    is not known.
    """

    def __init__(
        self, centre: QPointF, radii: tuple[float, ...], frame: AxesFrame, font: QFont
    ) -> None:
        self._centre, self._ascent = centre, QFontMetricsF(font).ascent()
        self._lines: list[tuple[QPen, QPolygonF]] = []
        self._names: list[tuple[QRectF, str]] = []
        for radius, style in zip(radii, STYLES, strict=True):
            # a white circle between two dark ones: lines of one pixel, for thicker ones take Qt
            # twenty times as long
            for inwards, colour, kind in (
                (1.0, _HALO, Qt.PenStyle.SolidLine),
                (-1.0, _HALO, Qt.PenStyle.SolidLine),
                (0.0, _WHITE, style),
            ):
                ring = (radius - inwards) * _CIRCLE + (centre.x(), centre.y())
                if radius:
                    self._lines.append((QPen(colour, 1.0, kind), polygon(ring)))
        for radius, name in zip(radii[::-1], NAMES[::-1], strict=True):
            if radius > LEAST_NAMED:
                self._place(name, radius, frame, font)

    def _place(self, name: str, radius: float, frame: AxesFrame, font: QFont) -> None:
        """Place a name on its circle, where no other name is."""
        width, height = advance(font, name) + 6, QFontMetricsF(font).height()
        for degrees in (45, 20, 70, 135, 160, 110, -45, -135):
            way = math.radians(degrees)
            at = self._centre + QPointF(radius * math.cos(way), -radius * math.sin(way))
            room = QRectF(at.x() - width / 2, at.y() - height / 2, width, height)
            is_inside = frame.holds(room.left(), room.top()) and frame.holds(
                room.right(), room.bottom()
            )
            if is_inside and not any(room.intersects(other) for other, _ in self._names):
                self._names.append((room, name))
                return

    def draw(self, painter: QPainter) -> None:
        """Draw circles, centre and names."""
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        for pen, line in self._lines:
            painter.setPen(pen)
            painter.drawPolyline(line)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing, False)
        for pen in (QPen(_HALO, 3), QPen(_WHITE, 1)):
            painter.setPen(pen)
            for arm in (QPointF(7, 0), QPointF(0, 7)):
                painter.drawLine(self._centre - arm, self._centre + arm)
        for room, name in self._names:
            painter.fillRect(room, _HALO)
            painter.setPen(_WHITE)
            write(painter, room.topLeft() + QPointF(3, self._ascent), name)


class _Picture:
    """An image in the colours of a table; `rect` is its place in pixels of the camera."""

    def __init__(
        self,
        indices: NDArray[np.uint8],
        table: list[int],
        rect: Rect,
        whole: QImage | None = None,
    ) -> None:
        self._indices, self._table, self.rect, self._whole = indices, table, rect, whole

    def pieces(self, covered: Rect | None) -> Iterator[tuple[QImage, Rect]]:
        """What is seen beside a covered part, with its places; all of it where none is."""
        if covered is None:
            if self._whole is None:
                self._whole = _coloured(self._indices, self._table)
            yield self._whole, self.rect
            return
        rows, cols = self._indices.shape
        left, top, width, height = self.rect
        dx, dy = width / cols, height / rows
        x_first, y_first = covered[0] - left, covered[1] - top
        x_last, y_last = x_first + covered[2], y_first + covered[3]
        above, below = max(0, math.ceil(y_first / dy)), max(0, math.floor(y_last / dy))
        before, after = max(0, math.ceil(x_first / dx)), max(0, math.floor(x_last / dx))
        for y0, y1, x0, x1 in (
            (0, above, 0, cols),
            (below, rows, 0, cols),
            (above, below, 0, before),
            (above, below, after, cols),
        ):
            piece = self._indices[y0:y1, x0:x1]
            if piece.size:
                place = (left + x0 * dx, top + y0 * dy, piece.shape[1] * dx, piece.shape[0] * dy)
                yield _coloured(piece, self._table), place


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


@cache
def _table(*, is_diverging: bool) -> list[int]:
    return [qRgb(*colour) for colour in (diverging() if is_diverging else sequential()).tolist()]


@lru_cache(maxsize=8)
def _greys(black: int, white: int, saturated: str) -> list[int]:
    grey = np.clip((np.arange(255) - black) * 255.0 / (white - black), 0, 255).astype(int)
    return [*(qRgb(n, n, n) for n in grey.tolist()), QColor(saturated).rgb()]


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
