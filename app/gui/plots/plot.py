"""What curves and pictures share: axes, colours, mouse and keyboard, and the drawing for a file."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pyqtgraph as pg
from pyqtgraph.graphicsItems.ViewBox.ViewBoxMenu import ViewBoxMenu
from pyqtgraph.GraphicsScene.mouseEvents import MouseClickEvent
from PySide6.QtCore import QEvent, QPointF, QRectF, QSize, Qt, Signal
from PySide6.QtGui import QAction, QFocusEvent, QKeyEvent, QMouseEvent, QPainter
from PySide6.QtWidgets import (
    QGraphicsGridLayout,
    QGraphicsView,
    QGraphicsWidget,
    QLabel,
)

from app.gui import theme
from app.gui.plots.axis import CACHED, NOT_CACHED, CachedAxis
from app.gui.scales import Range, Ranges
from app.gui.source import Point
from app.gui.widgets import write_or_hide
from app.records.record_types import F64

ZOOM = 0.85  # of the range, for a step of the wheel
MOST_ZOOM = 1e-4  # of the range that shows all
SAME = 0.5  # px: what has moved by less is not drawn again
GRID = 0.25  # share of the colour of grid lines in the ground's
MARGINS = (2, 8, 16, 2)  # left, top, right, bottom, px: a number at an axis' end takes of them


class Plot(pg.GraphicsView):  # type: ignore[misc]
    """A plot whose ranges are given by `show_ranges` until the operator zooms.

    Not a `pg.PlotWidget`, whose forms for options and two more axes take six times as long to make.

    The wheel zooms about the pointer, over an axis along that one only; dragging moves; a double
    click or R shows all; + and - zoom about the middle. All drawing follows the look of the window.

    Attributes
    ----------
    title : str
        Of the plot, from which names of files are made.
    all : (Range, Range)
        Those of x and y that show all.
    colours : Palette
        In which the plot is drawn now: that of the window, or the light one in a file.
    pen_ratio : float
        Pixels of a file that a line of one pixel takes in it; 0 on the screen, where all lines are
        of one: wider ones, antialiased, take Qt twenty times as long.
    """

    pointed = Signal(float, float)  # x and y under the pointer; NaN when it has left

    def __init__(self, title: str = "") -> None:
        super().__init__()
        self.title, self.colours, self.pen_ratio = title, theme.now(), 0.0
        self.all: Ranges = ((0.0, 1.0), (0.0, 1.0))
        self.item, self.box = QGraphicsWidget(), Box()
        self.axes = CachedAxis("left", self.box), CachedAxis("bottom", self.box)
        self.grid = self._put_in_place()
        # one rectangle: with the many of its own choice Qt clips each item to all of them
        self.setViewportUpdateMode(self.ViewportUpdateMode.BoundingRectViewportUpdate)
        # nothing shows through it: what is below is not drawn first
        self.viewport().setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setMinimumSize(120, 80)
        self._hint = QLabel(self.viewport())
        self._hint.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self._hint.setWordWrap(True)
        self._hint.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        self._hint.hide()
        self.box.geometryChanged.connect(self._place_hint)
        self.box.all_asked.connect(self.reset)
        self.offer([])  # the dialog of pyqtgraph fails for drawings
        self.scene().sigMouseClicked.connect(self._click)
        self.box.state["wheelScaleFactor"] = math.log(ZOOM) / math.log(1.02) / 120
        self.reset()

    def sizeHint(self) -> QSize:
        """A size at which a plot is read well."""
        return QSize(340, 240)

    # ------------------------------------------------------------------ what is shown

    def show_ranges(self, x: Range, y: Range) -> None:
        """Let x and y be what shows all: it is in view unless the operator has zoomed."""
        if (x, y) == self.all:
            return
        was_zoomed, self.all = self.is_zoomed, (x, y)
        if not was_zoomed:
            self.reset()

    def reset(self) -> None:
        """Show all."""
        (left, right), (low, high) = self.all
        widest, highest = right - left, high - low
        self.box.disableAutoRange()
        self.box.setLimits(
            minXRange=MOST_ZOOM * widest, maxXRange=widest / MOST_ZOOM,
            minYRange=MOST_ZOOM * highest, maxYRange=highest / MOST_ZOOM,
        )  # fmt: skip
        self.box.setRange(xRange=self.all[0], yRange=self.all[1], padding=0)

    @property
    def is_zoomed(self) -> bool:
        """Whether the operator chose what is shown."""
        return bool(self.box.targetRange() != [list(ends) for ends in self.all])

    def hint(self, text: str) -> None:
        """Say what will be drawn here; empty: something is."""
        write_or_hide(self._hint, text)

    def _place_hint(self) -> None:
        """Between the axes."""
        self._hint.setGeometry(self.box.sceneBoundingRect().toRect())

    def offer(self, actions: list[QAction]) -> None:
        """Put actions into the context menu, behind those of the ranges and of the mouse."""
        self.scene().contextMenu = actions

    def table(self) -> str:
        """The numbers that are drawn, as CSV."""
        raise NotImplementedError

    def _put_in_place(self) -> QGraphicsGridLayout:
        """The axes left of the curves and below them; above them is room for a legend."""
        layout = QGraphicsGridLayout()
        self.item.setLayout(layout)
        layout.setSpacing(0)
        layout.setContentsMargins(*MARGINS)
        layout.addItem(self.box, 1, 1)
        for axis, (row, column) in zip(self.axes, ((1, 0), (2, 1)), strict=True):
            layout.addItem(axis, row, column)
        layout.setRowStretchFactor(1, 1)
        layout.setColumnStretchFactor(1, 1)
        self.setCentralItem(self.item)
        return layout

    def close(self) -> bool:
        """As a widget: what is drawn goes with it, no sooner."""
        return QGraphicsView.close(self)

    # ------------------------------------------------------------------ how it looks

    def recolour(self) -> None:
        """Draw all in `colours`."""
        self.setBackground(self.colours.panel)
        width = self.width_of(1.0)
        for axis in self.scene().items():
            if isinstance(axis, pg.AxisItem):
                axis.setPen(self.colours.grid, width=width)
                ticks = theme.mixed(self.colours.grid, self.colours.panel, GRID)
                axis.setTickPen(ticks, width=width)
                axis.setTextPen(self.colours.muted)
        self._hint.setStyleSheet(f"color: {self.colours.muted}")

    def width_of(self, width: float) -> float:
        """Of a pen, px: in a file as it should be, on the screen 1."""
        return width * self.pen_ratio or 1.0

    def paint(self, painter: QPainter, room: QRectF, pen_ratio: float = 1.0) -> None:
        """Draw all of it in `room` of a page, in light colours, as lines and texts. Pens are
        `pen_ratio` times as wide, for a painter's scale does not change them.
        """
        before = self.size()
        self._print(theme.LIGHT, room.size().toSize(), pen_ratio)
        cached = [item for item in self.scene().items() if item.cacheMode() == CACHED]
        for item in cached:  # a drawing has texts and lines, no pixels
            item.setCacheMode(NOT_CACHED)
        self.render(painter, room, self.viewport().rect())
        for item in cached:
            item.setCacheMode(CACHED)
        self._print(theme.now(), before, 0.0)

    def _print(self, colours: theme.Palette, size: QSize, pen_ratio: float) -> None:
        self.colours, self.pen_ratio = colours, pen_ratio
        self.recolour()
        self.resize(size)
        self.resizeEvent(None)  # also where it is not in view
        self.grid.activate()

    def changeEvent(self, event: QEvent) -> None:
        """Follow the look of the window."""
        super().changeEvent(event)
        if event.type() is QEvent.Type.StyleChange and self.colours is not theme.now():
            self.colours = theme.now()
            self.recolour()

    def drawForeground(self, painter: QPainter, _rect: QRectF) -> None:
        """Draw the ring of what has the focus."""
        if self.hasFocus() and not self.pen_ratio:
            painter.save()
            painter.resetTransform()
            painter.setPen(theme.ring())
            painter.drawRect(self.viewport().rect())
            painter.restore()

    def focusInEvent(self, event: QFocusEvent) -> None:
        """Draw the ring."""
        super().focusInEvent(event)
        self.viewport().update()

    def focusOutEvent(self, event: QFocusEvent) -> None:
        """Draw it no more."""
        super().focusOutEvent(event)
        self.viewport().update()

    # ------------------------------------------------------------------ mouse and keyboard

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """R shows all; + and - zoom."""
        factor = {Qt.Key.Key_Plus: ZOOM, Qt.Key.Key_Minus: 1 / ZOOM}.get(Qt.Key(event.key()))
        if event.key() == Qt.Key.Key_R:
            self.reset()
        elif factor is not None:
            self.box.scaleBy((factor, factor))
        else:
            event.ignore()  # the window has keys of its own

    def _click(self, event: MouseClickEvent) -> None:
        if event.double() and not event.isAccepted():  # by something that is drawn there
            self.reset()

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        """Say where the pointer is."""
        super().mouseMoveEvent(event)
        at = event.position()
        is_inside = self.box.sceneBoundingRect().contains(at)
        self.pointed.emit(*(self.point(at) if is_inside else (math.nan, math.nan)))

    def leaveEvent(self, event: QEvent) -> None:
        """Nothing is pointed at any more."""
        super().leaveEvent(event)
        self.pointed.emit(math.nan, math.nan)

    def place(self, x: float, y: float) -> QPointF:
        """Where a point is in this widget, px."""
        return QPointF(self.box.mapViewToScene(QPointF(x, y)))

    def point(self, at: QPointF) -> Point:
        """The x and y of a place in this widget."""
        there = self.box.mapSceneToView(at)
        return there.x(), there.y()


def are_near(values: F64 | None, others: F64 | None, most: float) -> bool:
    """Whether numbers differ by so much at most; where one is not known, the other is not."""
    if values is others:
        return True
    if values is None or others is None or values.shape != others.shape:
        return False
    is_near = (np.abs(values - others) <= most) | (np.isnan(values) & np.isnan(others))
    return bool(is_near.all())


class Box(pg.ViewBox):  # type: ignore[misc]
    """The room of the curves, whose menu is made when it is asked for: it takes long."""

    all_asked = Signal()

    def __init__(self) -> None:
        super().__init__(enableMenu=False)
        self.setFlag(self.GraphicsItemFlag.ItemHasNoContents)  # but what is in it
        self.menu: Any = None
        self.state["enableMenu"] = True

    def getMenu(self, _event: object = None) -> Any:
        """Ranges and mouse."""
        if self.menu is None:
            self.menu = ViewBoxMenu(self)
            self.menu.viewAll.triggered.disconnect()
            self.menu.viewAll.triggered.connect(self.all_asked)
        return self.menu
