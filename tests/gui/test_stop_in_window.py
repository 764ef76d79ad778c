"""The window says what became of STOP MOTION, in each state of the run and with each answer."""

import queue
import threading
import time
from types import SimpleNamespace

import pytest
from PySide6.QtCore import Qt
from pytestqt.qtbot import QtBot
from scripted_run import ScriptedRun
from window_hands import Open, click, colour_of, finish, wait_for_end, wait_for_words
from workshops import Makes

from app.gui import theme
from app.gui.cells import Tone
from app.gui.stop_answer import NOTHING_MOVES, StopAnswers
from app.gui.window import MainWindow
from app.gui.window_model import WindowModel
from app.records.run_view import RunView
from app.settings.sections import Config
from app.system.stopping import (
    CUT_POWER,
    Stop,
    StopAnswer,
    at_rest,
    failed,
    not_connected,
    sent_to,
    unread,
)

SENT, REST = sent_to("stage X"), at_rest("stage X", 12.5e-3)
MOVES = failed("stage X: 1.5 s after the stop it says that it moves")


class Stopped(ScriptedRun):
    """A run whose actuator answers as it is told, at once and when its position was read."""

    first: StopAnswer = SENT
    later: StopAnswer | None = None  # what is read once it was pressed
    then: StopAnswer | None = None
    hangs: threading.Event | None = None
    has_returned = False

    def stop_motion(self) -> StopAnswer:
        self.then = self.later
        super().stop_motion()
        if self.hangs is not None:
            self.has_returned = self.hangs.wait(60) or True
        return self.first

    def stop_answer(self) -> StopAnswer | None:
        return self.then


@pytest.fixture
def run() -> Stopped:
    return Stopped(320, 240, frames=60)


def that_makes_runs(open_window: Open) -> tuple[MainWindow, list[Stopped]]:
    """A window, and the runs that it will have made."""
    runs: list[Stopped] = []

    def make() -> Stopped:
        runs.append(Stopped(320, 240, frames=60))
        return runs[-1]

    return open_window(model=WindowModel(Makes(make), Config())), runs


def press(qtbot: QtBot, window: MainWindow, answer: StopAnswer | None = None) -> None:
    """Press STOP MOTION, and wait for an answer if one is given."""
    qtbot.mousePress(window.top.stop_motion, Qt.MouseButton.LeftButton)
    if answer is not None:
        wait_for(qtbot, window, answer)


def says(window: MainWindow, answer: StopAnswer) -> bool:
    return window.notice.isVisible() and window.notice.text.text() == answer.sentence


def wait_for(qtbot: QtBot, window: MainWindow, answer: StopAnswer) -> None:
    qtbot.waitUntil(lambda: says(window, answer))


def test_sent_is_amber_then_at_rest_is_green_and_stays(
    qtbot: QtBot, window: MainWindow, run: Stopped, beeps: list[str]
) -> None:
    qtbot.keyClick(window, Qt.Key.Key_F5)
    qtbot.waitUntil(lambda: window._view is not None)
    parts = (window.readouts, window.interface, window.curves)
    before = [part.mapTo(window, part.rect().topLeft()) for part in parts]
    press(qtbot, window, SENT)
    qtbot.wait(50)
    assert [part.mapTo(window, part.rect().topLeft()) for part in parts] == before
    assert colour_of(window.notice) == theme.now().tones[Tone.WARN]
    run.then = REST
    run.stopped = False  # it ends later
    window._redraw_soon()
    wait_for(qtbot, window, REST)
    assert colour_of(window.notice) == theme.now().tones[Tone.GOOD]
    run.stopped = True
    wait_for_end(qtbot, window)
    assert says(window, REST)
    click(qtbot, window.notice.no)
    qtbot.wait(250)
    assert not window.notice.isVisible()
    assert not beeps


@pytest.mark.parametrize("at_once", [True, False])
def test_failed_is_red_beeps_and_stays_until_it_is_dismissed(
    qtbot: QtBot,
    window: MainWindow,
    run: Stopped,
    beeps: list[str],
    at_once: bool,
) -> None:
    run.first, run.later = (MOVES, None) if at_once else (SENT, MOVES)
    window.begin()
    press(qtbot, window)
    wait_for(qtbot, window, MOVES)
    assert window.notice.text.text().startswith(CUT_POWER)
    assert window.notice.is_alarm
    assert colour_of(window.notice) == "#ffffff"
    assert window.notice.grab().toImage().pixelColor(9, 9).name() == "#c8202b"
    assert beeps == ["beep"]
    wait_for_end(qtbot, window)
    qtbot.wait(250)
    assert says(window, MOVES)
    click(qtbot, window.notice.no)
    qtbot.wait(250)
    assert not window.notice.isVisible()


def test_a_stage_that_could_not_be_stopped_is_told_though_nobody_pressed(
    qtbot: QtBot, window: MainWindow, run: Stopped, beeps: list[str]
) -> None:
    window.begin()
    run.then = SENT
    qtbot.waitUntil(lambda: window._view is not None and window._view.stop == SENT)
    assert not window.notice.isVisible()  # a limit has stopped it, which the run says itself
    run.then = MOVES
    wait_for(qtbot, window, MOVES)
    assert beeps == ["beep"]


def test_an_actuator_that_does_not_return_is_on_its_way_and_delays_nothing(
    qtbot: QtBot, window: MainWindow, run: Stopped
) -> None:
    run.hangs = threading.Event()
    window.begin()
    press(qtbot, window)
    assert run.called.wait(60)
    assert not run.has_returned
    assert "on its way" in window.notice.text.text()
    run.then = failed("stage X: it does not return from its calls", is_final=False)
    window._redraw_soon()
    qtbot.waitUntil(lambda: window.notice.is_alarm)
    run.hangs.set()


@pytest.mark.parametrize("state", ["no source", "idle", "ended"])
def test_nothing_is_sent_where_nothing_is_connected(
    qtbot: QtBot,
    open_window: Open,
    run: Stopped,
    beeps: list[str],
    state: str,
) -> None:
    window = open_window(None if state == "no source" else run)
    run.first = not_connected("the run has ended and its bench is closed")
    expected = run.first.sentence
    if state == "no source":
        expected = "no bench is connected"
    if state == "ended":
        window.begin()
        finish(qtbot, window, run)
    qtbot.keyClick(window, Qt.Key.Key_Escape)
    wait_for_words(qtbot, window, expected)
    assert colour_of(window.notice) == theme.now().tones[Tone.NEUTRAL]
    window.toggle_theme()
    assert theme.now().name == "light"
    assert colour_of(window.notice) == theme.now().tones[Tone.NEUTRAL]
    assert not beeps


def test_the_next_run_begins_without_the_answer_to_the_last(
    qtbot: QtBot, open_window: Open
) -> None:
    window, runs = that_makes_runs(open_window)
    qtbot.keyClick(window, Qt.Key.Key_F5)
    qtbot.waitUntil(lambda: bool(runs) and runs[0].started)
    runs[0].later = REST
    press(qtbot, window)
    wait_for_end(qtbot, window)
    wait_for(qtbot, window, REST)
    qtbot.waitUntil(window.top.start.isEnabled)
    click(qtbot, window.top.start)
    qtbot.waitUntil(lambda: len(runs) == 2 and runs[1].started)
    qtbot.wait(250)
    assert not window.notice.isVisible()


def test_a_view_that_was_asked_for_before_the_press_is_no_answer_to_it(
    qtbot: QtBot, open_window: Open, run: Stopped
) -> None:
    looks, (asked, goes_on, is_taken) = run.look, (threading.Event() for _ in range(3))

    def slow_look(*seen: int, **shown: bool) -> RunView:
        view = looks(*seen, **shown)
        if view.stop is not None and not asked.is_set():
            asked.set()
            goes_on.wait(60)
        elif goes_on.is_set():  # the window takes only the newest of several
            is_taken.wait(60)
        return view

    run.look = slow_look  # type: ignore[method-assign]
    other = run.then = at_rest("stage X", 2e-3)  # of a stop that was not pressed here
    window = open_window(run)
    window.begin()
    qtbot.waitUntil(asked.is_set)
    run.first, run.later, run.outcome = SENT, SENT, lambda: None  # type: ignore[method-assign]
    press(qtbot, window, SENT)
    goes_on.set()
    qtbot.waitUntil(lambda: window._view is not None and window._view.stop == other)
    is_taken.set()
    assert says(window, SENT)
    run.then = REST
    wait_for(qtbot, window, REST)


def test_an_answer_that_comes_when_the_next_run_was_stopped_is_none_to_that(
    qtbot: QtBot, open_window: Open
) -> None:
    window, runs = that_makes_runs(open_window)
    window.begin()
    qtbot.waitUntil(lambda: bool(runs) and runs[0].started)
    first = runs[0]
    first.first, first.hangs = REST, threading.Event()
    press(qtbot, window)
    wait_for_end(qtbot, window)
    window.begin()
    qtbot.waitUntil(lambda: len(runs) == 2 and runs[1].started)
    runs[1].outcome = lambda: None  # type: ignore[method-assign]
    press(qtbot, window, SENT)
    first.hangs.set()
    qtbot.waitUntil(lambda: first.has_returned)
    runs[1].then = MOVES
    wait_for(qtbot, window, MOVES)
    assert not [text for _, text in window._logs.take() if REST.sentence in text]


@pytest.mark.parametrize("has_ended", [False, True])
def test_a_failure_is_shown_at_once_though_other_answers_come_before_it(
    qtbot: QtBot,
    window: MainWindow,
    run: Stopped,
    beeps: list[str],
    has_ended: bool,
) -> None:
    """Also by the last view of a run that has ended, after which nothing is read of it."""
    run.later = MOVES
    if not has_ended:
        run.outcome = lambda: None  # type: ignore[method-assign]
    window.begin()
    for _ in range(20):  # an operator in a hurry
        press(qtbot, window)
    qtbot.waitUntil(lambda: window._view is not None and window._view.stop == MOVES)
    assert says(window, MOVES)
    assert beeps


# ------------------------------------------------------------------ without a window


def shown(*came: StopAnswer, pressed: bool = True) -> list[StopAnswer]:
    answers = StopAnswers()
    if pressed:
        press_nothing(answers)
    return [answer for answer in came if answers.is_news(answer, time.monotonic())]


def press_nothing(answers: StopAnswers) -> tuple[StopAnswer, float]:
    """Press STOP where nothing moves; what comes of it."""
    came: queue.SimpleQueue[tuple[StopAnswer, float]] = queue.SimpleQueue()
    answers.press(None, lambda *answer: came.put(answer))
    return came.get(timeout=60)


def test_what_was_read_is_not_replaced_by_that_it_was_sent() -> None:
    assert shown(SENT, REST, SENT, REST) == [SENT, REST]
    assert shown(SENT, MOVES, SENT) == [SENT, MOVES]


def test_a_stop_that_was_refused_and_then_read_at_rest_is_at_rest() -> None:
    refused = failed("stage X: not allowed", is_final=False)
    assert shown(refused, REST) == [refused, REST]


def test_a_stop_that_fails_is_shown_though_the_stage_was_read_at_rest() -> None:
    refused = failed("bench: no answer within 5 s", is_final=False)
    assert shown(REST, refused) == [REST, refused]


def test_only_a_failure_is_shown_of_a_stop_that_nobody_asked_for_here() -> None:
    assert shown(SENT, unread("stage X", "no answer"), MOVES, pressed=False) == [MOVES]


@pytest.mark.parametrize("by", ["press", "begin"])
def test_what_was_asked_before_a_stop_or_a_run_is_an_answer_to_it_only_if_it_failed(
    by: str,
) -> None:
    answers = StopAnswers()
    _, earlier = press_nothing(answers)
    assert answers.is_news(SENT, earlier)
    if by == "press":
        answer, now = press_nothing(answers)
        assert (answer, answers.is_news(answer, now)) == (NOTHING_MOVES, True)
    else:
        answers.begin()
        now = time.monotonic()
    assert not answers.is_news(REST, earlier)
    assert answers.is_news(REST, now) == (by == "press")
    assert answers.is_news(MOVES, earlier)


def test_a_failure_of_the_next_run_is_shown_though_it_reads_as_that_of_the_last() -> None:
    answers = StopAnswers()
    assert answers.is_news(MOVES, 0.0)
    assert not answers.is_news(MOVES, 0.0)
    answers.begin()
    assert not answers.is_answered
    assert answers.is_news(MOVES, 0.0)


def test_an_exception_on_the_way_is_a_failure() -> None:
    def broken() -> StopAnswer:
        raise OSError("bench: the line is dead")

    came: queue.SimpleQueue[tuple[StopAnswer, float]] = queue.SimpleQueue()
    stopped = SimpleNamespace(stop_motion=broken)
    StopAnswers().press(stopped, lambda *answer: came.put(answer))  # type: ignore[arg-type]
    answer, _ = came.get(timeout=60)
    assert (answer.kind, answer.sentence) == (Stop.FAILED, f"{CUT_POWER}: bench: the line is dead")
