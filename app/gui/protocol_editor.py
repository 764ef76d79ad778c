"""The protocol of the next run: chosen, or written as steps; in words below."""

from __future__ import annotations

from PySide6.QtCore import Signal
from PySide6.QtGui import QFontDatabase
from PySide6.QtWidgets import QToolButton, QWidget

from app.gui.cells import Tone
from app.gui.editors import NAME_WIDTH, Choice, Lines
from app.gui.form import OWN_STEPS, STEPS_KEY, Form, check_steps, protocols, steps_in_words
from app.gui.widgets import column, label, row, tint
from app.settings.plain_values import steps_lines
from app.system.errors import ConfigError

TEXT_HEIGHT = 170


class ProtocolEditor(QWidget):
    """A choice of protocols, the steps in words, and their text to be edited."""

    entered = Signal(str)  # steps as TOML; empty: none

    def __init__(self, form: Form) -> None:
        super().__init__()
        self._form, self._shown = form, ""
        self._protocols = protocols()
        self.choice = Choice((*self._protocols, OWN_STEPS))
        self.choice.setAccessibleName("Protocol")
        self.choice.setToolTip(
            "What the run does, step by step. Steps of the program's own benches can be chosen, and"
            " edited below."
        )
        self.edit, self.text = QToolButton(), Lines(TEXT_HEIGHT)
        self.steps, self.sentence = label("", "muted"), label("", "detail")
        self._build()
        self.refresh()

    def refresh(self) -> None:
        """Show the steps of the form."""
        config = self._form.config
        refused = self._form.refused.get(STEPS_KEY)
        self.choice.show_text(OWN_STEPS if refused else self._form.protocol())
        if refused is not None:
            self._show_steps((), refused.sentence)
            return
        steps = config.run.steps or config.run.protocol
        text = "\n".join(steps_lines(steps, comments=False)).strip()
        if text != self._shown:
            self._shown = text
            self.text.show_text(text)
        self._show_steps(steps_in_words(config), "")

    def _show_steps(self, steps: tuple[str, ...], sentence: str) -> None:
        lines = (f"{number}  {step}" for number, step in enumerate(steps, 1))
        self.steps.setText("\n".join(lines))
        self.steps.setVisible(bool(steps))
        self.sentence.setText(sentence)
        self.sentence.setVisible(bool(sentence))

    def _choose(self, name: str) -> None:
        if name == OWN_STEPS:
            self.edit.setChecked(True)
            self.text.setFocus()
        else:
            self.entered.emit(self._protocols[name])

    def _preview(self) -> None:
        """Say what the text would do, while it is typed."""
        if not self.text.document().isModified():
            return
        try:
            self._show_steps(check_steps(self.text.toPlainText(), self._form.config), "")
        except ConfigError as error:
            self._show_steps((), str(error))

    def _build(self) -> None:
        self.text.setFont(QFontDatabase.systemFont(QFontDatabase.SystemFont.FixedFont))
        self.text.setLineWrapMode(Lines.LineWrapMode.NoWrap)
        self.text.setAccessibleName("Steps of the protocol, as in a settings file")
        self.text.setToolTip(
            "One table [[run.steps]] for each step, as in a settings file; taken by Tab or a click"
            " elsewhere. What a step leaves out is that of the load, travel and velocity above."
        )
        self.text.hide()
        self.edit.setObjectName("framed")
        self.edit.setText("Edit")
        self.edit.setCheckable(True)
        self.edit.setToolTip("Shows the steps as text, to be edited")
        self.edit.toggled.connect(self.text.setVisible)
        for words in (self.steps, self.sentence):
            words.setWordWrap(True)
        tint(self.sentence, Tone.BAD)
        name = label("Protocol", "name")
        name.setFixedWidth(NAME_WIDTH)
        head = row(name, (self.choice, 1), self.edit, spacing=6)
        self.setLayout(column(head, self.text, self.sentence, self.steps, spacing=4))
        self.choice.entered.connect(self._choose)
        self.text.entered.connect(self.entered)
        self.text.textChanged.connect(self._preview)
