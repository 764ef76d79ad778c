"""The region in which displacements are measured, drawn on the picture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from PySide6.QtGui import QHideEvent, QKeySequence, QShowEvent, QUndoCommand, QUndoStack
from PySide6.QtWidgets import QComboBox, QListWidget

from analysis.region import measured
from analysis.settings import Polygon
from app.evaluation.setup import grid_of
from app.gui.number_boxes import NumberBox
from app.gui.plots.picture import PicturePlot
from app.gui.plots.region import Corners, RegionShapes, circle, described, rectangle
from app.gui.widgets import (
    STRETCH,
    EmptyNote,
    Panel,
    button,
    label,
    row,
    shortcut,
    tool_button,
    widget,
)
from app.gui.window_model import WindowModel

SHARES = {True: 0.3, False: 0.1}  # half the side of a new shape, of the picture
RECTANGLE, CIRCLE, POLYGON, CONTACT = "Rectangle", "Circle", "Polygon", "Around the contact"
NO_CONTACT = (
    "There is no circle around the contact yet: its centre and radius a are measured in a run. Show"
    " a run or a session, and add the circle then."
)
NAMES = {True: "measure", False: "leave out"}


Region = tuple[str, ...]  # its polygons, as in the settings


class _Change(QUndoCommand):
    """The region before and after something was done to it."""

    def __init__(
        self, text: str, before: Region, after: Region, use: Callable[[Region], object]
    ) -> None:
        super().__init__(text)
        self._before, self._after, self._use = before, after, use

    def undo(self) -> None:
        """Have the region as it was."""
        self._use(self._before)

    def redo(self) -> None:
        """Have it changed."""
        self._use(self._after)


class RegionPanel(Panel):
    """Shows the shapes of `dic.region` on a picture while it is in sight itself.

    Every change can be undone. A run that is under way keeps the region that it began with.
    """

    name = "region"
    title = "Region"
    keys = (("Ctrl+Z, Ctrl+Y", "Undoes a change of the region, and does it again."),)

    def __init__(self, model: WindowModel, picture: PicturePlot) -> None:
        super().__init__()
        self.model, self.picture, self.shapes = model, picture, RegionShapes(picture)
        self.undo_stack = QUndoStack(self)
        self._shown: tuple[Region, float] | None = None  # and the size of a pixel, m
        self._used = self.region  # that was drawn here, or began here
        self._build()
        self.shapes.changed.connect(self._moved)
        model.settings_changed.connect(self._follow)
        model.busy_changed.connect(lambda _: self._say())
        self._follow()

    @property
    def region(self) -> Region:
        """That of the next run, as in the settings."""
        return self.model.config.dic.region

    def add(self, is_measured: bool) -> None:
        """Add a shape of the kind that is chosen."""
        if (corners := self._new(SHARES[is_measured])) is None:
            self.model.said.emit(NO_CONTACT, False)
            return
        self._change("add", (*self.region, Polygon(is_measured, corners).text))
        self.list.setCurrentRow(self.list.count() - 1)

    def remove(self) -> None:
        """Remove the shape that is chosen in the list."""
        at = self.list.currentRow()
        if at >= 0:
            self._change("remove", (*self.region[:at], *self.region[at + 1 :]))

    def _new(self, share: float) -> Corners | None:
        """A shape in the middle of the picture, or about the contact; None: that is not known."""
        rows, columns = self.model.config.camera.shape
        kind, half, x, y = (
            self.kind.currentText(),
            share * min(rows, columns),
            columns / 2,
            rows / 2,
        )
        if kind == RECTANGLE:
            return rectangle(x, y, 2 * half, 2 * half)
        if kind != CONTACT:
            return circle(x, y, half)[:: 1 if kind == CIRCLE else 4]
        about = self.picture.circles
        if about is None or about.centre_px is None or not about.apparent_px > 0:
            return None
        return circle(*about.centre_px, self.factor.value() * about.apparent_px)

    # ------------------------------------------------------------------ the region of the next run

    def _change(self, text: str, region: Region) -> None:
        if region != self.region:
            self.undo_stack.push(_Change(text, self.region, region, self._use))

    def _use(self, region: Region) -> None:
        """Let the next run measure in this region; say why where it cannot."""
        config = self.model.config
        try:
            changed = replace(config, dic=replace(config.dic, region=region))
        except ValueError as error:
            self.model.said.emit(f"The region stays as it is: {error}", False)
            self._draw()
            return
        self._used = region
        self.model.set_config(changed)

    def _follow(self) -> None:
        """Show the region of the next run; what was done to that of other settings cannot be undone
        in these.
        """
        if self.region != self._used:
            self._used = self.region
            self.undo_stack.clear()
        if (now := (self.region, self.model.config.camera.pixel)) != self._shown:
            self._shown = now
            self._draw()
        self._say()

    def _moved(self, at: int, polygon: Polygon) -> None:
        """A shape has become another by the mouse."""
        self._change("move", (*self.region[:at], polygon.text, *self.region[at + 1 :]))

    # ------------------------------------------------------------------ drawing

    def _draw(self) -> None:
        """Show all shapes, on the picture and in the list."""
        chosen, polygons = self.list.currentRow(), self.model.config.dic.polygons
        mm = self.model.config.camera.pixel * 1e3
        self.shapes.show_polygons(polygons, mm)
        self.list.clear()
        for at, polygon in enumerate(polygons):
            self.list.addItem(f"{NAMES[polygon.is_measured]}: {described(polygon, mm)}")
            self.list.item(at).setToolTip(f"{polygon.text} px")
        self.list.setCurrentRow(min(chosen, len(polygons) - 1))

    def _say(self) -> None:
        dic, grid = self.model.config.dic, grid_of(self.model.config)
        what = (
            "Displacements are measured inside the green shapes, or everywhere if there is none,"
            " and not in the red ones. Drag a corner, or what is inside to move all; click an edge"
            " for a new corner, and a corner twice to remove it."
            if dic.polygons
            else "Displacements are measured in the whole picture."
        )
        later = " The run that is on keeps the region that it began with."
        self.sentence.setText(what + (later if self.model.is_busy else ""))
        boxes = measured(dic.polygons, grid.x_px, grid.y_px[:, None])
        self.boxes.setText(
            f"{boxes.sum()} of {boxes.size} boxes of {dic.box} px have their centre in it"
        )
        self.remove_button.setEnabled(bool(dic.polygons))

    def showEvent(self, event: QShowEvent) -> None:
        """Draw on the picture."""
        super().showEvent(event)
        self.shapes.set_visible(True)

    def hideEvent(self, event: QHideEvent) -> None:
        """Leave the picture alone."""
        super().hideEvent(event)
        self.shapes.set_visible(False)

    # ------------------------------------------------------------------ building

    def _build(self) -> None:
        self.sentence, self.boxes = label("", "muted", wraps=True), label("", "muted")
        self.kind = widget(QComboBox, toolTip="What is added")
        self.kind.addItems([RECTANGLE, CIRCLE, POLYGON, CONTACT])
        name = "Radius of the circle around the contact, in radii a (seen)"
        self.factor = NumberBox(name, "a", (0.1, 10.0), 1)
        self.factor.setSingleStep(0.1)
        self.factor.setValue(1.5)
        self.factor.setToolTip(name)
        self.factor.hide()
        self.list = widget(QListWidget, accessibleName="Shapes of the region")
        self.kind.currentTextChanged.connect(lambda kind: self.factor.setVisible(kind == CONTACT))
        EmptyNote(self.list, "No shape: all of the picture is measured")
        self.list.setFixedHeight(92)
        self.measure_button = button(
            "Measure in", "A shape in which displacements are measured", partial(self.add, True)
        )
        self.leave_button = button(
            "Leave out",
            "A shape in which they are not: dirt, a reflection",
            partial(self.add, False),
        )
        self.remove_button = tool_button(
            "Remove", "Removes the shape that is chosen in the list", self.remove
        )
        stack, keys = self.undo_stack, QKeySequence.StandardKey
        self.undo_button = tool_button("Undo", act=stack.undo)
        self.redo_button = tool_button("Redo", act=stack.redo)
        for made, key, changed in (
            (self.undo_button, keys.Undo, stack.canUndoChanged),
            (self.redo_button, keys.Redo, stack.canRedoChanged),
        ):
            shortcut(key, self, made.click)
            changed.connect(made.setEnabled)
            made.setEnabled(False)
        choice = row(self.kind, self.factor, STRETCH)
        first = row(self.measure_button, self.leave_button, STRETCH)
        second = row(self.undo_button, self.redo_button, STRETCH, self.remove_button)
        self.hold(choice, first, self.list, second, self.boxes, self.sentence, STRETCH)
