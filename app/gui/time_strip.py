"""The strip of a recorded run: its states in colours, its events, and the frame that is shown."""

from __future__ import annotations

import math

from PySide6.QtCore import QPointF, QRectF, Qt, Signal
from PySide6.QtGui import QColor, QMouseEvent, QPainter, QPaintEvent, QPen, QPolygonF
from PySide6.QtWidgets import QToolTip, QWidget

from app.evaluation.timeline import LOSS, STOP, ContactState, Mark, Timeline
from app.gui import theme
from app.gui.cells import number, typeset
from app.gui.scales import round_step
from app.records.record_types import NOTE, RESTART, STEP

# told apart also by those who confuse red and green, and by how bright they are
COLOURS = {
    ContactState.BACKGROUND: "#6b7482",
    ContactState.CONTACT: "#8d97a6",
    ContactState.REFERENCE: "#c9ced6",
    ContactState.STICK: "#56b4e9",
    ContactState.PARTIAL: "#f0e442",
    ContactState.SLIDE: "#e0842f",
    ContactState.END: "#4a525e",
}
MARKS = {STEP: "#e4e7eb", NOTE: "#e4e7eb", RESTART: "#c6a8f0", LOSS: "#ff6b6b", STOP: "#ff6b6b"}
INK = "#10131a"
EDGE_PX, BAND_PX, TICKS_PX = 8, 22, 16
NEAR_PX = 5  # from a mark, to be told of it


class TimeStrip(QWidget):
    """Draws a `Timeline`; `chosen` has the frame nearest to where it is pressed or dragged."""

    chosen = Signal(int)

    def __init__(self) -> None:
        super().__init__()
        self._line: Timeline | None = None
        self._frame = 0
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setMouseTracking(True)
        self.setFixedHeight(EDGE_PX + BAND_PX + TICKS_PX + 4)
        self.setMinimumWidth(160)
        self.setAccessibleName("Time line of the recorded run")

    def show_timeline(self, line: Timeline | None) -> None:
        """Draw another run."""
        self._line = line
        self.update()

    def show_frame(self, frame: int) -> None:
        """Move the cursor to a frame."""
        if frame != self._frame:
            self._frame = frame
            self.update()

    @property
    def _end(self) -> int:
        return max(1, self._line.end) if self._line else 1

    def x_of(self, sample: float) -> float:
        """Where a sample is."""
        return EDGE_PX + (self.width() - 2 * EDGE_PX) * sample / self._end

    def sample_at(self, x: float) -> float:
        """Which sample is there."""
        share = (x - EDGE_PX) / max(1, self.width() - 2 * EDGE_PX)
        return min(max(share, 0.0), 1.0) * self._end

    def describe(self, x: float) -> str:
        """What was at a place: the time, the state, and what happened there."""
        line = self._line
        if line is None:
            return ""
        sample = self.sample_at(x)
        state = line.state_at(sample)
        near = [mark.text for mark in line.marks if abs(self.x_of(mark.sample) - x) <= NEAR_PX]
        first = f"t = {number(line.time_s(sample), 2)} s, frame {line.nearest(sample)}"
        return "\n".join(filter(None, (f"{first}: {state}" if state else first, *near)))

    # ------------------------------------------------------------------ the mouse

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Choose the frame there."""
        if event.button() is Qt.MouseButton.LeftButton:
            self._choose(event.position().x())

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        """Follow the pointer while it is pressed; else say what was there."""
        x = event.position().x()
        if event.buttons() & Qt.MouseButton.LeftButton:
            self._choose(x)
        elif self._line is not None:
            QToolTip.showText(event.globalPosition().toPoint(), self.describe(x), self)

    def _choose(self, x: float) -> None:
        if self._line is not None and self.isEnabled():
            self.chosen.emit(self._line.nearest(self.sample_at(x)))

    # ------------------------------------------------------------------ drawing

    def paintEvent(self, _: QPaintEvent) -> None:
        """Draw states, events, times, and the cursor over them."""
        line = self._line
        if line is None:
            return
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        font = painter.font()
        font.setPointSizeF(max(7.0, font.pointSizeF() - 1.5))
        painter.setFont(font)
        self._draw_states(painter, line)
        self._draw_times(painter, line)
        for mark in line.marks:
            self._draw_mark(painter, mark)
        if not self.isEnabled():
            painter.fillRect(self.rect(), QColor(20, 23, 28, 120))
        self._draw_cursor(painter, line)
        if self.hasFocus():
            painter.setPen(theme.ring())
            painter.setBrush(Qt.BrushStyle.NoBrush)
            painter.drawRect(self.rect())
        painter.end()

    def _draw_states(self, painter: QPainter, line: Timeline) -> None:
        words = painter.fontMetrics()
        for state, begin, end in line.stretches:
            left, right = self.x_of(begin), self.x_of(end)
            rect = QRectF(left, EDGE_PX, max(1.0, right - left), BAND_PX)
            painter.fillRect(rect, QColor(COLOURS[state]))
            if words.horizontalAdvance(state) + 6 < rect.width():
                painter.setPen(QColor(INK if state is not ContactState.END else "#ffffff"))
                painter.drawText(rect, Qt.AlignmentFlag.AlignCenter, state)
        painter.setPen(QPen(QColor(INK), 1))
        base = EDGE_PX + BAND_PX
        for sample, is_analysed in zip(line.samples, line.is_analysed, strict=True):
            if not is_analysed:  # a notch in the band
                x = self.x_of(float(sample))
                painter.drawLine(QPointF(x, base - 3), QPointF(x, base))

    def _draw_times(self, painter: QPainter, line: Timeline) -> None:
        first, last = line.time_s(0), line.time_s(line.end)
        step = round_step(max(last - first, 1e-9) / max(1, self.width() // 70))
        painter.setPen(self.palette().windowText().color())
        top = EDGE_PX + BAND_PX
        for k in range(math.ceil(first / step), math.floor(last / step) + 1):
            x = self.x_of(k * step * line.sample_rate_hz + (line.drive_start or 0))
            text = typeset(f"{k * step:.6g} s")
            painter.drawLine(QPointF(x, top), QPointF(x, top + 3))
            width = painter.fontMetrics().horizontalAdvance(text)
            left = min(max(x - width / 2, 0.0), self.width() - width)
            painter.drawText(QPointF(left, top + 3 + painter.fontMetrics().ascent()), text)

    def _draw_mark(self, painter: QPainter, mark: Mark) -> None:
        x, colour = self.x_of(mark.sample), QColor(MARKS[mark.kind])
        painter.setPen(Qt.PenStyle.NoPen)
        painter.setBrush(colour)
        # a flag upwards; what went wrong is larger, and across the band
        if mark.kind in (STEP, NOTE):
            painter.drawRect(QRectF(x - 0.75, EDGE_PX - 6, 1.5, 6))
            return
        tip = [QPointF(x - 4, 0), QPointF(x + 4, 0), QPointF(x, EDGE_PX)]
        painter.drawPolygon(QPolygonF(tip))
        painter.drawRect(QRectF(x - 0.5, EDGE_PX, 1.0, BAND_PX))

    def _draw_cursor(self, painter: QPainter, line: Timeline) -> None:
        x = self.x_of(line.middle_of(self._frame))
        bottom = EDGE_PX + BAND_PX + 3
        for width, colour in ((4, INK), (2, "#ffffff")):
            painter.setPen(QPen(QColor(colour), width))
            painter.drawLine(QPointF(x, 1), QPointF(x, bottom))
