"""The line in which the window says what is wrong, or asks a question without blocking."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

from PySide6.QtCore import QEvent
from PySide6.QtWidgets import QSizePolicy

from app.gui.background import Act
from app.gui.cells import Tone, localized
from app.gui.widgets import Panel, button, keep_room, label, row, tint, write

LINES = 2  # of text for which there is always room


class Said(NamedTuple):
    """A sentence, in the colour of a tone, and whether it is an alarm or what became of a stop."""

    sentence: str = ""
    tone: Tone = Tone.NEUTRAL
    is_alarm: bool = False
    is_of_stop: bool = False


NOTHING = Said()


class Notice(Panel):
    """A sentence across the window, and a question behind it; hidden while there is nothing to say.
    Its room stays, so that nothing moves under the mouse when it comes.

    An alarm, and what became of a stop, stay until they are dismissed or the operator begins a new
    run; other sentences give way to newer ones.
    """

    def __init__(self) -> None:
        super().__init__()
        self.text = label("", "notice", wraps=True)
        self.text.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Ignored)
        self._acts: list[Act] = [self.clear, self.clear]  # of these buttons
        self.yes, self.other = (button("", act=partial(self._answer, n)) for n in range(2))
        self.no = button("", act=self.clear)
        self._said, self._question = NOTHING, ""
        self.setLayout(row((self.text, 1), self.yes, self.other, self.no, margins=(14, 2, 10, 2)))
        keep_room(self)
        self.clear()

    @property
    def is_alarm(self) -> bool:
        """Whether it shows an alarm."""
        return self._said.is_alarm

    @property
    def is_question(self) -> bool:
        """Whether it asks something."""
        return bool(self._question)

    @property
    def stays(self) -> bool:
        """Whether what it says stays until it is dismissed."""
        return self._said.is_alarm or self._said.is_of_stop

    def say(self, sentence: str, *, is_alarm: bool = False) -> None:
        """Show `sentence`; what stays, and a question, give way to an alarm only."""
        if is_alarm or not (self.stays or self.is_question):
            self._show(Said(sentence, Tone.BAD if is_alarm else Tone.WARN, is_alarm))

    def say_stop(self, sentence: str, tone: Tone) -> None:
        """Show what became of a stop, in place of everything but an alarm of another kind; what was
        sent to nothing does not stay.
        """
        is_alarm = tone is Tone.BAD
        if is_alarm or self._said.is_of_stop or not self.is_alarm:
            self._show(Said(sentence, tone, is_alarm, tone is not Tone.NEUTRAL))

    def ask(
        self,
        sentence: str,
        yes: str,
        on_yes: Act,
        no: str = "Keep running",
        other: str = "",
        on_other: Act = lambda: None,
    ) -> None:
        """Ask for a decision, beside what stays; the window stays in use meanwhile. There may be an
        `other` way than yes and no.
        """
        self._acts = [on_yes, on_other]
        for one, text in ((self.yes, yes), (self.other, other), (self.no, no)):
            one.setText(text)
        self._show(self._said if self.stays else NOTHING, sentence)
        self.no.setFocus()  # the keys are at the answers

    def clear(self) -> None:
        """Show nothing any more."""
        self._show(NOTHING)

    def give_way(self) -> None:
        """Show nothing any more but an alarm, which nobody may have seen yet."""
        if not self.is_alarm:
            self.clear()

    def take_back_question(self) -> None:
        """Ask no more, because nothing is left to decide."""
        if self.is_question:
            self._show(self._said)

    def retract(self, sentence: str) -> None:
        """Take a sentence back, unless something else is said or asked since."""
        if self._said.sentence == sentence and not (self.stays or self.is_question):
            self.clear()

    def changeEvent(self, event: QEvent) -> None:
        """Have room for two lines, in the font of now."""
        super().changeEvent(event)
        lines = LINES * self.text.fontMetrics().lineSpacing()
        if self.height() != (room := max(lines, self.no.sizeHint().height()) + 6):
            self.setFixedHeight(room)

    def _answer(self, which: int) -> None:
        self.take_back_question()
        self._acts[which]()

    def _show(self, said: Said, question: str = "") -> None:
        self._said, self._question = said, question
        self.yes.setVisible(bool(question))
        self.other.setVisible(bool(question and self.other.text()))
        if not question:
            self.no.setText("Dismiss")
        text = localized("  ".join(filter(None, (said.sentence, question))))
        write(self.text, text)
        tone = Tone.WARN if question and not said.is_alarm else said.tone
        tint(self, tone)
        tint(self.text, None if tone is Tone.BAD else tone)  # white on red
        self.setVisible(bool(text))
