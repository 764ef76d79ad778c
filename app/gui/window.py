"""The operator's window: it shows a run ten times a second, and can stop the motion at any time."""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable
from functools import partial

from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtGui import QCloseEvent, QKeySequence, QShortcut
from PySide6.QtWidgets import QMainWindow, QSplitter, QWidget

from app.gui import theme
from app.gui.image_view import InterfaceView
from app.gui.notice import Notice
from app.gui.panels import CellRow, HealthStrip, ResultPanel, TopBar
from app.gui.playback_bar import PlaybackBar
from app.gui.plots import CurvesView
from app.gui.reader import Answer, ViewReader
from app.gui.source import RunSource, Setup
from app.gui.view_state import ViewState
from app.gui.widgets import column
from app.records import Outcome

LOG = logging.getLogger(__name__)
TICK_MS = 15  # one part of the window is drawn per tick, so that a key waits for one part at most
REFRESH_S = 0.1  # from the beginning of one redraw to the next
# after a redraw the window rests this many times as long as it took, the longer the more often
# frames wait for the analysis: it needs the core
RESTS, MOST_RESTS, MOST_BEHIND = 3.0, 10.0, 2
SILENT_S = 1.0  # a source that takes longer to answer is reported
GIVE_UP_S = 10.0  # how long a closing window waits for the run to end


class MainWindow(QMainWindow):
    """One operator, one window, one run after the other.

    Parameters
    ----------
    source : RunSource, optional
        The run or the replay that Start begins.
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
        self._source: RunSource | None = None
        self._reader: ViewReader | None = None
        self._started = False  # the source was started
        self._is_fresh = False  # the source was neither started nor stopped
        self._setup: Setup | None = None
        self._view: ViewState | None = None
        self._close_by: float | None = None  # end of the wait for the run, once closing was ordered
        self._must_close = False
        self._reported = False  # the notice shows a trouble with reading or drawing
        self._logged = ""  # the last trouble with drawing that was logged
        # when the last redraw began, by the clock and in processor time of this thread
        self._drawn = (0.0, 0.0)
        self._rests = RESTS
        self._sparing = 1  # the time between redraws is so many times as long
        self._parts: deque[Callable[[], None]] = deque()  # of the redraw under way, not yet drawn
        self._failures: deque[str] = deque()  # sentences from other threads
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
            LOG.warning("the run did not start", exc_info=error)
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
        """Stop the actuator now.

        This is done in a thread of its own, so that neither the window nor a slow device can delay
        it.
        """
        if self._source is None:
            self.notice.say("STOP MOTION: no bench is connected, so this program moves nothing.")
            return
        self._is_fresh = False  # a run that was stopped before it began does not begin
        self.notice.say("STOP MOTION was sent to the actuator.")
        failed = "STOP MOTION FAILED, cut the actuator's power"
        self._in_background(failed, lambda source: source.stop_motion())

    def answer(self) -> None:
        """Answer the question of the run, if it has one."""
        self._in_background("The answer could not be sent", lambda source: source.answer("yes"))

    def close_after_run(self) -> None:
        """Stop the motion, wait until the run has saved its data, then close.

        A second call closes at once.
        """
        if self._close_by is not None or not self._is_running() or self._stays():
            self._close_now()
            return
        self._close_by = time.monotonic() + GIVE_UP_S
        self.notice.clear()
        self.stop_motion()
        self.notice.say("Closing: the motion is stopped and the run is saving its data.")

    def outcome(self) -> Outcome | None:
        """How the run ended; None until then."""
        return self._view.outcome if self._view else None

    @property
    def source(self) -> RunSource | None:
        """The run that this window shows."""
        return self._source

    # ------------------------------------------------------------------ drawing

    def _tick(self) -> None:
        """Draw the next part, or begin a redraw if the last one has been rested from.

        What a redraw has used of this thread's time includes the painting by Qt.
        """
        used, since = time.thread_time() - self._drawn[1], time.monotonic() - self._drawn[0]
        if self._parts:
            self._draw(self._parts.popleft())
        elif since >= max(REFRESH_S * self._sparing, (1 + self._rests) * used):
            self._drawn = (time.monotonic(), time.thread_time())
            self._draw(self._look)
        if self._close_by is not None and (
            not self._is_running() or time.monotonic() > self._close_by
        ):
            self._close_now()

    def _draw(self, part: Callable[[], None]) -> None:
        """Draw a part; an error becomes a sentence, and the window goes on."""
        try:
            part()
        except Exception as error:
            what = f"{type(error).__name__}: {error}"
            if what != self._logged:  # once, not at every redraw
                self._logged = what
                LOG.warning("the window could not draw the run", exc_info=error)
            self._report(f"The window could not draw the run ({what}); the run itself goes on.")

    def _look(self) -> None:
        """Take the newest answer of the source, and request the next."""
        while self._failures:
            self.notice.say(self._failures.popleft(), is_alarm=True)
            self._close_by = None  # the window stays, for an alarm must be seen
        if self._reader is None:
            return
        answer, silent_s = self._reader.take(), self._reader.silent_s()
        if answer is not None:
            self._show(answer)
        elif silent_s > SILENT_S:
            self._report(f"The run has not answered for {silent_s:.0f} s; STOP MOTION still works.")
        if self.outcome() is None:  # nothing changes any more after the end
            self._reader.is_shown = self.isVisible() and not self.isMinimized()
            self._reader.request()

    def _show(self, answer: Answer) -> None:
        """Show what is small at once, and put the plots in line to be drawn."""
        if answer.problem:
            self._report(answer.problem)
        elif self._reported:
            self._reported = False
            self.notice.retract()
        if answer.setup is not None and answer.setup is not self._setup:
            self._setup = answer.setup
            self.top.title.setText(answer.setup.title)
            self.setWindowTitle(f"{answer.setup.title} – SlipScope")
            self.interface.show_setup(answer.setup)
            self.curves.show_setup(answer.setup)
        view, before = answer.view, self._view
        if view is None or answer.problem:
            return
        self._view = view
        self._sparing = 2 if view.shed else 1
        change = 1.5 if view.behind > MOST_BEHIND else 0.97
        self._rests = min(MOST_RESTS, max(RESTS, self._rests * change))
        self.top.show_state(view.state, view.tone, view.phase)
        self.top.sentence.setText(view.sentence)
        self._show_buttons()
        self.playback.refresh()
        views = (
            self.interface.show_view,
            *self.curves.parts,
            self.result.show_view,
            self.health.show_view,
        )
        self._parts = deque(partial(show, view) for show in views)
        self._parts.append(partial(self.readouts.show_cells, view.readouts))
        if view.ended and not (before and before.ended) and not self.notice.is_alarm:
            self.notice.clear()  # how the run ended stands beside the badge

    def _report(self, sentence: str) -> None:
        """Say what is wrong with reading or drawing, until it is over."""
        self._reported = True
        self.notice.say(sentence)

    def _show_buttons(self) -> None:
        ended = self._view is not None and self._view.ended
        is_ready = not self._started or (ended and self._make_source is not None)
        self.top.start.setEnabled(is_ready and not self._is_running())
        self.top.stop.setEnabled(self._is_running())

    def _redraw_soon(self) -> None:
        """Look again at the next tick, because the operator chose another frame."""
        self._drawn = (0.0, time.thread_time())
        if self._reader is not None:
            self._reader.request()

    # ------------------------------------------------------------------ the run behind the window

    def _is_running(self) -> bool:
        return self._started and not (self._view is not None and self._view.ended)

    def _stays(self) -> bool:
        return self._source is not None and self._source.stays

    def _prepare(self) -> None:
        """Attach a new source; say why where none can be made."""
        if self._make_source is None:
            return
        try:
            self._attach(self._make_source())
        except Exception as error:
            LOG.warning("no run could be prepared", exc_info=error)
            self.notice.say(f"No run could be prepared: {error}")

    def _attach(self, source: RunSource) -> None:
        """Show `source` from now on; late answers of an earlier one are dropped."""
        if self._reader is not None:
            self._reader.close()
        self._source, self._started, self._is_fresh, self._view = source, False, True, None
        self._reader = ViewReader(source)
        self.playback.attach(source)
        self._reader.request()
        self._show_buttons()

    def _in_background(self, failed: str, act: Callable[[RunSource], None]) -> None:
        source = self._source
        if source is None:
            return

        def work() -> None:
            try:
                act(source)
            except Exception as error:
                LOG.error("%s", failed, exc_info=error)
                self._failures.append(f"{failed}: {error}")

        threading.Thread(target=work, name="slipscope-window-stop", daemon=True).start()

    # ------------------------------------------------------------------ closing

    def closeEvent(self, event: QCloseEvent) -> None:
        """Close at once when nothing runs, or what runs stays; else ask in the window, within reach
        of STOP MOTION.
        """
        if self._is_running() and not self._stays() and not self._must_close:
            event.ignore()
            if self._close_by is None:
                self.notice.ask(
                    "A run is going on.", "Stop the motion and close", self.close_after_run
                )
            return
        self._timer.stop()
        if self._reader is not None:
            self._reader.close()
        event.accept()
        self.closed.emit()

    def _close_now(self) -> None:
        self._must_close = True
        self.close()

    # ------------------------------------------------------------------ building

    def _build(self) -> None:
        self.top, self.notice, self.playback = TopBar(), Notice(), PlaybackBar()
        self.interface, self.result = InterfaceView(), ResultPanel()
        self.readouts, self.curves, self.health = CellRow(), CurvesView(), HealthStrip()
        split = QSplitter(Qt.Orientation.Horizontal)
        split.setHandleWidth(8)
        split.setChildrenCollapsible(False)
        for layout in (
            column((self.interface, 1), self.result, spacing=8),
            column(self.readouts, (self.curves, 1), spacing=8),
        ):
            side = QWidget()
            side.setLayout(layout)
            split.addWidget(side)
        split.setSizes([880, 720])
        body = QWidget()
        body.setObjectName("body")
        rows = (self.top, self.notice, (split, 1), self.playback, self.health)
        body.setLayout(column(*rows, spacing=8, margins=(8, 8, 8, 8)))
        self.setCentralWidget(body)
        self.resize(1600, 960)
        self.top.start.clicked.connect(self.begin)
        self.top.stop.clicked.connect(self.end_run)
        # a button acts on the way down: held, it has stopped the motion already
        self.top.stop_motion.pressed.connect(self.stop_motion)
        self._shortcut(Qt.Key.Key_Escape, self.stop_motion)
        self._shortcut(Qt.Key.Key_F5, self.begin)
        self._shortcut(Qt.Key.Key_F8, self.answer)
        self._shortcut("Ctrl+Q", self.close)
        self._shortcut(Qt.Key.Key_Space, self.playback.toggle)
        self._shortcut(Qt.Key.Key_Right, self.playback.go_forward, repeats=True)
        self._shortcut(Qt.Key.Key_Left, self.playback.go_back, repeats=True)
        self.playback.acted.connect(self._redraw_soon)

    def _shortcut(
        self, key: Qt.Key | str, act: Callable[[], object], *, repeats: bool = False
    ) -> None:
        shortcut = QShortcut(QKeySequence(key), self)
        shortcut.setContext(Qt.ShortcutContext.ApplicationShortcut)
        shortcut.setAutoRepeat(repeats)
        shortcut.activated.connect(act)
