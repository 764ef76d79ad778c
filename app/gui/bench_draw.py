"""What of a bench is drawn: the histogram of the live picture, a force with its band and limits, a
device with its state.
"""

from __future__ import annotations

import math

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPen
from PySide6.QtWidgets import QWidget

from app.gui import theme
from app.gui.bench_cells import Gauge
from app.gui.cells import Tone, typeset
from app.gui.plots.plot import Plot
from app.gui.widgets import Panel, Part, colour_as, column, label, row, tint
from app.records.bench_view import PictureView

HISTOGRAM_PX = 84
BAR_PX, TRACE_PX = 22, 36  # heights of a scale, and of the trace below it
TRACE_S = 10.0
LEAST_SPAN_N = 4e-3  # of the trace of a force


class GreyHistogram(Plot):
    """How many pixels of the live picture have which grey level, the saturated ones in red.

    Attributes
    ----------
    note : str
        Why that picture is not live; empty if it is.
    """

    def __init__(self) -> None:
        super().__init__("Grey levels")
        self.note = ""
        self._picture: PictureView | None = None
        self._bars = pg.BarGraphItem(x=[0.0], height=[0.0], width=1.0, pen=None)
        self.box.addItem(self._bars, ignoreBounds=True)
        left, bottom = self.axes
        left.hide()
        bottom.setGrid(False)
        self.box.setMouseEnabled(False, False)
        self.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.setFixedHeight(HISTOGRAM_PX)
        self.setAccessibleName("Histogram of the live picture")
        self.setToolTip(
            "Share of the pixels at each part of the grey scale, in per cent of its end; drawn as"
            " the root, so that few are seen. Red: saturated"
        )
        self.show_ranges((0.0, 100.0), (0.0, 1.0))
        self.show_picture(None)
        self.recolour()

    def show_picture(self, picture: PictureView | None, note: str = "") -> None:
        """Show the levels of this picture, unless they are shown already."""
        self.note = note
        self.hint(note if picture else "no picture")
        if picture is not self._picture:
            self._picture = picture
            self.recolour()

    def recolour(self) -> None:
        """Draw all in the colours of the look."""
        super().recolour()
        if self._picture is None:
            self._bars.setOpts(x=[0.0], height=[0.0])
            return
        shares = self._picture.histogram
        width, heights = 100 / len(shares), np.sqrt(shares / max(float(shares.max()), 1e-9))
        brushes = [pg.mkBrush(self.colours.muted)] * len(shares)
        if self._picture.saturated > 0:
            brushes[-1] = pg.mkBrush(self.colours.saturated)
        left = width * np.arange(len(shares))
        self._bars.setOpts(x0=left, x=None, height=heights, width=width, brushes=brushes)


class ForceScale(QWidget):
    """The scale of a force with the band where it should be, its value, its limits if it has some,
    and its trace of ten seconds if that is known.
    """

    def __init__(self) -> None:
        super().__init__()
        self.gauge: Gauge | None = None
        self.setFixedHeight(BAR_PX)

    def show_gauge(self, gauge: Gauge) -> None:
        """Show this."""
        self.gauge = gauge
        self.setFixedHeight(BAR_PX + TRACE_PX * bool(gauge.limits))
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw it."""
        gauge = self.gauge
        if gauge is None:
            return
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        own = QColor(theme.now().role(gauge.quantity))
        bar = QRectF(0, 4, self.width(), BAR_PX - 8)
        span = max(gauge.high - gauge.low, 1e-9)

        def x(value: float) -> float:
            share = (min(max(value, gauge.low), gauge.high) - gauge.low) / span
            return bar.left() + share * bar.width()

        painter.fillRect(bar, QColor(theme.now().window))
        low, high = map(x, gauge.band)
        band = QRectF(low, bar.top(), max(3.0, high - low), bar.height())
        colour = QColor(theme.now().tones[Tone.GOOD])
        colour.setAlpha(170)
        painter.fillRect(band, colour)
        painter.setPen(QPen(QColor(theme.now().muted), 1))
        painter.drawLine(QPointF(x(0.0), bar.top()), QPointF(x(0.0), bar.bottom()))
        painter.setPen(QPen(QColor(theme.now().tones[Tone.BAD]), 2.5))
        for limit in gauge.limits:
            painter.drawLine(QPointF(x(limit), bar.top() - 3), QPointF(x(limit), bar.bottom() + 3))
        if math.isfinite(gauge.value):
            painter.setPen(QPen(own, 3))
            here = x(gauge.value)
            painter.drawLine(QPointF(here, bar.top() - 4), QPointF(here, bar.bottom() + 4))
        painter.setRenderHint(QPainter.RenderHint.Antialiasing, False)  # ten times as fast
        painter.setPen(QPen(own, 1))
        self._draw_trace(painter, QRectF(0, BAR_PX + 4, self.width(), TRACE_PX - 4), gauge)

    def _draw_trace(self, painter: QPainter, place: QRectF, gauge: Gauge) -> None:
        known = np.isfinite(gauge.history)
        values = gauge.history[known]
        if len(values) < 2:
            return
        low, high = values.min(), values.max()
        share = 0.5 - 0.9 * (values - (low + high) / 2) / max(high - low, LEAST_SPAN_N)
        x = place.right() + gauge.time_s[known] / TRACE_S * place.width()
        y = place.top() + share * place.height()
        painter.drawPolyline(pg.functions.arrayToQPolygonF(x, y))


class ForceBand(QWidget):
    """A force: its name and what is said of it, its scale, and the numbers of the scale."""

    def __init__(self) -> None:
        super().__init__()
        self.gauge: Gauge | None = None
        self.name, self.legend = label("", "name"), label("", "detail")
        self.text = label("", "detail", alignment=Qt.AlignmentFlag.AlignRight)
        self._scale = ForceScale()
        head = row(self.name, (self.text, 1), spacing=8)
        self.setLayout(column(head, self._scale, self.legend, spacing=0))

    def show_gauge(self, gauge: Gauge) -> None:
        """Show the force now."""
        self.gauge = gauge
        self.name.setText(typeset(gauge.name))
        colour_as(self.name, gauge.quantity)
        self.text.setText(typeset(gauge.text))
        tint(self.text, gauge.tone)
        self.legend.setText(typeset(gauge.legend))
        self.legend.setVisible(bool(gauge.legend))
        if (hint := typeset(gauge.hint)) != self.toolTip():
            self.setToolTip(hint)
        self._scale.show_gauge(gauge)


def framed(*parts: Part) -> Panel:
    """A frame around `parts`, one below the other."""
    frame = Panel()
    frame.hold(*parts)
    return frame
