"""Editors of settings: one kind for each type, and the row that an editor stands in."""

from __future__ import annotations

from typing import Any

from PySide6.QtCore import QEvent, Qt, Signal
from PySide6.QtGui import QFocusEvent, QKeyEvent, QWheelEvent
from PySide6.QtWidgets import (
    QCheckBox,
    QComboBox,
    QGridLayout,
    QLineEdit,
    QPlainTextEdit,
    QSizePolicy,
    QToolButton,
    QWidget,
)

from app.gui.cells import Tone
from app.gui.form import FormField, RefusedEntry
from app.gui.widgets import label, tint

NAME_WIDTH, UNIT_WIDTH = 104, 52


def _is_command(event: QEvent) -> bool:
    """Whether a key may be one of the window's: what was typed is to be taken before it acts."""
    if event.type() != QEvent.Type.ShortcutOverride or not isinstance(event, QKeyEvent):
        return False
    is_function = Qt.Key.Key_F1 <= event.key() <= Qt.Key.Key_F35
    return is_function or bool(event.modifiers() & Qt.KeyboardModifier.ControlModifier)


class LineEditor(QLineEdit):
    """A number or a text; taken by Enter, Tab, a click elsewhere, or a key of the window."""

    entered = Signal(str)

    def __init__(self) -> None:
        super().__init__()
        self.setMinimumWidth(60)
        self.editingFinished.connect(self._take)

    def show_text(self, text: str) -> None:
        """Show a value."""
        self.setText(text)
        self.setCursorPosition(0)
        self.setModified(False)

    def event(self, event: QEvent) -> bool:
        """Take what was typed before a key of the window acts."""
        if _is_command(event):
            self._take()
        return super().event(event)

    def _take(self) -> None:
        if self.isModified():
            self.setModified(False)
            self.entered.emit(self.text())


class Lines(QPlainTextEdit):
    """A text of several lines; taken by Tab, Ctrl+Enter, a click elsewhere, or a key of the
    window.
    """

    entered = Signal(str)

    def __init__(self, height: int) -> None:
        super().__init__()
        self.setTabChangesFocus(True)
        self.setFixedHeight(height)

    def show_text(self, text: str) -> None:
        """Show a value."""
        self.blockSignals(True)
        self.setPlainText(text)
        self.blockSignals(False)

    def event(self, event: QEvent) -> bool:
        """Take what was typed before a key of the window acts."""
        if _is_command(event):
            self._take()
        return super().event(event)

    def focusOutEvent(self, event: QFocusEvent) -> None:
        """Take what was typed."""
        self._take()
        super().focusOutEvent(event)

    def _take(self) -> None:
        if self.document().isModified():
            self.document().setModified(False)
            self.entered.emit(self.toPlainText())


class Choice(QComboBox):
    """One of several; the wheel scrolls the page it stands on, and changes nothing."""

    entered = Signal(str)

    def __init__(self, choices: tuple[str, ...]) -> None:
        super().__init__()
        self.addItems(choices)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        self.setMinimumContentsLength(6)
        self.textActivated.connect(self.entered)

    def show_text(self, text: str) -> None:
        """Show a value."""
        self.setCurrentText(text)

    def wheelEvent(self, event: QWheelEvent) -> None:
        """Leave the wheel to the page."""
        event.ignore()


class Check(QCheckBox):
    """Yes or no."""

    entered = Signal(str)

    def __init__(self) -> None:
        super().__init__()
        self.clicked.connect(lambda is_on: self.entered.emit(str(is_on)))

    def show_text(self, text: str) -> None:
        """Show a value."""
        self.setChecked(text == "True")


Editor = LineEditor | Lines | Choice | Check


def editor_of(field: FormField, lines: int = 0) -> Editor:
    """An empty editor for values of this field; one of several `lines` where that is given."""
    if field.option.type is bool:
        return Check()
    if field.option.choices and field.option.type is str:
        return Choice(field.option.choices)
    return Lines(lines * 20 + 10) if lines else LineEditor()


class FieldRow(QWidget):
    """A setting: its name, editor, unit and reset, and below them what is wrong with it."""

    entered = Signal(object, str)  # the Field, and what was typed
    reset_asked = Signal(object)
    focused = Signal(object)

    def __init__(self, field: FormField, name: str = "", lines: int = 0) -> None:
        super().__init__()
        self.field = field
        self._shown: tuple[Any, ...] = ()
        self._title = name or field.name
        self.name, self.unit = label(self._title, "name"), label(field.unit, "muted")
        self.sentence = label("", "detail")
        self.editor = editor_of(field, lines)
        self.reset = QToolButton()
        self._build()

    @property
    def title(self) -> str:
        """What the setting is called in this row."""
        return self._title

    def show_value(
        self, value: Any, base: Any, base_name: str, refused: RefusedEntry | None
    ) -> None:
        """Show a value, whether it differs from that of the base, or what was refused."""
        told = (value, base, base_name, refused)
        if told == self._shown:
            return
        had = self._shown and self._shown[3]
        text = refused.text if refused else self.field.text(value)
        if not self._shown or value != self._shown[0] or refused or had:
            self.editor.show_text(text)
        self._shown = told
        is_changed = value != base
        self.name.setText(f"● {self._title}" if is_changed else self._title)
        tint(self.name, Tone.WARN if is_changed else None)
        there = f"{self.field.text(base)} {self.field.unit}".strip() if base is not None else "none"
        self.reset.setToolTip(f"{base_name}: {there}. Takes that again (Ctrl+R).")
        self.reset.setVisible(is_changed or refused is not None)
        changed = f"\nNot as in {base_name}: {there}" if is_changed else ""
        tip = f"{self.field.key}: {self.field.help}{changed}"
        for widget in (self.name, self.editor):
            widget.setToolTip(tip)
        self.sentence.setText(refused.sentence if refused else "")
        self.sentence.setVisible(refused is not None)
        tint(self.editor, Tone.BAD if refused else None)

    def _build(self) -> None:
        self.reset.setText("↺")
        self.reset.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        self.reset.setObjectName("bare")
        keep = self.reset.sizePolicy()
        keep.setRetainSizeWhenHidden(True)
        self.reset.setSizePolicy(keep)
        self.reset.hide()
        for text in (self.name, self.sentence):
            text.setWordWrap(True)
        tint(self.sentence, Tone.BAD)
        self.sentence.hide()
        self.name.setFixedWidth(NAME_WIDTH)
        self.unit.setFixedWidth(UNIT_WIDTH)
        self.editor.setAccessibleName(f"{self._title}, {self.field.unit}".rstrip(", "))
        self.editor.setAccessibleDescription(self.field.help)
        self.editor.setSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Fixed)
        self.editor.installEventFilter(self)
        grid = QGridLayout(self)
        grid.setContentsMargins(0, 0, 0, 0)
        grid.setHorizontalSpacing(6)
        grid.setVerticalSpacing(2)
        has_unit = bool(self.field.unit)
        grid.addWidget(self.name, 0, 0)
        grid.addWidget(self.editor, 0, 1, 1, 1 if has_unit else 2)
        if has_unit:
            grid.addWidget(self.unit, 0, 2)
        grid.addWidget(self.reset, 0, 3)
        grid.addWidget(self.sentence, 1, 0, 1, 4)
        grid.setColumnStretch(1, 1)
        self.editor.entered.connect(self._enter)
        self.reset.clicked.connect(lambda: self.reset_asked.emit(self.field))

    def _enter(self, text: str) -> None:
        self._shown = ()  # what was typed is shown as it is written, also where nothing changes
        self.entered.emit(self.field, text)

    def eventFilter(self, watched: Any, event: QEvent) -> bool:
        """Say that the editor has the focus now."""
        if event.type() == QEvent.Type.FocusIn:
            self.focused.emit(self.field)
        return False
