"""STOP MOTION in every state of the window, with each of its four answers."""

import threading
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest
from PySide6.QtCore import Qt
from pytestqt.qtbot import QtBot
from scripted_run import ScriptedRun
from window_hands import Open, colour_of
from workshops import Makes

from app.gui import theme
from app.gui.cells import Tone
from app.gui.window import MainWindow
from app.gui.window_model import WindowModel
from app.records.bench_view import Health
from app.runs import live
from app.settings import config
from app.settings.sections import Config
from app.system.stopping import Stop, StopAnswer, at_rest, failed, not_connected, unread

ANSWERS = {
    "sent": unread("stage X", "no answer"),
    "at rest": at_rest("stage X", 12.5e-3),
    "failed": failed("stage X: it says that it moves"),
    "not connected": not_connected("the run has ended and its bench is closed"),
}
TONES = {
    Stop.SENT: Tone.WARN,
    Stop.AT_REST: Tone.GOOD,
    Stop.FAILED: Tone.BAD,
    Stop.NOT_CONNECTED: Tone.NEUTRAL,
}
FRAMES = {"background": 4, "contact": 12, "question": 12, "drive": 40, "end": 60}
QUESTION = "Is the block clean?"
each_answer = pytest.mark.parametrize("answer", ANSWERS.values(), ids=ANSWERS)


class Stopped(ScriptedRun):
    """A run whose actuator answers as it is told; it may ask a question."""

    asks = ""

    def __init__(self, answer: StopAnswer) -> None:
        super().__init__(320, 240, frames=60)
        self.says = answer

    def stop_motion(self) -> StopAnswer:
        super().stop_motion()
        return self.says

    def stop_answer(self) -> StopAnswer | None:
        return None

    def health(self) -> Health:
        return replace(super().health(), question=self.asks)


@pytest.fixture
def open_run(open_window: Open) -> Open:
    """Opens a window whose runs are made by a function, and which notes which answers it shows."""

    def make(make_run: Callable[[], Any]) -> MainWindow:
        window = open_window(model=WindowModel(Makes(make_run), Config()))
        say, window.was_said = window.notice.say_stop, []

        def say_and_look(sentence: str, tone: Tone) -> None:
            say(sentence, tone)  # it may give way to the end of the run at once
            window.was_said += [one for one in ANSWERS.values() if says(window, one)]

        window.notice.say_stop = say_and_look
        return window

    return make


def says(window: MainWindow, answer: StopAnswer) -> bool:
    """Whether the window says so, in the colour of this answer."""
    notice, tone = window.notice, TONES[answer.kind]
    colour = "#ffffff" if tone is Tone.BAD else theme.now().tones[tone]
    is_said = notice.isVisible() and notice.text.text() == answer.sentence
    return is_said and colour_of(notice) == colour


def is_shown(window: MainWindow, run: Stopped) -> bool:
    """Whether the window shows what the run is at."""
    view = window._view
    has_seen = view is not None and window.source is run and view.curves.seen == run.frame
    return has_seen and (not run.asks or view.sentence.startswith(run.asks))


def check_answer(
    qtbot: QtBot, window: MainWindow, beeps: list[str], answer: StopAnswer, key: Qt.Key
) -> None:
    """Press STOP by a key, and see the answer; only a failure is heard."""
    qtbot.keyClick(window, key)
    qtbot.waitUntil(lambda: answer in window.was_said)
    window.was_said.clear()
    assert window.notice.is_alarm == (answer.kind is Stop.FAILED)
    assert beeps == ["beep"] * (answer.kind is Stop.FAILED)


@each_answer
def test_during_a_run_and_after_its_end(
    qtbot: QtBot, open_run: Open, beeps: list[str], answer: StopAnswer
) -> None:
    """One run after the other, each stopped in another state."""
    runs: list[Stopped] = []

    def make() -> Stopped:
        runs.append(Stopped(answer))
        return runs[-1]

    window = open_run(make)
    for number, (state, frame) in enumerate(FRAMES.items()):
        beeps.clear()
        window.begin()
        assert not window.top.start.isEnabled()
        qtbot.waitUntil(lambda at=number: len(runs) > at and runs[at].started)
        run = runs[-1].at(frame)
        run.asks = QUESTION if state == "question" else ""
        qtbot.waitUntil(lambda run=run: is_shown(window, run))
        has_ended = state == "end"
        if state == "question":
            qtbot.waitUntil(lambda: window.top.sentence.text().startswith(QUESTION))
        else:
            assert window._view.phase == state
        key = Qt.Key.Key_Escape if number % 2 else Qt.Key.Key_F12
        check_answer(qtbot, window, beeps, answer, key)
        qtbot.waitUntil(lambda run=run: run.calls == ["stop_motion"])
        badge = "DONE" if has_ended else "STOPPED"  # how a run has ended is not told anew
        qtbot.waitUntil(lambda badge=badge: window.top.badge.text() == badge)
        qtbot.waitUntil(
            lambda has_ended=has_ended: (
                (window.top.sentence.text() == "STOP MOTION was pressed") != has_ended
            )
        )
        qtbot.waitUntil(window.top.start.isEnabled)


@each_answer
def test_with_a_connected_bench(
    qtbot: QtBot, open_run: Open, beeps: list[str], answer: StopAnswer
) -> None:
    """It is the bench that is stopped, also while a run is being made, which then never begins."""
    run, may_be_made = Stopped(answer), threading.Event()
    window = open_run(lambda: may_be_made.wait(60) and run)
    assert window.bench is not None
    link, calls = window.bench.link, []
    bench = SimpleNamespace(stop_motion=lambda: calls.append("stop") or answer)
    link._preview = bench
    check_answer(qtbot, window, beeps, answer, Qt.Key.Key_Escape)
    assert calls == ["stop"]
    assert window.top.badge.text() == "IDLE"
    assert window.top.start.isEnabled()

    link._preview = None
    window.notice.clear()
    beeps.clear()
    window.begin()
    link._preview = bench  # it is not let go of yet
    check_answer(qtbot, window, beeps, answer, Qt.Key.Key_Escape)
    assert calls == ["stop", "stop"]
    link._preview = None
    may_be_made.set()
    qtbot.waitUntil(lambda: window.top.badge.text() == "STOPPED")
    assert not run.started
    assert window.top.start.isEnabled()


@each_answer
def test_while_closing(qtbot: QtBot, open_run: Open, beeps: list[str], answer: StopAnswer) -> None:
    """STOP at the question whether to close; a yes stops first, and a stop that fails keeps the
    window open.
    """
    first, second = Stopped(answer), Stopped(answer)
    runs = iter((first, second))
    window = open_run(lambda: next(runs))
    window.begin()
    qtbot.waitUntil(lambda: window._view is not None)
    window.close()
    assert window.notice.is_question
    qtbot.waitUntil(window.notice.no.hasFocus)
    check_answer(qtbot, window, beeps, answer, Qt.Key.Key_Escape)
    assert window.isVisible()
    qtbot.waitUntil(lambda: window.top.badge.text() == "STOPPED")

    qtbot.waitUntil(window.top.start.isEnabled)
    window.begin()
    qtbot.waitUntil(lambda: second.started and is_shown(window, second))
    window.close()
    assert not second.called.is_set()
    qtbot.keyClick(window.notice.no, Qt.Key.Key_Backtab)
    qtbot.keyClick(window.notice.yes, Qt.Key.Key_Space)
    assert second.called.wait(60)
    qtbot.waitUntil(lambda: not window.isVisible() or says(window, answer))
    if answer.kind is Stop.FAILED:
        assert window.isVisible()
        assert window.notice.is_alarm
    else:
        qtbot.waitUntil(lambda: not window.isVisible())


def test_a_second_run_that_is_stopped_while_it_is_made_has_an_end(
    qtbot: QtBot, open_run: Open, tmp_path: Any
) -> None:
    """The run that was called off is told as such, in place of the first, and Start makes a
    third.
    """
    settings = config.load(None, ("camera.width=160", "camera.height=120", "dic.box=20"))
    first, third = Stopped(ANSWERS["at rest"]), Stopped(ANSWERS["at rest"])
    second = live.make_run(settings, tmp_path / "x.h5", pace=None)
    runs, may_be_made = iter([first, second, third]), threading.Event()
    window = open_run(lambda: may_be_made.wait(60) and next(runs))
    may_be_made.set()
    window.begin()
    qtbot.waitUntil(lambda: first.started)
    first.at(60)
    qtbot.waitUntil(lambda: window.top.badge.text() == "DONE")

    may_be_made.clear()
    window.begin()
    assert window.top.badge.text() == "MAKING READY"
    assert window.strip.progress.value() == 0
    assert window.strip.sentence.text() == "The run is being made ready."
    qtbot.keyClick(window, Qt.Key.Key_Escape)
    may_be_made.set()
    qtbot.waitUntil(lambda: window.source is second and window.outcome() is not None)
    assert window.top.badge.text() == "STOPPED"
    told = "The run was stopped before it began: STOP MOTION was pressed"
    qtbot.waitUntil(lambda: window.top.sentence.text() == told)
    qtbot.waitUntil(lambda: window.result.verdict.text() == "STOPPED")
    assert not (tmp_path / "x.h5").exists()
    second.start()  # somebody may be late; it stays as it is
    assert second.wait(60) is window.outcome()

    assert window.top.start.isEnabled()
    window.begin()
    qtbot.waitUntil(lambda: third.started)
    assert window.outcome() is None
