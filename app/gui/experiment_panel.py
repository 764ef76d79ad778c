"""The experiment: the steps of the protocol, what the step under way waits for, and one key."""

from __future__ import annotations

from collections.abc import Callable
from itertools import zip_longest

from PySide6.QtCore import Qt
from PySide6.QtWidgets import (
    QApplication,
    QGridLayout,
    QLineEdit,
    QPlainTextEdit,
)

from app.experiment.decisions import LONGEST_NOTE
from app.gui.background import Take
from app.gui.bench_draw import ForceBand
from app.gui.cells import as_sentence, tone_of, typeset
from app.gui.panels import RunPanel
from app.gui.run_steps import RunSteps, StepLine, StepStatus, planned
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
    write_or_hide,
)
from app.gui.window_model import WindowModel
from app.runs.run_source import Kind

MARKS = {
    StepStatus.TO_COME: "○",
    StepStatus.UNDER_WAY: "▶",
    StepStatus.DONE: "✓",
    StepStatus.STOPPED: "■",
    StepStatus.FAILED: "✗",
}
CONNECT_PX = 64  # from the top of a dock to below the button that connects a bench
PAUSES = "The run waits before its next step until you resume it (F9); limits are watched meanwhile"
WITHDRAWS = "The run goes on with its next step after all (F9)"
NOTES = "Recorded with the time of the newest sample, in the session of this run (F4)"
PLAYED_ONLY = "What is played was recorded: it waits for nobody, and takes no notes."


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
        is_now = line.standing is StepStatus.UNDER_WAY
        is_over = line.standing in (StepStatus.STOPPED, StepStatus.FAILED)
        self.mark.setText(MARKS[line.standing])
        tint(self.mark, tone_of(line.standing))
        self.text.setText(typeset(f"{line.number}  {line.text}"))
        restyle(self.text, "heading" if is_now or is_over else "muted")
        for one in (self.mark, self.text):
            one.setToolTip(str(line.standing))
        write_or_hide(self.note, line.note)
        tint(self.note, tone_of(line.standing) if is_over else None)


def refusal(steps: RunSteps | None, what: str, *, is_live: bool) -> str:
    """Why there can be no "pause" or "note" of a run at these steps; empty if there can."""
    return getattr(steps, f"no_{what}") if is_live else PLAYED_ONLY


def order_pause(
    steps: RunSteps, order: Callable[[str, Take], object], say: Take, *, is_live: bool
) -> None:
    """Let a run at these steps wait after the one under way, or withdraw that; or say why it
    cannot.
    """
    if why := refusal(steps, "pause", is_live=is_live):
        say(why)
    elif steps.is_pause_asked:
        order("The pause could not be withdrawn", lambda source: source.cancel_pause())
    else:
        order("The run could not be asked to wait", lambda source: source.pause())


class ExperimentPanel(RunPanel):
    """The protocol of the run that is shown, step by step, and the button that goes on."""

    name = "experiment"
    title = "Experiment"
    keys = (
        ("Enter", "Answers the question of the step under way, from the line of the answer."),
        ("Enter", "Records a note with the time, from the line of the note."),
    )

    def __init__(self, model: WindowModel) -> None:
        super().__init__()
        self.model, self._order = model, model.ordered.emit
        self.rows: list[StepRow] = []
        self.bands = [ForceBand() for _ in range(2)]
        self._shown: RunSteps | None = None
        self._has_run, self._is_live = False, True
        self._build()
        model.settings_changed.connect(self._show_planned)
        model.busy_changed.connect(self._show_button)
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
        if self._shown is not None and (asked := self._shown.question):
            text = self.taken_answer()
            self._order("The answer could not be sent", lambda source: source.answer(text, asked))

    def taken_answer(self) -> str:
        """What is typed as an answer, else yes; the line is empty then."""
        text = self.answer.text().strip() or "yes"
        self.answer.clear()
        return text

    def pause(self) -> None:
        """Let the run wait after the step under way, or withdraw that; or say why it cannot."""
        if self._shown is not None:
            order_pause(self._shown, self._order, self._say, is_live=self._is_live)

    def go_to_note(self) -> None:
        """Put the keys into the line of a note, or say why none can be taken."""
        if why := self._refusal("note"):
            self._say(why)
        else:
            self.note.setFocus()

    def take_note(self) -> None:
        """Record what stands in the line of the note with the newest sample."""
        if (text := self.note.text().strip()) and not self._refusal("note"):
            self._order("The note could not be recorded", lambda source: source.note(text))
            self.model.noted.emit(f"Note: {text}")
            self.note.clear()

    def _refusal(self, what: str) -> str:
        """Why there can be no "pause" or "note"; empty if there can."""
        return refusal(self._shown, what, is_live=self._is_live)

    def _say(self, sentence: str) -> None:
        self.model.said.emit(sentence, False)

    def _show_planned(self) -> None:
        """The steps of the next run, until one is shown."""
        if not self._has_run:
            self._show(planned(self.model.config))

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
                part.show_gauge(band)
        write_or_hide(self.left, steps.left and f"{steps.left} of all steps")
        if before is None or steps.question != before.question:
            self._show_question(steps.question)
        self._show_button()

    def _show_question(self, question: str) -> None:
        write_or_hide(self.question, as_sentence(question))
        self.answer.clear()  # what was typed is no answer to another question
        self.answer.setVisible(bool(question))
        is_typing = isinstance(QApplication.focusWidget(), QLineEdit | QPlainTextEdit)
        if question and not is_typing:
            self.answer.setFocus()

    def _show_button(self) -> None:
        steps = self._shown
        if steps is None:
            return
        can_act = bool(steps.question)
        after = "  F8 or Enter" * can_act + " …" * steps.waits
        is_played = steps.waits and not self._is_live
        text = "As it was recorded: nothing moves" if is_played else steps.acts + after
        self.button.setText(text)
        self.button.setEnabled(can_act)
        restyle(self.button, "start" if can_act else "wait")
        self.pause_button.setText(steps.pause)
        why_pause, why_note = self._refusal("pause"), self._refusal("note")
        self.pause_button.setToolTip(why_pause or (WITHDRAWS if steps.is_pause_asked else PAUSES))
        self.pause_button.setEnabled(not why_pause)
        for one in (self.note, self.note_button):
            one.setToolTip(why_note or NOTES)
            one.setEnabled(not why_note)

    def _build(self) -> None:
        top = Qt.AlignmentFlag.AlignTop
        # the button begins below the place of Connect, which is in a dock that this one may cover
        self.sentence = label("", "muted", wraps=True, minimumHeight=CONNECT_PX, alignment=top)
        self.left = label("", "muted", wraps=True)
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
        self.pause_button = button("", act=self.pause)
        self.note_button = button("Note", act=self.take_note)
        by_pointer_only(self.button, self.pause_button, self.note_button)
        self.note = widget(
            QLineEdit,
            placeholderText="what happens now",
            accessibleName="Note",
            maxLength=LONGEST_NOTE,
            returnPressed=self.take_note,
        )
        self.grid = QGridLayout()
        self.grid.setColumnStretch(1, 1)
        self.grid.setHorizontalSpacing(8)
        self.grid.setVerticalSpacing(2)
        notes = row((self.note, 1), self.note_button)
        acts = self.button, self.pause_button, notes  # what comes and goes is below them
        bands = column(*self.bands, spacing=4)
        asks = self.question, self.answer, bands, self.grid, self.left
        self.hold(self.sentence, *acts, *asks, STRETCH, spacing=8)
