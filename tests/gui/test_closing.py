"""Closing the window while a run goes on, is made ready, or has ended."""

import threading
from pathlib import Path
from types import SimpleNamespace

import pytest
from pytestqt.qtbot import QtBot
from scripted_run import ScriptedRun
from window_hands import Open, begin, click, finish, make_run, model_of, wait_for_words

from app.gui.window import MainWindow


def test_closing_during_a_run_asks_in_the_window_and_stops_first(
    qtbot: QtBot, window: MainWindow, run: ScriptedRun
) -> None:
    begin(qtbot, window, run, 30)
    window.close()
    assert window.isVisible()
    assert window.notice.is_question
    window.notice.no.click()
    assert not run.calls
    window.close()
    with qtbot.waitSignal(window.closed):
        window.notice.yes.click()
    assert run.calls == ["stop_motion"]
    assert window.outcome() is not None
    assert not window.isVisible()


def test_a_window_can_be_closed_while_its_run_goes_on(
    qtbot: QtBot, window: MainWindow, run: ScriptedRun
) -> None:
    begin(qtbot, window, run, 30)
    window.close()
    assert not window.notice.other.isVisible()  # it ends with this process
    window.notice.no.click()
    run.bench = SimpleNamespace(name="b-17")  # type: ignore[attr-defined]
    window.close()
    assert "slipscope attach b-17" in window.notice.text.text()
    with qtbot.waitSignal(window.closed):
        click(qtbot, window.notice.other)
    assert run.stays
    assert run.calls == []


@pytest.mark.parametrize("end", ["called off", "begins", "fails"])
def test_closing_while_a_run_is_made_ready_asks(qtbot: QtBot, open_window: Open, end: str) -> None:
    may_be_made, run = threading.Event(), make_run()

    def make() -> ScriptedRun:
        may_be_made.wait(60)
        if end == "fails":
            raise OSError("no stage")
        return run

    window = open_window(model=model_of(make))
    window.begin()
    window.close()
    assert window.isVisible()
    assert "made ready" in window.notice.text.text()
    if end == "called off":
        with qtbot.waitSignal(window.closed):
            click(qtbot, window.notice.yes)
    may_be_made.set()
    if end == "begins":
        qtbot.waitUntil(lambda: run.started)
        wait_for_words(qtbot, window, "going on")
        assert window.notice.is_question
    elif end == "fails":
        wait_for_words(qtbot, window, "no stage")
        assert not window.notice.is_question
        window.close()
        assert not window.isVisible()
    assert run.started == (end == "begins")


@pytest.mark.parametrize("what", ["run that is called off", "run of an ended one", "replay"])
def test_what_is_made_after_the_window_was_closed_neither_begins_nor_is_looked_at(
    qtbot: QtBot, open_window: Open, what: str
) -> None:
    may_be_made, run = threading.Event(), make_run()

    def make() -> ScriptedRun:
        may_be_made.wait(60)
        return run

    window = open_window(model=model_of(make))
    if what == "replay":
        window.open_session(Path("late.h5"))
    else:
        window.begin()
    with qtbot.waitSignal(window.closed):
        if what == "run that is called off":
            window.close_after_run()
        elif what == "run of an ended one":  # for whose end the window had waited
            window._close_now()
        else:
            window.close()
    readers = set(threading.enumerate())
    may_be_made.set()
    qtbot.waitUntil(lambda: window.source is run)
    assert not run.started
    assert "slipscope-window-reader" not in {t.name for t in set(threading.enumerate()) - readers}
    qtbot.waitUntil(run.called.is_set)
    assert run.calls == [run.reason]


@pytest.mark.parametrize("is_stopped", [False, True])
def test_whether_to_close_is_not_asked_any_more_once_the_run_has_ended(
    qtbot: QtBot, window: MainWindow, run: ScriptedRun, is_stopped: bool
) -> None:
    begin(qtbot, window, run, 30)
    run.outcome = lambda: None  # type: ignore[method-assign]
    if is_stopped:
        window.stop_motion()
        wait_for_words(qtbot, window, "at rest")
    answer = window.notice.text.text()
    window.close()
    assert window.notice.is_question
    del run.outcome
    finish(qtbot, window, run)
    qtbot.waitUntil(lambda: not window.notice.is_question)
    assert window.notice.isVisible() == is_stopped
    assert window.notice.stays == is_stopped
    if is_stopped:
        assert window.notice.text.text() == answer
        assert not window.notice.yes.isVisible()
