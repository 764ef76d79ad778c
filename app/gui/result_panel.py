"""The result card: every number of a run with both parts of its uncertainty, and how it ended."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from PySide6.QtCore import Qt
from PySide6.QtGui import QGuiApplication, QResizeEvent
from PySide6.QtWidgets import (
    QBoxLayout,
    QHeaderView,
    QLabel,
    QPushButton,
    QScrollArea,
    QTableWidget,
    QTableWidgetItem,
    QWidget,
)

from app.gui import theme
from app.gui.cells import DASH, Cell, Tone, typeset, with_subscript
from app.gui.source import Setup
from app.gui.view_state import ViewState
from app.gui.widgets import STRETCH, EmptyNote, Panel, column, label, row
from app.records.quantities import Measurement
from app.records.record_types import End
from app.report.card import Card
from app.report.summary_rows import Row

TONES = {
    End.COMPLETE: Tone.GOOD,
    End.IMPORTED: Tone.GOOD,
    End.FAILED: Tone.BAD,
    End.PLAYED: Tone.REPLAY,
}
MOST_INPUTS = 4  # of which is said what they cost a result
FLAT_PX = 760  # from which there is room for the notes beside the table
SETTINGS = ("setting", "", "value", "", "unit")
CARD = ("quantity", "", "value", "± total", "unit")  # a symbol speaks for itself


class ResultPanel(Panel):
    """The settings of the run and, once it has ended, its result card."""

    name, title = "result", "Result"

    def __init__(self) -> None:
        super().__init__()
        self._shown: object = None
        self._card: Card | None = None
        self.heading, self.verdict = label("Settings of the run", "heading"), QLabel("")
        self.table = read_only_table(CARD)
        EmptyNote(
            self.table,
            "The settings of a run and, once it has ended, every number that came of it with its"
            " total uncertainty; under the pointer its parts, by noise and by the inputs.",
        )
        self.doubt = QLabel("")
        self.doubt.setWordWrap(True)
        self.doubt.hide()
        self.notes = label("", "muted")
        self.notes.setWordWrap(True)
        self.notes.setTextInteractionFlags(
            Qt.TextInteractionFlag.TextSelectableByMouse
            | Qt.TextInteractionFlag.TextSelectableByKeyboard
        )
        self.copy_text, self.copy_csv = QPushButton("Copy text"), QPushButton("Copy CSV")
        self.copy_text.setToolTip("The whole card, as it is shown, to the clipboard")
        self.copy_csv.setToolTip("The quantities, unrounded, to the clipboard")
        self.copy_text.clicked.connect(lambda: self._copy(lambda card: card.text()))
        self.copy_csv.clicked.connect(lambda: self._copy(lambda card: card.csv()))
        words = QWidget()
        words.setLayout(column(self.notes, STRETCH))
        self._words = QScrollArea()
        self._words.setWidgetResizable(True)
        self._words.setWidget(words)
        self._words.setFrameShape(QScrollArea.Shape.NoFrame)
        self._words.setMinimumHeight(48)
        self._body = QBoxLayout(QBoxLayout.Direction.TopToBottom)
        self._body.addWidget(self.table, 4)
        self._body.addWidget(self._words, 2)
        self.setLayout(
            column(
                row(self.heading, self.verdict, STRETCH, self.copy_text, self.copy_csv, spacing=8),
                self.doubt,
                (self._body, 1),
                spacing=6,
                margins=(12, 8, 12, 8),
            )
        )
        self._show_settings(())

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Put the notes below the table, or beside it where there is more width than height."""
        super().resizeEvent(event)
        self.table.resizeRowsToContents()
        is_flat = self.width() > max(FLAT_PX, 2 * self.height())
        way = QBoxLayout.Direction
        self._body.setDirection(way.LeftToRight if is_flat else way.TopToBottom)

    def show_setup(self, setup: Setup) -> None:
        """Forget the result of an earlier run."""
        self._shown = self._card = None

    @property
    def parts(self) -> tuple[Callable[[ViewState], None], ...]:
        """One function, for there is one table."""
        return (self.show_view,)

    def show_view(self, view: ViewState) -> None:
        """Show the settings or the result, if it is another."""
        shown = view.card or view.result
        if shown == self._shown:
            return
        self._shown = shown
        if view.card is None:
            self._show_settings(view.result)
        else:
            self.show_card(view.card, view.agreement.sentences if view.agreement else ())

    def show_card(self, card: Card, verdict: tuple[str, ...] = ()) -> None:
        """Show a card, with the verdict of a replay."""
        self._card = card
        self.heading.setText("Result")
        colour = theme.TONES[TONES.get(card.verdict, Tone.WARN)]
        self.verdict.setText(card.verdict.upper())
        self.verdict.setStyleSheet(
            f"background: {colour}; color: {theme.now().window}; border-radius: 4px;"
            " padding: 1px 8px; font-weight: 700;"
        )
        self.verdict.show()
        texts = [(q.name, q.symbol, *_value_and_total(q), q.unit) for q in card.quantities]
        fill(self.table, CARD, texts, list(map(_about, card.quantities)))
        self.doubt.setText("\n".join(typeset(_sentence(note)) for note in card.doubts))
        self.doubt.setStyleSheet(f"color: {theme.TONES[Tone.WARN]}; font-weight: 700;")
        self.doubt.setVisible(bool(card.doubts))
        said = [_sentence(card.reason), *map(_sentence, verdict)]
        said += [_told(one) for one in (*card.further, *card.account)]
        said += [f"Note: {note}" for note in card.notes if note not in card.doubts]
        self.notes.setText("\n".join(map(typeset, said)))
        self._words.show()
        for button in (self.copy_text, self.copy_csv):
            button.setEnabled(True)

    def _show_settings(self, cells: tuple[Cell, ...]) -> None:
        self._card = None
        self.heading.setText("Settings of the run")
        self.verdict.hide()
        self.doubt.hide()
        fill(self.table, SETTINGS, [(c.name, "", c.value, "", c.unit) for c in cells])
        self._words.hide()
        for button in (self.copy_text, self.copy_csv):
            button.setEnabled(False)

    def _copy(self, made: Callable[[Card], str]) -> None:
        if self._card is not None:
            QGuiApplication.clipboard().setText(made(self._card))


def read_only_table(columns: tuple[str, ...]) -> QTableWidget:
    """An empty table that is as wide as its place, whose cells can be selected and not changed."""
    table = QTableWidget(0, len(columns))
    table.setHorizontalHeaderLabels(list(columns))
    table.verticalHeader().hide()
    table.setEditTriggers(QTableWidget.EditTrigger.NoEditTriggers)
    table.setTabKeyNavigation(False)
    table.verticalHeader().setDefaultSectionSize(table.fontMetrics().height() + 8)
    header = table.horizontalHeader()
    header.setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
    header.setSectionResizeMode(0, QHeaderView.ResizeMode.Stretch)
    return table


def fill(
    table: QTableWidget,
    columns: tuple[str, ...],
    rows: Sequence[tuple[str, ...]],
    tooltips: Sequence[str] = (),
) -> None:
    """Show rows of texts: the first column is words, the second symbols, the last units; a dash
    where a value is empty. A row without a tooltip of its own has those of its texts.
    """
    table.setHorizontalHeaderLabels(list(columns))
    table.setRowCount(len(rows))
    right = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
    for k, (name, symbol, *values, unit) in enumerate(rows):
        mark = QLabel(with_subscript(symbol))
        mark.setAlignment(Qt.AlignmentFlag.AlignCenter)
        table.setCellWidget(k, 1, mark)
        shown = [
            typeset(v).replace(" to ", "–") or (DASH if head else "")
            for v, head in zip(values, columns[2:-1], strict=True)
        ]
        texts = (name, "", *shown, typeset(unit))
        for j, text in enumerate(texts):
            item = QTableWidgetItem(text)
            item.setToolTip(tooltips[k] if tooltips else text)
            if 2 <= j < len(texts) - 1:
                item.setTextAlignment(right)
            table.setItem(k, j, item)
    table.resizeRowsToContents()


def _value_and_total(q: Measurement) -> tuple[str, str]:
    """The value with the digits that its total uncertainty leaves, and that uncertainty."""
    value, spread = q.rounded
    return value, spread.removeprefix("± ")


def _about(q: Measurement) -> str:
    """Where a number comes from, and both parts of its uncertainty."""
    _, noise, inputs = q.parts
    parts = (("by noise", noise), ("by the inputs", inputs))
    told = [f"{name} {part} {q.unit}".strip() for name, part in parts if part]
    dear = sorted(q.budget, key=lambda one: -abs(q.budget[one]))[:MOST_INPUTS]
    told += [f"  {one}: 1 σ more changes it by {100 * q.budget[one]:+.2g} %" for one in dear]
    head = [q.origin] if q.origin else []
    return typeset("\n".join(head + told + ([_sentence(q.doubt)] if q.doubt else [])))


def _told(one: Row) -> str:
    head = f"{one.label} {one.symbol}".strip()
    return f"{head}: {one.value}" if head else one.value


def _sentence(text: str) -> str:
    return f"{text[:1].upper()}{text[1:]}"
