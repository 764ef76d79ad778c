"""The experiment: the steps of the protocol, what the step under way waits for, and one key."""

from __future__ import annotations

from itertools import zip_longest

from PySide6.QtCore import QRectF, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent
from PySide6.QtWidgets import (
    QApplication,
    QGridLayout,
    QLineEdit,
    QPlainTextEdit,
    QWidget,
)

from app.gui import theme
from app.gui.cells import Tone, number
from app.gui.desk import Desk
from app.gui.panels import RunPanel
from app.gui.run_steps import TONES, Act, Band, RunSteps, Standing, StepLine, planned
from app.gui.source import Setup
from app.gui.view_state import ViewState
from app.gui.widgets import (
    STRETCH,
    button,
    by_pointer_only,
    column,
    label,
    restyle,
    row,
    tint,
    widget,
)
from app.runs.run_source import Kind

MARKS = {
    Standing.TO_COME: "○",
    Standing.UNDER_WAY: "▶",
    Standing.DONE: "✓",
    Standing.STOPPED: "■",
    Standing.FAILED: "✗",
}
AFTER = {Act.BEGIN: "", Act.ANSWER: "  F8 or Enter", Act.WAIT: " …"}
BAR_HEIGHT = 22
CONNECT_PX = 64  # from the top of a dock to below the button that connects a bench
SMALL_N = 0.1  # a band below this is told in mN


class BandBar(QWidget):
    """A force as a mark on a scale, with the band in which it must be."""

    def __init__(self) -> None:
        super().__init__()
        self.band: Band | None = None
        self.setFixedHeight(BAR_HEIGHT)

    def show_band(self, band: Band) -> None:
        """Show this."""
        self.band = band
        self.update()

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw scale, band and mark."""
        if self.band is None:
            return
        band, painter = self.band, QPainter(self)
        low, high = band.span_n
        scale = self.width() / max(high - low, 1e-9)
        middle, tone = self.height() / 2, theme.TONES[Tone.GOOD if band.is_within else Tone.WARN]
        faint = QColor(theme.TEXT)
        faint.setAlpha(40)
        painter.fillRect(QRectF(0, middle - 2, self.width(), 4), faint)
        left, wide = (band.low_n - low) * scale, (band.high_n - band.low_n) * scale
        painter.fillRect(QRectF(left, middle - 6, max(wide, 2), 12), faint)
        at = min(max((band.value_n - low) * scale, 1), self.width() - 3)
        painter.fillRect(QRectF(at - 1, 0, 4, self.height()), QColor(tone))


class BandRow(QWidget):
    """A band with its name and value."""

    def __init__(self) -> None:
        super().__init__()
        self.name, self.value, self.bar = label("", "name"), label("", "count"), BandBar()
        self.name.setMinimumWidth(96)
        self.value.setMinimumWidth(84)
        self.value.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        self.setLayout(row(self.name, (self.bar, 1), self.value, spacing=8))

    def show_band(self, band: Band) -> None:
        """Show this."""
        self.bar.show_band(band)
        self.name.setText(band.name)
        self.value.setText(_force(band.value_n, band))
        tint(self.value, Tone.GOOD if band.is_within else Tone.WARN)
        now, low, high = (_force(n, band) for n in (band.value_n, band.low_n, band.high_n))
        self.setToolTip(f"{band.name}: {now}, to be between {low} and {high}")


def _force(force_n: float, band: Band) -> str:
    is_small = band.high_n < SMALL_N
    return f"{number(force_n * 1e3, 1)} mN" if is_small else f"{number(force_n, 3)} N"


class StepRow:
    """A step: its mark, text and note."""

    def __init__(self, grid: QGridLayout, at: int) -> None:
        self.mark = label("", "count")
        self.text, self.note = (label("", "muted", wraps=True) for _ in range(2))
        self._shown: StepLine | None = None
        grid.addWidget(self.mark, 2 * at, 0, Qt.AlignmentFlag.AlignTop)
        grid.addWidget(self.text, 2 * at, 1)
        grid.addWidget(self.note, 2 * at + 1, 1)

    def show_line(self, line: StepLine | None) -> None:
        """Show a step, or none."""
        if line == self._shown:
            return
        self._shown = line
        for one in (self.mark, self.text, self.note):
            one.setVisible(line is not None)
        if line is None:
            return
        is_now = line.standing is Standing.UNDER_WAY
        is_over = line.standing in (Standing.STOPPED, Standing.FAILED)
        self.mark.setText(MARKS[line.standing])
        tint(self.mark, TONES[line.standing])
        self.text.setText(f"{line.number}  {line.text}")
        restyle(self.text, "heading" if is_now or is_over else "muted")
        for one in (self.mark, self.text):
            one.setToolTip(str(line.standing))
        self.note.setText(line.note)
        tint(self.note, TONES[line.standing] if is_over else None)
        self.note.setVisible(bool(line.note))


class ExperimentPanel(RunPanel):
    """The protocol of the run that is shown, step by step, and the button that goes on."""

    name = "experiment"
    title = "Experiment"
    keys = (("Enter", "Answers the question of the step under way, from the line of the answer."),)

    def __init__(self, desk: Desk) -> None:
        super().__init__()
        self.desk = desk
        self.rows: list[StepRow] = []
        self.bands = [BandRow() for _ in range(2)]
        self._shown: RunSteps | None = None
        self._has_run, self._is_live = False, True
        self._build()
        desk.settings_changed.connect(self._show_planned)
        desk.busy_changed.connect(lambda _: self._show_button())
        self._show_planned()

    def show_setup(self, setup: Setup) -> None:
        """Show the steps of a run that begins."""
        self._has_run, self._is_live = True, setup.kind is Kind.LIVE
        self._show(planned(setup.config))

    def show_view(self, view: ViewState) -> None:
        """Show how far the run is."""
        self.sentence.setText(view.sentence)
        self._show(view.steps)

    def go_on(self) -> None:
        """Answer the question of the step under way."""
        if self._shown is not None and self._shown.act is Act.ANSWER:
            self.desk.answer_asked.emit(self.answer.text().strip() or "yes")
            self.answer.clear()

    def _show_planned(self) -> None:
        """The steps of the next run, until one is shown."""
        if not self._has_run:
            self._show(planned(self.desk.config))

    def _show(self, steps: RunSteps) -> None:
        before, self._shown = self._shown, steps
        if steps == before:
            return
        while len(self.rows) < len(steps.lines):
            self.rows.append(StepRow(self.grid, len(self.rows)))
        for one, line in zip_longest(self.rows, steps.lines):
            one.show_line(line)
        for part, band in zip_longest(self.bands, steps.bands):
            part.setVisible(band is not None)
            if band is not None:
                part.show_band(band)
        self.left.setText(steps.left and f"{steps.left} of all steps")
        self.left.setVisible(bool(steps.left))
        if before is None or steps.question != before.question:
            self._show_question(steps.question)
        self._show_button()

    def _show_question(self, question: str) -> None:
        self.question.setText(question)
        for one in (self.question, self.answer):
            one.setVisible(bool(question))
        is_typing = isinstance(QApplication.focusWidget(), QLineEdit | QPlainTextEdit)
        if question and not is_typing:
            self.answer.setFocus()

    def _show_button(self) -> None:
        steps = self._shown
        if steps is None:
            return
        can_act = steps.act is Act.ANSWER
        is_played = steps.act is Act.WAIT and not self._is_live
        text = "As it was recorded: nothing moves" if is_played else steps.acts + AFTER[steps.act]
        self.button.setText(text)
        self.button.setEnabled(can_act)
        restyle(self.button, "start" if can_act else "wait")

    def _build(self) -> None:
        self.sentence, self.left = (label("", "muted", wraps=True) for _ in range(2))
        self.question = label("", "heading", wraps=True)
        self.button = button("", act=self.go_on)
        self.answer = widget(
            QLineEdit,
            placeholderText="yes",
            accessibleName="Answer",
            toolTip="The answer that goes into the session; empty: yes",
            returnPressed=self.go_on,
        )
        self.button.setMinimumHeight(48)
        by_pointer_only(self.button)
        self.grid = QGridLayout()
        self.grid.setColumnStretch(1, 1)
        self.grid.setHorizontalSpacing(8)
        self.grid.setVerticalSpacing(2)
        asks = column(self.button, self.question, self.answer, spacing=8)
        bands = column(*self.bands, spacing=4)
        # the button begins below the place of Connect, which is in a dock that this one may cover
        self.sentence.setMinimumHeight(CONNECT_PX)
        self.sentence.setAlignment(Qt.AlignmentFlag.AlignTop)
        parts = (self.sentence, asks, bands, self.grid, self.left, STRETCH)
        self.setLayout(column(*parts, spacing=8, margins=(10, 8, 10, 8)))
