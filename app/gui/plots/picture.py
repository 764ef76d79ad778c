"""An image of the interface, a field over it, and the circles of the contact."""

from __future__ import annotations

import math
import time
from functools import cache, cached_property, lru_cache, partial
from typing import Any

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from pyqtgraph.GraphicsScene.mouseEvents import MouseClickEvent
from PySide6.QtCore import QLineF, QPointF, QRectF, QSize, Qt, Signal
from PySide6.QtGui import (
    QColor,
    QPainter,
    QPainterPath,
    QPaintEvent,
    QPen,
    QStaticText,
)
from PySide6.QtWidgets import QGraphicsItem, QGraphicsScene

from analysis.arrays import U8
from app.gui import theme
from app.gui.cells import localized, number
from app.gui.frame_results import Circles, FieldImage, ShownImage
from app.gui.plots.axis import CACHED, tick_strings
from app.gui.plots.plot import SAME, Plot, are_near
from app.gui.plots.raster import Raster
from app.gui.scales import Range, power_of_ten, round_step
from app.gui.source import Rect, centres_px
from app.gui.view_state import NOTHING_DISPLAYED, DisplayStatistics
from app.gui.widgets import keep_room
from app.records.record_types import F64
from app.system.outputs import csv_text

NO_PICTURE = (
    "The camera's image, and the displacements in it, appear here when a bench is connected, a run"
    " begins (F5), or a recorded session is opened (Ctrl+O)."
)
MAPS = {False: "viridis", True: "CET-D1A"}  # whether the colours go both ways from zero
COLOURS = 255  # of a map; index 0 is what was not measured
DIFFERENCE = "difference (grey levels)"
MARGIN = 0.01  # about the image, of its size
SCALE_BAR = 0.2  # of the width that is seen of the picture, at least
ALONG = math.cos(math.radians(5.0))  # least cosine of the drive to the rows that is along them
LEAST_NAMED = 8.0  # radius on the screen, px
BAR_PX, CROSS_PX, NAME_PX = 14, 7, 30
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
LEVEL_STEPS = 100  # of the colour range, when it is set by the mouse
# whether the colours go both ways, their range, and the name of what they stand for
ColourScale = tuple[bool, Range, str]
HALO, WHITE = (0, 0, 0, 150), "#ffffff"
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
        super().__init__("Interface")
        self.field: FieldImage | None = None
        self.circles: Circles | None = None
        self.colour_scale: ColourScale | None = None
        self.display = NOTHING_DISPLAYED
        # a field with the ends of its colours, and which of them each of its points has
        self._indices: tuple[object, U8] = None, np.empty((0, 0), np.uint8)
        self._read_at_s: float | None = None  # of an image that is not painted yet
        self._mm, self._grid = 1.0, (0.0, 0.0, 1.0, 1.0)
        self._shows_circles, self._has_cut, self._place = True, False, math.nan
        self._above = Raster(self.box)
        self._below = Raster(self.box, self._above)
        self._contact = _ContactMarks(self)
        self._cut = pg.InfiniteLine(angle=0, pen=pg.mkPen(WHITE, width=1))
        self._cut_place = pg.ScatterPlotItem([0], [0], symbol="d", size=9, pen=HALO, brush=WHITE)
        self._point = pg.ScatterPlotItem([0], [0], symbol="o", size=11, pen=WHITE, brush=HALO)
        self._scale = pg.ScaleBar(1.0, width=4, brush=WHITE, pen=pg.mkPen(HALO), offset=(-20, -16))
        self._scale.text.fill = pg.mkBrush(HALO)
        self._scale.text.setColor(WHITE)
        self._scale.text.textItem.setCacheMode(CACHED)
        # an index of places keeps items that have moved unnoticed, also once they are deleted
        self.scene().setItemIndexMethod(QGraphicsScene.ItemIndexMethod.NoIndex)
        self.box.setAspectLocked(True)
        self.box.invertY(True)
        for axis in self.axes:
            axis.setGrid(False)  # it would be drawn over the image
        self.axes[0].setLabel("y (mm)")
        self._name_x(0.0)
        # only wider: a narrower axis gives a larger picture, whose ticks may need a wider one again
        self.axes[0].setStyle(autoReduceTextSpace=False)
        self.axes[0].textWidth = 0
        images, points = (self._below, self._above), (self._cut_place, self._point)
        for part in (*images, self._contact, self._cut, *points):
            self.box.addItem(part, ignoreBounds=True)
        self._point.hide()
        self._scale.setParentItem(self.box)
        self.box.sigXRangeChanged.connect(self._fit)
        self._set_empty(True)
        self.recolour()

    def _name_x(self, angle: float) -> None:
        along = "→" if math.cos(angle) > ALONG else "←" if math.cos(angle) < -ALONG else ""
        self.axes[1].setLabel(f"x, driving direction {along} (mm)" if along else "x (mm)")

    def begin_run(self, size: tuple[int, int], mm: float, grid: Rect, angle: float = 0.0) -> None:
        """Empty the picture; `size` is that of images in pixels of `mm`, `grid` that of a field,
        `angle` (rad) that of the drive in the picture.
        """
        self._mm, self._grid = mm, grid
        self._name_x(angle)
        self.circles = self.colour_scale = None
        self.display, self._read_at_s = NOTHING_DISPLAYED, None
        self._below.hide()
        self._point.hide()
        self._below.setOpacity(1.0)
        self.show_field(None, (0.0, 1.0))
        self._set_empty(False)
        self._bar.setVisible(self.colour_scale is not None)
        width, height = size[0] * mm, size[1] * mm
        pad = MARGIN * width
        self.show_ranges((-pad, width + pad), (-pad, height + pad))
        self.reset()
        self._show_overlays()

    def sizeHint(self) -> QSize:
        """A size at which a picture is seen well."""
        return QSize(640, 480)

    # ------------------------------------------------------------------ what is shown

    def prepare(self, image: ShownImage | None, field: FieldImage | None) -> None:
        """Make, in another thread, what will be drawn if these are shown next."""
        if image is not None:
            self._below.prepare(image.pixels)
        if field is not None and (colours := self.colour_scale) is not None:
            self._indices = (field, colours[1]), colour_indices(field.values, colours[1])
            self._above.prepare(self._indices[1])

    def show_image(self, image: ShownImage, levels: tuple[int, int]) -> None:
        """Show an image, black and white at these grey levels, saturated pixels in red."""
        self._below.show_pixels(image.pixels, self._placed(image.rect_px), greys(*levels))
        if self.field is None:
            self._name_colours(None)

    def show_colours(self, rgb: U8, rect: Rect, *, opacity: float = 1.0) -> None:
        """Show a picture whose colours are given, shape (rows, cols, 3)."""
        self._below.setOpacity(opacity)
        self._below.show_pixels(rgb, self._placed(rect), None)

    def show_difference(self, pixels: NDArray[np.int32], rect: Rect, ends: Range) -> None:
        """Show the difference of two images, in grey levels."""
        indices, table = colour_indices(pixels, ends), colour_table(is_diverging=True)
        self._below.show_pixels(indices, self._placed(rect), table)
        self._name_colours((True, ends, DIFFERENCE))

    def show_field(self, field: FieldImage | None, ends: Range) -> None:
        """Show a field in the colours of a range; None: no field."""
        self.field = field
        if field is not None:
            is_diverging = field.is_diverging and ends[0] == -ends[1]
            table = colour_table(is_diverging=is_diverging)
            of, indices = self._indices
            if of != (field, ends):
                indices = colour_indices(field.values, ends)
            self._above.show_pixels(indices, self._placed(self._grid), table)
            self._name_colours((is_diverging, ends, field.label))
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
        values = self.field.values + np.float32(self.field.offset)
        x, y = (self._mm * at_px for at_px in centres_px(self._grid, values))
        row, col = np.nonzero(np.isfinite(values))
        rows = zip(x[col], y[row], values[row, col].tolist(), strict=True)
        return csv_text([("x_mm", "y_mm", self.field.kind.key), *rows])

    # ------------------------------------------------------------------ drawing

    def _placed(self, rect: Rect) -> QRectF:
        """A rectangle of pixels in mm."""
        return QRectF(*(self._mm * length for length in rect))

    @cached_property
    def _bar(self) -> pg.ColorBarItem:
        """The colour bar, made for the first picture: it takes long."""
        bar = pg.ColorBarItem(width=BAR_PX, label=" ", colorMapMenu=False, hoverBrush=HALO)
        for part in (bar, bar.vb):
            part.setFlag(part.GraphicsItemFlag.ItemHasNoContents)  # but what is in it
        for side in ("top", "bottom", "left", "right"):  # its outline
            axis = bar.getAxis(side)
            axis.setCacheMode(CACHED)
            axis.tickStrings = partial(tick_strings, axis)
        bar.axis.enableAutoSIPrefix(False)
        bar.axis.setStyle(maxTickLevel=1)
        bar.sigLevelsChangeFinished.connect(lambda bar: self.range_chosen.emit(*bar.levels()))
        self.grid.addItem(bar, 1, 3)
        self.grid.setColumnFixedWidth(2, 5)
        keep_room(bar)  # the picture keeps its place
        self.recolour()
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
        self._scale.bar.setPen(pg.mkPen("k", width=self.width_of(2)))  # on white paper it is seen

    def _name_colours(self, colours: ColourScale | None) -> None:
        """Show what the colours stand for."""
        if colours == self.colour_scale and colours is not None:
            return
        self.colour_scale = colours
        if colours is None:
            if "_bar" in vars(self):  # it is not made for nothing
                self._bar.hide()
            return
        self._bar.show()
        is_diverging, ends, name = colours
        if (colour_map := pg.colormap.get(MAPS[is_diverging])) is not self._bar.colorMap():
            self._bar.setColorMap(colour_map)
        if ends != self._bar.levels():
            self._bar.rounding = round_step((ends[1] - ends[0]) / LEVEL_STEPS)
            self._bar.setLevels(ends)
        power = power_of_ten(ends)
        self._bar.axis.setScale(10.0**-power)
        name += f" × 10{str(power).translate(RAISED)}" * bool(power)
        if name != (axis := self._bar.getAxis("left")).labelText:
            axis.setLabel(name)
        axis.show()  # which takes the width of its name, that it has lost while it was hidden
        self.grid.activate()  # places are asked for before Qt comes to it

    def _show_overlays(self) -> None:
        """Place circles, centre, cut and scale bar."""
        mm, circles = self._mm, self.circles
        centre = circles.centre_px if circles and self._shows_circles else None
        radii = (circles.apparent_px, circles.hertz_px, circles.stick_px) if circles else ()
        self._contact.setVisible(centre is not None)
        if centre:
            pixel, _ = self.box.viewPixelSize()
            self._contact.show_circles(mm * np.array([*centre, *radii]), pixel)
        self._cut.setVisible(self._has_cut)
        self._cut.setValue(mm * self.cut_px)
        self._cut_place.setVisible(self._has_cut and math.isfinite(self._place))
        if math.isfinite(self._place):
            self._cut_place.setPos(self._place, mm * self.cut_px)

    def _fit(self) -> None:
        """Follow the zoom: a scale bar of a round length, and names where there is room."""
        (low, high), _ = self.box.viewRange()
        (left, right), _ = self.all
        length = round_step(SCALE_BAR * min(high - low, right - left))
        if length != self._scale.size:
            is_fine = length < 0.1
            shown = f"{number(1e3 * length, 0)} µm" if is_fine else f"{localized(f'{length:g}')} mm"
            self._scale.size = length
            self._scale.text.setText(shown)
            self._scale.updateBar()
        self._show_overlays()


class _ContactMarks(QGraphicsItem):
    """The circles of the contact with their names, and its centre: over dark lines, for the ground
    has any colour.
    """

    def __init__(self, plot: Plot) -> None:
        super().__init__()
        self._plot, self._pixel, self._room = plot, 1.0, QRectF()
        self.setCacheMode(CACHED)  # they move less often than what is below them
        self._places: F64 = np.empty(0)
        self._dark = pg.mkPen("k")  # opaque: else it takes Qt three times as long
        self._rings = [  # in the colours of both themes, for the picture is the same in both
            (pg.mkPen(theme.DARK.role(role), style=style), QStaticText(name), degrees)
            for name, role, style, degrees in RINGS
        ]
        self._cross = QPainterPath()
        for x, y in ((CROSS_PX, 0), (0, CROSS_PX)):
            self._cross.moveTo(-x, -y)
            self._cross.lineTo(x, y)

    def show_circles(self, places: F64, pixel: float) -> None:
        """Draw circles about a centre, whose x, y and radii are `places`, where a pixel is so
        large, all in mm; a radius of NaN is not known. What is drawn to half a pixel stays: else
        the whole picture would be drawn again with each reading of the force.
        """
        if pixel == self._pixel and are_near(places, self._places, SAME * pixel):
            return
        self.prepareGeometryChange()
        self._places, self._pixel = places, pixel
        self.setPos(*places[:2])
        reach = np.fmax.reduce(places[2:], initial=0.0) + NAME_PX * pixel
        self._room = QRectF(-reach, -reach, 2 * reach, 2 * reach)
        self.update()  # what is kept: another geometry alone does not draw it anew

    def boundingRect(self) -> QRectF:
        """What they take, with their names."""
        return self._room

    def paint(self, painter: QPainter, *_: Any) -> None:
        """Draw them, in pixels."""
        painter.scale(self._pixel, self._pixel)
        known = [
            (radius / self._pixel, *ring)
            for radius, ring in zip(self._places[2:], self._rings, strict=True)
            if math.isfinite(radius)
        ]
        width = self._plot.width_of(1.0)
        self._dark.setWidthF(3 * width)
        for radius, pen, *_name in known:
            pen.setWidthF(width)
            for one in (self._dark, pen):
                painter.setPen(one)
                painter.drawEllipse(QPointF(), radius, radius)
        for radius, pen, name, degrees in known:
            if radius > LEAST_NAMED:
                room = QRectF(QPointF(), name.size())
                room.moveCenter(QLineF.fromPolar(radius, degrees).p2())
                painter.fillRect(room.adjusted(-3, -1, 3, 1), QColor(*HALO))
                painter.setPen(pen)
                painter.drawStaticText(room.topLeft(), name)
        for colour, broad in ((QColor(*HALO), 5.0), (QColor(WHITE), 2.0)):
            painter.setPen(QPen(colour, broad))
            painter.drawPath(self._cross)


def colour_indices(values: NDArray[Any], ends: Range) -> U8:
    """Which of the `COLOURS` of a map each value has, from 1 on; NaN has 0."""
    low, high = ends
    scale = COLOURS / (high - low)
    index = np.asarray(values, np.float32) * np.float32(scale) + np.float32(1 - low * scale)
    np.clip(index, 1, COLOURS, out=index)
    np.fmax(index, 0, out=index)  # where NaN is
    return index.astype(np.uint8)


@cache
def colour_table(*, is_diverging: bool) -> U8:
    """The colours of the indices, RGBA, shape (256, 4): none for what was not measured."""
    table = pg.colormap.get(MAPS[is_diverging]).getLookupTable(nPts=COLOURS, alpha=True)
    return np.concatenate([np.zeros((1, 4), np.uint8), table.astype(np.uint8)])


@lru_cache(maxsize=8)
def greys(black: int, white: int) -> U8:
    """The colours of grey levels, RGBA, shape (256, 4), red where a pixel is saturated."""
    grey = np.clip((np.arange(256) - black) * 255.0 / (white - black), 0, 255).astype(np.uint8)
    table = np.column_stack([grey, grey, grey, np.full(256, 255, np.uint8)])
    table[255, :3] = pg.mkColor(theme.DARK.saturated).getRgb()[:3]
    return table
