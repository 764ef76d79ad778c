"""The region in which displacements are measured, drawn on the picture."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pyqtgraph as pg
from PySide6.QtCore import QPointF, Qt
from PySide6.QtGui import QHideEvent, QKeySequence, QShortcut, QShowEvent, QUndoCommand, QUndoStack
from PySide6.QtWidgets import QListWidget, QPushButton, QToolButton

from analysis.settings import Polygon
from app.gui import theme
from app.gui.cells import Tone
from app.gui.desk import Desk
from app.gui.image_view import InterfaceView
from app.gui.widgets import STRETCH, Panel, column, label, row

SHARES = {True: 0.3, False: 0.1}  # half the side of a new polygon, of the picture
CHANGES = {True: "measure", False: "leave out"}
ABOVE = 100  # the picture and all that is drawn on it


class _Change(QUndoCommand):
    """The region before and after something was done to it."""

    def __init__(
        self,
        text: str,
        before: tuple[str, ...],
        after: tuple[str, ...],
        use: Callable[[tuple[str, ...]], object],
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
    """Draws the polygons of `dic.region` on the picture of a view while it is in sight.

    Corners are dragged; a click on an edge adds a corner, and the menu of a corner removes it.
    Every change can be undone. A run that is under way keeps the region that it began with.
    """

    name = "region"
    title = "Region"
    keys = (("Ctrl+Z, Ctrl+Y", "Undoes a change of the region, and does it again."),)

    def __init__(self, desk: Desk, view: InterfaceView) -> None:
        super().__init__()
        self.desk, self._view = desk, view
        self.undo_stack = QUndoStack(self)
        self.drawn: list[Any] = []  # a PolyLineROI for each polygon
        self._shown: tuple[str, ...] = ()
        self._build()
        desk.settings_changed.connect(self._follow)
        desk.busy_changed.connect(lambda _: self._say())
        self._follow()

    @property
    def region(self) -> tuple[str, ...]:
        """That of the next run, as in the settings."""
        return self.desk.config.dic.region

    def add(self, is_measured: bool) -> None:
        """Add a rectangle in the middle of the picture."""
        rows, columns = self.desk.config.camera.shape
        half = SHARES[is_measured] * min(rows, columns)
        left, right = round(columns / 2 - half), round(columns / 2 + half)
        top, bottom = round(rows / 2 - half), round(rows / 2 + half)
        corners = ((left, top), (right, top), (right, bottom), (left, bottom))
        self._change("add", (*self.region, Polygon(is_measured, corners).text))
        self.list.setCurrentRow(self.list.count() - 1)

    def remove(self) -> None:
        """Remove the polygon that is chosen in the list."""
        at = self.list.currentRow()
        if at >= 0:
            self._change("remove", (*self.region[:at], *self.region[at + 1 :]))

    # ------------------------------------------------------------------ the region of the desk

    def _change(self, text: str, region: tuple[str, ...]) -> None:
        if region != self.region:
            self.undo_stack.push(_Change(text, self.region, region, self._use))

    def _use(self, region: tuple[str, ...]) -> None:
        """Let the next run measure in this region; say why where it can not."""
        config = self.desk.config
        try:
            changed = replace(config, dic=replace(config.dic, region=region))
        except ValueError as error:
            self.desk.said.emit(f"The region stays as it is: {error}", False)
            self._draw()
            return
        self.desk.set_config(changed)

    def _follow(self) -> None:
        """Show the region that the desk has."""
        if self.region != self._shown:
            self._shown = self.region
            self._draw()
        self._say()

    def _moved(self, at: int) -> None:
        """A corner was dragged, added or removed."""
        if at >= len(self.drawn):
            return
        roi = self.drawn[at]
        places = (roi.mapToParent(place) for _, place in roi.getLocalHandlePositions())
        corners = tuple((round(place.x()), round(place.y())) for place in places)
        polygon = self.desk.config.dic.polygons[at]._replace(corners=corners)
        self._change("move", (*self.region[:at], polygon.text, *self.region[at + 1 :]))

    # ------------------------------------------------------------------ drawing

    def _draw(self) -> None:
        """Draw all polygons anew, on the picture and in the list."""
        chosen = self.list.currentRow()
        self._clear()
        self.list.clear()
        for at, polygon in enumerate(self.desk.config.dic.polygons):
            self.list.addItem(f"{CHANGES[polygon.is_measured]}: {len(polygon.corners)} corners")
            self.list.item(at).setToolTip(f"{polygon.text} px")
            if self.isVisible():
                self._draw_one(at, polygon)
        self.list.setCurrentRow(min(chosen, self.list.count() - 1))

    def _draw_one(self, at: int, polygon: Polygon) -> None:
        tone = theme.TONES[Tone.GOOD if polygon.is_measured else Tone.BAD]
        pen = pg.mkPen(tone, width=2, style=Qt.PenStyle.SolidLine)
        roi = pg.PolyLineROI(
            [QPointF(*corner) for corner in polygon.corners], closed=True, movable=False, pen=pen
        )
        roi.setZValue(ABOVE)
        roi.sigRegionChangeFinished.connect(lambda _, at=at: self._moved(at))
        self._view.plot.getPlotItem().addItem(roi, ignoreBounds=True)
        self.drawn.append(roi)

    def _clear(self) -> None:
        for roi in self.drawn:
            roi.sigRegionChangeFinished.disconnect()
            self._view.plot.getPlotItem().removeItem(roi)
        self.drawn.clear()

    def _say(self) -> None:
        polygons = self.desk.config.dic.polygons
        what = (
            "Displacements are measured inside the green polygons, or everywhere if there is none,"
            " and not in the red ones. Drag a corner; click an edge for a new one."
            if polygons
            else "Displacements are measured in the whole picture."
        )
        later = " The run that is on keeps the region that it began with."
        self.sentence.setText(what + (later if self.desk.is_busy else ""))
        self.remove_button.setEnabled(bool(polygons))

    def showEvent(self, event: QShowEvent) -> None:
        """Draw on the picture."""
        super().showEvent(event)
        self._draw()

    def hideEvent(self, event: QHideEvent) -> None:
        """Leave the picture."""
        super().hideEvent(event)
        self._clear()

    # ------------------------------------------------------------------ building

    def _build(self) -> None:
        self.sentence, self.list = label("", "muted"), QListWidget()
        self.sentence.setWordWrap(True)
        self.list.setAccessibleName("Polygons of the region")
        self.list.setFixedHeight(92)
        self.measure_button, self.leave_button = QPushButton("Measure in"), QPushButton("Leave out")
        self.measure_button.setToolTip("A polygon in which displacements are measured")
        self.leave_button.setToolTip("A polygon in which they are not: dirt, a reflection")
        self.measure_button.clicked.connect(lambda: self.add(True))
        self.leave_button.clicked.connect(lambda: self.add(False))
        self.remove_button = QToolButton()
        self.remove_button.setText("Remove")
        self.remove_button.setToolTip("Removes the polygon that is chosen in the list")
        self.remove_button.clicked.connect(self.remove)
        self.undo_button, self.redo_button = QToolButton(), QToolButton()
        for button, act, keys in (
            (self.undo_button, self.undo_stack.undo, QKeySequence.StandardKey.Undo),
            (self.redo_button, self.undo_stack.redo, QKeySequence.StandardKey.Redo),
        ):
            button.clicked.connect(act)
            shortcut = QShortcut(QKeySequence(keys), self)
            shortcut.setContext(Qt.ShortcutContext.WidgetWithChildrenShortcut)
            shortcut.activated.connect(act)
        self.undo_button.setText("Undo")
        self.redo_button.setText("Redo")
        self.undo_stack.canUndoChanged.connect(self.undo_button.setEnabled)
        self.undo_stack.canRedoChanged.connect(self.redo_button.setEnabled)
        self.undo_button.setEnabled(False)
        self.redo_button.setEnabled(False)
        first = row(self.measure_button, self.leave_button, STRETCH, spacing=6)
        second = row(self.undo_button, self.redo_button, STRETCH, self.remove_button, spacing=6)
        parts = (first, self.list, second, self.sentence, STRETCH)
        self.setLayout(column(*parts, spacing=6, margins=(10, 8, 10, 8)))
