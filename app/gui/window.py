"""The operator's window: it looks at a run ten times a second, and stops the motion whatever else
happens.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from functools import partial

from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtGui import QCloseEvent, QKeySequence, QShortcut
from PySide6.QtWidgets import QMainWindow, QSplitter, QVBoxLayout, QWidget

from app.gui import theme
from app.gui.image_view import InterfaceView
from app.gui.notice import Notice
from app.gui.panels import CellRow, HealthStrip, ResultPanel, TopBar
from app.gui.playback_bar import PlaybackBar
from app.gui.plots import CurvesView
from app.gui.reader import Answer, Reader
from app.gui.source import RunSource
from app.gui.view_state import ViewState
from app.records import Outcome

TICK_MS = 15  # one part of the window is drawn per tick: a key waits for that part at most
REFRESH_MS = 100  # the parts begin anew
# times as long as a redraw took its thread, the next one waits: the analysis needs the core too
RESTS = 2.0
SILENT_S = 1.0  # a source that has not answered for so long is reported
GIVE_UP_S = 10.0  # how long a closing window waits for the run to end


class MainWindow(QMainWindow):
    """One operator, one window, one run after the other.

    Parameters
    ----------
    source : RunSource, optional
        The run, or the replay, that Start begins.
    make_source : callable, optional
        Makes the next run; called at once where there is no `source`, and again by Start when a run
        has ended.
    """

    closed = Signal()

    def __init__(
        self, source: RunSource | None = None, make_source: Callable[[], RunSource] | None = None
    ) -> None:
        super().__init__()
        self.setWindowTitle("SlipScope")
        self.setStyleSheet(theme.STYLE)
        self._make_source = make_source
        self._reader: Reader | None = None
        self._source: RunSource | None = None
        self._started = self._is_fresh = False
        self._view: ViewState | None = None
        self._shown_scene: object = None
        self._closing_for_ms: int | None = None
        self._must_close = False
        self._reported = False
        # when the last redraw began, on the clock and in the time of this thread
        self._drawn = (0.0, 0.0)
        self._parts: list[Callable[[], None]] = []  # of the redraw under way, still to be drawn
        self._failures: list[str] = []  # sentences from other threads
        self._build()
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._tick)
        self._timer.start(TICK_MS)
        if source is not None:
            self._attach(source)
        else:
            self._prepare()

    # ------------------------------------------------------------------ what the operator can do

    def begin(self) -> None:
        """Start the run that is ready, or a new one when the last has ended."""
        if self._is_running():
            return
        if not self._is_fresh:
            self._prepare()
        if self._source is None or self._started:
            return
        try:
            self._source.start()
        except Exception as error:
            self.notice.say(f"The run did not start: {error}")
            return
        self._started, self._is_fresh = True, False
        self.notice.clear()
        self._show_buttons()

    def end_run(self) -> None:
        """Ask for an orderly end of the run."""
        self._in_background(
            "The run could not be asked to end",
            lambda source: source.request_stop("the operator ended the run"),
        )

    def stop_motion(self) -> None:
        """Stop the actuator now; in a thread of its own, so that neither the window nor a slow
        device can hold it up.
        """
        if self._source is None:
            self.notice.say("STOP MOTION: no bench is connected, so nothing moves by our command.")
            return
        self._is_fresh = False  # a run that was stopped before it began does not begin
        self.notice.say("STOP MOTION was sent to the actuator.")
        failed = "STOP MOTION FAILED, cut the actuator's power"
        self._in_background(failed, lambda source: source.stop_motion())

    def close_after_run(self) -> None:
        """Stop the motion, wait for the run to put its data in order, then close; a second call
        closes at once.
        """
        if self._closing_for_ms is not None or not self._is_running():
            self._close_now()
            return
        self._closing_for_ms = 0
        self.notice.clear()
        self.stop_motion()
        self.notice.say("Closing: the motion is stopped and the run is being put in order.")

    def outcome(self) -> Outcome | None:
        """How the last run ended; None while it has not."""
        return self._view.outcome if self._view else None

    @property
    def source(self) -> RunSource | None:
        """The run this window looks at."""
        return self._source

    # ------------------------------------------------------------------ looking

    def _tick(self) -> None:
        """Draw the next part, or begin anew, unless the last redraw, its painting included, was too
        dear to follow it up at once.
        """
        used, now = time.thread_time() - self._drawn[1], time.monotonic() - self._drawn[0]
        if self._parts:
            self._draw(self._parts.pop(0))
        elif now >= max(REFRESH_MS * 1e-3, (1 + RESTS) * used):
            self._drawn = (time.monotonic(), time.thread_time())
            self._draw(self._look)
        self._wait_to_close()

    def refresh(self) -> None:
        """Draw the newest answer of the source, all parts of it, and ask for the next."""
        self._draw(self._look)
        while self._parts:
            self._draw(self._parts.pop(0))

    def _draw(self, part: Callable[[], None]) -> None:
        """Draw a part; an error becomes a sentence, the window goes on."""
        try:
            part()
        except Exception as error:
            self._report(
                f"The window could not draw the run ({type(error).__name__}: {error}); the run"
                " itself goes on."
            )

    def _look(self) -> None:
        self._say_failures()
        if self._reader is None:
            return
        answer = self._reader.take()
        if answer is not None:
            self._show(answer)
        elif self._reader.silent_s() > SILENT_S:
            self._report(
                f"The run has not answered for {self._reader.silent_s():.0f} s; STOP MOTION still"
                " works."
            )
        if self.outcome() is None:  # after that nothing changes
            self._reader.ask()

    def _show(self, answer: Answer) -> None:
        if answer.problem:
            self._report(answer.problem)
        elif self._reported:
            self._reported = False
            self.notice.retract()
        if answer.scene is not None and answer.scene is not self._shown_scene:
            self._shown_scene = answer.scene
            self.top.title.setText(answer.scene.title)
            self.setWindowTitle(f"{answer.scene.title} – SlipScope")
            self.interface.show_scene(answer.scene)
            self.curves.show_scene(answer.scene)
        if answer.view is None or answer.problem:
            return
        ended_now = answer.view.ended and not (self._view and self._view.ended)
        self._view = answer.view
        self.top.show_state(answer.view.state, answer.view.tone, answer.view.phase)
        self.top.sentence.setText(answer.view.sentence)
        self._show_buttons()
        self.playback.refresh()
        view = answer.view
        views = (
            self.interface.show_view,
            *self.curves.parts,
            self.result.show_view,
            self.health.show_view,
        )
        self._parts = [
            *(partial(show, view) for show in views),
            partial(self.readouts.show_cells, view.readouts),
        ]
        if ended_now and not self.notice.is_alarm:
            self.notice.clear()  # how it ended stands beside the badge

    def _report(self, sentence: str) -> None:
        """A trouble with reading or drawing; taken back when it is over."""
        self._reported = True
        self.notice.say(sentence)

    def _say_failures(self) -> None:
        while self._failures:
            self.notice.say(self._failures.pop(0), is_alarm=True)
            self._closing_for_ms = None  # an alarm must be seen: the window stays

    # ------------------------------------------------------------------ the run behind the window

    def _is_running(self) -> bool:
        return self._started and not (self._view is not None and self._view.ended)

    def _prepare(self) -> None:
        """A new source from `make_source`, attached; a sentence where there is none."""
        if self._make_source is None:
            return
        try:
            self._attach(self._make_source())
        except Exception as error:
            self.notice.say(f"No run could be prepared: {error}")

    def _attach(self, source: RunSource) -> None:
        """Look at `source` from now on; answers still to come from an earlier one go nowhere."""
        if self._reader is not None:
            self._reader.close()
        self._source, self._started, self._is_fresh, self._view = source, False, True, None
        self._reader = Reader(source)
        self.playback.attach(source)
        self._reader.ask()
        self._show_buttons()

    def _in_background(self, failed: str, act: Callable[[RunSource], None]) -> None:
        source = self._source
        if source is None:
            return

        def work() -> None:
            try:
                act(source)
            except Exception as error:
                self._failures.append(f"{failed}: {error}")

        threading.Thread(target=work, name="slipscope-window-stop", daemon=True).start()

    def _show_buttons(self) -> None:
        ended = self._view is not None and self._view.ended
        self.top.start.setEnabled(
            not self._is_running()
            and (not self._started or (ended and self._make_source is not None))
        )
        self.top.stop.setEnabled(self._is_running())

    # ------------------------------------------------------------------ closing

    def closeEvent(self, event: QCloseEvent) -> None:
        """Close at once when nothing runs; else ask in the window itself, where STOP MOTION stays
        within reach.
        """
        if self._is_running() and not self._must_close:
            event.ignore()
            if self._closing_for_ms is None:
                self.notice.ask(
                    "A run is going on.", "Stop the motion and close", self.close_after_run
                )
            return
        self._timer.stop()
        if self._reader is not None:
            self._reader.close()
        event.accept()
        self.closed.emit()

    def _wait_to_close(self) -> None:
        if self._closing_for_ms is None:
            return
        self._closing_for_ms += TICK_MS
        if not self._is_running() or self._closing_for_ms > GIVE_UP_S * 1e3:
            self._close_now()

    def _close_now(self) -> None:
        self._must_close = True
        self.close()

    # ------------------------------------------------------------------ building

    def _build(self) -> None:
        self.top, self.notice = TopBar(), Notice()
        self.interface, self.result = InterfaceView(), ResultPanel()
        self.readouts, self.curves, self.health = CellRow(), CurvesView(), HealthStrip()
        self.playback = PlaybackBar()
        split = QSplitter(Qt.Orientation.Horizontal)
        split.setHandleWidth(8)
        split.setChildrenCollapsible(False)
        for parts in (
            ((self.interface, 1), (self.result, 0)),
            ((self.readouts, 0), (self.curves, 1)),
        ):
            side = QWidget()
            layout = QVBoxLayout(side)
            layout.setContentsMargins(0, 0, 0, 0)
            layout.setSpacing(8)
            for part, stretch in parts:
                layout.addWidget(part, stretch)
            split.addWidget(side)
        split.setSizes([880, 720])
        body = QWidget()
        body.setObjectName("body")
        layout = QVBoxLayout(body)
        layout.setContentsMargins(8, 8, 8, 8)
        layout.setSpacing(8)
        layout.addWidget(self.top)
        layout.addWidget(self.notice)
        layout.addWidget(split, 1)
        layout.addWidget(self.playback)
        layout.addWidget(self.health)
        self.setCentralWidget(body)
        self.resize(1600, 960)
        self.top.start.clicked.connect(self.begin)
        self.top.stop.clicked.connect(self.end_run)
        # on the way down: a held button has stopped the motion already
        self.top.stop_motion.pressed.connect(self.stop_motion)
        self._shortcut(Qt.Key.Key_Escape, self.stop_motion)
        self._shortcut(Qt.Key.Key_F5, self.begin)
        self._shortcut("Ctrl+Q", self.close)
        for key, act in (
            (Qt.Key.Key_Space, "toggle"),
            (Qt.Key.Key_Right, "go_forward"),
            (Qt.Key.Key_Left, "go_back"),
        ):
            self._shortcut(key, getattr(self.playback, act)).setAutoRepeat(act != "toggle")
        self.playback.acted.connect(self._hurry)

    def _hurry(self) -> None:
        """Look at once: the operator asked to see another frame."""
        self._drawn = (0.0, time.thread_time())
        if self._reader is not None:
            self._reader.ask()

    def _shortcut(self, key: Qt.Key | str, act: Callable[[], object]) -> QShortcut:
        shortcut = QShortcut(QKeySequence(key), self)
        shortcut.setContext(Qt.ShortcutContext.ApplicationShortcut)
        shortcut.setAutoRepeat(False)
        shortcut.activated.connect(act)
        return shortcut
