"""The interface as the camera sees it, with a field, the circles of the contact, and a cut."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any, cast

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QStandardItemModel
from PySide6.QtWidgets import QCheckBox, QComboBox, QLineEdit, QSlider

from analysis.options import number_in
from app.gui.cells import number, short, typeset
from app.gui.charts import Chart, Line
from app.gui.frame_results import KINDS, Circles, FieldImage, FrameResults, ShownImage
from app.gui.plot_panel import PlotPanel
from app.gui.plots.curves import CurvePlot
from app.gui.plots.picture import PicturePlot
from app.gui.scales import Range, colour_range, with_other_sign
from app.gui.source import Setup, cell_at, centres_px
from app.gui.view_state import ViewState
from app.gui.widgets import STRETCH, Panel, column, keep_room, label, row, widget
from app.records.bench_view import PictureView
from app.settings.sections import Config

CUT = "Cut through the centre"
RAW, DIFFERENCE = "raw", "difference"
PICTURES = {RAW: (RAW, "raw image"), DIFFERENCE: (DIFFERENCE, "difference to the reference")} | {
    key: (kind.symbol, f"{kind.symbol}  {kind.hint[0].lower()}{kind.hint[1:]}")
    for key, kind in KINDS.items()
}  # their names, and what they are
NOT_YET = "not measured of this frame"
ABSENT = {"sigma_kPa": "the traction of every point needs the setting stress.field"}
LIVE = "live picture of the connected bench, not recorded"
OLD_OPACITY = 0.4  # of a picture that is not live any more
ENDS_PX = 64
POINT_HINT = "Point to read, click for the history there. Wheel zooms, drag moves, R: all."


class InterfaceView(Panel):
    """Live image, one of the fields over it, and the circles.

    The axes are in mm from the top-left pixel, x along the rows of the image, y down.
    """

    chosen = Signal(float, float)  # a place in px, by a click on a picture with a field

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("")  # the panel of the picture has the frame
        self._setup: Setup | None = None
        self._image: ShownImage | None = None
        self._reference: ShownImage | None = None
        self._frame: FrameResults | None = None
        self._circles: Circles | None = None
        self.field: FieldImage | None = None  # that is shown
        self._grey: NDArray[Any] = np.empty((0, 0), np.uint8)  # or the image, or the difference
        self._held: dict[str, Range] = {}  # ranges of the colour scale
        self._written: object = None  # the colour scale whose ends are written
        self._point = (math.nan, math.nan)
        self._is_of_bench = False  # a connected one, whose picture no recorded one replaces
        self._offered: set[str] = set()
        self.canvas, self.cut = PicturePlot(), CurvePlot()
        self._build_controls()
        self._build_layout()
        self._offer()

    def show_setup(self, setup: Setup) -> None:
        """Empty the view and show all of the next run's pictures."""
        self._setup, self._is_of_bench = setup, False
        self._image = self._reference = self._frame = self._circles = self.field = None
        if not self.locked.isChecked():
            self._held.clear()
        camera, is_back = setup.config.camera, setup.config.run.direction < 0
        size, angle = (camera.width, camera.height), camera.angle + math.pi * is_back
        self.canvas.begin_run(size, self._mm, setup.grid_rect_px, angle)
        self.cut.begin_run()
        self._show_ends()
        self._show_cut()
        self.panel.say("")
        self.panel.origin = self.cut_panel.origin = setup.name
        self._offer()

    def show_view(self, view: ViewState) -> None:
        """Draw what has changed since the last call, unless a connected bench is shown."""
        if self._is_of_bench:
            return
        if self._setup is not None and self._setup.title == LIVE:
            self.show_setup(view.charts.setup)
        if view.image is not self._image or view.reference is not self._reference:
            if view.image is not self._image:
                self.canvas.note_image(view.at_s)
            self._image, self._reference = view.image, view.reference
            self._show_image()
        if view.frame is not self._frame:
            self._frame = view.frame
            self._offer()
            self._show_field()
        elif self.field is None:
            self._show_cut()
        if view.circles != self._circles:
            self._circles = view.circles
            self.canvas.show_circles(view.circles)
        self._say()

    def prepare(self, view: ViewState) -> None:
        """Make, in the thread that has read a view, what will most likely be drawn of it."""
        shown, frame, field = self.field, view.frame, None
        has_come = frame is not self._frame
        if has_come and shown and frame and not shown.offset and shown.kind.key in frame.keys:
            field = frame.field(shown.kind.key)
        is_new = view.image is not self._image and self.key != DIFFERENCE
        self.canvas.prepare(view.image if is_new else None, field)

    def show_live(
        self, picture: PictureView, config: Config, note: str, is_connected: bool
    ) -> None:
        """Show what the camera of a bench sees, which nobody records; dimmed with a note that says
        why it is not live. A recorded picture takes its place once it is not connected any more.
        """
        camera = config.camera
        whole = (-0.5, -0.5, float(camera.width), float(camera.height))
        if self._setup is None or self._setup.title != LIVE or self._setup.config != config:
            self.show_setup(Setup(LIVE, camera.pixel * 1e6, whole, config))
        self._is_of_bench = is_connected
        self.canvas.show_colours(picture.rgb, whole, opacity=OLD_OPACITY if note else 1.0)
        self.panel.say(note or LIVE)

    # ------------------------------------------------------------------ what is shown

    def _show_image(self) -> None:
        """The image below, or its difference to the reference."""
        if self._image is None:
            return
        if self.key == DIFFERENCE and self._reference is not None:
            self._grey = pixels = self._image.levels.astype(np.int32) - self._reference.levels
            ends = self._ends_of(lambda: reach_of(pixels), is_diverging=True)
            self.canvas.show_difference(pixels, self._image.rect_px, ends)
        else:
            self._grey = self._image.levels
            levels = self._image.stretched if self.stretch.isChecked() else (0, 255)
            self.canvas.show_image(self._image, levels)

    def _show_field(self) -> None:
        """The field that is chosen, in the colours of its range."""
        self.field = None
        if self._frame is not None and self.key in self._frame.keys:
            field = self._frame.field(self.key)
            self.field = field.about_median() if self.median.isChecked() else field
        if self.field is None:
            self.canvas.show_field(None, (0.0, 1.0))
        else:
            field = self.field
            ends = self._ends_of(lambda: field.extent, is_diverging=field.is_diverging)
            self.canvas.show_field(field, ends)
        if self.canvas.colour_scale is not self._written:
            self._show_ends()
        self._show_cut()

    def _show_cut(self) -> None:
        if self.show_cut.isChecked():
            self.cut.show_chart(self._cut_chart())

    def _ends_of(self, extent: Callable[[], Range], *, is_diverging: bool) -> Range:
        """The ends of the colours, which hold an extent unless they are locked."""
        held = self._held.get(self._range_key)
        if held is not None and self.locked.isChecked():
            return with_other_sign(held, *extent())
        held = self._held[self._range_key] = colour_range(
            *extent(), held, is_diverging=is_diverging
        )
        return held

    def _cut_chart(self) -> Chart:
        """What is shown, along the drive through the contact's centre."""
        if self._setup is None:
            return Chart(CUT, "x (mm)", "")
        y_px = self.canvas.cut_px
        if self.field is not None:
            values, rect, column = self.field.values, self._setup.grid_rect_px, self.field.kind.key
            name = self.field.label
        elif self._image is not None:
            values, rect, column, name = self._grey, self._image.rect_px, self.key, "grey levels"
        else:
            return Chart(CUT, "x (mm)", "")
        x_px, rows_px = centres_px(rect, values)
        x_mm, at = self._mm * x_px, np.abs(rows_px - y_px).argmin()
        role = {"ux_um": "displacement", "sigma_kPa": "shear"}.get(self.key, "apparent")
        line = Line("", x_mm, values[at].astype(np.float64), role, ("x_mm", column), width=1.2)
        width_mm = self._setup.config.camera.width * self._mm
        return Chart(CUT, "x (mm)", name, (line,), x_range=(0.0, width_mm))

    # ------------------------------------------------------------------ what is said

    def _say(self) -> None:
        captions = [part.caption for part in (self.field, self._image) if part is not None]
        if self._frame is not None and self.field is None and self.key in KINDS:
            captions.insert(0, f"{KINDS[self.key].symbol}: {ABSENT.get(self.key, NOT_YET)}")
        self.panel.say(" · ".join(captions))
        self._read_point()

    @property
    def _mm(self) -> float:
        """Of a pixel; NaN before the first run."""
        return self._setup.pixel_um * 1e-3 if self._setup else math.nan

    def _point_at(self, x_mm: float, y_mm: float) -> None:
        self._point = (x_mm / self._mm, y_mm / self._mm)
        self._read_point()

    def _choose_point(self, x_mm: float, y_mm: float) -> None:
        """Mark a place whose history the curves show."""
        if self._frame is not None:
            self.canvas.show_point(x_mm, y_mm)
            self.chosen.emit(x_mm / self._mm, y_mm / self._mm)

    def _read_point(self) -> None:
        if self._setup is None or not math.isfinite(self._point[0]):
            text = POINT_HINT
        else:
            text = describe_point(self._setup, self.field, *self._point, self._image)
        self.pointed.setText(text)

    # ------------------------------------------------------------------ what the operator chooses

    def _choose(self) -> None:
        self.key, self.field = str(self.which.currentData()), None
        kind = KINDS.get(self.key)
        self.median.setEnabled(kind is not None and kind.sign != "one")
        self.opacity.setEnabled(kind is not None)
        self._show_image()
        self._show_field()
        self._say()

    def _offer(self) -> None:
        """Offer the pictures that there are; the others are off."""
        there = {RAW, *(self._frame.keys if self._frame else KINDS)}
        if self._reference is not None:
            there.add(DIFFERENCE)
        if there == self._offered:
            return
        self._offered = there
        model = cast(QStandardItemModel, self.which.model())
        for n, (key, (_, hint)) in enumerate(PICTURES.items()):
            model.item(n).setEnabled(is_there := key in there)
            model.item(n).setToolTip(hint if is_there else f"{hint}: {ABSENT.get(key, NOT_YET)}")

    @property
    def _range_key(self) -> str:
        """Of the range that is in use: one for each picture, and another about the median."""
        return f"{self.key} {bool(self.field and self.field.offset)}"

    def _type_range(self) -> None:
        """Take the two numbers for the ends of the colours, or show again those in use."""
        if not any(end.isModified() for end in self.ends):
            return  # a field that was only left
        for end in self.ends:
            end.setModified(False)
        try:
            low, high = (
                number_in(end.text().replace(",", ".").replace("−", "-")) for end in self.ends
            )
        except ValueError:
            self._show_ends()
        else:
            self._set_range(low, high)

    def _set_range(self, low: float, high: float) -> None:
        """Keep these ends of the colours; where they go both ways zero stays in the middle."""
        if self.canvas.colour_scale is not None and -math.inf < low < high < math.inf:
            is_diverging, (before, _), _ = self.canvas.colour_scale
            if is_diverging:
                reach = abs(low if low != before else high) or max(-low, high)
                low, high = -reach, reach
            self._held[self._range_key] = low, high
            self.locked.setChecked(True)
            self._choose()
        self._show_ends()

    def _show_ends(self) -> None:
        """Write the ends of the colours where they can be typed."""
        self._written = colours = self.canvas.colour_scale
        for n, field in enumerate(self.ends):
            field.setVisible(colours is not None)
            if not (field.hasFocus() and field.isModified()):
                field.setText(typeset(f"{colours[1][n]:g}") if colours else "")

    def _build_controls(self) -> None:
        self.which = widget(QComboBox, toolTip="Which picture is shown")
        for key, (name, _) in PICTURES.items():
            self.which.addItem(name, key)
        self.key = "ux_um"  # of the picture that is shown
        self.which.setCurrentIndex(list(PICTURES).index(self.key))
        self.opacity = widget(
            QSlider,
            Qt.Orientation.Horizontal,
            maximum=100,
            value=100,
            toolTip="Opacity of the field over the image",
            valueChanged=lambda percent: self.canvas.set_opacity(percent / 100),
        )
        self.opacity.setFixedWidth(90)
        self.median, self.locked, self.stretch, self.show_circles, self.show_cut = (
            widget(QCheckBox, text, toolTip=tip, checked=text == "circles", toggled=act)
            for text, tip, act in (
                (
                    "− median",
                    "Subtract the median of the field from all of its values, and show both signs;"
                    " the number is in the name of the colours",
                    self._choose,
                ),
                ("lock range", "Keep the colour scale as it is; else it follows", self._choose),
                (
                    "stretch grey",
                    "Stretch the grey levels in each image; else black is 0 and white is full"
                    " scale",
                    self._choose,
                ),
                (
                    "circles",
                    "Dashed: a (seen), the edge of the contact in the image; dotted: a<sub>H</sub>"
                    " (Hertz), from the load and the settings; solid: stick radius c; cross: centre"
                    " of the contact",
                    self.canvas.set_circles_visible,
                ),
                (
                    "cut",
                    "The field along the line through the contact's centre",
                    self._set_cut_visible,
                ),
            )
        )
        self.ends = tuple(
            widget(
                QLineEdit,
                accessibleName=f"{end} end of the colours",
                toolTip=f"{end} end of the colours, typed here or dragged on their bar",
                maximumWidth=ENDS_PX,
                minimumWidth=ENDS_PX,
                editingFinished=self._type_range,
            )
            for end in ("Lower", "Upper")
        )
        for end in self.ends:  # there are none without colours
            keep_room(end)
            end.hide()
        self.canvas.range_chosen.connect(self._set_range)
        self.which.currentIndexChanged.connect(self._choose)

    def _set_cut_visible(self, is_visible: bool) -> None:
        self.cut_panel.setVisible(is_visible)
        self.canvas.set_cut_visible(is_visible)
        self._show_cut()

    def _build_layout(self) -> None:
        self.pointed = label(POINT_HINT, "muted")
        controls = (*self.ends, self.which, self.opacity)
        self.panel = PlotPanel(self.canvas, *controls, title="Interface")
        checks = (self.median, self.locked, self.stretch, self.show_circles, self.show_cut)
        self.panel.body.insertLayout(1, row(*checks, STRETCH, spacing=12))
        self.panel.body.addWidget(self.pointed)
        self.cut_panel = PlotPanel(self.cut, title=f"{CUT}, along the drive")
        self.cut.setMaximumHeight(170)
        self.cut_panel.hide()
        self.setLayout(column((self.panel, 1), self.cut_panel, spacing=8))
        for before, after in pairwise((self.which, *self.ends)):  # no number is typed into first
            self.setTabOrder(before, after)
        self.canvas.pointed.connect(self._point_at)
        self.canvas.clicked.connect(self._choose_point)
        self.cut.pointed.connect(lambda x, _y: self.canvas.show_place(x))


def reach_of(difference: NDArray[np.int32]) -> Range:
    """What nearly all of a difference of images lies in, grey levels; wider than noise."""
    reach = float(np.percentile(np.abs(difference[::4, ::4]), 99))
    return -reach, max(reach, 2.0)


def describe_point(
    setup: Setup,
    field: FieldImage | None,
    x_px: float,
    y_px: float,
    image: ShownImage | None = None,
) -> str:
    """Place of a point in px and mm, the grey level there, and the field's value in its box."""
    x_mm, y_mm = (at_px * setup.pixel_um * 1e-3 for at_px in (x_px, y_px))
    texts = [
        f"x {number(x_px, 0)} px, y {number(y_px, 0)} px",
        f"{number(x_mm, 2)} mm, {number(y_mm, 2)} mm",
    ]
    if image is not None:
        at = round(y_px), round(x_px)
        if all(0 <= n < size for n, size in zip(at, image.full.shape, strict=True)):
            texts.append(f"grey {image.full[at]}")
    if field is not None:
        cell = cell_at(setup.grid_rect_px, field.values, x_px, y_px)
        if cell is not None:
            value = float(field.values[cell])
            symbol = field.label.rpartition(" (")[0] or field.label
            measured = typeset(f"{short(value, 3)} {field.kind.unit}".strip())
            texts.append(f"{symbol} {measured if math.isfinite(value) else 'not measured'}")
    return "  ·  ".join(texts)
