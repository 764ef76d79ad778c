"""The curves of a `Chart`: items that stay as long as their names and styles do, and are given new
data where these differ by half a pixel at least.
"""

from __future__ import annotations

import math
from html import escape

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QPointF, QRectF, Qt
from PySide6.QtGui import QColor, QPainter, QPen, QPolygonF
from PySide6.QtWidgets import (
    QGraphicsItem,
    QGraphicsPathItem,
    QGraphicsPolygonItem,
    QGraphicsTextItem,
)

from app.gui.cells import with_subscript
from app.gui.charts import Chart, ChartMark, Guide, Line
from app.gui.plots.plot import Plot
from app.gui.scales import Range
from app.records.record_types import F64

SAME = 0.5  # px: what has moved by less is not drawn again
APART = 3.0  # px: of dots that are closer together one is drawn
GAP = 4.0  # px, between a name and what it belongs to
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
        self.chart = EMPTY
        self._held: tuple[Range | None, Range | None] = (None, None)
        self._style: object = None
        self._placed: object = None  # what the places of the names were found for
        self._curves: list[Curve] = []
        self._guides: list[tuple[pg.InfiniteLine, TextLabel]] = []
        self._spans: list[pg.LinearRegionItem] = []
        self._marks = pg.ScatterPlotItem(size=9, brush=None, antialias=True)
        self._marks.hide()
        self._marked: tuple[ChartMark, ...] = ()
        self._mark_labels: list[TextLabel] = []
        self.legend = TextLabel(self)
        self.box.addItem(self._marks, ignoreBounds=True)
        self.box.sigRangeChanged.connect(self._draw)
        self.box.sigResized.connect(self._draw)

    def show_chart(self, chart: Chart) -> None:
        """Draw `chart`."""
        self.chart, self.title = chart, chart.title
        self._held = chart.ranges(self._held)
        self.show_ranges(*self._held)
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
        if hasattr(self, "legend"):
            self._draw()

    # ------------------------------------------------------------------ drawing

    def _draw(self, *_: object) -> None:
        """Give the items what is in the chart; make new ones where there are others."""
        chart = self.chart
        style = (
            (chart.x_label, chart.y_label),
            tuple((line.name, line.role, line.style, line.is_faint) for line in chart.lines),
            tuple(line.sd is None for line in chart.lines),
            tuple((guide.text, guide.role, guide.is_upright) for guide in chart.guides),
            tuple(span.role for span in chart.spans),
            tuple(mark.text for mark in chart.marks),
        )
        if style != self._style:
            self._style = style
            self._build(chart)
        pixel = self.box.viewPixelSize()
        for curve, line in zip(self._curves, chart.lines, strict=True):
            curve.show(line, pixel)
        for region, span in zip(self._spans, chart.spans, strict=True):
            if region.getRegion() != (span.low, span.high):
                region.setRegion((span.low, span.high))
        for (rule, _label), guide in zip(self._guides, chart.guides, strict=True):
            rule.setVisible(math.isfinite(guide.value))
            if math.isfinite(guide.value) and rule.value() != guide.value:
                rule.setValue(guide.value)
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
        old = [item for curve in self._curves for item in curve.items]
        old += [line for line, _ in self._guides] + self._spans
        for item in old:
            self.box.removeItem(item)
        for name in self._labels():
            name.remove()
        self._curves = [Curve(self, line) for line in chart.lines]
        self._spans = [self._region(span.role) for span in chart.spans]
        self._guides = [
            (self._guide(guide), TextLabel(self, with_subscript(guide.text), guide.role))
            for guide in chart.guides
        ]
        self._mark_labels = [TextLabel(self, escape(mark.text)) for mark in chart.marks]
        self._marks.setPen(pg.mkPen(self.colours.text, width=self.width_of(1.0)))
        self._marks.setSize(9 * (self.pen_ratio or 1.0))
        new = [item for curve in self._curves for item in curve.items]
        for item in (*self._spans, *new, *(line for line, _ in self._guides)):
            self.box.addItem(item, ignoreBounds=True)

    def _labels(self) -> list[TextLabel]:
        """The names of guides and marks."""
        return [label for _, label in self._guides] + self._mark_labels

    def _region(self, role: str) -> pg.LinearRegionItem:
        region = pg.LinearRegionItem(
            orientation="horizontal",
            movable=False,
            pen=pg.mkPen(None),
            brush=self.colour(role, TINT),
        )
        region.setZValue(-20)
        return region

    def _guide(self, guide: Guide) -> pg.InfiniteLine:
        pen = pg.mkPen(
            self.colour(guide.role), width=self.width_of(1.0), style=Qt.PenStyle.DashLine
        )
        return pg.InfiniteLine(angle=90 if guide.is_upright else 0, pen=pen)

    def colour(self, role: str, opacity: int = 255) -> QColor:
        """The colour of a role, so opaque of 255."""
        colour = QColor(self.colours.role(role))
        colour.setAlpha(opacity)
        return colour

    # ------------------------------------------------------------------ names

    def _show_legend(self) -> None:
        """Write the names of all curves above the axes, in as many lines as they need."""
        drawn = {line.name: line for line in self.chart.lines if line.name and len(line.x)}
        html = "&emsp; ".join(
            f'<font color="{self.colours.role(line.role)}">{SIGNS[line.style]}</font>&nbsp;'
            + escape(name).replace(" ", "&nbsp;")
            for name, line in drawn.items()
        )
        height = self.legend.write(html, "muted", self.item.size().width())
        if self.grid.rowMaximumHeight(0) != height:
            self.grid.setRowFixedHeight(0, height)

    def _place_labels(self) -> None:
        """Put each name beside its guide or mark where it covers neither a curve nor a name."""
        axes = self.box.sceneBoundingRect()
        guides = [
            (guide, self.place(guide.value, guide.value), label)
            for guide, (_, label) in zip(self.chart.guides, self._guides, strict=True)
            if math.isfinite(guide.value)
        ]
        marks = [self.place(mark.x, mark.y) for mark in self.chart.marks]
        at_now = (
            axes.getRect(),
            [at.toPoint() for _, at, _ in guides],
            [at.toPoint() for at in marks],
            [len(line.x) // REPLACED for line in self.chart.lines],
        )
        if at_now == self._placed:
            return
        self._placed = at_now
        upright = [at.x() for guide, at, _ in guides if guide.is_upright]
        rooms = {
            label: _rooms_beside(guide, at, axes, label.size)
            for guide, at, label in guides
            if (axes.left() <= at.x() <= axes.right() if guide.is_upright
                else axes.top() <= at.y() <= axes.bottom())
        } | {
            label: _rooms_about(at, label.size)
            for at, label in zip(marks, self._mark_labels, strict=True)
            if axes.contains(at)
        }  # fmt: skip
        places = Places(axes, self._trace(), upright) if rooms else None
        for label in self._labels():
            if places is not None and label in rooms:
                label.move(places.free(rooms[label]))
            else:
                label.hide()

    def _trace(self) -> F64:
        """Points on all curves of this run in this widget, px, shape (n, 2)."""
        traces = []
        scale, corner = self.box.viewPixelSize(), self.place(0, 0)
        for line in self.chart.lines:
            if line.is_faint or not len(line.x):
                continue
            at = np.linspace(0, len(line.x) - 1, TRACED)
            x, y = (
                v[at.astype(np.intp)] if len(v) > TRACED else np.interp(at, np.arange(len(v)), v)
                for v in (line.x, line.y)
            )
            traces.append(np.column_stack([corner.x() + x / scale[0], corner.y() - y / scale[1]]))
        return np.concatenate(traces) if traces else np.empty((0, 2))


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
        self._band.setBrush(plot.colour(line.role, TINT))
        self._band.setZValue(-10)
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

    def show(self, line: Line, pixel: tuple[float, float]) -> None:
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

    def show_points(self, x: F64, y: F64, pixel: tuple[float, float]) -> None:
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


class TextLabel:
    """A text in a plot, over a piece of the ground; its place is in pixels of the plot."""

    def __init__(self, plot: CurvePlot, html: str = "", role: str = "text") -> None:
        self._plot, self._text = plot, QGraphicsTextItem(plot.item)
        self._written: tuple[str, str, float] = ("", "", 0.0)
        self._text.setZValue(20)
        self._text.document().setDocumentMargin(1)
        self._text.setAcceptedMouseButtons(Qt.MouseButton.NoButton)
        self._text.setCacheMode(QGraphicsItem.CacheMode.DeviceCoordinateCache)
        plot.cached.append(self._text)
        self.write(html, role)

    def write(self, html: str, role: str, width: float = -1) -> float:
        """Write a text in lines no longer than `width`; its height, px."""
        if not html:
            self.hide()
            return 0.0
        colours = self._plot.colours
        whole = f'<span style="background: {colours.panel}">{html}</span>'
        if self._written != (whole, role, width):
            self._written = (whole, role, width)
            self._text.setDefaultTextColor(colours.role(role))
            self._text.setHtml(whole)
            self._text.setTextWidth(width)
        self._text.show()
        return self._text.boundingRect().height()

    @property
    def size(self) -> tuple[float, float]:
        """Width and height, px."""
        room = self._text.boundingRect()
        return room.width(), room.height()

    @property
    def text(self) -> str:
        """What is written."""
        return self._text.toPlainText()

    @property
    def rect(self) -> QRectF:
        """Where it is, px; empty while it is hidden."""
        return self._text.sceneBoundingRect() if self._text.isVisible() else QRectF()

    def move(self, room: QRectF) -> None:
        """Show it there."""
        self._text.setPos(self._plot.item.mapFromScene(room.topLeft()))
        self._text.show()

    def hide(self) -> None:
        """Not be seen."""
        self._text.hide()

    def remove(self) -> None:
        """Leave the plot."""
        self._plot.cached.remove(self._text)
        self._plot.scene().removeItem(self._text)


class Places:
    """Rooms for names in the axes: off other names, off curves, whose points `traced` have the
    shape (n, 2), and off lines that stand at `upright`; all in pixels.
    """

    def __init__(self, axes: QRectF, traced: F64, upright: list[float]) -> None:
        self._axes, self._traced, self._upright = axes, traced, upright
        self._used: list[QRectF] = []

    def free(self, rooms: list[QRectF]) -> QRectF:
        """The first room that covers nothing, else the one in the axes that covers least."""
        inside = [room for room in rooms if self._axes.contains(room)] or rooms
        room = next((r for r in inside if not self._covers(r)), None)
        if room is None:
            room = min(inside, key=self._covers)
        self._used.append(room)
        return room

    def _covers(self, room: QRectF) -> int:
        """How bad it is: a name counts for more than a curve, and a curve for more than a line."""
        x, y = self._traced.T
        on_curve = (x > room.left()) & (x < room.right()) & (y > room.top()) & (y < room.bottom())
        return (
            4 * any(room.intersects(other) for other in self._used)
            + 2 * int(on_curve.any())
            + any(room.left() < at < room.right() for at in self._upright)
        )


def _rooms_beside(
    guide: Guide, at: QPointF, axes: QRectF, size: tuple[float, float]
) -> list[QRectF]:
    """Places for the name of a guide, the best first."""
    width, height = size
    if guide.is_upright:
        rows = range(max(1, int(axes.height() / height)))
        sides = (at.x() + GAP, at.x() - GAP - width)
        places = [(x, axes.top() + 2 + n * height) for n in rows for x in sides]
    else:
        steps = range(1, 1 + max(1, int(axes.width() / (width + GAP))))
        sides = (at.y() - height, at.y() + 1)
        places = [(axes.right() - n * (width + GAP), y) for n in steps for y in sides]
    return [QRectF(*place, width, height) for place in places]


def _rooms_about(at: QPointF, size: tuple[float, float]) -> list[QRectF]:
    """Places for the name of a mark, the best first."""
    width, height = size
    corners = ((6, 2), (-6 - width, -2 - height), (6, -2 - height), (-6 - width, 2))
    return [QRectF(at.x() + x, at.y() + y, width, height) for x, y in corners]


def _are_same(line: Line, other: Line, pixel: tuple[float, float]) -> bool:
    """Whether two lines are the same to half a pixel."""
    pairs: list[tuple[F64 | None, F64 | None, float]] = [
        (line.x, other.x, pixel[0]), (line.y, other.y, pixel[1]), (line.sd, other.sd, pixel[1])
    ]  # fmt: skip
    return all(a is b or _are_near(a, b, SAME * one) for a, b, one in pairs)


def _are_near(values: F64 | None, others: F64 | None, most: float) -> bool:
    if values is None or others is None or values.shape != others.shape:
        return False
    is_near = (np.abs(values - others) <= most) | (np.isnan(values) & np.isnan(others))
    return bool(is_near.all())


def _polygon(x: F64, y: F64) -> QPolygonF:
    """Points of Qt; pyqtgraph ends the process where there are none."""
    return pg.functions.arrayToQPolygonF(x, y) if len(x) else QPolygonF()


def _cells(x: F64, y: F64, width: float, height: float) -> NDArray[np.complex128]:
    """In which cell of a grid each point lies."""
    cells: NDArray[np.complex128] = np.rint(x / width) + 1j * np.rint(y / height)
    return cells


def _apart(x: F64, y: F64, pixel: tuple[float, float]) -> tuple[F64, F64]:
    """One of the points that are closer together than `APART`."""
    there = np.flatnonzero(np.isfinite(x) & np.isfinite(y))
    cells = _cells(x[there], y[there], APART * pixel[0], APART * pixel[1])
    _, first = np.unique(cells, return_index=True)
    spots = np.sort(there[first])
    return x[spots], y[spots]


def _thinned(x: F64, y: F64, pixel: tuple[float, float]) -> tuple[F64, F64]:
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
