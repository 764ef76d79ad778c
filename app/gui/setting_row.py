"""One setting as a row: its name, an editor for its type, its unit, a reset, and below them the
sentence that says what is wrong with it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from PySide6.QtCore import QEvent, QObject, Qt, Signal
from PySide6.QtGui import QKeyEvent, QMouseEvent
from PySide6.QtWidgets import QCheckBox, QLineEdit, QPlainTextEdit, QWidget

from app.gui.cells import Tone
from app.gui.form import FormField
from app.gui.widgets import (
    Choice,
    column,
    keep_room,
    label,
    row,
    tint,
    tool_button,
    widget,
    write_or_hide,
)

NAME, VALUE = 2, 3  # shares of the width
UNIT_PX, LINE_PX = 46, 20


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


class SettingRow(QWidget):
    """The row of a field; what is typed there is taken by Enter, Tab or a click elsewhere, and
    `text` is what stands there.

    Parameters
    ----------
    field : FormField
    name : str
        In place of the name of the field.
    lines : int
        Of text, for which there is room.
    beside : sequence of QWidget
        What stands behind the editor.
    """

    entered = Signal(object, str)  # the FormField, and what was typed
    reset_asked = Signal(object)  # the FormField
    focused = Signal(object)  # this row, whose editor has the keys now

    def __init__(
        self, field: FormField, name: str = "", *, lines: int = 1, beside: Sequence[QWidget] = ()
    ) -> None:
        super().__init__()
        self.field, self.title = field, name or field.name
        self.name = label(self.title, "muted", wraps=True, is_cut=True)
        self.editor = self._made_editor(lines)
        self._value = self.editor.metaObject().userProperty()  # what is edited in it
        self.reset = tool_button("↺", "Reset", lambda: self.reset_asked.emit(field), style="bare")
        self.reset.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        keep_room(self.reset)
        self.reset.hide()
        self.sentence = label("", "detail", wraps=True, visible=False)
        self._shown: RowState | None = None
        self.editor.setAccessibleName(f"{self.title}, {field.unit}".rstrip(", "))
        self.editor.setAccessibleDescription(field.help)
        self.editor.installEventFilter(self)
        unit = label(field.unit, "muted")
        unit.setMinimumWidth(UNIT_PX if field.unit else 0)
        value = row((self.editor, 1), unit, *beside, self.reset, spacing=4)
        self.setLayout(column(row((self.name, NAME), (value, VALUE)), self.sentence, spacing=1))

    def _made_editor(self, lines: int) -> QWidget:
        """An editor for values of this type."""
        option = self.field.option
        if option.type is bool:
            return widget(QCheckBox, clicked=self.take)
        if option.choices and option.type is str:
            return Choice(option.choices, textActivated=self.take)
        if lines > 1:
            page = QPlainTextEdit(tabChangesFocus=True)
            page.setFixedHeight(lines * LINE_PX + 6)
            return page
        return widget(QLineEdit, minimumWidth=50, editingFinished=self.take)

    def text(self) -> str:
        """What stands in the editor."""
        return str(self._value.read(self.editor))

    def take(self, *_: object) -> None:
        """Hand on what was typed, if it is another text than the one shown."""
        text = self.text()
        if self._shown is not None and text != self._shown.text:
            self.entered.emit(self.field, text)

    def show_state(self, one: RowState) -> None:
        """Show a value, whether it differs from that of the base, or what was refused."""
        if one.text != self.text():
            self._value.write(self.editor, one.text)
            if isinstance(self.editor, QLineEdit):
                self.editor.setCursorPosition(0)
        if one == self._shown:
            return
        self._shown = one
        if isinstance(self.editor, QLineEdit):
            self.editor.setPlaceholderText(one.placeholder)
        self.editor.setEnabled(one.is_enabled)
        self.reset.setVisible(bool(one.is_changed or one.refusal))
        self.reset.setToolTip(f"{one.base}. Takes that again (Ctrl+R).")
        changed = f"\nNot as in {one.base}" if one.is_changed else ""
        for part in (self.name, self.editor):
            part.setToolTip(f"{self.field.key}: {self.field.help}{changed}")
        self.name.setText(f"● {self.title}" if one.is_changed else self.title)
        tone = Tone.BAD if one.refusal else None
        tint(self.name, Tone.WARN if one.is_changed and not one.refusal else tone)
        tint(self.editor, tone)
        tint(self.sentence, tone)
        write_or_hide(self.sentence, one.refusal or one.note)

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Put the keys into the editor: its name was clicked."""
        super().mousePressEvent(event)
        self.editor.setFocus(Qt.FocusReason.MouseFocusReason)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Hear that the editor has the keys; take what stands in it before a key of the window
        acts, and where a page is left.
        """
        kind = event.type()
        is_left = kind == QEvent.Type.FocusOut and isinstance(watched, QPlainTextEdit)
        if is_left or is_command(event):
            self.take()
        elif kind == QEvent.Type.FocusIn:
            self.focused.emit(self)
        return False


def is_command(event: QEvent) -> bool:
    """Whether a key may be one of the window's: what was typed is to be taken before it acts."""
    if event.type() != QEvent.Type.ShortcutOverride or not isinstance(event, QKeyEvent):
        return False
    is_function = Qt.Key.Key_F1 <= event.key() <= Qt.Key.Key_F35
    return is_function or bool(event.modifiers() & Qt.KeyboardModifier.ControlModifier)
