"""The result card: every number of a run with both parts of its uncertainty, and how it ended."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

from PySide6.QtCore import Qt
from PySide6.QtGui import QGuiApplication, QResizeEvent
from PySide6.QtWidgets import (
    QBoxLayout,
    QHeaderView,
    QLabel,
    QTableWidget,
    QTableWidgetItem,
)

from app.gui.cells import (
    DASH,
    Cells,
    Tone,
    as_sentence,
    number,
    short,
    tone_of,
    typeset,
    with_subscript,
)
from app.gui.panels import RunPanel
from app.gui.source import Setup
from app.gui.view_state import ViewState
from app.gui.widgets import (
    STRETCH,
    EmptyNote,
    column,
    holding,
    label,
    row,
    scroll_area,
    tint,
    tool_button,
    widget,
    words,
    write_or_hide,
)
from app.records.quantities import Measurement
from app.report.card import Card
from app.report.summary_rows import Row

Texts = tuple[str, ...]  # of the columns of a table
MOST_INPUTS = 4  # of which is said what they cost a result
FLAT_PX = 760  # from which there is room for the notes beside the table
SETTINGS = ("setting", "", "value", "", "unit")
CARD = ("quantity", "", "value", "± total", "unit")  # a symbol speaks for itself


class ResultPanel(RunPanel):
    """The settings of the run and, once it has ended, its result card."""

    name, title = "result", "Result"

    def __init__(self) -> None:
        super().__init__()
        self._shown: object = None
        self._card: Card | None = None
        self._noted: list[str] = []  # of a recorded run, by its operator
        self.heading, self.verdict = label("", "heading"), label("", "badge")
        self.table = read_only_table(CARD)
        EmptyNote(
            self.table,
            "The settings of a run and, once it has ended, every number that came of it with its"
            " total uncertainty; under the pointer its parts, by noise and by the inputs.",
        )
        self.doubt = label("", "heading", wraps=True)
        tint(self.doubt, Tone.WARN)
        self.notes, flags = words("muted"), Qt.TextInteractionFlag
        self.notes.setTextInteractionFlags(
            flags.TextSelectableByMouse | flags.TextSelectableByKeyboard
        )
        self.copy_text = tool_button(
            "Copy text",
            "The whole card, as it is shown, to the clipboard",
            partial(self._copy, Card.text),
        )
        self.copy_csv = tool_button(
            "Copy CSV",
            "The quantities, unrounded, to the clipboard",
            partial(self._copy, Card.csv),
        )
        self._words = scroll_area(minimumHeight=48)
        self._words.setWidget(holding(column(self.notes, STRETCH)))
        self._body = QBoxLayout(QBoxLayout.Direction.TopToBottom)
        self._body.addWidget(self.table, 4)
        self._body.addWidget(self._words, 2)
        top = row(self.heading, self.verdict, STRETCH, spacing=8)
        copies = row(STRETCH, self.copy_text, self.copy_csv, spacing=8)  # a narrow dock holds both
        self.hold(top, self.doubt, (self._body, 1), copies)
        self._show_settings(())

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Put the notes below the table, or beside it where there is more width than height."""
        super().resizeEvent(event)
        is_flat = self.width() > max(FLAT_PX, 2 * self.height())
        way = QBoxLayout.Direction
        self._body.setDirection(way.LeftToRight if is_flat else way.TopToBottom)

    def show_setup(self, setup: Setup) -> None:
        """Forget the result of an earlier run; take the notes that were recorded with this one."""
        self._shown = self._card = None
        self._noted.clear()
        if (line := setup.timeline) is not None:
            self._noted += [
                f"At t = {number(line.time_s(note.sample), 2)} s: {note.text}"
                for note in line.notes
            ]

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

    def show_card(self, card: Card, verdict: Texts = ()) -> None:
        """Show a card, with the verdict of a replay."""
        self._begin("Result", card)
        tint(self.verdict, tone_of(card.verdict, Tone.WARN))
        self.verdict.setText(card.verdict.upper())
        texts = [(q.name, q.symbol, *_value_and_total(q), q.unit) for q in card.quantities]
        fill(self.table, CARD, texts, list(map(_about, card.quantities)))
        write_or_hide(self.doubt, "\n".join(map(as_sentence, card.doubts)))
        said = [as_sentence(card.reason), *map(as_sentence, verdict)]
        said += [*self._noted, *(_as_line(one) for one in (*card.further, *card.account))]
        said += [f"Note: {note}" for note in card.notes if note not in card.doubts]
        self.notes.setText("\n".join(map(typeset, said)))

    def _show_settings(self, cells: Cells) -> None:
        self._begin("Settings of the run", None)
        fill(self.table, SETTINGS, [(c.name, "", c.value, "", c.unit) for c in cells])

    def _begin(self, heading: str, card: Card | None) -> None:
        """Show what there is beside the table of a card, or of none."""
        self._card = card
        self.heading.setText(heading)
        for part in (self.verdict, self.doubt, self._words):
            part.setVisible(card is not None)
        for copy in (self.copy_text, self.copy_csv):
            copy.setEnabled(card is not None)

    def _copy(self, made: Callable[[Card], str]) -> None:
        if self._card is not None:
            QGuiApplication.clipboard().setText(made(self._card))


def read_only_table(columns: Texts) -> QTableWidget:
    """An empty table that is as wide as its place, whose cells can be selected and not changed."""
    table = widget(
        QTableWidget,
        *(0, len(columns)),
        editTriggers=QTableWidget.EditTrigger.NoEditTriggers,
        tabKeyNavigation=False,
    )
    table.verticalHeader().hide()
    table.verticalHeader().setDefaultSectionSize(table.fontMetrics().height() + 8)
    header = table.horizontalHeader()
    header.setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
    header.setSectionResizeMode(0, QHeaderView.ResizeMode.Stretch)
    later = Qt.ConnectionType.QueuedConnection  # the bar to scroll by may come or go meanwhile
    header.sectionResized.connect(table.resizeRowsToContents, later)
    return table


def fill(
    table: QTableWidget,
    columns: Texts,
    rows: Sequence[Texts],
    tooltips: Sequence[str] = (),
) -> None:
    """Show rows of texts: the first column is words, the second symbols, the last units; a dash
    where a value is empty. A row without a tooltip of its own has those of its texts.
    """
    table.setHorizontalHeaderLabels(list(columns))
    table.setRowCount(len(rows))
    right = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
    for k, (name, symbol, *values, unit) in enumerate(rows):
        centre = Qt.AlignmentFlag.AlignCenter
        table.setCellWidget(k, 1, widget(QLabel, with_subscript(symbol), alignment=centre))
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
    lines = [f"{name} {part} {q.unit}".strip() for name, part in parts if part]
    dear = sorted(q.budget, key=lambda one: -abs(q.budget[one]))[:MOST_INPUTS]
    lines += [
        f"  {one}: 1 σ more changes it by {short(100 * q.budget[one], 2, '+')} %" for one in dear
    ]
    head = [q.origin] if q.origin else []
    return typeset("\n".join(head + lines + ([as_sentence(q.doubt)] if q.doubt else [])))


def _as_line(one: Row) -> str:
    head = f"{one.label} {one.symbol}".strip()
    return f"{head}: {one.value}" if head else one.value
