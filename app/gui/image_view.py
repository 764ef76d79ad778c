"""The interface as the camera sees it, with a field, the apparent radius and the stick radius."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QRectF, Qt
from PySide6.QtWidgets import QCheckBox, QComboBox, QSlider

from app.gui import theme
from app.gui.cells import number
from app.gui.frame_results import FrameResults, Overlay, ShownImage
from app.gui.source import Setup
from app.gui.view_state import ViewState
from app.gui.widgets import STRETCH, Panel, column, label, row

_ANGLES = np.linspace(0.0, 2 * np.pi, 181)


class InterfaceView(Panel):
    """Live image, overlay and circles.

    The axes are in mm from the top-left pixel, x along the driving direction, y down.
    """

    def __init__(self) -> None:
        super().__init__()
        self._setup: Setup | None = None
        self._image: ShownImage | None = None
        self._frame: FrameResults | None = None
        self._overlay: Overlay | None = None  # that of the two in _frame which is shown
        self.plot = theme.plot_widget("x, driving direction → (mm)", "y (mm)")
        self.image = pg.ImageItem(axisOrder="row-major")
        self.overlay = pg.ImageItem(axisOrder="row-major")
        dashed = pg.mkPen(theme.APPARENT, width=2, style=Qt.PenStyle.DashLine)
        self.apparent = pg.PlotCurveItem(pen=dashed, antialias=True)
        self.stick = pg.PlotCurveItem(pen=pg.mkPen(theme.STICK, width=2.5), antialias=True)
        cross = pg.mkPen(theme.APPARENT, width=1.5)
        self.centre = pg.ScatterPlotItem(symbol="+", size=16, pen=cross, brush=None)
        self._build_plot()
        self._build_controls()
        self._build_layout()

    def show_setup(self, setup: Setup) -> None:
        """Empty the view and set its scale for a new run."""
        self._setup, self._image, self._frame, self._overlay = setup, None, None, None
        for side in ("bottom", "left"):
            self.plot.getPlotItem().getAxis(side).setScale(setup.pixel_um * 1e-3)
        self._show_all()
        self.image.clear()
        self.overlay.clear()
        for item in self._marks:
            item.setData([], [])
        self.caption.setText("")

    @property
    def parts(self) -> tuple[Callable[[ViewState], None], ...]:
        """See `app.gui.desk.Part`."""
        return (self.show_view,)

    def show_view(self, view: ViewState) -> None:
        """Draw what has changed since the last call."""
        shown, circles = view.image, view.circles
        if shown is not None and shown is not self._image:
            self._image = shown
            self.image.setImage(shown.pixels, levels=shown.levels, rect=QRectF(*shown.rect_px))
        self._frame = view.frame
        self.which.setVisible(view.frame is not None and view.frame.traction is not None)
        self._show_overlay()
        _draw_circle(self.apparent, circles.centre_px, circles.apparent_px)
        _draw_circle(self.stick, circles.centre_px, circles.stick_px)
        self.centre.setData(pos=[circles.centre_px] if circles.centre_px else [])
        captions = [part.caption for part in (self._overlay, shown) if part is not None]
        self.caption.setText(" · ".join(captions))

    def _show_overlay(self) -> None:
        overlay = self._frame.displacement if self._frame else None
        if self._frame and self._frame.traction and self.which.currentIndex() == 1:
            overlay = self._frame.traction
        if overlay is self._overlay:
            return
        self._overlay = overlay
        if overlay is None or self._setup is None:
            self.overlay.clear()
            return
        limit, rect = overlay.limit, QRectF(*self._setup.grid_rect_px)
        self.overlay.setImage(overlay.values, levels=(-limit, limit), rect=rect)
        self.colour_bar.setLevels((-limit, limit))
        self.colour_bar.getAxis("left").setLabel(f"{overlay.symbol} ({overlay.unit})")
        values = [share * limit for share in (-1.0, -0.5, 0.0, 0.5, 1.0)]
        ticks = [(value, number(value, 0 if limit >= 10 else 1)) for value in values]
        self.colour_bar.getAxis("right").setTicks([ticks])

    def _build_plot(self) -> None:
        self._marks = (self.apparent, self.stick, self.centre)
        plot = self.plot.getPlotItem()
        plot.invertY(True)
        plot.setAspectLocked(True)
        plot.showGrid(x=False, y=False)
        plot.hideButtons()
        for depth, item in enumerate((self.image, self.overlay, *self._marks)):
            item.setZValue(depth)
            plot.addItem(item)
        colours, pen = theme.displacement_map(), theme.GRID
        self.colour_bar = pg.ColorBarItem(
            values=(-1, 1), colorMap=colours, label="uₓ (µm)", interactive=False, width=16, pen=pen
        )
        self.colour_bar.setImageItem(self.overlay, insert_in=plot)
        axis = self.colour_bar.getAxis("right")
        axis.setTextPen(theme.MUTED)
        axis.setWidth(44)
        self.colour_bar.layout.setContentsMargins(0, 10, 0, 10)  # room for the outermost numbers
        self.plot.scene().sigMouseMoved.connect(self._show_cursor)
        self.plot.scene().sigMouseClicked.connect(self._reset_zoom)

    def _build_controls(self) -> None:
        self.show_field, self.show_circles = QCheckBox("overlay"), QCheckBox("circles a, c")
        self.which, self.opacity = QComboBox(), QSlider(Qt.Orientation.Horizontal)
        self.which.addItems(["uₓ", "σₓ"])
        self.which.setToolTip("Displacement along the driving direction, or shear traction")
        self.which.hide()
        self.show_circles.setToolTip(
            "Dashed: apparent radius a; solid: stick radius c; cross: centre of the contact"
        )
        self.opacity.setRange(0, 100)
        self.opacity.setFixedWidth(120)
        self.opacity.setToolTip("Opacity of the overlay")
        self.show_field.setChecked(True)
        self.show_circles.setChecked(True)
        self.which.currentIndexChanged.connect(self._show_overlay)
        self.show_field.toggled.connect(self.overlay.setVisible)
        for item in self._marks:
            self.show_circles.toggled.connect(item.setVisible)
        self.opacity.valueChanged.connect(lambda percent: self.overlay.setOpacity(percent / 100))
        self.opacity.setValue(45)

    def _build_layout(self) -> None:
        self.caption = label("", "muted")
        self.pointed = label(
            "Point at the image to read it. The wheel zooms, dragging moves, a double click shows"
            " all.",
            "muted",
        )
        head = row(label("Interface", "heading"), 10, self.caption, STRETCH)
        for widget in (self.show_field, self.which, self.opacity, self.show_circles):
            head.addSpacing(8)
            head.addWidget(widget)
        self.setLayout(column(head, (self.plot, 1), self.pointed, margins=(12, 8, 12, 8)))

    def _reset_zoom(self, event: Any) -> None:
        if event.double():
            self._show_all()

    def _show_all(self) -> None:
        if self._setup is not None:
            camera = self._setup.config.camera
            self.plot.setRange(QRectF(-0.5, -0.5, camera.width, camera.height), padding=0.03)

    def _show_cursor(self, position: Any) -> None:
        if self._setup is not None:
            point = self.plot.getPlotItem().vb.mapSceneToView(position)
            self.pointed.setText(describe_point(self._setup, self._overlay, point.x(), point.y()))


def describe_point(setup: Setup, overlay: Overlay | None, x_px: float, y_px: float) -> str:
    """Place of a point in px and mm, and the overlay's value in the box under it."""
    x_mm, y_mm = (at_px * setup.pixel_um * 1e-3 for at_px in (x_px, y_px))
    place = (
        f"x {number(x_px, 0)} px, y {number(y_px, 0)} px  ·  {number(x_mm, 2)} mm,"
        f" {number(y_mm, 2)} mm"
    )
    if overlay is None:
        return place
    left, top, width, height = setup.grid_rect_px
    rows, cols = overlay.values.shape
    col, row = math.floor((x_px - left) / width * cols), math.floor((y_px - top) / height * rows)
    if not (0 <= row < rows and 0 <= col < cols):
        return place
    value = float(overlay.values[row, col])
    measured = f"{number(value, 2)} {overlay.unit}" if math.isfinite(value) else "not measured"
    return f"{place}  ·  {overlay.symbol} {measured}"


def _draw_circle(curve: Any, centre: tuple[float, float] | None, radius: float) -> None:
    if centre is None or not math.isfinite(radius):
        curve.setData([], [])
    else:
        curve.setData(centre[0] + radius * np.cos(_ANGLES), centre[1] + radius * np.sin(_ANGLES))
