"""A run whose window has crashed: the next window finds it and offers it, and its STOP MOTION stops
it, with or without a run of its own.
"""

import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from operators import Mouse
from processes.launched import launched, wait_until
from PySide6.QtCore import Qt
from pytestqt.qtbot import QtBot
from scripted_run import ScriptedRun
from window_hands import finish, wait_for_words
from workshops import Makes

from app.gui.run_factory import RunFactory
from app.gui.window import MainWindow
from app.gui.window_model import WindowModel
from app.settings.sections import Config
from app.system.stopping import CUT_POWER, Stop, StopAnswer, at_rest, failed, not_connected


class Beside(ScriptedRun):
    stays = True


class Shop(Makes):
    """A bench runs that this window has not begun; `says` is what its stop answers."""

    def __init__(self, says: StopAnswer | None = None) -> None:
        super().__init__(lambda: ScriptedRun(320, 240, frames=60))
        self.says, self.beside = says, Beside(320, 240, frames=60, title="the other bench")
        self.stops: list[Any] = []
        self.may_look = threading.Event()
        self.may_look.set()

    def runs_under_way(self) -> list[tuple[str, str]]:
        self.may_look.wait(60)
        return [("1842-ab", "the other bench, which records a.h5")] if self.says else []

    def attach(self, name: str) -> Any:
        assert name == "1842-ab"
        return self.beside.at(30)

    def stop_others(self, own: Any) -> StopAnswer | None:
        self.stops.append(own)
        return self.says


def model(shop: Any) -> WindowModel:
    return WindowModel(shop, Config())


REST = at_rest("stage X", 12.5e-3)
MOVES = failed("stage X: it says that it moves")


@pytest.mark.parametrize("answer", [REST, MOVES], ids=["at rest", "failed"])
def test_stop_in_a_window_without_a_run_stops_the_one_that_is_under_way(
    qtbot: QtBot, open_window: Any, beeps: list[str], answer: StopAnswer
) -> None:
    shop = Shop(answer)
    window = open_window(None, model(shop))
    qtbot.keyClick(window, Qt.Key.Key_Escape)
    qtbot.waitUntil(lambda: window.notice.text.text() == answer.sentence)
    assert shop.stops == [None]
    assert window.notice.is_alarm == (answer is MOVES)
    assert beeps == ["beep"] * (answer is MOVES)


def test_stop_with_nothing_under_way_says_that_it_has_looked(
    qtbot: QtBot, open_window: Any
) -> None:
    window = open_window(None, model(Shop()))
    qtbot.keyClick(window, Qt.Key.Key_Escape)
    qtbot.waitUntil(window.notice.isVisible)
    assert "no bench is connected" in window.notice.text.text()
    assert "no run of yours is under way on this computer" in window.notice.text.text()


@pytest.mark.parametrize("answer", [REST, MOVES], ids=["at rest", "failed"])
def test_stop_beside_a_run_of_its_own_stops_both_and_an_alarm_is_seen(
    qtbot: QtBot, open_window: Any, beeps: list[str], answer: StopAnswer
) -> None:
    shop, own = Shop(answer), ScriptedRun(320, 240, frames=60)
    window = open_window(own, model(shop))
    window.begin()
    own.at(30)
    qtbot.waitUntil(lambda: window._view is not None)
    qtbot.keyClick(window, Qt.Key.Key_Escape)
    qtbot.waitUntil(lambda: own.calls == ["stop_motion"])
    qtbot.waitUntil(lambda: shop.stops == [own])

    def log() -> str:
        window.log.refresh()
        return window.log.text.toPlainText()

    qtbot.waitUntil(lambda: answer.sentence in log())
    assert window.notice.is_alarm == (answer is MOVES)
    assert beeps == ["beep"] * (answer is MOVES)
    if answer is REST:  # the answer of its own run stands
        wait_for_words(qtbot, window, "the stage X is at rest")


def test_an_ended_run_does_not_hide_the_one_that_moves(qtbot: QtBot, open_window: Any) -> None:
    class Ended(ScriptedRun):
        def stop_motion(self) -> StopAnswer:
            return not_connected("the run has ended and its bench is closed")

        def stop_answer(self) -> StopAnswer | None:
            return None

    shop, own = Shop(REST), Ended(320, 240, frames=60)
    window = open_window(own, model(shop))
    window.begin()
    finish(qtbot, window, own)
    qtbot.keyClick(window, Qt.Key.Key_F12)
    qtbot.waitUntil(lambda: window.notice.text.text() == REST.sentence)


def test_stop_after_a_run_is_for_the_bench_that_was_connected_since(
    qtbot: QtBot, open_window: Any
) -> None:
    own = ScriptedRun(320, 240, frames=60)
    window = open_window(own, model(Shop()))
    window.begin()
    finish(qtbot, window, own)
    window.bench.link._preview = SimpleNamespace(stop_motion=lambda: REST)
    qtbot.keyClick(window, Qt.Key.Key_F12)
    qtbot.waitUntil(lambda: window.notice.text.text() == REST.sentence)
    assert own.calls == []
    window.bench.link._preview = None


def test_an_exception_on_the_way_to_the_others_is_a_failure(qtbot: QtBot, open_window: Any) -> None:
    shop = Shop()
    shop.stop_others = lambda own: 1 / 0  # type: ignore[method-assign, assignment, return-value]
    window = open_window(None, model(shop))
    qtbot.keyClick(window, Qt.Key.Key_Escape)
    qtbot.waitUntil(lambda: window.notice.text.text() == f"{CUT_POWER}: division by zero")


def offered(qtbot: QtBot, open_window: Any, shop: Shop) -> MainWindow:
    """A window that offers the run that goes on."""
    window: MainWindow = open_window(None, model(shop))
    qtbot.waitUntil(lambda: window.notice.is_question)
    return window


def test_a_new_window_offers_the_run_that_goes_on(qtbot: QtBot, open_window: Any) -> None:
    shop = Shop(REST)
    shop.beside.start()
    window = offered(qtbot, open_window, shop)
    assert "the other bench, which records a.h5" in window.notice.text.text()
    assert not window.notice.yes.hasFocus()
    Mouse(qtbot, window).click(window.notice.yes)
    qtbot.waitUntil(lambda: window.top.title.text() == "the other bench")
    qtbot.waitUntil(lambda: window._view is not None and window._view.phase == "drive")
    assert not window.notice.is_question
    window.close()  # which it outlives
    assert shop.beside.calls == []
    assert not window.isVisible()


def test_the_offer_can_be_refused_and_does_not_come_over_a_run(
    qtbot: QtBot, open_window: Any
) -> None:
    shop = Shop(REST)
    window = offered(qtbot, open_window, shop)
    Mouse(qtbot, window).click(window.notice.no)
    assert not window.notice.isVisible()
    assert window.source is None

    late = Shop(REST)
    late.may_look.clear()
    other = open_window(None, model(late))
    other.begin()
    qtbot.waitUntil(lambda: other.source is not None)
    late.may_look.set()
    qtbot.wait(300)
    assert not other.notice.is_question


def test_an_offer_that_gave_way_to_a_replay_can_be_asked_for_again(
    qtbot: QtBot, open_window: Any
) -> None:
    shop = Shop(REST)
    window = offered(qtbot, open_window, shop)
    old = ScriptedRun(320, 240, frames=60)
    shop.replay = lambda session: old  # type: ignore[method-assign, assignment]
    window.open_session(Path("old.h5"))
    qtbot.waitUntil(lambda: window.source is old)
    assert not window.notice.is_question
    finish(qtbot, window, old)
    window.actions_by_name["find_run"].trigger()
    qtbot.waitUntil(lambda: window.notice.is_question)
    Mouse(qtbot, window).click(window.notice.yes)
    qtbot.waitUntil(lambda: window.top.title.text() == "the other bench")
    assert not window.actions_by_name["find_run"].isEnabled()


def test_that_no_run_is_under_way_is_said_to_those_who_ask(qtbot: QtBot, open_window: Any) -> None:
    window = open_window(None, model(Shop()))
    qtbot.wait(100)
    assert not window.notice.isVisible()
    window.actions_by_name["find_run"].trigger()
    wait_for_words(qtbot, window, "No run of yours is under way")


def test_the_bench_of_a_window_that_has_crashed_is_stopped_and_shown(
    qtbot: QtBot, open_window: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with launched(tmp_path / "a.h5", "run.travel=300", "limits.age=10") as run:
        run.start()
        wait_until(lambda: run.look().health.phase == "drive", "the drive")
        for which in ("running", "reachable"):
            monkeypatch.setattr(f"app.processes.launch.{which}", lambda: [run.bench])
        kept: list[Any] = []
        window = open_window(None, model(RunFactory(kept.append)))
        qtbot.waitUntil(lambda: window.notice.is_question)
        assert "a.h5" in window.notice.text.text()
        qtbot.keyClick(window, Qt.Key.Key_Escape)
        wait_for_words(qtbot, window, "is at rest at")
        assert "a.h5" in window.notice.text.text()
        outcome = run.wait(120)
        assert outcome is not None
        assert outcome.reason == "STOP MOTION was pressed"
        assert run.look().stop.kind is Stop.AT_REST
        assert window.notice.stays
