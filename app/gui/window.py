"""The operator's window: it shows a run ten times a second, and can stop the motion at any time."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable
from functools import partial
from operator import methodcaller
from pathlib import Path

from PySide6.QtCore import Qt, QTimer, Signal
from PySide6.QtGui import QCloseEvent

from app.gui import questions
from app.gui.background import Act, BackgroundWork, Take
from app.gui.base_window import BaseWindow
from app.gui.bench_link import LinkState
from app.gui.cells import Tone, tone_of
from app.gui.file_question import SESSION_FILES, ask_file
from app.gui.log_panel import LogPanel, LogStore
from app.gui.memory import LAYOUT
from app.gui.pace import Pace
from app.gui.reader import CLOSES_S, ViewReader
from app.gui.redraw_scheduler import RedrawScheduler
from app.gui.run_factory import PendingRun
from app.gui.source import as_replay, session_of
from app.gui.stop_answer import ON_ITS_WAY, StopAnswers
from app.gui.stop_key import close_open
from app.gui.view_state import ViewState
from app.gui.widgets import widget
from app.gui.window_model import WindowModel
from app.runs.run_source import Kind, RunSource
from app.system.errors import in_full
from app.system.stopping import StopAnswer

LOG = logging.getLogger(__name__)
TICK_MS, LEAST_TICK_MS = 50, 5  # from tick to tick
SILENT_S = 1.0  # a source that takes longer to answer is reported
GIVE_UP_S, ORDERS_S = 10.0, 0.5  # how long a close waits for the run, its end for earlier orders
LATER_MS = 500  # until what would take the place of a question is asked


class MainWindow(BaseWindow):
    """One operator, one window, one run after the other.

    Parameters
    ----------
    source : RunSource, optional
        A run or a replay that is shown at once, and that Start begins.
    model : WindowModel, optional
        Settings of the next run, and who makes it; without one `source` is all that is shown.
    """

    closed = Signal()

    def __init__(self, source: RunSource | None = None, model: WindowModel | None = None) -> None:
        super().__init__(model, LogStore())
        self._pending: PendingRun | None = None  # what is being made in a thread
        self._source: RunSource | None = None
        self._reader: ViewReader | None = None
        self._started = self._is_fresh = False  # it was started; neither started nor stopped
        self._is_to_end = False  # the run was asked to, which it may not say yet
        self._close_by: float | None = None  # end of the wait for the run, once closing was ordered
        self._must_close, self._pace = False, Pace()
        self._logged = ""  # the last trouble with drawing that was logged
        self._redraws = RedrawScheduler(self.interface, self._show_numbers, self._displays)
        logging.getLogger("app").addHandler(self._logs)
        self._stops, self._background = StopAnswers(), BackgroundWork(self)
        self._connect()
        self._timer = widget(QTimer, self, timerType=Qt.TimerType.PreciseTimer, timeout=self._tick)
        self._timer.start(TICK_MS)
        if source is not None:
            self._attach(source)
        else:
            self.find_run("")
        self._show_buttons()

    # ------------------------------------------------------------------ what the operator can do

    def begin(self) -> None:
        """Start the run that is ready, or make one with the settings that are set up."""
        if self._is_running() or self._pending:
            return
        self.notice.clear()
        if self._is_fresh:
            self._start()
        elif self.model is not None:
            if refusal := self.go_to_refused():
                self._refused = f"The run was not started: {refusal}"
                self.notice.say(self._refused)
                self.model.not_begun.emit()
                return
            make = partial(self.model.factory.run, self.model.config, self.model.session)
            self._make("The run", make, is_live=True)

    def _begin_unless_alarmed(self) -> None:
        if self.notice.is_alarm:  # which is seen first
            self.top.say("An alarm is shown: the next run waits for Start (F5).")
        else:
            self.begin()

    def open_session(self, session: Path | None = None) -> None:
        """Play a recorded run in place of what is shown; without a path the operator is asked."""
        if self.model is None:
            return
        if self.is_live():
            self.notice.say("A run is going on; end it before a session is opened.")
            return
        if session is None:
            ask_file(self, "Open a session", self.open_session, kinds=SESSION_FILES)
            return
        self.memory.remember("session", session)
        make = partial(self.model.factory.replay, session)
        self._make(f"The replay of {session.name}", make, is_live=False)

    def find_run(self, none: str = "No run of yours is under way on this computer.") -> None:
        """Look for runs that go on without a window, and offer the newest; else say `none`."""
        if self.model is not None:
            look, offer = self.model.factory.runs_under_way, partial(self._offer_under_way, none)
            self._background.start(look, offer, partial(LOG.warning, "runs under way: %s"))

    def _offer_under_way(self, none: str, runs: list[tuple[str, str]]) -> None:
        """Ask whether a run is to be shown that goes on without a window, as after a crash."""
        if self.notice.is_question:  # which stands under the mouse
            QTimer.singleShot(LATER_MS, self, partial(self._offer_under_way, none, runs))
        elif runs and not (self.is_live() or self._pending):
            questions.offer_run(self.notice, runs, self._show_under_way)
        elif none and not runs:
            self.notice.say(none)

    def _show_under_way(self, name: str) -> None:
        self.notice.clear()
        if self.model is not None and not (self.is_live() or self._pending):
            attach = partial(self.model.factory.attach, name)
            self._make("The run under way", attach, is_live=True)

    def _start(self) -> None:
        assert self._source is not None
        try:
            self._source.start()
        except Exception as error:
            LOG.warning("the run did not start", exc_info=error)
            self.notice.say(f"The run did not start: {error}")
            return
        self._started, self._is_fresh = True, False
        self._stops.begin()
        self.notice.give_way()
        if not self._is_replay() and self.experiment is not None:
            self._bring(self.experiment.name)
            self._bring("curves")
        self._show_buttons()
        self._redraw_soon()

    def end_run(self) -> None:
        """Ask for an orderly end of the run."""
        self._call_end()
        why = "the operator ended the run"
        self._request_end("The run could not be asked to end", why, ORDERS_S)

    def stop_motion(self) -> None:
        """Stop the actuator now, and show what became of it."""
        preview = self.bench.preview if self.bench and not self._is_running() else None
        own, tell = self._source, self._background.tell
        stopped = own if preview is None else preview
        asked_at = self._stops.press(
            stopped,
            lambda *came: tell(partial(self._show_stop, *came)),
            partial(self.model.factory.stop_others, own) if self.model else lambda: None,
            lambda beside: tell(partial(self._say, beside.sentence, beside.has_failed)),
        )
        if self._pending is not None:
            self._pending.is_stopped = True
        self._is_fresh = False  # a run that was stopped before it began does not begin
        self._call_end()
        if stopped is not None:
            self._show_stop(ON_ITS_WAY, asked_at)

    def stop_or_close(self) -> None:
        """Stop whatever can move, and close the list or the dialog that is open; where one is open
        and nothing of this window can move, nothing is sent.
        """
        has_bench = self.bench is not None and self.bench.link.phase is not LinkState.OFF
        if not close_open() or has_bench or self.is_live():
            self.stop_motion()

    def answer(self) -> None:
        """Answer the question that is shown, if the run still asks it: as typed, else yes."""
        if self._view is not None and (asked := self._view.steps.question):
            text = self.experiment.taken_answer() if self.experiment else "yes"
            self._in_background("The answer could not be sent", methodcaller("answer", text, asked))

    def close_after_run(self) -> None:
        """Stop the motion, wait until the run has saved its data, then close; a run that is being
        made never begins.

        A second call closes at once.
        """
        if self._pending is not None:
            self._pending.is_stopped = True
        if self._close_by is not None or not self._is_running() or self._stays():
            self._close_now()
            return
        self._close_by = time.monotonic() + GIVE_UP_S
        self.notice.clear()
        self.stop_motion()

    def report_exception(self, error: Exception) -> None:
        """Say that something went wrong that nobody expected, and log it; from any thread."""
        if (what := in_full(error)) == self._logged:  # once, not at every look
            return
        self._logged = what
        LOG.error("something in the program went wrong", exc_info=error)
        self._background.tell(partial(self._say, questions.unexpected(what), False))

    def is_live(self) -> bool:
        """Whether a run on a bench goes on, or is being made."""
        if self._pending is not None:
            return self._pending.is_live
        return self._is_running() and not self._is_replay()

    @property
    def source(self) -> RunSource | None:
        """The run that this window shows."""
        return self._source

    # ------------------------------------------------------------------ drawing

    def _tick(self) -> None:
        """Look at the run if the last redraw has been rested from."""
        self.stop_key.watch_keys()
        now = time.monotonic()
        if self._pace.left_s(now) <= 0:
            self._pace.begin(now)
            self._draw(self._look)
        ms = math.ceil(1e3 * self._pace.left_s(now))
        self._timer.setInterval(TICK_MS if ms >= 1.5 * TICK_MS else max(LEAST_TICK_MS, ms))
        is_over = not (self._is_running() or self._stops.is_waiting)
        if self._close_by is not None and (is_over or time.monotonic() > self._close_by):
            self._background.tell(self._close_unless_alarmed)  # after the answers that have come

    def _draw(self, part: Act) -> None:
        """Draw a part; an error becomes a sentence, and the window goes on."""
        try:
            part()
        except Exception as error:
            if (what := in_full(error)) != self._logged:  # once, not at every redraw
                self._logged = what
                LOG.warning("the window could not draw the run", exc_info=error)
            self._report(f"The window could not draw the run ({what}); the run itself goes on.")

    def _look(self) -> None:
        """See to all that is not the run's, and ask the source for what is to be drawn."""
        if self.docks.if_made(LogPanel.name):
            self.log.look()
        if self._refused and self.setup and not self.setup.refusal():
            self.notice.retract(self._refused)
            self._refused = ""
        if self._reader is None:
            return
        silent_s = self._reader.silent_s()
        if silent_s > SILENT_S:
            self._report(f"The run has not answered for {silent_s:.0f} s; STOP MOTION still works.")
        if self.outcome() is None:  # nothing changes any more after the end
            self._reader.is_shown = self.isVisible() and not self.isMinimized()
            self._reader.display = self.interface.canvas.display
            self._reader.request()

    def _take(self) -> None:
        """Show what the source has answered."""
        answer = self._reader.take() if self._reader is not None else None
        if answer is None:
            return
        if answer.problem:
            self._report(answer.problem)
        elif self._reported:
            self.notice.retract(self._reported)
            self._reported = ""
        if answer.setup is not None and answer.setup is not self._setup:
            self.show_setup(answer.setup)
        view, before = answer.view, self._view
        if view is None or answer.problem:
            return
        self._view, had_ended = view, before is not None and before.ended
        if not had_ended:  # what the run says at its end, it says of all stops
            self._show_stop(view.stop, time.monotonic() if view.ended else view.at_s)
        self._pace.follow(view)
        if view.ended or not self._is_to_end:
            self.top.show_state(view.badge, view.tone, view.phase)
        if before is None or had_ended != view.ended:
            self._show_buttons()
        self._draw(self.playback.refresh)
        self._draw_all(self._redraws.of(view))
        if view.ended and not had_ended:
            self._say_ended(view)
            if not (self.notice.stays or self._stops.is_answered):
                self.notice.clear()  # how the run ended stands beside the badge

    def _call_end(self) -> None:
        """Let all parts know that the operator has called for the end of a run, and show it."""
        if self.model is not None:
            self.model.stop_pressed.emit()
        self._is_to_end = self.is_live()
        if self._is_to_end:
            self.top.show_state("stopping", Tone.BUSY, self._view.phase if self._view else "")

    def _draw_all(self, parts: list[Callable[[ViewState], None]]) -> None:
        if self._view is not None:
            for show in parts:
                self._draw(partial(show, self._view))

    def _show_stop(self, answer: StopAnswer | None, asked_at: float) -> None:
        """Show an answer to a stop if it is news; that one has failed cannot be missed."""
        if answer is None or not self._stops.is_news(answer, asked_at):
            return
        self.notice.say_stop(answer.sentence, tone_of(answer.kind))
        self._logs.say(answer.sentence, is_trouble=answer.has_failed)
        if answer.has_failed:
            self._close_by, self._is_to_end = None, False  # the window stays, so that it is seen
            self.ring()

    def _say(self, sentence: str, is_alarm: bool) -> None:
        """Say a sentence; an alarm is heard, too, and keeps the window open."""
        self.notice.say(sentence, is_alarm=is_alarm)
        self._logs.say(sentence, is_trouble=is_alarm)
        if is_alarm:
            self._close_by = None
            self.ring()

    def _say_ended(self, view: ViewState) -> None:
        """Tell the log and the model that a run has ended; a failure is heard."""
        assert view.outcome is not None
        has_failed = view.outcome.state == "failed"
        if view.kind is Kind.LIVE:
            self.readouts.end(view.readouts)
        if self._close_by is None:
            self.notice.take_back_question()  # whether to close during the run
        self._logs.say(f"{view.state}: {view.outcome.reason}", is_trouble=has_failed)
        if has_failed:
            self.ring()
        if self.model is not None:
            self.model.ended.emit(self._source)
            purpose = getattr(self._source, "config", self.model.config).run.purpose
            self._bring("calibration" if purpose == "calibration" else self.result.name)

    def _show_buttons(self) -> None:
        is_running = self._is_running()
        can_begin = (self._is_fresh or self.model is not None) and not self._pending
        for name, is_possible in (
            ("begin", can_begin and not is_running),
            ("end_run", is_running),
            ("open_session", self.model is not None and not self.is_live()),
            ("find_run", self.model is not None and not self.is_live()),
        ):
            self.actions_by_name[name].setEnabled(is_possible)
        if self.model is not None:
            self.model.set_busy(is_running or self._pending is not None, is_live=self.is_live())

    def _choose_point(self, x_px: float, y_px: float) -> None:
        """Let the curves show the history of a place in the picture."""
        if self._reader is not None:
            self._reader.point_px = x_px, y_px
            self._redraw_soon()

    def _redraw_soon(self) -> None:
        """Look again now, because the operator chose another frame."""
        self._pace.hurry()
        if self._reader is not None:
            self._reader.request(anew=True)

    # ------------------------------------------------------------------ the run behind the window

    def _is_running(self) -> bool:
        return self._started and not (self._view is not None and self._view.ended)

    def _stays(self) -> bool:
        return self._pending is None and self._source is not None and self._source.stays

    def _is_replay(self) -> bool:
        return as_replay(self._source) is not None

    def _make(self, what: str, make: Callable[[], RunSource], *, is_live: bool) -> None:
        """Make a source in a thread, then show and begin it; say why where it cannot be made."""
        assert self.model is not None
        making, not_begun = PendingRun(is_live), self.model.not_begun
        self._pending = making
        self.notice.give_way()
        self.show_making(what)
        self._show_buttons()

        def failed(why: str) -> None:
            self._pending = None
            self.notice.take_back_question()
            LOG.warning("%s could not be made: %s", what, why)
            self._say(f"{what} could not be made: {why}", False)
            self.show_making("")
            self._show_buttons()
            not_begun.emit()

        self._background.start_anew(make, partial(self._take_made, making), failed)

    def _take_made(self, making: PendingRun, source: RunSource) -> None:
        """Show what was made, and begin it unless STOP was pressed, or the window closed, since."""
        self._pending, is_open = None, self._timer.isActive()
        was_asked = self.notice.is_question  # whether to close; a run that begins is another matter
        self.notice.take_back_question()
        if is_open:
            self._attach(source)
        self._source = source
        if making.is_stopped or not is_open:
            self._started = self._is_to_end = source.stays  # one that is under way still ends
            self._is_fresh = False
            self._show_buttons()
            self._request_end("The run could not be called off", "STOP MOTION was pressed")
        else:
            self._start()
            if was_asked:
                self.close()

    def _attach(self, source: RunSource) -> None:
        """Show `source` from now on; late answers of an earlier one are dropped."""
        if self._is_running() and self._is_replay():
            self.end_run()
        if self._reader is not None:
            self._reader.close()
        self._source, self._started, self._is_fresh, self._view = source, False, True, None
        self._is_to_end = False
        answered = partial(self._background.tell, partial(self._draw, self._take))
        self._reader = ViewReader(source, answered, self.interface.prepare)
        self.playback.attach(source)
        self.follow(session_of(source))
        self._reader.request()
        self._show_buttons()

    def _in_background(
        self, failed: str, act: Take, patience_s: float | None = None, *, is_end: bool = False
    ) -> None:
        def say(why: str) -> None:
            LOG.error("%s: %s", failed, why)
            self._is_to_end &= not is_end
            self._say(f"{failed}: {why}", True)

        if self._source is not None:
            order = partial(act, self._source), lambda _: None, say
            self._background.start(*order, in_order=True, patience_s=patience_s)

    def _request_end(self, failed: str, why: str, patience_s: float | None = None) -> None:
        self._in_background(failed, methodcaller("request_stop", why), patience_s, is_end=True)

    # ------------------------------------------------------------------ closing

    def closeEvent(self, event: QCloseEvent) -> None:
        """Close at once when nothing runs, or what runs stays; else ask in the window, within reach
        of STOP MOTION.
        """
        if self.is_live() and not (self._stays() or self._must_close):
            event.ignore()
            if self._close_by is None:
                leave = getattr(getattr(self._source, "bench", None), "name", ""), self._leave
                is_made = self._pending is not None
                questions.ask_to_close(self.notice, self.close_after_run, leave, is_made=is_made)
            return
        self._timer.stop()
        if self._reader is not None:
            self._reader.close(CLOSES_S)
        logging.getLogger("app").removeHandler(self._logs)
        self.memory.keep_layout(self.docks.kind, self.saveGeometry(), self.saveState(LAYOUT))
        event.accept()
        self.closed.emit()

    def _leave(self) -> None:
        """Close the window, and let its run go on."""
        assert self._source is not None
        self._source.stays = True
        self._close_now()

    def _close_unless_alarmed(self) -> None:
        if self._close_by is not None:
            self._close_now()

    def _close_now(self) -> None:
        self._must_close = True
        self.close()

    # ------------------------------------------------------------------ wires

    def _connect(self) -> None:
        self.playback.acted.connect(self._redraw_soon)
        self.playback.said.connect(self._say)
        self.interface.chosen.connect(self._choose_point)
        for dock in self.docks.by_name.values():
            dock.visibilityChanged.connect(lambda _: self._draw_all(self._redraws.others()))
        if self.model is not None:
            self.model.said.connect(self._say)
            self.model.asked.connect(self.notice.ask)
            self.model.noted.connect(partial(self._logs.say, is_trouble=False))
            self.model.begin_asked.connect(self._begin_unless_alarmed)
            self.model.ordered.connect(self._in_background)
            self.model.session_asked.connect(self.open_session)
