"""The time line of a replay, and its controls: play and pause, single frames, the pace, and any
recorded frame by a click or by its number.
"""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING

from PySide6.QtCore import QSignalBlocker, Qt, QTimer, Signal
from PySide6.QtWidgets import QComboBox, QSpinBox, QToolBar, QWidget

from app.gui.background import Act, BackgroundWork
from app.gui.cells import Tone, localized, number
from app.gui.source import as_replay
from app.gui.time_strip import TimeStrip
from app.gui.widgets import (
    STRETCH,
    Panel,
    button,
    column,
    label,
    row,
    shortcut,
    tint,
    widget,
    write,
)

if TYPE_CHECKING:
    from app.replay.replay import Replay

PACES: tuple[float | None, ...] = (0.1, 0.25, 0.5, 1.0, 2.0, 5.0, 10.0, None)
STEPS = {
    Qt.Key.Key_Home: ("|◂", "First frame (Home)"),
    Qt.Key.Key_Left: ("◂", "Previous recorded frame (left arrow)"),
    Qt.Key.Key_Space: ("Pause", "Plays on from the frame that is shown, or pauses (Space)"),
    Qt.Key.Key_Right: (
        "▸",
        "Next recorded frame (right arrow). After the newest one, replays one more.",
    ),
    Qt.Key.Key_End: ("▸|", "Last frame (End)"),
}
LOOK_MS = 60  # between two looks at where recorded frames have been played to


class PlaybackBar(QToolBar):
    """Controls of a replay; `acted` is emitted when another frame is to be shown.

    It is as wide as the window, so that it takes little height from the picture.

    Its keys act where the time line has the focus, and in the widgets given to `add_keys`.
    """

    name, title = "timeline", "Time line"
    keys = (
        ("Space", "Plays on from the frame that is shown, or pauses."),
        ("Left, Right", "The recorded frame before or after."),
        ("Home, End", "The first or the last recorded frame."),
    )
    acted = Signal()
    said = Signal(str, bool)  # a sentence for the operator; whether it is an alarm

    def __init__(self) -> None:
        super().__init__(self.title, movable=False, floatable=False)
        self.setObjectName(self.name)
        self.toggleViewAction().setVisible(False)  # it is there for a replay, and only then
        self._source: Replay | None = None
        self._background = BackgroundWork(self)
        self._was_browsing = False
        self.strip = TimeStrip()
        self.place, self.verdict = (label("", "muted", is_cut=True) for _ in range(2))
        acts: list[Act] = [
            partial(self._go_to, 0),
            partial(self._move, -1),
            self.toggle,
            partial(self._move, 1),
            partial(self._go_to, -1),
        ]
        steps = [button(*words, act) for words, act in zip(STEPS.values(), acts, strict=True)]
        self.first, self.back, self.play, self.forward, self.last = steps
        self._by_key = dict(zip(STEPS, acts, strict=True))
        tip = "Seconds of the experiment per second"
        self.pace = widget(QComboBox, toolTip=tip, activated=self._set_pace)
        self._paces = list(PACES)
        self.pace.addItems(list(map(_in_words, PACES)))
        self.number = widget(
            QSpinBox,
            toolTip="Number of the frame, as recorded; type another to show it",
            prefix="frame ",
            keyboardTracking=False,
            valueChanged=self.show_frame,
        )
        tip = "It was recorded, but not analysed during the run."
        self.analyse = button("Analyse this frame", tip, self.analyse_frame)
        self.analyse.hide()
        for one in (*steps, self.analyse):
            one.setFocusPolicy(Qt.FocusPolicy.TabFocus)  # a click leaves the keys where they are
        controls = row(*steps, self.pace, 8, self.number, STRETCH, self.analyse, spacing=4)
        texts = row((self.place, 3), (self.verdict, 2), spacing=4)
        panel = Panel()
        beside = column(controls, texts, spacing=2)
        panel.setLayout(row(beside, (self.strip, 1), spacing=8, margins=(10, 4, 10, 4)))
        self.addWidget(panel)
        self.number.editingFinished.connect(lambda: self.number.lineEdit().setModified(False))
        self.strip.chosen.connect(self.show_frame)
        self._timer = widget(QTimer, self, interval=LOOK_MS, timeout=self._look)
        self.add_keys(self.strip)
        self.hide()

    def add_keys(self, widget: QWidget) -> None:
        """Let Space, the arrows, Home and End move through the frames while `widget`, or what is in
        it, has the focus.
        """
        for key, act in self._by_key.items():
            is_arrow = key in (Qt.Key.Key_Left, Qt.Key.Key_Right)
            shortcut(key, widget, act).setAutoRepeat(is_arrow)

    def attach(self, source: object) -> None:
        """Control `source`; hide where it is not a replay."""
        self._source = as_replay(source)
        self.setVisible(self._source is not None)
        self._timer.stop()
        self._background.drop()  # the results of a frame of the last one
        self.analyse.setEnabled(True)
        if self._source is None:
            self.strip.show_timeline(None)
            return
        line = self._source.timeline
        self.strip.show_timeline(line)
        with QSignalBlocker(self.number):
            self.number.setRange(int(line.frames[0]), int(line.frames[-1]))
        self.number.setSuffix(f" of {line.frames[0]} to {line.frames[-1]}")
        pace = self._source.playback.pace
        if pace is not None and pace not in self._paces:
            at = sum(one is not None and one < pace for one in self._paces)
            self._paces.insert(at, pace)
            self.pace.insertItem(at, _in_words(pace))
        self.pace.setCurrentIndex(self._paces.index(pace))
        self._timer.start()
        self.refresh()

    # ------------------------------------------------------------------ what the operator can do

    def toggle(self) -> None:
        """Pause the replay, or go on from the frame that is shown."""
        if (source := self._source) is not None:
            if source.is_playing:
                source.pause()
            else:
                source.play()
            self._show_action()

    def _move(self, frames: int) -> None:
        """Show the recorded frame that many further; after the newest one that was replayed, replay
        one more.
        """
        if (source := self._source) is not None:
            source.move(frames)
            self._show_action()

    def _go_to(self, at: int) -> None:
        """Show the recorded frame at this place among all; -1: the last."""
        if self._source is not None:
            self.show_frame(int(self._source.timeline.frames[at]))

    def show_frame(self, frame: int) -> None:
        """Show a recorded frame, or the nearest that has an image."""
        if self._source is not None and self._source.can_browse:
            self._source.show(frame)
            self._show_action()

    def analyse_frame(self) -> None:
        """Compute the results of the frame that is shown, which has none."""
        if (source := self._source) is None:
            return
        frame = source.frame
        self.analyse.setEnabled(False)
        self.analyse.setText(f"Analysing frame {frame} …")

        def done(_: object) -> None:
            self.analyse.setEnabled(True)
            self._show_action()

        def failed(sentence: str) -> None:
            self.analyse.setEnabled(True)
            self.said.emit(sentence, False)
            self.refresh()

        self._background.start_anew(lambda: source.analyse(frame), done, failed)

    # ------------------------------------------------------------------ drawing

    def refresh(self) -> None:
        """Show where the replay is."""
        source = self._source
        if source is None:
            return
        frame, line, can_browse = source.frame, source.timeline, source.can_browse
        for part in (self.first, self.back, self.last, self.strip, self.number):
            part.setEnabled(can_browse)
        self.play.setText("Pause" if source.is_playing else "Play")
        self.strip.show_frame(frame)
        if not (self.number.hasFocus() and self.number.lineEdit().isModified()):
            with QSignalBlocker(self.number):
                self.number.setValue(frame)
        sample = line.middle_of(frame)
        state, is_known = line.state_at(sample), source.has_results(frame)
        how = "recorded" if source.is_browsing else "replayed"
        texts = (f"t = {number(line.time_s(sample), 2)} s", state)
        write(self.place, " · ".join(filter(None, (*texts, how if is_known else "not analysed"))))
        if self.analyse.isEnabled():
            self.analyse.setText("Analyse this frame")
        self.analyse.setVisible(not is_known and can_browse)
        self._show_verdict(source)

    def _show_verdict(self, source: Replay) -> None:
        verdict = source.verdict()
        text = verdict.sentences[0].partition(":")[0] if verdict else ""
        if text == self.verdict.text():
            return
        self.verdict.setText(text)
        if verdict:
            tone = Tone.GOOD if verdict.agrees else Tone.BAD
            tint(self.verdict, tone)
            self.verdict.setToolTip("\n".join(verdict.sentences))

    def _look(self) -> None:
        """Follow what is played; the window looks by itself only while the run changes."""
        source = self._source
        if source is None or not (source.is_playing or self._was_browsing):
            return
        was_browsing = self._was_browsing
        self._was_browsing = source.is_browsing and source.is_playing
        self.refresh()
        if was_browsing or self._was_browsing:
            self.acted.emit()

    def _set_pace(self, index: int) -> None:
        if self._source is not None:
            self._source.playback.set_pace(self._paces[index])
            self._show_action()

    def _show_action(self) -> None:
        self.refresh()
        self.acted.emit()


def _in_words(pace: float | None) -> str:
    return localized(f"{pace:g} x") if pace else "max"
