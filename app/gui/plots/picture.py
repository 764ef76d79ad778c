"""An image of the interface, a field over it, and the circles of the contact."""

from __future__ import annotations

import math
import time
from functools import cache, lru_cache
from typing import Any

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from pyqtgraph.GraphicsScene.mouseEvents import MouseClickEvent
from PySide6.QtCore import QRectF, QSize, Qt, Signal
from PySide6.QtGui import QImage, QPainter, QPainterPath, QPaintEvent, qRgba
from PySide6.QtWidgets import (
    QGraphicsEllipseItem,
    QGraphicsItem,
    QGraphicsPathItem,
    QGraphicsScene,
)

from app.gui import theme
from app.gui.cells import number
from app.gui.frame_results import Circles, FieldImage, ShownImage
from app.gui.plots.plot import Plot
from app.gui.scales import Range, round_step
from app.gui.source import Rect
from app.gui.view_state import NOTHING_DISPLAYED, DisplayStatistics
from app.system.outputs import csv_text

NO_PICTURE = (
    "The camera's image, and the displacements in it, appear here when a bench is connected, a run"
    " begins (F5), or a recorded session is opened (Ctrl+O)."
)
MAPS = {False: "viridis", True: "CET-D1A"}  # whether the colours go both ways from zero
COLOURS = 255  # of a map; index 0 is what was not measured
DIFFERENCE = "difference (grey levels)"
MARGIN = 0.01  # about the image, of its size
SCALE_BAR = 0.2  # of the width of the picture, at least
LEAST_NAMED = 8.0  # radius on the screen, px
BAR_PX, CROSS_PX = 14, 7
LEVEL_STEPS = 100  # of the colour range, when it is set by the mouse
HALO, WHITE = (0, 0, 0, 150), "#ffffff"
CACHED = QGraphicsItem.CacheMode.DeviceCoordinateCache
# of the circles a, a_H and c: name, colour as in the curves, line, and where the name is, degrees
RINGS = (
    ("a", "apparent", Qt.PenStyle.DashLine, 45),
    ("a<sub>H</sub>", "muted", Qt.PenStyle.DotLine, 20),
    ("c", "stick", Qt.PenStyle.SolidLine, 70),
)


class PicturePlot(Plot):
    """The picture; its axes are in mm from the centre of the top-left pixel, with the same scale
    along both, and y points down.
    """

    range_chosen = Signal(float, float)  # of the colours, by the mouse on their bar
    clicked = Signal(float, float)  # x and y (mm) of a click of the left button on the picture

    def __init__(self) -> None:
        self._bar_axes: list[pg.AxisItem] = []  # of the colour bar
        super().__init__("Interface")
        self.field: FieldImage | None = None
        self.circles: Circles | None = None
        # whether the colours go both ways, their range, and the name of what they stand for
        self.colour_scale: tuple[bool, Range, str] | None = None
        self.display = NOTHING_DISPLAYED
        self._read_at_s: float | None = None  # of an image that is not painted yet
        self._mm, self._grid = 1.0, (0.0, 0.0, 1.0, 1.0)
        self._shows_circles, self._has_cut, self._place = True, False, math.nan
        self._below, self._above = _Raster(), _Raster()
        self._bar = self._make_bar()
        self._rings = [_Ring(*ring) for ring in RINGS]
        self._cross = _cross()
        self._cut = pg.InfiniteLine(angle=0, pen=pg.mkPen(WHITE, width=1))
        self._cut_place = pg.ScatterPlotItem([0], [0], symbol="d", size=9, pen=HALO, brush=WHITE)
        self._point = pg.ScatterPlotItem([0], [0], symbol="o", size=11, pen=WHITE, brush=HALO)
        self._scale = pg.ScaleBar(1.0, width=4, brush=WHITE, pen=pg.mkPen(HALO), offset=(-20, -16))
        self._scale.text.fill = pg.mkBrush(HALO)
        self._scale.text.setColor(WHITE)
        # an index of places keeps items that have moved unnoticed, also once they are deleted
        self.scene().setItemIndexMethod(QGraphicsScene.ItemIndexMethod.NoIndex)
        self.box.setAspectLocked(True)
        self.box.invertY(True)
        for axis, words in zip(self.axes, ("y (mm)", "x, driving direction → (mm)"), strict=True):
            axis.setGrid(False)  # it would be drawn over the image
            axis.setLabel(words)
        parts = (self._below, self._above, *(part for ring in self._rings for part in ring.parts))
        for part in (*parts, self._cross, self._cut, self._cut_place, self._point):
            self.box.addItem(part, ignoreBounds=True)
        self._point.hide()
        self._scale.setParentItem(self.box)
        self.box.sigXRangeChanged.connect(self._fit)
        self._set_empty(True)
        self.recolour()

    def begin_run(self, size: tuple[int, int], mm: float, grid: Rect) -> None:
        """Empty the picture; `size` is that of images in pixels of `mm`, `grid` that of a field."""
        self._mm, self._grid = mm, grid
        self.circles = self.colour_scale = None
        self.display, self._read_at_s = NOTHING_DISPLAYED, None
        self._below.hide()
        self._point.hide()
        self._below.setOpacity(1.0)
        self.show_field(None, (0.0, 1.0))
        self._set_empty(False)
        width, height = size[0] * mm, size[1] * mm
        pad = MARGIN * width
        self.show_ranges((-pad, width + pad), (-pad, height + pad))
        self.reset()
        self._show_overlays()

    def sizeHint(self) -> QSize:
        """A size at which a picture is seen well."""
        return QSize(640, 480)

    # ------------------------------------------------------------------ what is shown

    def show_image(self, image: ShownImage, levels: tuple[int, int]) -> None:
        """Show an image, black and white at these grey levels, saturated pixels in red."""
        self._below.show_pixels(image.pixels, self._placed(image.rect_px), greys(*levels))
        if self.field is None:
            self._name_colours(None)

    def show_colours(self, rgb: NDArray[np.uint8], rect: Rect, *, opacity: float = 1.0) -> None:
        """Show a picture whose colours are given, shape (rows, cols, 3)."""
        self._below.setOpacity(opacity)
        self._below.show_pixels(rgb, self._placed(rect), None)

    def show_difference(self, pixels: NDArray[np.int16], rect: Rect, ends: Range) -> None:
        """Show the difference of two images, in grey levels."""
        indices, table = colour_indices(pixels, ends), colour_table(is_diverging=True)
        self._below.show_pixels(indices, self._placed(rect), table)
        self._name_colours((True, ends, DIFFERENCE))

    def show_field(self, field: FieldImage | None, ends: Range) -> None:
        """Show a field in the colours of a range; None: no field."""
        self.field = field
        if field is not None:
            table = colour_table(is_diverging=field.is_diverging)
            indices = colour_indices(field.values, ends)
            self._above.show_pixels(indices, self._placed(self._grid), table)
            self._name_colours((field.is_diverging, ends, field.label))
            return
        self._above.hide()
        if self.colour_scale is None or self.colour_scale[2] != DIFFERENCE:
            self._name_colours(None)

    def set_opacity(self, share: float) -> None:
        """Let the image be seen through the field."""
        self._above.setOpacity(share)

    def show_circles(self, circles: Circles) -> None:
        """Draw the circles and the centre."""
        self.circles = circles
        self._show_overlays()

    def set_circles_visible(self, is_visible: bool) -> None:
        """Show or hide the circles."""
        self._shows_circles = is_visible
        self._show_overlays()

    def set_cut_visible(self, is_visible: bool) -> None:
        """Show or hide the line through the centre, along the drive."""
        self._has_cut = is_visible
        self._show_overlays()

    def show_place(self, x_mm: float) -> None:
        """Mark the place of the cut that is pointed at; NaN: none."""
        self._place = x_mm
        self._show_overlays()

    def show_point(self, x_mm: float, y_mm: float) -> None:
        """Mark the place whose history is shown."""
        self._point.setPos(x_mm, y_mm)
        self._point.show()

    def _click(self, event: MouseClickEvent) -> None:
        super()._click(event)
        is_single = event.button() == Qt.MouseButton.LeftButton and not event.double()
        if is_single and not event.isAccepted():
            self.clicked.emit(*self.point(event.scenePos()))

    def note_image(self, read_at_s: float) -> None:
        """What will be painted next is an image that was read at that moment."""
        self._read_at_s = read_at_s

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw all, and note that an image was seen."""
        super().paintEvent(event)
        if self._read_at_s is not None:
            delay_s, self._read_at_s = time.monotonic() - self._read_at_s, None
            self.display = DisplayStatistics(self.display.shown + 1, delay_s)

    # ------------------------------------------------------------------ places and numbers

    @property
    def cut_px(self) -> float:
        """The y of the line through the contact's centre, or through the middle of the field."""
        centre = self.circles.centre_px if self.circles else None
        return centre[1] if centre else self._grid[1] + self._grid[3] / 2

    def table(self) -> str:
        """The field that is drawn as CSV, a row for each point that was measured."""
        if self.field is None:
            return csv_text([("x_mm", "y_mm")])
        left, top, width, height = self._grid
        rows, cols = self.field.values.shape
        x = self._mm * (left + (np.arange(cols) + 0.5) * width / cols)
        y = self._mm * (top + (np.arange(rows) + 0.5) * height / rows)
        values = self.field.values + np.float32(self.field.offset)
        row, col = np.nonzero(np.isfinite(values))
        rows = zip(x[col], y[row], values[row, col].tolist(), strict=True)
        return csv_text([("x_mm", "y_mm", self.field.kind.key), *rows])

    # ------------------------------------------------------------------ drawing

    def _placed(self, rect: Rect) -> QRectF:
        """A rectangle of pixels in mm."""
        return QRectF(*(self._mm * length for length in rect))

    def _make_bar(self) -> pg.ColorBarItem:
        bar = pg.ColorBarItem(width=BAR_PX, label=" ", colorMapMenu=False, hoverBrush=HALO)
        self._bar_axes = [bar.getAxis(side) for side in ("left", "right", "top", "bottom")]
        self.cached += self._bar_axes
        for axis in self.cached:
            axis.setCacheMode(CACHED)
        bar.axis.enableAutoSIPrefix(False)
        bar.sigLevelsChangeFinished.connect(lambda bar: self.range_chosen.emit(*bar.levels()))
        self.grid.addItem(bar, 1, 3)
        self.grid.setColumnFixedWidth(2, 5)
        policy = bar.sizePolicy()
        policy.setRetainSizeWhenHidden(True)  # the picture keeps its place
        bar.setSizePolicy(policy)
        return bar

    def _set_empty(self, is_empty: bool) -> None:
        """Show axes and scale bar, or what will be seen here."""
        self.hint(NO_PICTURE if is_empty else "")
        for part in (*self.axes, self._scale):
            part.setVisible(not is_empty)
        if is_empty:
            self._name_colours(None)
            self._show_overlays()

    def recolour(self) -> None:
        """Draw all in `colours`."""
        super().recolour()
        for axis in self._bar_axes:
            axis.setPen(self.colours.grid)
            axis.setTextPen(self.colours.muted)

    def _name_colours(self, colours: tuple[bool, Range, str] | None) -> None:
        """Show what the colours stand for."""
        if colours == self.colour_scale and colours is not None:
            return
        self.colour_scale = colours
        self._bar.setVisible(colours is not None)
        if colours is None:
            return
        is_diverging, ends, name = colours
        if (colour_map := pg.colormap.get(MAPS[is_diverging])) is not self._bar.colorMap():
            self._bar.setColorMap(colour_map)
        if ends != self._bar.levels():
            self._bar.rounding = round_step((ends[1] - ends[0]) / LEVEL_STEPS)
            self._bar.setLevels(ends)
        self._bar.getAxis("left").setLabel(name)
        self.grid.activate()  # places are asked for before Qt comes to it

    def _show_overlays(self) -> None:
        """Place circles, centre, cut and scale bar."""
        mm, circles = self._mm, self.circles
        centre = circles.centre_px if circles and self._shows_circles else None
        x, y = (mm * at for at in centre) if centre else (math.nan, math.nan)
        radii = (circles.apparent_px, circles.hertz_px, circles.stick_px) if circles else ()
        least = LEAST_NAMED * self.box.viewPixelSize()[0]
        for n, ring in enumerate(self._rings):
            ring.show_at(x, y, mm * radii[n] if centre else math.nan, least)
        self._cross.setVisible(centre is not None)
        self._cut.setVisible(self._has_cut)
        self._cut.setValue(mm * self.cut_px)
        self._cut_place.setVisible(self._has_cut and math.isfinite(self._place))
        if centre:
            self._cross.setPos(x, y)
        if math.isfinite(self._place):
            self._cut_place.setPos(self._place, mm * self.cut_px)

    def _fit(self) -> None:
        """Follow the zoom: a scale bar of a round length, and names where there is room."""
        (low, high), _ = self.box.viewRange()
        length = round_step(SCALE_BAR * (high - low))
        if length != self._scale.size:
            is_fine = length < 0.1
            shown = f"{number(1e3 * length, 0)} µm" if is_fine else f"{length:g} mm"
            self._scale.size = length
            self._scale.text.setText(shown)
            self._scale.updateBar()
        self._show_overlays()


class _Raster(QGraphicsItem):
    """Pixels in the colours of a table: `pg.ImageItem` makes the table anew for each image."""

    def __init__(self) -> None:
        super().__init__()
        self._rect, self._image = QRectF(), QImage()
        self._pixels: NDArray[np.uint8] | None = None
        self._table: NDArray[np.uint8] | None = None
        self._colours: list[int] = []

    def show_pixels(
        self, pixels: NDArray[np.uint8], rect: QRectF, table: NDArray[np.uint8] | None
    ) -> None:
        """Draw indices of `table`, or colours where there is none, in a rectangle of the axes."""
        pixels = np.ascontiguousarray(pixels)
        height, width, *colours = pixels.shape
        kind = QImage.Format.Format_RGB888 if colours else QImage.Format.Format_Indexed8
        image = QImage(pixels.data, width, height, pixels.strides[0], kind)
        if table is not None:
            if table is not self._table:
                self._table, self._colours = table, [qRgba(*colour) for colour in table.tolist()]
            image.setColorTable(self._colours)
        self._image, self._pixels = image, pixels  # which the image does not keep
        if rect != self._rect:
            self.prepareGeometryChange()
            self._rect = rect
        self.update()
        self.show()

    def boundingRect(self) -> QRectF:
        """Where it is."""
        return self._rect

    def paint(self, painter: QPainter, *_: Any) -> None:
        """Draw it."""
        painter.drawImage(self._rect, self._image)


class _Ring:
    """A circle with its name: a line of a pixel over a dark one, for the ground has any colour."""

    def __init__(self, name: str, role: str, style: Qt.PenStyle, degrees: float) -> None:
        colour = theme.DARK.role(role)  # in both themes, for the picture is the same in both
        self._halo, self._line = QGraphicsEllipseItem(), QGraphicsEllipseItem()
        self._halo.setPen(pg.mkPen(HALO, width=3))
        self._line.setPen(pg.mkPen(colour, width=1, style=style))
        written = f'<span style="color: {colour}">{name}</span>'
        self._name = pg.TextItem(html=written, fill=HALO, anchor=(0.5, 0.5))
        self._name.setZValue(1)  # above the lines of the other circles
        self._way = math.cos(math.radians(degrees)), -math.sin(math.radians(degrees))
        self.parts = (self._halo, self._line, self._name)

    def show_at(self, x: float, y: float, radius: float, least: float) -> None:
        """Draw it in mm, named from the radius `least` on; nothing where it is not known."""
        is_known = math.isfinite(x + radius)
        for part in self.parts:
            part.setVisible(is_known)
        if not is_known:
            return
        box = QRectF(x - radius, y - radius, 2 * radius, 2 * radius)
        if box != self._line.rect():
            for part in self.parts[:2]:
                part.setRect(box)
            self._name.setPos(x + radius * self._way[0], y + radius * self._way[1])
        self._name.setVisible(radius > least)


def _cross() -> QGraphicsPathItem:
    """The sign of the centre, of the same size at each zoom."""
    path = QPainterPath()
    for x, y in ((CROSS_PX, 0), (0, CROSS_PX)):
        path.moveTo(-x, -y)
        path.lineTo(x, y)
    cross = QGraphicsPathItem(path)
    cross.setPen(pg.mkPen(HALO, width=5))
    QGraphicsPathItem(path, cross).setPen(pg.mkPen(WHITE, width=2))
    cross.setFlag(QGraphicsItem.GraphicsItemFlag.ItemIgnoresTransformations)
    return cross


def colour_indices(values: NDArray[Any], ends: Range) -> NDArray[np.uint8]:
    """Which of the `COLOURS` of a map each value has, from 1 on; NaN has 0."""
    low, high = ends
    share = (np.asarray(values, np.float32) - np.float32(low)) * np.float32(COLOURS / (high - low))
    np.clip(share, 0, COLOURS - 1, out=share)
    share += 1
    return np.asarray(np.nan_to_num(share, copy=False, nan=0.0), np.uint8)


@cache
def colour_table(*, is_diverging: bool) -> NDArray[np.uint8]:
    """The colours of the indices, RGBA, shape (256, 4): none for what was not measured."""
    table = pg.colormap.get(MAPS[is_diverging]).getLookupTable(nPts=COLOURS, alpha=True)
    return np.concatenate([np.zeros((1, 4), np.uint8), table.astype(np.uint8)])


@lru_cache(maxsize=8)
def greys(black: int, white: int) -> NDArray[np.uint8]:
    """The colours of grey levels, RGBA, shape (256, 4), red where a pixel is saturated."""
    grey = np.clip((np.arange(256) - black) * 255.0 / (white - black), 0, 255).astype(np.uint8)
    table = np.column_stack([grey, grey, grey, np.full(256, 255, np.uint8)])
    table[255, :3] = pg.mkColor(theme.DARK.saturated).getRgb()[:3]
    return table
