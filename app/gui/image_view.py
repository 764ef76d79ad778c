"""The interface as the camera sees it, with u_x, the contact's edge a and the stick radius c drawn
over it.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QRectF, Qt
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QFrame,
    QHBoxLayout,
    QLabel,
    QSlider,
    QVBoxLayout,
    QWidget,
)

from app.gui import theme
from app.gui.numbers import number
from app.gui.view_state import FieldView, ImageView, Scene, ViewState

_ANGLES = np.linspace(0.0, 2 * np.pi, 181)


class InterfaceView(QFrame):
    """Live image, overlay and circles; axes in mm from the top-left pixel, x along the drive, y
    down.
    """

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setObjectName("panel")
        self._scene: Scene | None = None
        self._image: ImageView | None = None
        self._field: FieldView | None = None
        # displacement, shear traction
        self._fields: tuple[FieldView | None, FieldView | None] = (None, None)
        self.plot = theme.plot_widget("x, driving direction → (mm)", "y (mm)")
        self.image = pg.ImageItem(axisOrder="row-major")
        self.overlay = pg.ImageItem(axisOrder="row-major")
        dashed = pg.mkPen(theme.APPARENT, width=2, style=Qt.PenStyle.DashLine)
        self.apparent = pg.PlotCurveItem(pen=dashed, antialias=True)
        self.stick = pg.PlotCurveItem(pen=pg.mkPen(theme.STICK, width=2.5), antialias=True)
        self.centre = pg.ScatterPlotItem(
            symbol="+", size=16, pen=pg.mkPen(theme.APPARENT, width=1.5), brush=None
        )
        self.colour_bar = pg.ColorBarItem(
            values=(-1, 1),
            colorMap=theme.displacement_map(),
            label="uₓ (µm)",
            interactive=False,
            width=16,
            pen=theme.GRID,
        )
        self._build_plot()
        self.heading, self.caption, self.pointed = QLabel("Interface"), QLabel(""), QLabel("")
        self.show_field, self.show_circles = QCheckBox("overlay"), QCheckBox("circles a, c")
        self.which = QComboBox()
        self.opacity = QSlider(Qt.Orientation.Horizontal)
        self._build_layout()

    def show_scene(self, scene: Scene) -> None:
        """Empty the view and set its scale for a new run."""
        self._scene, self._image, self._field, self._fields = scene, None, None, (None, None)
        for side in ("bottom", "left"):
            self.plot.getPlotItem().getAxis(side).setScale(scene.pixel_um * 1e-3)
        self._show_all()
        self.image.clear()
        self.overlay.clear()
        for item in (self.apparent, self.stick, self.centre):
            item.setData([], [])
        self.caption.setText("")

    def show_view(self, view: ViewState) -> None:
        """Draw what changed since the last call."""
        if view.image is not None and view.image is not self._image:
            self._image = view.image
            self.image.setImage(
                view.image.pixels, levels=view.image.levels, rect=QRectF(*view.image.rect_px)
            )
        self._fields = view.field, view.stress_field
        self.which.setVisible(view.stress_field is not None)
        self._show_overlay()
        _draw_circle(self.apparent, view.centre_px, view.apparent_px)
        _draw_circle(self.stick, view.centre_px, view.stick_px)
        self.centre.setData(
            *([], []) if view.centre_px is None else ([view.centre_px[0]], [view.centre_px[1]])
        )
        self.caption.setText(
            " · ".join(part.caption for part in (self._field, view.image) if part is not None)
        )

    def _show_overlay(self) -> None:
        field = self._fields[
            1 if self._fields[1] is not None and self.which.currentIndex() == 1 else 0
        ]
        if field is self._field:
            return
        self._field = field
        if field is None:
            self.overlay.clear()
            return
        limit = field.limit
        self.overlay.setImage(field.values, levels=(-limit, limit), rect=QRectF(*field.rect_px))
        self.colour_bar.setLevels((-limit, limit))
        self.colour_bar.getAxis("left").setLabel(f"{field.symbol} ({field.unit})")
        self.colour_bar.getAxis("right").setTicks(
            [[(value, number(value, 0 if limit >= 10 else 1)) for value in colour_ticks(limit)]]
        )

    def _build_plot(self) -> None:
        plot = self.plot.getPlotItem()
        plot.invertY(True)
        plot.setAspectLocked(True)
        plot.showGrid(x=False, y=False)
        plot.hideButtons()
        for depth, item in enumerate(
            (self.image, self.overlay, self.apparent, self.stick, self.centre)
        ):
            item.setZValue(depth)
            plot.addItem(item)
        self.colour_bar.setImageItem(self.overlay, insert_in=plot)
        axis = self.colour_bar.getAxis("right")
        axis.setTextPen(theme.MUTED)
        axis.setWidth(44)
        self.colour_bar.layout.setContentsMargins(0, 10, 0, 10)  # the end ticks' text needs room
        self.plot.scene().sigMouseMoved.connect(self._show_cursor)
        self.plot.scene().sigMouseClicked.connect(self._reset_zoom)

    def _build_layout(self) -> None:
        self.heading.setObjectName("heading")
        for label in (self.caption, self.pointed):
            label.setObjectName("muted")
        self.show_field.setChecked(True)
        self.show_circles.setChecked(True)
        self.show_circles.setToolTip(
            "dashed: apparent radius a; solid: stick radius c; cross: centre of the contact"
        )
        self.opacity.setRange(0, 100)
        self.opacity.setFixedWidth(120)
        self.opacity.setToolTip("opacity of the overlay")
        self.which.addItems(["uₓ", "σₓ"])
        self.which.setToolTip("displacement along the drive, or shear traction")
        self.which.hide()
        self.which.currentIndexChanged.connect(self._show_overlay)
        self.show_field.toggled.connect(self.overlay.setVisible)
        self.show_circles.toggled.connect(self._set_circles_visible)
        self.opacity.valueChanged.connect(lambda percent: self.overlay.setOpacity(percent / 100))
        self.opacity.setValue(45)
        head, foot = QHBoxLayout(), QHBoxLayout()
        head.addWidget(self.heading)
        head.addSpacing(10)
        head.addWidget(self.caption)
        head.addStretch(1)
        for widget in (self.show_field, self.which, self.opacity, self.show_circles):
            head.addSpacing(8)
            head.addWidget(widget)
        foot.addWidget(self.pointed)
        self.pointed.setText(
            "point at the image to read it; wheel zooms, drag moves, double click shows all"
        )
        layout = QVBoxLayout(self)
        layout.setContentsMargins(12, 8, 12, 8)
        layout.addLayout(head)
        layout.addWidget(self.plot, 1)
        layout.addLayout(foot)

    def _set_circles_visible(self, visible: bool) -> None:
        for item in (self.apparent, self.stick, self.centre):
            item.setVisible(visible)

    def _reset_zoom(self, event: Any) -> None:
        if event.double():
            self._show_all()

    def _show_all(self) -> None:
        if self._scene is not None:
            camera = self._scene.config.camera
            self.plot.setRange(QRectF(-0.5, -0.5, camera.width, camera.height), padding=0.03)

    def _show_cursor(self, position: Any) -> None:
        if self._scene is None:
            return
        point = self.plot.getPlotItem().vb.mapSceneToView(position)
        self.pointed.setText(describe_point(self._scene, self._field, point.x(), point.y()))


def describe_point(scene: Scene, field: FieldView | None, x_px: float, y_px: float) -> str:
    """Place of a point in px and mm, and the field's value in the box under it."""
    scale = scene.pixel_um * 1e-3
    place = (
        f"x {number(x_px, 0)} px, y {number(y_px, 0)} px  ·  {number(x_px * scale, 2)} mm,"
        f" {number(y_px * scale, 2)} mm"
    )
    if field is None:
        return place
    left, top, width, height = field.rect_px
    rows, cols = field.values.shape
    col, row = math.floor((x_px - left) / width * cols), math.floor((y_px - top) / height * rows)
    if not (0 <= row < rows and 0 <= col < cols):
        return place
    value = float(field.values[row, col])
    return f"{place}  ·  {field.symbol} " + (
        f"{number(value, 2)} {field.unit}" if math.isfinite(value) else "not measured"
    )


def colour_ticks(limit: float) -> list[float]:
    """The colour bar's ticks: its ends, its middle and half-way."""
    return [share * limit for share in (-1.0, -0.5, 0.0, 0.5, 1.0)]


def _draw_circle(curve: Any, centre: tuple[float, float] | None, radius: float) -> None:
    if centre is None or not math.isfinite(radius):
        curve.setData([], [])
    else:
        curve.setData(centre[0] + radius * np.cos(_ANGLES), centre[1] + radius * np.sin(_ANGLES))
