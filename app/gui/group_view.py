"""One table of the settings, whose rows are made as they come into view."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QSizePolicy, QToolButton, QWidget

from app.gui.editors import FieldRow
from app.gui.form import FormField, FormGroup
from app.gui.widgets import column


class GroupView(QWidget):
    """A table of the settings, which opens by a click on its head; a row is made when it is first
    seen.
    """

    def __init__(self, group: FormGroup, make_row: Callable[[FormField], FieldRow]) -> None:
        super().__init__()
        self.group, self.rows = group, dict[str, FieldRow]()
        self._make_row = make_row
        self.head, self.body = QToolButton(), QWidget()
        self._column = column(spacing=6, margins=(6, 2, 0, 8))
        self.body.setLayout(self._column)
        self.body.hide()
        self.head.setText(group.table)
        self.head.setToolTip(group.title)
        self.head.setCheckable(True)
        self.head.setObjectName("bare")
        self.head.setArrowType(Qt.ArrowType.RightArrow)
        self.head.setToolButtonStyle(Qt.ToolButtonStyle.ToolButtonTextBesideIcon)
        self.head.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self.setLayout(column(self.head, self.body))

    def show_only(self, words: list[str], changed: set[str] | None) -> None:
        """Show the settings that these words mean and that are `changed`, if that is given; the
        table is open while some are looked for.
        """
        meant = [
            field
            for field in self.group.fields
            if field.is_like(words) and (changed is None or field.key in changed)
        ]
        is_search = bool(words) or changed is not None
        is_open = bool(meant) and (self.head.isChecked() or is_search)
        arrow = Qt.ArrowType.DownArrow if is_open else Qt.ArrowType.RightArrow
        self.head.setArrowType(arrow)
        if is_open:
            self._show(meant)
        self.body.setVisible(is_open)
        self.setVisible(bool(meant))

    def _show(self, fields: list[FormField]) -> None:
        for field in fields:
            if field.key not in self.rows:
                self.rows[field.key] = self._make_row(field)
        for at, one in enumerate(one for one in self.group.fields if one.key in self.rows):
            made = self.rows[one.key]
            if self._column.indexOf(made) != at:
                self._column.insertWidget(at, made)
            made.setVisible(one in fields)
