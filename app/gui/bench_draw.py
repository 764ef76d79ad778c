"""What of a connected bench is drawn: the live picture with its histogram, a force with its limits,
a device with its state.
"""

from __future__ import annotations

import math

import numpy as np
from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QImage, QPainter, QPaintEvent, QPen, QPolygonF
from PySide6.QtWidgets import QLabel, QSizePolicy, QWidget

from app.gui import theme
from app.gui.bench_cells import MARKS, DeviceLine, Gauge
from app.gui.cells import Tone
from app.gui.widgets import Panel, Part, column, label, row
from app.records.bench_view import PictureView

HISTOGRAM_PX = 44
LEAST_SPAN_N = 4e-3  # of the trace of a force


class PictureBox(QWidget):
    """The live picture as wide as there is room, and the histogram of its grey levels below."""

    def __init__(self) -> None:
        super().__init__()
        self.note = ""
        self._picture: PictureView | None = None
        self._image = QImage()
        self._ratio = 0.75
        policy = QSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        policy.setHeightForWidth(True)
        self.setSizePolicy(policy)
        self.setAccessibleName("Live picture")

    def show_picture(self, picture: PictureView | None, note: str = "") -> None:
        """Show this picture with a note on it, unless both are shown already."""
        if note != self.note:
            self.note = note
            self.update()
        if picture is self._picture:
            return
        self._picture = picture
        if picture is None:
            self._image = QImage()
        else:
            rows, columns, _ = picture.rgb.shape
            data = np.ascontiguousarray(picture.rgb)
            form = QImage.Format.Format_RGB888
            self._image = QImage(data.data, columns, rows, 3 * columns, form).copy()
            if rows / columns != self._ratio:
                self._ratio = rows / columns
                self.updateGeometry()
        self.update()

    def hasHeightForWidth(self) -> bool:
        """Its height follows from its width."""
        return True

    def heightForWidth(self, width: int) -> int:
        """Of the picture and the histogram."""
        return round(width * self._ratio) + HISTOGRAM_PX

    def sizeHint(self) -> QSize:
        """As in a dock."""
        return QSize(300, self.heightForWidth(300))

    def minimumSizeHint(self) -> QSize:
        """As in the narrowest dock."""
        return QSize(200, self.heightForWidth(200))

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw both."""
        painter = QPainter(self)
        height = min(self.height() - HISTOGRAM_PX, round(self.width() * self._ratio))
        width = round(height / self._ratio)
        place = QRectF((self.width() - width) / 2, 0, width, height)
        painter.fillRect(place, QColor("black"))
        if self._picture is None:
            painter.setPen(QColor(theme.MUTED))
            painter.drawText(place, Qt.AlignmentFlag.AlignCenter, "no picture")
            return
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
        painter.drawImage(place, self._image)
        if self.note:
            strip = QRectF(place.left(), place.top(), place.width(), 24)
            painter.fillRect(strip, QColor(theme.WINDOW))
            painter.setPen(QColor(theme.TONES[Tone.WARN]))
            painter.drawText(strip, Qt.AlignmentFlag.AlignCenter, self.note)
        self._draw_histogram(painter, QRectF(place.left(), height + 4, width, HISTOGRAM_PX - 6))

    def _draw_histogram(self, painter: QPainter, place: QRectF) -> None:
        assert self._picture is not None
        shares = self._picture.histogram
        painter.fillRect(place, QColor(theme.WINDOW))
        heights = np.sqrt(shares / max(float(shares.max()), 1e-9))  # the small ones are seen
        width = place.width() / len(shares)
        for i, height in enumerate(heights.tolist()):
            is_last = i == len(shares) - 1 and self._picture.saturated > 0
            colour = QColor("#ff3030") if is_last else QColor(theme.MUTED)
            bar = QRectF(0, 0, max(1.0, width - 0.5), height * place.height())
            bar.moveBottomLeft(QPointF(place.left() + i * width, place.bottom()))
            painter.fillRect(bar, colour)


class _ForceScale(QWidget):
    """The scale of a force with limits, band and value, and the trace of ten seconds."""

    def __init__(self) -> None:
        super().__init__()
        self.gauge: Gauge | None = None
        self.setFixedHeight(58)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw it."""
        gauge = self.gauge
        if gauge is None:
            return
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        bar = QRectF(0, 4, self.width(), 14)
        span = gauge.high - gauge.low

        def x(value: float) -> float:
            share = (min(max(value, gauge.low), gauge.high) - gauge.low) / span
            return bar.left() + share * bar.width()

        painter.fillRect(bar, QColor(theme.WINDOW))
        low, high = map(x, gauge.band)
        band = QRectF(low, bar.top(), max(3.0, high - low), bar.height())
        colour = QColor(theme.TONES[Tone.GOOD])
        colour.setAlpha(170)
        painter.fillRect(band, colour)
        painter.setPen(QPen(QColor(theme.MUTED), 1))
        painter.drawLine(QPointF(x(0.0), bar.top()), QPointF(x(0.0), bar.bottom()))
        painter.setPen(QPen(QColor(theme.TONES[Tone.BAD]), 2.5))
        for limit in gauge.limits:
            painter.drawLine(QPointF(x(limit), bar.top() - 3), QPointF(x(limit), bar.bottom() + 3))
        if math.isfinite(gauge.value):
            painter.setPen(QPen(QColor(_colour(gauge)), 3))
            here = x(gauge.value)
            painter.drawLine(QPointF(here, bar.top() - 4), QPointF(here, bar.bottom() + 4))
        painter.setRenderHint(QPainter.RenderHint.Antialiasing, False)  # ten times as fast
        painter.setPen(QPen(QColor(_colour(gauge)), 1))
        self._draw_trace(painter, QRectF(0, 26, self.width(), 30), gauge)

    def _draw_trace(self, painter: QPainter, place: QRectF, gauge: Gauge) -> None:
        values = [value for value in gauge.history if math.isfinite(value)]
        if len(values) < 2:
            return
        low, high = min(values), max(values)
        middle, span = (low + high) / 2, max(high - low, LEAST_SPAN_N)
        line = QPolygonF()
        for at, value in zip(gauge.time_s, gauge.history, strict=True):
            if math.isfinite(value):
                share = 0.5 - (value - middle) / span * 0.9
                line.append(
                    QPointF(place.right() + at / 10.0 * place.width(), place.top() + share * 30)
                )
        painter.drawPolyline(line)


class GaugeView(QWidget):
    """A force: its value, large; its scale; its last ten seconds; what is wrong with it."""

    def __init__(self, name: str) -> None:
        super().__init__()
        self.value, self.note, self.legend = label("–", ""), label("", "detail"), label("", "name")
        self.value.setStyleSheet("font-size: 26px; font-weight: 600;")
        self._scale = _ForceScale()
        self._tone: Tone | None = None
        head = row(label(name, "name"), (self.value, 1), label("N", "detail"), spacing=8)
        self.value.setAlignment(Qt.AlignmentFlag.AlignRight)
        self.note.setAlignment(Qt.AlignmentFlag.AlignRight)
        foot = row(self.legend, (self.note, 1), spacing=6)
        self.setLayout(column(head, self._scale, foot, spacing=0))

    def show_gauge(self, gauge: Gauge) -> None:
        """Show the force now."""
        self.value.setText(gauge.text)
        self.note.setText(gauge.note)
        is_calm = gauge.tone in (Tone.NEUTRAL, Tone.GOOD)
        self.legend.setText(gauge.legend if is_calm else "")  # an alarm needs the room
        if gauge.tone is not self._tone:
            self._tone = gauge.tone
            colour = theme.TEXT if gauge.tone is Tone.NEUTRAL else theme.TONES[gauge.tone]
            self.value.setStyleSheet(f"font-size: 26px; font-weight: 600; color: {colour};")
            self.note.setStyleSheet("" if is_calm else f"color: {theme.TONES[gauge.tone]};")
        if gauge.hint != self.toolTip():
            self.setToolTip(gauge.hint)
        self._scale.gauge = gauge
        self._scale.update()


class DeviceLineView(QWidget):
    """A device with its state and its sentence."""

    def __init__(self) -> None:
        super().__init__()
        self.mark, self.device, self.sentence = QLabel(), QLabel(), words("muted")
        self.word = label("", "detail")
        self.mark.setFixedWidth(16)
        self._shown: DeviceLine | None = None
        head = row(self.mark, (self.device, 1), self.word, spacing=4)
        self.setLayout(column(head, self.sentence, spacing=0))

    def show_line(self, line: DeviceLine) -> None:
        """Show it, unless it is shown already."""
        if line == self._shown:
            return
        self._shown = line
        colour = theme.TONES[line.tone]
        self.mark.setText(MARKS[line.tone])
        self.mark.setStyleSheet(f"color: {colour}; font-weight: 700;")
        self.device.setText(line.name)
        self.word.setText(line.word)
        is_wrong = line.tone in (Tone.WARN, Tone.BAD)
        for text in (self.word, self.sentence):
            text.setStyleSheet(f"color: {colour};" if is_wrong else "")
        self.sentence.setText(line.sentence)
        self.sentence.setVisible(bool(line.sentence))


def words(style: str) -> QLabel:
    """A sentence over as many lines as it needs, which can be copied."""
    made = label("", style)
    made.setWordWrap(True)
    made.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
    return made


def framed(*parts: Part) -> Panel:
    """A frame around `parts`, one below the other."""
    frame = Panel()
    frame.setLayout(column(*parts, spacing=6, margins=(10, 8, 10, 8)))
    return frame


def _colour(gauge: Gauge) -> str:
    return theme.now().normal if gauge.symbol == "P" else theme.now().shear
