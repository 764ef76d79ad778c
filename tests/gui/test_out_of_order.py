"""What is asked and answered in another order, or later, than an operator expects."""

import threading
from pathlib import Path
from typing import Any

import pytest
from pytestqt.qtbot import QtBot
from scripted_run import ScriptedRun
from window_hands import (
    Open,
    begin,
    click,
    make_run,
    model_of,
    wait_for_end,
    wait_for_frame,
    wait_for_words,
)
from workshops import Makes

from app.gui.notice import Notice
from app.gui.reader import ViewReader
from app.gui.window import MainWindow
from app.gui.window_model import WindowModel
from app.records.run_view import RunView
from app.settings.sections import Config
from app.system.stopping import Stop, StopAnswer, at_rest, failed


class Slow(Makes):
    """Makes each source when that is allowed, by the name that it has."""

    def __init__(self) -> None:
        super().__init__(lambda: None)
        self.may: dict[str, threading.Event] = {}
        self.made: dict[str, ScriptedRun] = {}

    def _made(self, name: str) -> ScriptedRun:
        assert self.may.setdefault(name, threading.Event()).wait(60)
        self.made[name] = make_run(title=name)
        return self.made[name]

    def run(self, config: Config, session: Path | None) -> Any:
        return self._made("run")

    def replay(self, session: Path) -> Any:
        return self._made(session.stem)

    def attach(self, name: str) -> Any:
        assert self.may.setdefault(name, threading.Event()).wait(60)
        return self.made[name]

    def let(self, name: str) -> None:
        self.may.setdefault(name, threading.Event()).set()


@pytest.fixture
def shop() -> Slow:
    return Slow()


@pytest.fixture
def shop_window(open_window: Open, shop: Slow) -> MainWindow:
    """A window whose runs and replays come from there."""
    return open_window(model=WindowModel(shop, Config()))  # type: ignore[arg-type]


def test_a_session_does_not_take_the_place_of_a_run_that_is_being_made(
    qtbot: QtBot, shop_window: MainWindow, shop: Slow
) -> None:
    shop_window.begin()
    assert not shop_window.actions_by_name["open_session"].isEnabled()
    shop.let("old")
    shop_window.open_session(Path("old.h5"))
    assert "A run is going on" in shop_window.notice.text.text()
    shop.let("run")
    qtbot.waitUntil(lambda: "run" in shop.made and shop.made["run"].started)
    qtbot.wait(100)
    assert shop_window.source is shop.made["run"]
    assert "old" not in shop.made


@pytest.mark.parametrize("first", ["a", "b"])
def test_of_two_sessions_the_one_that_was_asked_for_last_is_played(
    qtbot: QtBot, shop_window: MainWindow, shop: Slow, first: str
) -> None:
    for name in ("a", "b"):
        shop_window.open_session(Path(f"{name}.h5"))
    for name in (first, "a", "b"):
        shop.let(name)
        qtbot.waitUntil(lambda name=name: name in shop.made)
        qtbot.wait(50)
    qtbot.waitUntil(lambda: shop_window.source is shop.made["b"])
    assert shop.made["b"].started
    assert not shop.made["a"].started
    assert shop_window._pending is None


@pytest.mark.parametrize("by", ["stop_motion", "end_run"])
def test_the_badge_says_at_the_press_that_a_run_is_to_end_until_it_has(
    qtbot: QtBot, window: MainWindow, run: ScriptedRun, by: str
) -> None:
    goes_on = threading.Event()

    def request_stop(reason: str) -> None:
        goes_on.wait(60)

    rest = at_rest("stage X", 2e-3)
    run.stop_motion = lambda: goes_on.wait(60) and rest  # type: ignore[method-assign, assignment]
    run.request_stop = request_stop  # type: ignore[method-assign]
    begin(qtbot, window, run, 30)
    assert window.top.badge.text() == "RUNNING"
    getattr(window, by)()
    assert window.top.badge.text() == "STOPPING"
    run.at(31)
    wait_for_frame(qtbot, window, 31)
    assert window._view is not None
    assert window._view.badge == "RUNNING"  # as the run still says
    assert window.top.badge.text() == "STOPPING"
    run.at(60)
    qtbot.waitUntil(lambda: window.top.badge.text() == "DONE")
    goes_on.set()


@pytest.mark.parametrize("by", ["stop_motion", "end_run"])
def test_the_badge_says_what_the_run_is_at_where_it_could_not_be_asked_to_end(
    qtbot: QtBot, window: MainWindow, run: ScriptedRun, by: str
) -> None:
    def request_stop(reason: str) -> None:
        raise OSError("the line is dead")

    run.request_stop = request_stop  # type: ignore[method-assign]
    run.stop_motion = lambda: failed(OSError("the line is dead"))  # type: ignore[method-assign]
    begin(qtbot, window, run, 30)
    getattr(window, by)()
    wait_for_words(qtbot, window, "the line is dead")
    run.at(31)
    qtbot.waitUntil(lambda: window.top.badge.text() == "RUNNING")


def test_an_order_that_fails_while_a_run_is_to_end_leaves_the_badge_alone(
    qtbot: QtBot, window: MainWindow, run: ScriptedRun
) -> None:
    def note(source: object) -> None:
        raise OSError("the note is lost")

    run.request_stop = lambda reason: None  # type: ignore[method-assign]
    begin(qtbot, window, run, 30)
    window.end_run()
    window._in_background("The note could not be recorded", note)
    wait_for_words(qtbot, window, "the note is lost")
    run.at(31)
    wait_for_frame(qtbot, window, 31)
    assert window.top.badge.text() == "STOPPING"


def test_a_look_that_is_asked_for_during_a_look_follows_it() -> None:
    """Nothing else asks for one after the end of a run."""
    begins, goes_on, answered = (threading.Semaphore(0) for _ in range(3))
    run = make_run()
    look = run.look

    def slow(*asked: int, **shown: bool) -> RunView:
        begins.release()
        assert goes_on.acquire(timeout=60)
        return look(*asked, **shown)

    run.look = slow  # type: ignore[method-assign]
    reader = ViewReader(run, answered.release, lambda view: None)
    reader.request()
    assert begins.acquire(timeout=60)
    reader.request()  # of a tick, for which the look under way is enough
    reader.request(anew=True)
    for _ in range(2):
        goes_on.release()
        assert answered.acquire(timeout=60)
    assert begins.acquire(timeout=60)
    assert not begins.acquire(timeout=0.1)
    reader.request()
    goes_on.release()
    assert answered.acquire(timeout=60)
    reader.close()


def test_only_what_was_said_is_taken_back(qtbot: QtBot) -> None:
    notice = Notice()
    qtbot.addWidget(notice)
    notice.say("the run is silent")
    notice.say("the campaign waits")
    notice.retract("the run is silent")
    assert notice.text.text() == "the campaign waits"
    notice.retract("the campaign waits")
    assert not notice.text.text()


def test_a_question_that_is_answered_is_asked_no_more(qtbot: QtBot) -> None:
    notice, answers = Notice(), []
    qtbot.addWidget(notice)
    notice.ask("Is the way free?", "It is free, search", lambda: answers.append("free"), "No")
    notice.yes.click()
    assert answers == ["free"]
    assert not notice.is_question
    assert notice.yes.isHidden()
    notice.say("the stage is at rest")
    assert notice.text.text() == "the stage is at rest"


def test_an_offer_that_comes_late_waits_for_the_question_that_stands(
    qtbot: QtBot, open_window: Open, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("app.gui.window.LATER_MS", 1)
    window, answers = open_window(model=model_of(make_run)), []
    window.notice.ask("Is the way free?", "It is free", lambda: answers.append("free"))
    window._offer_under_way("", [("b-1", "a bench")])
    qtbot.wait(50)
    assert window.notice.yes.text() == "It is free"
    click(qtbot, window.notice.no)
    qtbot.waitUntil(lambda: window.notice.yes.text() == "Show it")
    assert not answers


ALARM = "STOP MOTION FAILED, cut the actuator's power: stage X"


def test_an_alarm_that_comes_while_a_run_is_made_stays(
    qtbot: QtBot, shop_window: MainWindow, shop: Slow
) -> None:
    shop_window._say("of the last run", True)
    shop_window.begin()
    assert not shop_window.notice.is_alarm  # who begins a run has seen it
    shop_window._say(ALARM, True)
    shop.let("run")
    qtbot.waitUntil(lambda: "run" in shop.made and shop.made["run"].started)
    qtbot.wait(50)
    assert shop_window.notice.text.text() == ALARM


def test_no_run_begins_by_itself_while_an_alarm_is_shown(
    qtbot: QtBot, shop_window: MainWindow, shop: Slow
) -> None:
    shop_window._say(ALARM, True)
    assert shop_window.model is not None
    shop_window.model.begin_asked.emit()
    assert not shop_window.is_live()
    assert shop_window.notice.text.text() == ALARM
    assert "waits for Start" in shop_window.top.sentence.text()
    shop_window.notice.clear()
    shop_window.model.begin_asked.emit()
    assert shop_window.is_live()
    shop.let("run")
    qtbot.waitUntil(lambda: "run" in shop.made)


def test_a_run_under_way_that_is_stopped_while_it_is_attached_is_shown_until_it_has_ended(
    qtbot: QtBot, shop_window: MainWindow, shop: Slow
) -> None:
    shop_window._show_under_way("run")
    shop_window.stop_motion()
    run = make_run(title="run").at(30)
    asked: list[str] = []
    run.stays = True
    run.request_stop = asked.append  # type: ignore[method-assign]
    shop.made["run"] = run
    shop.let("run")
    qtbot.waitUntil(lambda: shop_window.source is run and shop_window._view is not None)
    qtbot.waitUntil(lambda: asked == ["STOP MOTION was pressed"])
    assert shop_window.is_live()
    assert shop_window.top.badge.text() == "STOPPING"
    assert not shop_window.top.start.isEnabled()
    run.at(60)
    qtbot.waitUntil(lambda: shop_window.top.badge.text() == "DONE")
    assert not shop_window.is_live()
    assert shop_window.top.start.isEnabled()


def test_the_window_waits_for_no_look_at_the_last_run_as_it_shows_the_next(
    window: MainWindow, run: ScriptedRun
) -> None:
    reader, waited = window._reader, []
    assert reader is not None
    reader._thread.join = waited.append  # type: ignore[method-assign, assignment]
    window._attach(make_run())
    assert waited == [0.0]
    assert window._reader is not reader


def test_how_a_run_ended_is_told_though_its_time_line_cannot_be_drawn(
    qtbot: QtBot, open_window: Open
) -> None:
    run = make_run()
    window = open_window(model=model_of(lambda: run))
    begin(qtbot, window, run, 30)
    ended: list[object] = []
    assert window.model is not None
    window.model.ended.connect(ended.append)
    window.playback.refresh = lambda: 1 / 0  # type: ignore[method-assign, assignment]
    run.at(60)
    qtbot.waitUntil(lambda: ended == [run])


@pytest.mark.parametrize("answer", [at_rest("stage X", 2e-3), failed("stage X: it moves")])
def test_a_window_that_closes_waits_for_what_became_of_the_stop(
    qtbot: QtBot, window: MainWindow, run: ScriptedRun, answer: StopAnswer
) -> None:
    """Also where the run has ended before that is known."""
    goes_on, stop = threading.Event(), run.stop_motion

    def slow_stop() -> StopAnswer:
        stop()
        goes_on.wait(60)
        return answer

    run.stop_motion = slow_stop  # type: ignore[method-assign]
    run.stop_answer = lambda: None  # type: ignore[method-assign]
    begin(qtbot, window, run, 30)
    window.close_after_run()
    wait_for_end(qtbot, window)
    qtbot.wait(200)
    assert window.isVisible()
    goes_on.set()
    if answer.kind is Stop.FAILED:
        qtbot.waitUntil(lambda: window.notice.is_alarm)
        qtbot.wait(200)
    else:
        qtbot.waitUntil(lambda: not window.isVisible())
    assert window.isVisible() == (answer.kind is Stop.FAILED)
