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
from app.gui.widgets import Panel, Part, colour_as, column, label, row, tint, write_or_hide
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
        gauge, look = self.gauge, theme.now()
        if gauge is None:
            return
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        own, top, bottom = look.role(gauge.quantity), 4, BAR_PX - 4

        def x(value: float) -> float:
            return float(np.interp(value, (gauge.low, gauge.high), (0, self.width())))

        painter.fillRect(0, top, self.width(), bottom - top, QColor(look.window))
        low, high = map(x, gauge.band)
        colour = QColor(look.tones[Tone.GOOD])
        colour.setAlpha(170)
        painter.fillRect(QRectF(low, top, max(3.0, high - low), bottom - top), colour)
        for values, role, width, beyond in (
            ((0.0,), look.muted, 1, 0),
            (gauge.limits, look.tones[Tone.BAD], 2.5, 3),
            ((gauge.value,), own, 3, 4),
        ):
            painter.setPen(QPen(QColor(role), width))
            for at in map(x, filter(math.isfinite, values)):
                painter.drawLine(QPointF(at, top - beyond), QPointF(at, bottom + beyond))
        painter.setRenderHint(QPainter.RenderHint.Antialiasing, False)  # ten times as fast
        painter.setPen(QPen(QColor(own), 1))
        known = np.isfinite(gauge.history)
        trace = gauge.history[known]
        if len(trace) > 1:
            middle, span = (trace.min() + trace.max()) / 2, max(np.ptp(trace), LEAST_SPAN_N)
            y = BAR_PX + 4 + (TRACE_PX - 4) * (0.5 - 0.9 * (trace - middle) / span)
            along = self.width() + gauge.time_s[known] / TRACE_S * self.width()
            painter.drawPolyline(pg.functions.arrayToQPolygonF(along, y))


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
        write_or_hide(self.legend, typeset(gauge.legend))
        if (hint := typeset(gauge.hint)) != self.toolTip():
            self.setToolTip(hint)
        self._scale.show_gauge(gauge)


def framed(*parts: Part) -> Panel:
    """A frame around `parts`, one below the other."""
    frame = Panel()
    frame.hold(*parts)
    return frame
