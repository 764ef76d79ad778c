"""One setting as a row of a pyqtgraph ParameterTree: a name, an editor for its type, a unit, a
reset, and below it the sentence that says what is wrong with it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from pyqtgraph.parametertree import Parameter, ParameterItem
from PySide6.QtCore import QSize, Qt
from PySide6.QtGui import QColor
from PySide6.QtWidgets import (
    QCheckBox,
    QLineEdit,
    QPlainTextEdit,
    QToolButton,
    QTreeWidget,
    QTreeWidgetItem,
    QWidget,
)

from app.gui import theme
from app.gui.cells import Tone
from app.gui.form import FormField
from app.gui.widgets import Choice, keep_room, label, row, tint, widget

UNIT_WIDTH = 46
LINE_PX = 20


@dataclass(frozen=True, slots=True)
class RowState:
    """What a row shows.

    Attributes
    ----------
    text : str
        The value as it is written, or what was typed and refused.
    base : str
        What has the value that a reset takes, and that value with its unit.
    is_changed : bool
        Whether the value differs from that of the base.
    refusal : str
        Why what was typed cannot be used; empty if it can.
    note : str
        Other words below the row.
    placeholder : str
        What holds while the row is empty.
    is_enabled : bool
    """

    text: str
    base: str = ""
    is_changed: bool = False
    refusal: str = ""
    note: str = ""
    placeholder: str = ""
    is_enabled: bool = True


class SettingItem(ParameterItem):  # type: ignore[misc]
    """A row of the tree; what is typed there is taken by Enter, Tab or a click elsewhere.

    Attributes
    ----------
    field : FormField
    editor : QWidget
    reset : QToolButton
    sentence : QLabel
        The words below the row.
    """

    def __init__(self, param: Parameter, depth: int) -> None:
        super().__init__(param, depth)
        self.field: FormField = param.opts["field"]
        self.shown: RowState | None = None
        self.editor, self._text, self._put_text = self._make_editor(param.opts.get("lines", 1))
        self.reset = widget(
            QToolButton, text="↺", focusPolicy=Qt.FocusPolicy.NoFocus, objectName="bare"
        )
        self.sentence = label("", "detail")
        self._below: QTreeWidgetItem | None = None
        self._box = QWidget()
        unit = label(self.field.unit, "muted")
        unit.setMinimumWidth(UNIT_WIDTH if self.field.unit else 0)
        more = param.opts.get("beside", ())
        self._box.setLayout(row((self.editor, 1), unit, *more, self.reset, spacing=4))
        self.setSizeHint(1, QSize(80, max(26, self.editor.minimumHeight() + 4)))
        self._dress()

    def treeWidgetChanged(self) -> None:
        """Put the editor into the tree."""
        super().treeWidgetChanged()
        if (tree := self.treeWidget()) is not None:
            QTreeWidget.setItemWidget(tree, self, 1, self._box)
            self.editor.installEventFilter(tree)

    def _make_editor(
        self, lines: int
    ) -> tuple[QWidget, Callable[[], str], Callable[[str], object]]:
        """An editor for values of this type, what stands in it, and what puts a text into it."""
        option = self.field.option
        if option.type is bool:
            check = widget(QCheckBox, clicked=self.take)
            return (
                check,
                lambda: str(check.isChecked()),
                lambda text: check.setChecked(text == "True"),
            )
        if option.choices and option.type is str:
            choice = Choice(option.choices)
            choice.textActivated.connect(self.take)
            return choice, choice.currentText, choice.setCurrentText
        if lines > 1:
            page = QPlainTextEdit(tabChangesFocus=True)
            page.setFixedHeight(lines * LINE_PX + 6)
            return page, page.toPlainText, page.setPlainText
        line = widget(QLineEdit, minimumWidth=50, editingFinished=self.take)

        def put(text: str) -> None:
            line.setText(text)
            line.setCursorPosition(0)

        return line, line.text, put

    def _dress(self) -> None:
        keep_room(self.reset)
        self.reset.hide()
        self.reset.clicked.connect(lambda: self.treeWidget().reset_asked.emit(self.field))
        self.editor.setAccessibleName(f"{self.text(0)}, {self.field.unit}".rstrip(", "))
        self.editor.setAccessibleDescription(self.field.help)

    def take(self, *_: object) -> None:
        """Hand on what was typed, if it is another text than the one shown."""
        text, tree = self._text(), self.treeWidget()
        if tree is not None and self.shown is not None and text != self.shown.text:
            tree.entered.emit(self.field, text)

    def show(self, one: RowState) -> None:
        """Show a value, whether it differs from that of the base, or what was refused."""
        if one.text != self._text():
            self._put_text(one.text)
        if one == self.shown:
            return
        self.shown = one
        if isinstance(self.editor, QLineEdit):
            self.editor.setPlaceholderText(one.placeholder)
        self.editor.setEnabled(one.is_enabled)
        self.reset.setVisible(bool(one.is_changed or one.refusal))
        self.reset.setToolTip(f"{one.base}. Takes that again (Ctrl+R).")
        changed = f"\nNot as in {one.base}" if one.is_changed else ""
        tip = f"{self.field.key}: {self.field.help}{changed}"
        self.editor.setToolTip(tip)
        self.setToolTip(0, tip)
        self.mark()
        self._say(one.refusal or one.note)

    def mark(self) -> None:
        """Mark in the colours of the look what is refused, and what differs from the base."""
        one = self.shown or RowState("")
        title = self.param.title()
        self.setText(0, f"● {title}" if one.is_changed else title)
        colours = theme.now()
        colour = colours.tones[Tone.WARN] if one.is_changed else colours.muted
        self.setForeground(0, QColor(colours.tones[Tone.BAD] if one.refusal else colour))
        tint(self.editor, Tone.BAD if one.refusal else None)
        tint(self.sentence, Tone.BAD if one.refusal else None)

    def _say(self, words: str) -> None:
        if words and self._below is None:
            self._below = self.treeWidget().span(self.sentence, self)
        if self._below is not None:
            self.sentence.setText(words)
            self._below.setHidden(not words)
            self.sentence.setVisible(bool(words))
            self.treeWidget().fit()


class SettingParameter(Parameter):  # type: ignore[misc]
    """A setting, whose value is its text."""

    itemClass = SettingItem


def parameter(field: FormField, name: str = "", **opts: Any) -> SettingParameter:
    """The setting of a field, under another name where one is given."""
    title = name or field.name
    return SettingParameter(
        name=field.key, title=title, type="setting", value="", expanded=False, field=field, **opts
    )
