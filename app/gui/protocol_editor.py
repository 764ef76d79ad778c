"""The steps of the next run: a table of values for each, and buttons for their order."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from functools import partial

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QWidget

from analysis.options import options
from app.gui.cells import Tone, localized, typeset
from app.gui.form import STEPS_KEY, Form, FormField, Steps, Values, fields_of, steps_in_words
from app.gui.setting_row import RowState
from app.gui.settings_list import INDENT_PX, SettingsList, SettingsTable
from app.gui.widgets import (
    STRETCH,
    column,
    holding,
    label,
    menu_button,
    remove,
    restyle,
    row,
    tint,
    tool_button,
)
from app.settings.plain_values import title
from app.settings.protocol_steps import DO, KINDS, Motion, Step, durations
from app.system.durations import duration

QUESTION = "Ready?"  # of a new step that asks
_PLACE = re.compile(r"run\.steps: step (\d+) \(\w+\)(?:: (\w+) must)?")


class ProtocolEditor(QWidget):
    """Stands in the list of settings below the row where a protocol is chosen: the steps, each a
    table of its values, and buttons for their order.
    """

    entered = Signal(object)  # steps, as a settings file has them

    def __init__(self, form: Form, settings: SettingsList) -> None:
        super().__init__()
        self._form, self._settings = form, settings
        self._kinds: list[str] | None = None  # of the steps that are shown
        self._tables: list[SettingsTable] = []  # of these steps
        self._chosen = -1  # place of the step that the buttons act on; -1: the last
        self._steps = column(spacing=0)  # in a widget before the buttons: so Tab goes
        self.total = label("", "muted")
        self._build()
        settings.focused.connect(self._choose_of)
        self.refresh()

    # ------------------------------------------------------------------ showing

    def refresh(self) -> None:
        """Show the steps of the form."""
        steps = self._form.steps()
        if (kinds := [one[DO] for one in steps]) != self._kinds:
            self._kinds = kinds
            for one in self._tables:
                one.discard_rows()
                remove(one)
            self._tables = list(map(self._table, range(1, len(kinds) + 1)))
            for one in self._tables:
                self._steps.addWidget(one)
        config, refused = self._form.config, self._form.refused.get(STEPS_KEY)
        titles = _titles(self._form) if refused is None else [_brief(one) for one in steps]
        wrong, _ = self._place()
        for n, (one, words) in enumerate(zip(self._tables, titles, strict=True), 1):
            one.head.setText(f"{n}  {words}")
            tint(one.head, Tone.BAD if n == wrong else None)
        self._choose(self._chosen)
        seconds = durations(config.run.protocol)
        planned = duration(sum(one for one in seconds if math.isfinite(one)))
        self.total.setText("" if refused else localized(f"{planned} and the operator's time"))

    def state(self, field: FormField) -> RowState:
        """What the row of a value of a step shows."""
        number, name = _parts(field.key)
        steps = self._form.steps()
        if number > len(steps):
            return RowState("")
        kind = _kind(steps, number)
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
            self._tables[number - 1].open()
        key = f"{STEPS_KEY}.{number}.{name}" if name else STEPS_KEY
        self._settings.go_to(self._settings.rows(key)[0])

    def _place(self) -> tuple[int, str]:
        """Number of the step that is refused, from 1, and the key of its value, as far as they are
        known.
        """
        refused = self._form.refused.get(STEPS_KEY)
        found = _PLACE.match(refused.sentence) if refused else None
        number, name = (int(found[1]), found[2] or "") if found else (0, "")
        return (number, name) if number <= len(self._form.steps()) else (0, "")

    def _table(self, number: int) -> SettingsTable:
        kind = _kind(self._form.steps(), number)
        fields = fields_of(f"{STEPS_KEY}.{number}", kind, self._form.point)
        fields.sort(key=lambda one: one.option.name not in kind.__annotations__)  # its own first
        made = self._settings.new_table(kind.kind, typeset(title(kind)), "step")
        made.put_fields(tuple(fields))
        made.head.clicked.connect(lambda _: self._choose(number - 1))
        return made

    # ------------------------------------------------------------------ what the operator does

    def change(self, field: FormField, text: str) -> None:
        """Let a value of a step be what was typed; empty: what holds without it."""
        number, name = _parts(field.key)
        steps = self._form.steps()
        value = field.plain(text)
        is_left = not text.strip() or value == field.option.default
        if is_left and name not in _kind(steps, number).needs:
            steps[number - 1].pop(name, None)
        else:
            steps[number - 1][name] = value
        self.entered.emit(steps)

    def _choose(self, at: int) -> None:
        """Let the buttons act on the step at this place."""
        self._chosen = at
        for n, one in enumerate(self._tables):
            restyle(one.head, "chosen" if n == at else "step")

    def _choose_of(self, field: FormField) -> None:
        """Choose the step one of whose values has the keys."""
        if field.key.startswith(f"{STEPS_KEY}."):
            self._choose(_parts(field.key)[0] - 1)

    def _rearrange(self, act: Callable[[Steps, int], int]) -> None:
        """Do something with the steps and the place of the chosen one, and choose the place that
        comes out of it.
        """
        self._settings.take()
        steps, last = self._form.steps(), len(self._tables) - 1
        at = act(steps, self._chosen if 0 <= self._chosen <= last else last)
        self.entered.emit(steps)
        self._choose(at)

    def _add(self, kind: str) -> None:
        step = KINDS[kind]
        needs = {key: options(step)[key].default for key in step.needs}
        if "question" in needs:
            needs["question"] = QUESTION
        self._rearrange(partial(_insert, {DO: kind, **needs}))
        self._tables[self._chosen].open()

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
        buttons = [self.add]
        for text, tip, change in (
            ("Copy", "Adds a copy of the chosen step", partial(_insert, None)),
            ("↑", "Moves the chosen step up", partial(_move, -1)),
            ("↓", "Moves the chosen step down", partial(_move, 1)),
            ("✕", "Removes the chosen step", _remove),
        ):
            buttons.append(tool_button(text, tip, partial(self._rearrange, change)))
        _, self.double, self.up, self.down, self.remove = buttons
        order, margins = row(*buttons, STRETCH, spacing=3), (INDENT_PX, 0, 0, 4)
        self.setLayout(column(holding(self._steps), order, self.total, spacing=3, margins=margins))


def _insert(step: Values | None, steps: Steps, at: int) -> int:
    """Insert a step, or a copy of the one before."""
    steps.insert(at + 1, step or dict(steps[at]))
    return at + 1


def _move(by: int, steps: Steps, at: int) -> int:
    to = min(max(at + by, 0), len(steps) - 1)
    steps.insert(to, steps.pop(at))
    return to


def _remove(steps: Steps, at: int) -> int:
    del steps[at]
    return min(at, len(steps) - 1)


def _kind(steps: Steps, number: int) -> type[Step]:
    """Of a step, given by its number from 1."""
    return KINDS[steps[number - 1][DO]]


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
    words = steps_in_words(form.config)
    return [localized(text + time) for text, time in zip(words, times, strict=True)]


def _brief(step: Values) -> str:
    """A step that cannot be used, by what is written of it."""
    return " ".join([step[DO], *(f"{key} {value}" for key, value in step.items() if key != DO)])
