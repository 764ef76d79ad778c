"""The steps of the next run: a table of values for each, buttons for their order, the text."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from functools import partial
from typing import Any

from PySide6.QtCore import QEvent, QTimer, Signal
from PySide6.QtGui import QColor, QFontDatabase
from PySide6.QtWidgets import QPlainTextEdit, QWidget

from analysis.options import options
from app.gui import theme
from app.gui.cells import Tone, typeset
from app.gui.form import STEPS_KEY, Form, FormField, check_steps, steps_in_words
from app.gui.setting_row import EditorWatch, RowState, SettingItem
from app.gui.settings_tree import SettingsTree, table
from app.gui.widgets import STRETCH, column, label, menu_button, row, tint, tool_button, widget
from app.settings.plain_values import title
from app.settings.protocol_steps import DO, KINDS, Motion, durations
from app.system.durations import duration

TEXT_HEIGHT = 170
QUESTION = "Ready?"  # of a new step that asks
_PLACE = re.compile(r"run\.steps: step (\d+) \(\w+\)(?:: (\w+) must)?")


class ProtocolEditor(QWidget):
    """Stands in the tree below the row of the protocol, behind the steps.

    Attributes
    ----------
    text : QPlainTextEdit
        The steps as in a settings file.
    sentence : QLabel
        What is wrong with the text, while it is typed.
    """

    entered = Signal(object)  # steps, as a settings file has them, or their text

    def __init__(self, form: Form, tree: SettingsTree) -> None:
        super().__init__()
        self._form, self._tree = form, tree
        self._kinds: list[str] | None = None  # of the steps that are shown
        self.text = widget(
            QPlainTextEdit,
            font=QFontDatabase.systemFont(QFontDatabase.SystemFont.FixedFont),
            lineWrapMode=QPlainTextEdit.LineWrapMode.NoWrap,
            tabChangesFocus=True,
            accessibleName="Steps of the protocol, as in a settings file",
            toolTip="One table [[run.steps]] for each step; taken by Tab or a click elsewhere. What"
            " a step leaves out is that of the load, travel and velocity of the run.",
            textChanged=self._preview,
            visible=False,
        )
        self.text.setFixedHeight(TEXT_HEIGHT)
        self.sentence = label("", "detail", wraps=True)
        self.total = label("", "muted")
        self._build()

    def put_below(self, choice: SettingItem) -> None:
        """Stand below the row where a protocol is chosen, and show the steps there."""
        self._row = choice
        self._place_in_tree = self._tree.span(self, choice)
        self.refresh()

    # ------------------------------------------------------------------ showing

    def refresh(self) -> None:
        """Show the steps of the form."""
        steps, has_text = self._form.steps(), self.text.document().isModified()
        if (kinds := [one[DO] for one in steps]) != self._kinds:
            self._kinds = kinds
            self._tree.put_tables(self._row, map(self._table, range(1, len(kinds) + 1)))
        for button in self._buttons:
            button.setEnabled(bool(steps))  # else a text waits, which they would replace
        config, refused = self._form.config, self._form.refused.get(STEPS_KEY)
        titles = _titles(self._form) if refused is None else [_brief(one) for one in steps]
        for n, (param, words) in enumerate(zip(self._row.param.children(), titles, strict=True), 1):
            param.setOpts(title=f"{n}  {words}")
        self._colour()
        seconds = durations(config.run.protocol)
        planned = duration(sum(one for one in seconds if math.isfinite(one)))
        self.total.setText("" if refused else f"{planned} and the operator's time")
        if not has_text and self.text.toPlainText() != (text := self._form.steps_text()):
            self._put_text(text)
        self._say("")

    def changeEvent(self, event: QEvent) -> None:
        """Write the steps in the colours of another look."""
        super().changeEvent(event)
        if event.type() == QEvent.Type.StyleChange and self._kinds is not None:
            self._colour()

    def _colour(self) -> None:
        """Let the step that is refused be seen among the others."""
        refused, colours = self._place()[0], theme.now()
        for n, item in enumerate(self._items(), 1):
            colour = colours.tones[Tone.BAD] if n == refused else colours.text
            item.setForeground(0, QColor(colour))

    def state(self, field: FormField) -> RowState:
        """What the row of a value of a step shows."""
        number, name = _parts(field.key)
        steps = self._form.steps()
        if number > len(steps):
            return RowState("")
        kind = KINDS[steps[number - 1][DO]]
        value = steps[number - 1].get(name, field.option.default)
        refused = self._form.refused.get(STEPS_KEY)
        sentence = refused.sentence if refused and self._place() == (number, name) else ""
        if name in kind.like_run and not value:
            key = f"run.{kind.like_run[name]}"
            left = field.text(self._form.values()[key])
            return RowState("", refusal=sentence, placeholder=f"{left} as {key}")
        return RowState(field.text(value), refusal=sentence)

    @property
    def has_row_for_refusal(self) -> bool:
        """Whether what is refused is said beside a value of a step."""
        return bool(self._place()[1])

    def go_to_refused(self) -> None:
        """Put the keys where the steps that cannot be used were written."""
        number, name = self._place()
        if name:
            step = self._items()[number - 1]
            step.setExpanded(True)
            self._tree.go_to(self._tree.rows(f"{STEPS_KEY}.{number}.{name}")[0])
        elif self.as_text.isChecked():
            self.text.setFocus()
        else:
            self._tree.go_to(self._row)

    def _place(self) -> tuple[int, str]:
        """Number of the step that is refused, from 1, and the key of its value, as far as they are
        known.
        """
        refused = self._form.refused.get(STEPS_KEY)
        found = _PLACE.match(refused.sentence) if refused else None
        number, name = (int(found[1]), found[2] or "") if found else (0, "")
        return (number, name) if number <= len(self._form.steps()) else (0, "")

    def _items(self) -> list[Any]:
        return [next(iter(param.items)) for param in self._row.param.children()]

    def _table(self, number: int) -> Any:
        kind = KINDS[self._form.steps()[number - 1][DO]]
        fields = self._form.fields(f"{STEPS_KEY}.{number}", kind)
        fields.sort(key=lambda one: one.option.name not in kind.__annotations__)  # its own first
        return table(f"step {number}", typeset(title(kind)), fields, title=kind.kind)

    def _put_text(self, text: str) -> None:
        self.text.blockSignals(True)
        self.text.setPlainText(text)
        self.text.blockSignals(False)

    def _say(self, sentence: str) -> None:
        self.sentence.setText(sentence)
        self.sentence.setVisible(bool(sentence))
        self._tree.fit()

    # ------------------------------------------------------------------ what the operator does

    def change(self, field: FormField, text: str) -> None:
        """Let a value of a step be what was typed; empty: what holds without it."""
        number, name = _parts(field.key)
        steps = self._form.steps()
        value = field.plain(text)
        is_left = not text.strip() or value == field.option.default
        if is_left and name not in KINDS[steps[number - 1][DO]].needs:
            steps[number - 1].pop(name, None)
        else:
            steps[number - 1][name] = value
        self.entered.emit(steps)

    def _chosen(self) -> int:
        """Place of the step whose row, or one of whose values, has been chosen; else the last."""
        item, steps = self._tree.currentItem(), self._items()
        while item is not None and item not in steps:
            item = item.parent()
        return steps.index(item) if item is not None else len(steps) - 1

    def _rearrange(self, act: Callable[[list[dict[str, Any]], int], int]) -> None:
        """Do something with the steps and the place of the chosen one, and choose the place that
        comes out of it.
        """
        steps, at = self._form.steps(), self._chosen()
        at = act(steps, at)
        self.entered.emit(steps)
        if 0 <= at < len(items := self._items()):
            self._tree.setCurrentItem(items[at])

    def _add(self, kind: str) -> None:
        step = KINDS[kind]
        needs = {key: options(step)[key].default for key in step.needs}
        if "question" in needs:
            needs["question"] = QUESTION
        self._rearrange(partial(_insert, {DO: kind, **needs}))
        self._items()[self._chosen()].setExpanded(True)

    def _show_text(self, is_shown: bool) -> None:
        self.text.setVisible(is_shown)
        QTimer.singleShot(0, self, self._scroll_to_text)

    def _scroll_to_text(self) -> None:
        self._tree.fit()
        self._tree.scrollToItem(self._place_in_tree)

    def _take_text(self) -> None:
        if self.text.document().isModified():
            self.text.document().setModified(False)
            self.entered.emit(self.text.toPlainText())

    def _preview(self) -> None:
        """Say what is wrong with the text, while it is typed."""
        if self.text.document().isModified():
            self._say(check_steps(self.text.toPlainText(), self._form.config))

    # ------------------------------------------------------------------ building

    def _build(self) -> None:
        self.add = menu_button(
            "Add",
            "Adds a step behind the chosen one",
            {kind: partial(self._add, kind) for kind in KINDS},
        )
        for act, step in zip(self.add.menu().actions(), KINDS.values(), strict=True):
            act.setToolTip(title(step))
        self.add.menu().setToolTipsVisible(True)
        self._buttons = [self.add]
        for text, tip, change in (
            ("Copy", "Adds a copy of the chosen step", partial(_insert, None)),
            ("↑", "Moves the chosen step up", partial(_move, -1)),
            ("↓", "Moves the chosen step down", partial(_move, 1)),
            ("✕", "Removes the chosen step", _remove),
        ):
            self._buttons.append(tool_button(text, tip, partial(self._rearrange, change)))
        _, self.double, self.up, self.down, self.remove = self._buttons
        self.as_text = tool_button("Text", "Shows the steps as in a settings file, to be edited")
        self.as_text.setCheckable(True)
        self.as_text.toggled.connect(self._show_text)
        EditorWatch(self.text, self._take_text, lambda: None)
        tint(self.sentence, Tone.BAD)
        buttons = row(*self._buttons, STRETCH, spacing=3)
        total = row((self.total, 1), self.as_text, spacing=3)
        parts = (buttons, total, self.text, self.sentence)
        self.setLayout(column(*parts, spacing=3, margins=(0, 2, 0, 4)))


def _insert(step: dict[str, Any] | None, steps: list[dict[str, Any]], at: int) -> int:
    """Insert a step, or a copy of the one before."""
    steps.insert(at + 1, step or dict(steps[at]))
    return at + 1


def _move(by: int, steps: list[dict[str, Any]], at: int) -> int:
    to = min(max(at + by, 0), len(steps) - 1)
    steps.insert(to, steps.pop(at))
    return to


def _remove(steps: list[dict[str, Any]], at: int) -> int:
    del steps[at]
    return min(at, len(steps) - 1)


def _parts(key: str) -> tuple[int, str]:
    """Number of a step, from 1, and name of its value, of the key of a row."""
    number, _, name = key.removeprefix(f"{STEPS_KEY}.").partition(".")
    return int(number), name


def _titles(form: Form) -> list[str]:
    """The steps in words, with the times that are not among them."""
    steps = form.config.run.protocol
    times = (
        f" · {duration(seconds)}" if isinstance(step, Motion) and math.isfinite(seconds) else ""
        for step, seconds in zip(steps, durations(steps), strict=True)
    )
    return [words + time for words, time in zip(steps_in_words(form.config), times, strict=True)]


def _brief(step: dict[str, Any]) -> str:
    """A step that cannot be used, by what is written of it."""
    return " ".join([step[DO], *(f"{key} {value}" for key, value in step.items() if key != DO)])
