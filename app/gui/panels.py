"""The parts around the plots: run controls, readouts, the result and the health strip."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtWidgets import (
    QFrame,
    QGridLayout,
    QHBoxLayout,
    QLabel,
    QProgressBar,
    QPushButton,
    QVBoxLayout,
    QWidget,
)

from app.gui import theme
from app.gui.numbers import NOT_KNOWN, Cell, Tone
from app.gui.view_state import ViewState
from app.records import Phase


def _label(text: str, name: str) -> QLabel:
    label = QLabel(text)
    label.setObjectName(name)
    return label


def _subscripted(text: str) -> str:
    """``Q_s`` as rich text with a subscript."""
    head, mark, tail = text.rpartition("_")
    return f"{head}<sub>{tail}</sub>" if mark else text


class CellView(QWidget):
    """One named value with its unit and its uncertainty."""

    def __init__(self, cell: Cell, value_name: str = "value") -> None:
        super().__init__()
        self.name, self.value, self.detail = (
            _label("", "name"),
            _label("", value_name),
            _label("", "detail"),
        )
        self._shown: Cell | None = None
        row = QHBoxLayout()
        row.setSpacing(6)
        row.addWidget(self.value, 0, Qt.AlignmentFlag.AlignBaseline)
        row.addWidget(self.detail, 0, Qt.AlignmentFlag.AlignBaseline)
        row.addStretch(1)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.setSpacing(1)
        layout.addWidget(self.name)
        layout.addLayout(row)
        self.show_cell(cell)

    def show_cell(self, cell: Cell) -> None:
        """Show `cell`, if it is not what is shown."""
        if cell == self._shown:
            return
        self._shown = cell
        self.name.setText(_subscripted(cell.name))
        self.value.setText(cell.value)
        self.detail.setText(
            " ".join(part for part in (cell.detail, cell.unit) if part)
            if cell.value != NOT_KNOWN
            else ""
        )
        self.value.setStyleSheet(
            f"color: {theme.TONES[cell.tone]};" if cell.tone is not Tone.NEUTRAL else ""
        )


class CellRow(QFrame):
    """Named values side by side, in columns of one width."""

    def __init__(self, value_name: str = "value") -> None:
        super().__init__()
        self.setObjectName("panel")
        self._value_name = value_name
        self.views: list[CellView] = []
        self._row = QHBoxLayout()
        self._row.setSpacing(16)
        self.body = QVBoxLayout(self)
        self.body.setContentsMargins(12, 8, 12, 8)
        self.body.addLayout(self._row)

    def show_cells(self, cells: tuple[Cell, ...]) -> None:
        """Show `cells`; their number stays the same during a run."""
        while len(self.views) < len(cells):
            self.views.append(CellView(cells[len(self.views)], self._value_name))
            self._row.addWidget(self.views[-1], 1)
        for view, cell in zip(self.views, cells, strict=True):
            view.show_cell(cell)


class ResultPanel(CellRow):
    """The settings of the run and, once it has ended, what came out of it."""

    def __init__(self) -> None:
        super().__init__()
        self.heading, self.notes = _label("Settings of the run", "heading"), _label("", "muted")
        self.notes.setWordWrap(True)
        self.body.insertWidget(0, self.heading)
        self.body.addWidget(self.notes)
        self.notes.hide()

    def show_view(self, view: ViewState) -> None:
        """Show the settings or the result."""
        has_result = view.outcome is not None
        self.heading.setText("Result" if has_result else "Settings of the run")
        self.show_cells(view.result)
        self.notes.setText(
            " · ".join(part for part in (view.sentence, view.notes) if part) if has_result else ""
        )
        self.notes.setVisible(has_result)


class TopBar(QFrame):
    """Name and state of the run, its phases, and the three buttons."""

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("panel")
        self.title, self.badge, self.phases = _label("SlipScope", "title"), QLabel(""), QLabel("")
        self.sentence = _label("", "muted")
        self.sentence.setWordWrap(True)
        self.start, self.stop, self.stop_motion = (
            QPushButton("Start  F5"),
            QPushButton("End run"),
            QPushButton("STOP MOTION"),
        )
        self.start.setObjectName("start")
        self.stop_motion.setObjectName("stop_motion")
        self.stop_motion.setMinimumSize(220, 58)
        self.stop_motion.setToolTip(
            "Stops the actuator now and ends the run (Esc). A software button is not an emergency"
            " stop."
        )
        self.stop.setToolTip(
            "Ends the run in good order: the actuator stops, what was measured is kept."
        )
        self.start.setToolTip("Begins the run (F5).")
        for button in (self.start, self.stop):
            button.setMinimumHeight(40)
        words = QVBoxLayout()
        words.setSpacing(4)
        first = QHBoxLayout()
        first.setSpacing(12)
        for widget in (self.title, self.badge, self.phases):
            first.addWidget(widget)
        first.addStretch(1)
        words.addLayout(first)
        words.addWidget(self.sentence)
        row = QHBoxLayout(self)
        row.setContentsMargins(14, 8, 10, 8)
        row.setSpacing(10)
        row.addLayout(words, 1)
        for button in (self.start, self.stop, self.stop_motion):
            row.addWidget(button)
        self._shown: tuple[str, Tone, str] | None = None
        self.show_state("idle", Tone.NEUTRAL, "")

    def show_state(self, state: str, tone: Tone, phase: str) -> None:
        """Show the badge, and the phases with the present one lit."""
        if (state, tone, phase) == self._shown:
            return
        self._shown = (state, tone, phase)
        self.badge.setText(state.upper())
        self.badge.setStyleSheet(
            f"background: {theme.TONES[tone]}; color: #10131a; border-radius: 4px; padding: 2px"
            " 10px; font-weight: 700; font-size: 12px;"
        )
        words = (
            f"<b style='color:{theme.TEXT}'>{step}</b>"
            if step == phase
            else f"<span style='color:#6c7684'>{step}</span>"
            for step in Phase
        )
        self.phases.setText("<span style='color:#4b5563'> &nbsp;›&nbsp; </span>".join(words))


class HealthStrip(QFrame):
    """Where every trigger and sample went, how full the queue is, what is left of the disk and of
    the run.
    """

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("panel")
        self.cells: list[CellView] = []
        self.queue, self.progress = QProgressBar(), QProgressBar()
        self.queue.setObjectName("queue")
        self.queue.setTextVisible(False)
        self.queue_text, self.progress_text = _label("", "detail"), _label("0 %", "detail")
        self.progress.setTextVisible(False)
        for bar in (self.queue, self.progress):
            bar.setRange(0, 1000)
            bar.setFixedHeight(10)
        self._row = QHBoxLayout(self)
        self._row.setContentsMargins(14, 6, 14, 6)
        self._row.setSpacing(18)
        self.disk = CellView(Cell("disk left", "–"), "count")
        self._row.addWidget(self.disk)
        self._row.addWidget(_bar("recorder queue", self.queue, self.queue_text))
        self._row.addWidget(_bar("progress", self.progress, self.progress_text), 1)

    def show_view(self, view: ViewState) -> None:
        """Show the account as of now."""
        while len(self.cells) < len(view.health):
            self.cells.append(CellView(view.health[len(self.cells)], "count"))
            self._row.insertWidget(len(self.cells) - 1, self.cells[-1])
        for shown, cell in zip(self.cells, view.health, strict=True):
            shown.show_cell(cell)
        self.disk.show_cell(view.disk)
        self.queue.setValue(round(1000 * view.queue_fill))
        self.queue_text.setText(f"{view.queue.value} {view.queue.unit}")
        if self.queue.property("tone") != str(view.queue.tone):
            self.queue.setProperty("tone", str(view.queue.tone))
            self.queue.style().polish(self.queue)
            is_calm = view.queue.tone in (Tone.NEUTRAL, Tone.GOOD)
            self.queue_text.setStyleSheet(
                "" if is_calm else f"color: {theme.TONES[view.queue.tone]}; font-weight: 700;"
            )
        self.progress.setValue(round(1000 * view.progress))
        self.progress_text.setText(f"{100 * view.progress:.0f} %")


def _bar(name: str, bar: QProgressBar, text: QLabel) -> QWidget:
    widget = QWidget()
    grid = QGridLayout(widget)
    grid.setContentsMargins(0, 0, 0, 0)
    grid.setVerticalSpacing(4)
    grid.addWidget(_label(name, "name"), 0, 0)
    grid.addWidget(text, 0, 1, Qt.AlignmentFlag.AlignRight)
    grid.addWidget(bar, 1, 0, 1, 2)
    widget.setMinimumWidth(150)
    return widget
