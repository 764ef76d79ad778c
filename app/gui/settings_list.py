"""Settings one below the other: rows on top, and tables that are filled when opened."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any

from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtWidgets import QScrollArea, QSizePolicy, QWidget

from app.gui.form import FormField, FormGroup
from app.gui.setting_row import RowState, SettingRow
from app.gui.widgets import STRETCH, column, holding, remove, tool_button, widget

INDENT_PX = 14
MARGIN_PX = 4


class SettingsTable(QWidget):
    """Rows below a head that opens and closes them; they are made when they are first seen.

    Parameters
    ----------
    title, tip : str
        Of the head.
    style : str
        That of the head in `style.qss`.
    make : callable
        The row of a field.

    Attributes
    ----------
    fields : tuple of FormField
    wants_open : bool
        Whether the operator has opened it.
    is_searched : bool
        Whether something is looked for in it, which opens it for that time.
    """

    def __init__(
        self, title: str, tip: str, style: str, make: Callable[[FormField], SettingRow]
    ) -> None:
        super().__init__()
        self.fields: tuple[FormField, ...] = ()
        self.wants_open = self.is_searched = False
        self._make = make
        self.head = tool_button(title, tip, style=style)
        self.head.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
        self.head.setToolButtonStyle(Qt.ToolButtonStyle.ToolButtonTextBesideIcon)
        self.head.setCheckable(True)
        self.head.clicked.connect(self.open)
        self.head.toggled.connect(self._show_rows)
        self._rows = column(spacing=3, margins=(INDENT_PX, 2, 0, 4))
        self._body = holding(self._rows)
        self.setLayout(column(self.head, self._body, spacing=0))
        self._show_rows(False)

    @property
    def rows(self) -> list[SettingRow]:
        """Those that are made."""
        return self._body.findChildren(SettingRow)

    def put_fields(self, fields: tuple[FormField, ...]) -> None:
        """Have rows for these: another driver has other options."""
        if fields == self.fields:
            return
        self.fields = fields
        self.discard_rows()
        self._show_rows(self.head.isChecked())

    def discard_rows(self) -> None:
        """Delete the rows, with what was typed there and not taken: it was meant for what was."""
        for one in self.rows:
            one.blockSignals(True)
            remove(one)

    def open(self, is_open: bool = True) -> None:
        """Show the rows, or hide them, until the operator wishes otherwise, or the search ends."""
        if not self.is_searched:
            self.wants_open = is_open
        self.head.setChecked(is_open)

    def _show_rows(self, is_open: bool) -> None:
        arrows = Qt.ArrowType
        self.head.setArrowType(arrows.DownArrow if is_open else arrows.RightArrow)
        if is_open and not self.rows:
            for field in self.fields:
                self._rows.addWidget(self._make(field))
        self._body.setVisible(is_open)


class SettingsList(QScrollArea):
    """Rows and tables of settings, which are scrolled.

    Parameters
    ----------
    state : callable
        What the row of a field shows.
    """

    entered = Signal(object, str)  # the FormField, and what was typed
    reset_asked = Signal(object)  # the FormField
    focused = Signal(object)  # the FormField whose row has the keys now

    def __init__(self, state: Callable[[FormField], RowState]) -> None:
        super().__init__()
        self._state = state
        self._tab_order = widget(QTimer, self, singleShot=True, timeout=self._set_tab_order)
        self._tables: dict[str, SettingsTable] = {}
        self._on_top, self._below = column(spacing=3), column(spacing=0)
        self._top = holding(self._on_top)  # what stands on top is hidden as a whole
        parts = (self._top, self._below, STRETCH)
        self.setWidget(holding(column(*parts, spacing=4, margins=4 * (MARGIN_PX,))))
        self.setWidgetResizable(True)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)

    # ------------------------------------------------------------------ what there is

    def rows(self, key: str = "") -> list[SettingRow]:
        """The rows there are, from top to bottom; those of one setting where `key` is given."""
        made = self.findChildren(SettingRow)
        return [one for one in made if one.field.key == key] if key else made

    def table(self, name: str) -> SettingsTable:
        """The table of this name."""
        return self._tables[name]

    def add(self, part: QWidget) -> None:
        """Add something on top of all tables."""
        self._on_top.addWidget(part)

    def add_row(self, field: FormField, name: str = "", **options: Any) -> SettingRow:
        """Add a row on top of all tables."""
        self.add(made := self._row(field, name, **options))
        return made

    def new_table(self, title: str, tip: str, style: str) -> SettingsTable:
        """A table whose rows are of this list, closed, to be put somewhere in it."""
        return SettingsTable(title, tip, style, self._row)

    def put_groups(self, groups: Iterable[FormGroup]) -> None:
        """Have these tables at the end; those that are there stay."""
        for group in groups:
            if group.table not in self._tables:
                made = self.new_table(group.table, group.title, "table")
                self._tables[group.table] = made
                self._below.addWidget(made)
            self._tables[group.table].put_fields(group.fields)

    def _row(self, field: FormField, name: str = "", **options: Any) -> SettingRow:
        made = SettingRow(field, name, **options)
        made.show_state(self._state(field))
        made.entered.connect(self.entered)
        made.reset_asked.connect(self.reset_asked)
        made.focused.connect(self._enter)
        self._tab_order.start()
        return made

    # ------------------------------------------------------------------ showing

    def refresh(self) -> None:
        """Show all rows anew, where they have changed."""
        for one in self.rows():
            one.show_state(self._state(one.field))

    def show_only(self, words: Sequence[str], changed: set[str] | None) -> None:
        """Show the settings that these words mean and that are `changed`, if that is given; their
        tables are open while some are looked for, and what stands on top is hidden.
        """
        is_searched = bool(words) or changed is not None
        self._top.setVisible(not is_searched)
        for table in self._tables.values():
            meant = {
                field.key
                for field in table.fields
                if field.is_like(words) and (changed is None or field.key in changed)
            }
            table.is_searched = is_searched
            table.setVisible(bool(meant))
            table.head.setChecked(bool(meant) if is_searched else table.wants_open)
            for one in table.rows:
                one.setVisible(one.field.key in meant)

    def take(self) -> None:
        """Take what is typed in the row that has the keys."""
        for one in self.rows():
            if one.editor.hasFocus():
                one.take()

    def go_to(self, row: SettingRow) -> None:
        """Put the keys into a row, and bring it into view."""
        for table in self.findChildren(SettingsTable):
            if table.isAncestorOf(row):
                table.open()
        row.editor.setFocus()

    def _enter(self, row: SettingRow) -> None:
        # once it has its place, for its table may have been opened only now
        QTimer.singleShot(0, row, lambda: self.ensureWidgetVisible(row))
        self.focused.emit(row.field)

    def _set_tab_order(self) -> None:
        """Let Tab go from top to bottom, whenever a row was made."""
        before: QWidget = self
        for one in self.findChildren(QWidget):
            takes_keys = one.focusPolicy() & Qt.FocusPolicy.TabFocus
            if takes_keys and one.window() is self.window():
                self.setTabOrder(before, one)
                before = one
