"""The parts around the plots: run controls, readouts, and the result."""

from __future__ import annotations

import math
import re
import time
from pathlib import Path

from PySide6.QtCore import QSize, Qt
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QGridLayout, QLabel, QWidget

from app.gui import theme
from app.gui.cells import DASH, Cell, Cells, Tone, localized, readouts, with_subscript
from app.gui.source import Setup
from app.gui.view_state import ViewState
from app.gui.widgets import (
    Panel,
    PanelLabel,
    button,
    by_pointer_only,
    colour_as,
    column,
    label,
    restyle,
    row,
    tint,
    write,
)
from app.records.bench_view import ForcesView
from app.records.record_types import Phase

OLD_S = 1.0  # of a reading that is not live any more
STAMP_PX, STAMP_LINES = 76, 4
SPARE_PX = 70  # by which a narrow window may cut the stamp, and none of the numbers
ALL_PHASES_PX = 1150  # width of the bar that has room for the names of all phases
NOTHING = readouts(*5 * (math.nan,))
WIDEST = readouts(8.888, -8.888, -888.8e-6, 0.0, 0.04e-3)  # c: a bound of some hundredths


class RunPanel(Panel):
    """Shows a run; see `app.gui.window_model.RunDisplay`."""

    def show_setup(self, setup: Setup) -> None:
        """Empty the panel for a run that begins; here there is nothing that stays."""

    def show_view(self, view: ViewState) -> None:
        """Show the run as of now."""
        raise NotImplementedError


class CellView(QWidget):
    """One named value with its unit and its uncertainty."""

    def __init__(self, cell: Cell, value_style: str) -> None:
        super().__init__()
        styles = ("name", value_style, "detail")
        self.name, self.value, self.detail = (label("", one, kind=PanelLabel) for one in styles)
        self._shown: Cell | None = None
        numbers = row(spacing=6)
        for part in (self.value, self.detail):
            numbers.addWidget(part, 0, Qt.AlignmentFlag.AlignBaseline)
        numbers.addStretch(1)
        self.setLayout(column(self.name, numbers, spacing=1))
        self.show_cell(cell)

    def show_cell(self, cell: Cell) -> None:
        """Show `cell`, unless it is shown already."""
        if cell == self._shown:
            return
        self._shown = cell
        self.name.setText(with_subscript(cell.name))
        colour_as(self.name, cell.quantity)
        self.value.setText(localized(cell.value))
        if cell.hint != self.toolTip():
            self.setToolTip(cell.hint)
        is_known = cell.value != DASH
        detail = " ".join(filter(None, (cell.detail, cell.unit))) if is_known else ""
        self.detail.setText(localized(detail))
        tint(self.value, None if cell.tone is Tone.NEUTRAL else cell.tone)


class CellGrid(Panel):
    """Named values side by side, at most so many in a row, which share the width equally."""

    def __init__(self, *, style: str = "value", columns: int = 9, spacing: int = 16) -> None:
        super().__init__()
        self.views: list[CellView] = []
        self._style, self._columns = style, columns
        self.grid = QGridLayout()
        self.grid.setHorizontalSpacing(spacing)
        self.setLayout(column(self.grid, margins=(12, 8, 12, 8)))

    def show_cells(self, cells: Cells) -> None:
        """Show `cells`, whose number stays the same during a run."""
        for cell in cells[len(self.views) :]:
            place, at = divmod(len(self.views), self._columns)
            self.views.append(CellView(cell, self._style))
            self.grid.addWidget(self.views[-1], place, at)
            self.grid.setColumnStretch(at, 1)
        for view, cell in zip(self.views, cells, strict=True):
            view.show_cell(cell)


class LiveStrip(CellGrid):
    """P, Q, Q/P, the travel and c: as they are now, or dimmed with where they are from."""

    def __init__(self) -> None:
        super().__init__(spacing=8)
        right = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignTop
        self.stamp = label("", "detail", wraps=True, minimumWidth=STAMP_PX, alignment=right)
        # a long name is cut rather than making the strip higher, which moves all below it
        self.stamp.ensurePolished()
        self.stamp.setFixedHeight(STAMP_LINES * self.stamp.fontMetrics().lineSpacing())
        self.show_cells(WIDEST)
        for view in self.views:
            view.setMinimumWidth(view.sizeHint().width())  # numbers that come move nothing
        self.show_cells(NOTHING)
        self.grid.addWidget(self.stamp, 0, len(NOTHING))
        self._name, self._ended = "", ""  # of the run that is shown, and when it has ended
        self._of_run: Cells = NOTHING
        self._has_forces = False

    def minimumSizeHint(self) -> QSize:
        """Least room."""
        return super().minimumSizeHint() - QSize(SPARE_PX, 0)

    def begin(self, session: Path | None) -> None:
        """Show a run from now on, which records this file."""
        name = re.sub(r"([-_.])", "\\1\u200b", session.stem) if session else "run"  # may be broken
        self._name, self._ended, self._of_run = name, "", NOTHING

    def show_run(self, cells: Cells) -> None:
        """Show what is true of the run now, or at its end."""
        self._of_run = cells
        if not self._has_forces:  # of a connected bench, which are of now
            self._show(cells, self._ended, is_old=bool(self._ended))

    def end(self, cells: Cells) -> None:
        """The run has ended now, with these."""
        self._ended = f"ended {time.strftime('%H:%M')}\n{self._name}"
        self.show_run(cells)

    def show_bench(self, forces: ForcesView | None) -> None:
        """Show the forces of a bench that is connected without a run, and those of the last run
        again once it is let go of.
        """
        had_forces, self._has_forces = self._has_forces, forces is not None
        if forces is not None:
            is_old = forces.age_s > OLD_S
            stamp = f"no reading for {forces.age_s:.0f} s" if is_old else "connected bench"
            self._show(readouts(*forces.newest, *3 * (math.nan,)), stamp, is_old=is_old)
        elif had_forces:
            self.show_run(self._of_run)

    def _show(self, cells: Cells, stamp: str, *, is_old: bool) -> None:
        self.show_cells(cells)
        if stamp != self.stamp.text():
            write(self.stamp, stamp)
        for view in self.views:
            restyle(view.value, "old" if is_old else "value")


class TopBar(Panel):
    """Name and state of the run, its phases, and the three buttons."""

    def __init__(self) -> None:
        super().__init__()
        # the name is cut short in a narrow window, the buttons never
        self.title = label("SlipScope", "title", is_cut=True)
        self.sentence = label("", "muted", wraps=True, is_cut=True, kind=PanelLabel)
        self.badge, self.phases, self.place = label("", "badge"), QLabel(), label("", "fault")
        self.start, self.stop = button("Start  F5", style="start"), button("End run", style="stop")
        self.stop_motion = button("STOP MOTION  Esc", style="stop_motion")
        self.stop_motion.setMinimumSize(200, 48)
        first = row(self.badge, (self.title, 1), self.phases, 10, spacing=10)
        said = column(first, row((self.sentence, 1), self.place, spacing=10), spacing=2)
        buttons = (self.start, self.stop, self.stop_motion)
        by_pointer_only(*buttons)
        self.setLayout(row((said, 1), *buttons, spacing=8, margins=(10, 5, 8, 5)))
        self._shown, self._doing = ("", Tone.NEUTRAL, ""), ""
        self.show_state("idle", Tone.NEUTRAL, "")

    def show_state(self, state: str, tone: Tone, phase: str) -> None:
        """Show the badge, and the phases with the present one lit."""
        if (state, tone, phase) == self._shown:
            return
        self._shown = (state, tone, phase)
        self.show_again()

    def show_bench(self, doing: str) -> None:
        """Show what the stage of a connected bench does in place of the state; empty: it stands."""
        if doing != self._doing:
            self._doing = doing
            self.show_again()

    def say(self, sentence: str, place: str = "", *, is_fault: bool = False) -> None:
        """Show a sentence; why a run has failed is larger, in the colour of a fault, and beside it
        stands the place of its stage.
        """
        self.place.setText(localized(place))
        write(self.sentence, sentence)
        restyle(self.sentence, "fault" if is_fault else "muted")

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Show all phases, or only the present one, as there is room."""
        super().resizeEvent(event)
        self.show_again()

    def show_again(self) -> None:
        """Show the state in the colours of now."""
        state, tone, phase = self._shown
        if self._doing:
            state, tone = self._doing, Tone.BUSY
        self.badge.setText(state.upper())
        tint(self.badge, tone)
        colours = theme.now()
        words = (
            f"<b style='color:{colours.text}'>{step}</b>"
            if step == phase
            else f"<span style='color:{colours.muted}'>{step}</span>"
            for step in Phase
            if step == phase or self.width() >= ALL_PHASES_PX
        )
        between = f"<span style='color:{colours.muted}'> &nbsp;›&nbsp; </span>"
        self.phases.setText(between.join(words))
