"""The curves of a `Chart`: items that stay as long as their names and styles do, and are given new
data where these differ by half a pixel at least.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from html import escape

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QPainter, QPen, QPolygonF
from PySide6.QtWidgets import (
    QGraphicsItem,
    QGraphicsLineItem,
    QGraphicsPathItem,
    QGraphicsPolygonItem,
    QGraphicsRectItem,
    QGraphicsTextItem,
)

from app.gui import theme
from app.gui.cells import localized, with_subscript
from app.gui.charts import Chart, ChartMark, Guide, Held, Line
from app.gui.plots.axis import CACHED
from app.gui.plots.plot import SAME, Plot, are_near
from app.gui.source import Point
from app.records.record_types import F64

APART = 3.0  # px: of dots that are closer together one is drawn
GAP = 6.0  # px, between a name and what it belongs to
BAND = 300  # points of a band at most, nearly; it is smooth, and filling it is slow
REPLACED = 50  # points by which curves grow until names seek other places
TRACED = 500  # points of a curve that are looked at where a name seeks a free place
TINT, FAINT = 60, 110  # opacity of bands and of earlier runs, of 255
CAPS = {"dots": Qt.PenCapStyle.RoundCap, "squares": Qt.PenCapStyle.SquareCap}
SIGNS = {"line": "—", "dashed": "‒‒", "dots": "●", "squares": "■"}
EMPTY = Chart("", "", "")


class CurvePlot(Plot):
    """Shows one chart after the other."""

    def __init__(self) -> None:
        super().__init__()
        self.setAntialiasing(True)
        self.chart, self._waits = EMPTY, False
        self._held: Held = (None, None)
        self._style: object = None
        self._placed: object = None  # what the places of the names were found for
        self._curves: list[Curve] = []
        self._rules: list[QGraphicsLineItem] = []
        self._spans: list[QGraphicsRectItem] = []
        self._items: list[QGraphicsItem] = []  # all of these
        self._marks = pg.ScatterPlotItem(size=9, brush=None, antialias=True)
        self._marks.hide()  # it takes long also with no point
        self._marked: tuple[ChartMark, ...] = ()
        self.labels: list[TextLabel] = []  # of guides, then of marks
        self.legend = TextLabel(self)
        self.box.addItem(self._marks, ignoreBounds=True)
        self.box.sigRangeChanged.connect(self._draw)
        self.box.sigResized.connect(self._draw)
        self.recolour()

    def show_chart(self, chart: Chart) -> None:
        """Draw `chart`."""
        self.chart, self.title = chart, chart.title
        self._held = chart.ranges(self._held)
        self._waits = True  # a range that changes would have all drawn before the other does
        self.show_ranges(*self._held)
        self._waits = False
        self.hint(chart.hint if chart.is_empty else "")
        self._draw()

    def begin_run(self) -> None:
        """Forget the ranges of the last run, and the zoom."""
        self._held = (None, None)
        self.reset()

    def table(self) -> str:
        """The numbers that are drawn, as CSV."""
        return self.chart.table()

    def recolour(self) -> None:
        """Draw all in `colours`."""
        super().recolour()
        self._style = None
        self._draw()

    # ------------------------------------------------------------------ drawing

    def _draw(self, *_: object) -> None:
        """Give the items what is in the chart; make new ones where there are others."""
        if self._waits:
            return
        chart = self.chart
        style = (
            (chart.x_label, chart.y_label),
            [(one.name, one.role, one.style, one.is_faint, one.sd is None) for one in chart.lines],
            [(guide.text, guide.role, guide.is_upright) for guide in chart.guides],
            [span.role for span in chart.spans],
            [mark.text for mark in chart.marks],
        )
        if style != self._style:
            self._style = style
            self._build(chart)
        pixel = self.box.viewPixelSize()
        for curve, line in zip(self._curves, chart.lines, strict=True):
            curve.show(line, pixel)
        left, low, right, high = self.box.viewRect().getCoords()
        for region, span in zip(self._spans, chart.spans, strict=True):
            region.setRect(left, span.low, right - left, span.high - span.low)
        for rule, guide in zip(self._rules, chart.guides, strict=True):
            at, is_known = guide.value, math.isfinite(guide.value)
            rule.setVisible(is_known)
            if is_known:
                rule.setLine(*((at, low, at, high) if guide.is_upright else (left, at, right, at)))
        if chart.marks != self._marked:
            self._marked = chart.marks
            self._marks.setData([mark.x for mark in chart.marks], [mark.y for mark in chart.marks])
            self._marks.setVisible(bool(chart.marks))
        self._show_legend()
        self._place_labels()

    def _build(self, chart: Chart) -> None:
        """Make all items anew."""
        self._placed = None
        is_shown = bool(chart.x_label)  # else there is nothing that axes would belong to
        for axis, words in zip(self.axes, (chart.y_label, chart.x_label), strict=True):
            axis.setVisible(is_shown)
            axis.setLabel(with_subscript(words) if is_shown else None)
        for item in self._items:
            self.box.removeItem(item)
        for label in self.labels:
            self.scene().removeItem(label)
        self._curves = [Curve(self, line) for line in chart.lines]
        self._spans = [self._region(span.role) for span in chart.spans]
        self._rules = [self._rule(guide) for guide in chart.guides]
        drawn = (item for curve in self._curves for item in curve.items)
        self._items = [*self._spans, *drawn, *self._rules]
        for item in self._items:
            self.box.addItem(item, ignoreBounds=True)
        self.labels = [
            TextLabel(self, with_subscript(guide.text), guide.role) for guide in chart.guides
        ]
        self.labels += [TextLabel(self, escape(mark.text)) for mark in chart.marks]
        self._marks.setPen(pg.mkPen(self.colours.text, width=self.width_of(1.0)))
        self._marks.setSize(9 * (self.pen_ratio or 1.0))

    def _region(self, role: str) -> QGraphicsRectItem:
        region = QGraphicsRectItem()
        region.setPen(pg.mkPen(None))
        region.setBrush(self.colour(role, TINT))
        region.setZValue(-20)
        return region

    def _rule(self, guide: Guide) -> QGraphicsLineItem:
        rule = QGraphicsLineItem()
        dashed = Qt.PenStyle.DashLine
        rule.setPen(pg.mkPen(self.colour(guide.role), width=self.pen_ratio, style=dashed))
        return rule

    def colour(self, role: str, opacity: int = 255) -> QColor:
        """The colour of a role, so opaque of 255."""
        colour = QColor(self.colours.role(role))
        colour.setAlpha(opacity)
        return colour

    def band_colour(self, role: str) -> QColor:
        """The colour of a band. Others, and the grid in a file, are seen through it; one that is
        alone on the screen is opaque, for Qt mixes colours in all its threads, which takes several
        times as long.
        """
        if self.pen_ratio or sum(line.sd is not None for line in self.chart.lines) > 1:
            return self.colour(role, TINT)
        return QColor(theme.mixed(self.colours.role(role), self.colours.panel, TINT / 255))

    # ------------------------------------------------------------------ names

    def _show_legend(self) -> None:
        """Write the names of all curves above the axes, in as many lines as they need."""
        drawn = {line.name: line for line in self.chart.lines if line.name and len(line.x)}
        html = "&emsp; ".join(
            f'<font color="{self.colours.role(line.role)}">{SIGNS[line.style]}</font>&nbsp;'
            + escape(localized(name)).replace(" ", "&nbsp;")
            for name, line in drawn.items()
        )
        self.legend.write(html, "muted", self.item.size().width())
        height = self.legend.boundingRect().height() if html else 0.0
        if self.grid.rowMaximumHeight(0) != height:
            self.grid.setRowFixedHeight(0, height)

    def _place_labels(self) -> None:
        """Put each name beside its guide or mark where it covers neither a curve nor a name."""
        axes = self.box.sceneBoundingRect()
        spots = list(self._spots(axes.center()))
        lengths = [len(line.x) // REPLACED for line in self.chart.lines]
        at_now = (axes.getRect(), [at.toPoint() for _, at, _ in spots], lengths)
        if at_now == self._placed:
            return
        self._placed = at_now
        seen = {label: (at, side) for label, at, side in spots if axes.contains(at)}
        upright = [at.x() for _, at, is_upright in spots if is_upright]
        places = Places(axes, self._trace() if seen else np.empty((0, 2)), upright)
        for label in self.labels:
            label.setVisible(label in seen)  # one that was hidden is drawn anew
        for label, (at, is_upright) in seen.items():
            room = places.free(at, is_upright, label.boundingRect())
            label.setPos(self.item.mapFromScene(room.topLeft()))

    def _spots(self, centre: QPointF) -> Iterator[tuple[TextLabel, QPointF, bool | None]]:
        """Each name with the place of what it names, and whether that is a line that stands
        upright; None: it is a mark.
        """
        guides = self.chart.guides
        for label, guide in zip(self.labels, guides, strict=False):
            if math.isfinite(guide.value):
                at = self.place(guide.value, guide.value)
                x, y = (at.x(), centre.y()) if guide.is_upright else (centre.x(), at.y())
                yield label, QPointF(x, y), guide.is_upright
        for label, mark in zip(self.labels[len(guides) :], self.chart.marks, strict=True):
            yield label, self.place(mark.x, mark.y), None

    def _trace(self) -> F64:
        """Points on all curves of this run in this widget, px, shape (n, 2)."""
        traces = [np.empty((0, 2))]
        scale, corner = self.box.viewPixelSize(), self.place(0, 0)
        for line in self.chart.lines:
            if not line.is_faint and len(line.x):
                at = np.linspace(0, len(line.x) - 1, TRACED)
                x, y = (np.interp(at, np.arange(len(v)), v) for v in (line.x, line.y))
                places = corner.x() + x / scale[0], corner.y() - y / scale[1]
                traces.append(np.column_stack(places))
        return np.concatenate(traces)


class Curve:
    """The items of one line of a chart: its band of uncertainty, and the line or its dots. All but
    the dots are drawn by Qt alone: what pyqtgraph has for them takes several times as long.
    """

    def __init__(self, plot: CurvePlot, line: Line) -> None:
        colour = plot.colour(line.role, FAINT if line.is_faint else 255)
        self._line: Line | None = None
        self._pixel = (0.0, 0.0)
        self._band = QGraphicsPolygonItem()
        self._band.setPen(pg.mkPen(None))
        self._band.setBrush(plot.band_colour(line.role))
        self._band.setZValue(-18)
        self._drawing: Dots | QGraphicsPathItem
        if line.style in CAPS:
            pen = pg.mkPen(colour, width=2.5 * line.width * (plot.pen_ratio or 1.0))
            pen.setCapStyle(CAPS[line.style])
            self._drawing = Dots(pen)
        else:
            style = Qt.PenStyle.DashLine if line.style == "dashed" else Qt.PenStyle.SolidLine
            # of one pixel: for another width Qt looks for the outline, in units of the axes
            width = line.width * plot.pen_ratio
            self._drawing = QGraphicsPathItem()
            self._drawing.setPen(pg.mkPen(colour, width=width, style=style))
        if line.is_faint:
            self._drawing.setZValue(-15)

    @property
    def items(self) -> list[QGraphicsItem]:
        """What is drawn."""
        return [self._band, self._drawing]

    def show(self, line: Line, pixel: Point) -> None:
        """Draw a line, a pixel of which is so much of x and y; not if it is drawn already."""
        if pixel == self._pixel and self._line is not None and _are_same(line, self._line, pixel):
            return
        self._line, self._pixel = line, pixel
        if isinstance(self._drawing, Dots):
            self._drawing.show_points(*_apart(line.x, line.y, pixel), pixel)
        else:
            x, y = _thinned(line.x, line.y, pixel)
            self._drawing.setPath(pg.functions.arrayToQPath(x, y, connect="finite"))
        if line.sd is not None:
            sd = np.nan_to_num(line.sd)
            there = np.flatnonzero(np.isfinite(line.x) & np.isfinite(line.y))
            there = there[:: max(1, len(there) // BAND)]
            x, low, high = line.x[there], (line.y - sd)[there], (line.y + sd)[there]
            self._band.setPolygon(_polygon(np.append(x, x[::-1]), np.append(low, high[::-1])))


class Dots(QGraphicsItem):
    """Points of one pen; those of `pg.ScatterPlotItem`, each with its own, take far longer."""

    def __init__(self, pen: QPen) -> None:
        super().__init__()
        self._pen, self._points, self._room = pen, QPolygonF(), QRectF()

    def show_points(self, x: F64, y: F64, pixel: Point) -> None:
        """Draw these, where a pixel is so much of x and y."""
        self.prepareGeometryChange()
        self._points = _polygon(x, y)
        wide, high = (self._pen.widthF() * one for one in pixel)
        self._room = self._points.boundingRect().adjusted(-wide, -high, wide, high)

    def boundingRect(self) -> QRectF:
        """What they take."""
        return self._room

    def paint(self, painter: QPainter, *_: object) -> None:
        """Draw them as the ends of the pen are."""
        place = painter.worldTransform()
        painter.resetTransform()  # Qt draws a point as a line of 1/63 of a unit
        painter.setPen(self._pen)
        painter.drawPoints(place.map(self._points))


class TextLabel(QGraphicsTextItem):
    """A text in a plot, over a piece of the ground; its place is in pixels of the plot."""

    def __init__(self, plot: CurvePlot, html: str = "", role: str = "text") -> None:
        super().__init__(plot.item)
        self._plot = plot
        self._written: tuple[str, str, float] = ("", "", 0.0)
        self.setZValue(20)
        self.document().setDocumentMargin(1)
        self.setAcceptedMouseButtons(Qt.MouseButton.NoButton)
        self.setCacheMode(CACHED)
        self.write(html, role)

    def write(self, html: str, role: str, width: float = -1) -> None:
        """Write a text in lines no longer than `width`."""
        colours = self._plot.colours
        whole = f'<span style="background: {colours.panel}">{html}</span>'
        if self._written != (whole, role, width):
            self._written = (whole, role, width)
            self.setDefaultTextColor(colours.role(role))
            self.setHtml(whole)
            self.setTextWidth(width)
        self.setVisible(bool(html))


class Places:
    """Rooms for names in the axes: off other names, off curves, whose points `traced` have the
    shape (n, 2), and off lines that stand at `upright`; all in pixels.
    """

    def __init__(self, axes: QRectF, traced: F64, upright: list[float]) -> None:
        self._axes, self._traced, self._upright = axes, traced, upright
        self._used: list[QRectF] = []

    def free(self, at: QPointF, is_upright: bool | None, size: QRectF) -> QRectF:
        """The first room beside a line or a mark that covers nothing, else the one in the axes that
        covers least.
        """
        axes, width, height = self._axes, size.width(), size.height()
        columns = [at.x() + GAP, at.x() - GAP - width]
        rows = [at.y() - height, at.y() + 1]
        if is_upright is None:
            columns += [at.x() + GAP + width, at.x() - GAP - 2 * width]
        elif is_upright:
            rows = [axes.top() + 2 + n * height for n in range(1 + int(axes.height() / height))]
        else:
            steps = range(1, 2 + int(axes.width() / (width + GAP)))
            columns = [axes.right() - n * (width + GAP) for n in steps]
        rooms = [QRectF(x, y, width, height) for x in columns for y in rows]
        if is_upright:
            rooms.sort(key=QRectF.top)
        inside = [room for room in rooms if axes.contains(room)] or rooms
        free = next((room for room in inside if not self._covers(room)), None)
        self._used.append(free or min(inside, key=self._covers))
        return self._used[-1]

    def _covers(self, room: QRectF) -> int:
        """How bad it is: a name counts for more than a curve, and a curve for more than a line."""
        x, y = self._traced.T
        on_curve = (x > room.left()) & (x < room.right()) & (y > room.top()) & (y < room.bottom())
        return (
            4 * any(room.intersects(other) for other in self._used)
            + 2 * int(on_curve.any())
            + any(room.left() < at < room.right() for at in self._upright)
        )


def _are_same(line: Line, other: Line, pixel: Point) -> bool:
    """Whether two lines are the same to half a pixel."""
    ways = (("x", pixel[0]), ("y", pixel[1]), ("sd", pixel[1]))
    return all(are_near(getattr(line, n), getattr(other, n), SAME * one) for n, one in ways)


def _polygon(x: F64, y: F64) -> QPolygonF:
    """Points of Qt; pyqtgraph ends the process where there are none."""
    return pg.functions.arrayToQPolygonF(x, y) if len(x) else QPolygonF()


def _cells(x: F64, y: F64, width: float, height: float) -> NDArray[np.complex128]:
    """In which cell of a grid each point lies."""
    cells: NDArray[np.complex128] = np.rint(x / width) + 1j * np.rint(y / height)
    return cells


def _apart(x: F64, y: F64, pixel: Point) -> tuple[F64, F64]:
    """One of the points that are closer together than `APART`."""
    there = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    cells = _cells(x[there], y[there], APART * pixel[0], APART * pixel[1])
    _, first = np.unique(cells, return_index=True)
    spots = np.sort(there[first])
    return x[spots], y[spots]


def _thinned(x: F64, y: F64, pixel: Point) -> tuple[F64, F64]:
    """What is seen of a curve: the least and the greatest y in each pixel of a rising x, else the
    points that are in another pixel than the one before.
    """
    if not (np.isfinite(y).all() and (np.diff(x) >= 0).all()):
        moves = np.flatnonzero(np.diff(_cells(x, y, *pixel), prepend=np.nan))
        return x[moves], y[moves]
    begins = np.flatnonzero(np.diff(np.rint(x / pixel[0]), prepend=np.nan))
    if len(x) <= 2 * len(begins):
        return x, y
    ends = [end.reduceat(y, begins) for end in (np.minimum, np.maximum)]
    return x[begins].repeat(2), np.column_stack(ends).ravel()
