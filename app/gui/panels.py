"""The parts around the plots: run controls, readouts, and the result."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLabel, QPushButton, QSizePolicy, QWidget

from app.gui import theme
from app.gui.cells import DASH, Cell, Tone, with_subscript
from app.gui.result_panel import ResultPanel
from app.gui.widgets import Panel, by_pointer_only, column, label, row, tint
from app.records.record_types import Phase

__all__ = ["CellRow", "CellView", "ResultPanel", "TopBar"]


class CellView(QWidget):
    """One named value with its unit and its uncertainty."""

    def __init__(self, cell: Cell, value_style: str) -> None:
        super().__init__()
        self.name, self.value = label("", "name"), label("", value_style)
        self.detail = label("", "detail")
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
        self.value.setText(cell.value)
        if cell.hint != self.toolTip():
            self.setToolTip(cell.hint)
        is_known = cell.value != DASH
        self.detail.setText(" ".join(filter(None, (cell.detail, cell.unit))) if is_known else "")
        tint(self.value, None if cell.tone is Tone.NEUTRAL else cell.tone)


class CellRow(Panel):
    """Named values side by side, which share the width equally where `share` is 1."""

    def __init__(self, *, style: str = "value", share: int = 1, spacing: int = 16) -> None:
        super().__init__()
        self.views: list[CellView] = []
        self._style, self._share = style, share
        self.row = row(spacing=spacing)
        self.body = column(self.row, margins=(12, 8, 12, 8))
        self.setLayout(self.body)

    def show_cells(self, cells: tuple[Cell, ...]) -> None:
        """Show `cells`, whose number stays the same during a run."""
        for cell in cells[len(self.views) :]:
            self.views.append(CellView(cell, self._style))
            self.row.insertWidget(len(self.views) - 1, self.views[-1], self._share)
        for view, cell in zip(self.views, cells, strict=True):
            view.show_cell(cell)


class TopBar(Panel):
    """Name and state of the run, its phases, and the three buttons."""

    def __init__(self) -> None:
        super().__init__()
        self.title, self.badge, self.phases = label("SlipScope", "title"), QLabel(""), QLabel("")
        self.sentence = label("", "muted")
        self.sentence.setWordWrap(True)
        self.start, self.stop = _button("Start  F5", "start"), _button("End run", "stop")
        self.stop_motion = _button("STOP MOTION  Esc", "stop_motion")
        self.stop_motion.setMinimumSize(200, 48)
        # the name and the phases are cut short in a narrow window, the buttons never
        for words in (self.title, self.phases, self.sentence):
            words.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
        first = row(self.badge, (self.title, 2), (self.phases, 3), spacing=10)
        said = column(first, self.sentence, spacing=2)
        buttons = (self.start, self.stop, self.stop_motion)
        self.setLayout(row((said, 1), *buttons, spacing=8, margins=(10, 5, 8, 5)))
        self._shown: tuple[str, Tone, str] | None = None
        self.show_state("idle", Tone.NEUTRAL, "")

    def show_state(self, state: str, tone: Tone, phase: str) -> None:
        """Show the badge, and the phases with the present one lit."""
        if (state, tone, phase) == self._shown:
            return
        self._shown = (state, tone, phase)
        self.show_again()

    def show_again(self) -> None:
        """Show the state in the colours of now."""
        assert self._shown is not None
        state, tone, phase = self._shown
        self.badge.setText(state.upper())
        self.badge.setStyleSheet(
            f"background: {theme.TONES[tone]}; color: {theme.now().window}; border-radius: 4px;"
            " padding: 2px 10px; font-weight: 700;"
        )
        words = (
            f"<b style='color:{theme.TEXT}'>{step}</b>"
            if step == phase
            else f"<span style='color:{theme.MUTED}'>{step}</span>"
            for step in Phase
        )
        self.phases.setText(f"<span style='color:{theme.MUTED}'> &nbsp;›&nbsp; </span>".join(words))


def _button(text: str, style: str) -> QPushButton:
    button = QPushButton(text)
    button.setObjectName(style)
    by_pointer_only(button)
    return button
