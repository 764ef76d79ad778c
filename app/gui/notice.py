"""The line in which the window says what is wrong, or asks a question without blocking."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from PySide6.QtCore import QEvent
from PySide6.QtWidgets import QSizePolicy

from app.gui.cells import Tone
from app.gui.widgets import Panel, button, keep_room, label, row, tint

LINES = 2  # of text for which there is always room


class Notice(Panel):
    """A sentence across the window, hidden while there is nothing to say; its room stays, so that
    nothing moves under the mouse when it comes.

    An alarm, and what became of a stop, stay until they are dismissed or a new run begins; other
    sentences give way to newer ones.
    """

    def __init__(self) -> None:
        super().__init__()
        self.text = label("", "notice", wraps=True)
        self.text.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Ignored)
        self._acts: list[Callable[[], object]] = [self.clear, self.clear]  # of these buttons
        self.yes, self.other = (button("", act=partial(self._answer, n)) for n in range(2))
        self.no = button("Dismiss", act=self.clear)
        self.is_alarm = self.is_question = self.is_of_stop = False
        self._tone = Tone.NEUTRAL
        self._beside = ("", Tone.NEUTRAL, False, False)  # what stood where a question is asked
        self.setLayout(row((self.text, 1), self.yes, self.other, self.no, margins=(14, 2, 10, 2)))
        keep_room(self)
        self.clear()

    def say(self, sentence: str, *, is_alarm: bool = False) -> None:
        """Show `sentence`; what stays, or a question in its place, gives way to an alarm only."""
        if is_alarm or not (self.stays or self.is_question):
            self._show(sentence, Tone.BAD if is_alarm else Tone.WARN)
            self.is_alarm = is_alarm

    def say_stop(self, sentence: str, tone: Tone) -> None:
        """Show what became of a stop, in place of everything but an alarm of another kind; what was
        sent to nothing does not stay.
        """
        is_alarm = tone is Tone.BAD
        if is_alarm or self.is_of_stop or not self.is_alarm:
            self._show(sentence, tone)
            self.is_alarm, self.is_of_stop = is_alarm, tone is not Tone.NEUTRAL

    @property
    def stays(self) -> bool:
        """Whether what it shows stays until it is dismissed."""
        return self.is_alarm or self.is_of_stop

    def ask(
        self,
        sentence: str,
        yes: str,
        on_yes: Callable[[], object],
        no: str = "Keep running",
        other: str = "",
        on_other: Callable[[], object] = lambda: None,
    ) -> None:
        """Ask for a decision, beside an alarm that stands; the window stays in use meanwhile. There
        may be an `other` way than yes and no.
        """
        if not self.is_question:
            text = self.text.text() if self.stays else ""
            self._beside = text, self._tone, self.is_alarm, self.is_of_stop
        alarm = f"{self._beside[0]}  " if self._beside[0] else ""
        self._show(alarm + sentence, Tone.BAD if self.is_alarm else Tone.WARN)
        self.is_question = True
        self._acts = [on_yes, on_other]
        self.yes.setText(yes)
        self.yes.show()
        self.other.setText(other)
        self.other.setVisible(bool(other))
        self.no.setText(no)
        self.no.setFocus()  # the keys are at the answers

    def clear(self) -> None:
        """Show nothing any more."""
        self._show("", Tone.NEUTRAL)
        self.is_alarm = False
        self.hide()

    def take_back_question(self) -> None:
        """Ask no more, because nothing is left to decide; an alarm, or the answer to a stop, beside
        which it was asked, stays.
        """
        if self.is_question:
            text, tone, is_alarm, is_of_stop = self._beside
            self.clear()
            if text:
                self._show(text, tone)
                self.is_alarm, self.is_of_stop = is_alarm, is_of_stop

    def retract(self) -> None:
        """Take the sentence back, unless it stays or is a question."""
        if not (self.stays or self.is_question):
            self.clear()

    def changeEvent(self, event: QEvent) -> None:
        """Have room for two lines, in the font of now."""
        super().changeEvent(event)
        lines = LINES * self.text.fontMetrics().lineSpacing()
        if self.height() != (room := max(lines, self.no.sizeHint().height()) + 6):
            self.setFixedHeight(room)

    def _answer(self, which: int) -> None:
        self._acts[which]()

    def _show(self, sentence: str, tone: Tone) -> None:
        self.is_question = self.is_of_stop = False
        self._tone = tone
        for other in (self.yes, self.other):
            other.hide()
        self.no.setText("Dismiss")
        self.text.setText(sentence)
        self.text.setToolTip(sentence)  # whole, where the room is not enough
        tint(self, tone)
        tint(self.text, None if tone is Tone.BAD else tone)  # white on red
        self.show()
