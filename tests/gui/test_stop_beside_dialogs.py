"""A file is asked for beside the window: STOP MOTION still acts by key and by mouse, and no further
analysis takes the processor from a run.
"""

from collections.abc import Callable
from itertools import product
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QFileDialog, QLineEdit, QMenuBar
from pytestqt.qtbot import QtBot
from scripted_run import ScriptedRun
from window_hands import Open, click, finish, model_of, wait_for_end
from workshops import Makes

from app.gui.bench_link import LinkState
from app.gui.window import MainWindow
from app.system.stopping import at_rest

LEFT = Qt.MouseButton.LeftButton


@pytest.fixture
def run() -> ScriptedRun:
    return ScriptedRun(320, 240, frames=60)


@pytest.fixture
def analyses(monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """The sessions that are to be analysed again."""
    asked: list[Path] = []

    def reanalysis(self: Makes, session: Path, overrides: Any, output: Path) -> Any:
        asked.append(session)
        raise OSError("records: there is nothing to analyse")

    monkeypatch.setattr(Makes, "reanalysis", reanalysis, raising=False)
    return asked


@pytest.fixture
def window(open_window: Open, run: ScriptedRun) -> MainWindow:
    return open_window(model=model_of(lambda: run))


def asked(qtbot: QtBot, window: MainWindow) -> QFileDialog:
    """The dialog that is in front, which the operator types in."""
    qtbot.waitUntil(lambda: any(d.isVisible() for d in window.findChildren(QFileDialog)))
    (dialog,) = (d for d in window.findChildren(QFileDialog) if d.isVisible())
    dialog.activateWindow()
    field = dialog.findChild(QLineEdit)
    assert field is not None
    field.setFocus()
    qtbot.keyClicks(field, "sess")
    assert "sess" in field.text()
    return dialog


def by_menu(qtbot: QtBot, window: MainWindow) -> None:
    qtbot.keyClick(window, Qt.Key.Key_O, Qt.KeyboardModifier.ControlModifier)


def by_set_up(qtbot: QtBot, window: MainWindow) -> None:
    assert window.setup is not None
    click(qtbot, window.setup.save_button)


def by_sessions(qtbot: QtBot, window: MainWindow) -> None:
    assert window.sessions is not None
    click(qtbot, window.sessions.open)


def test_a_moving_stage_is_stopped_while_a_file_is_asked_for(
    qtbot: QtBot, window: MainWindow
) -> None:
    keys = Qt.Key.Key_Escape, Qt.Key.Key_F12, None
    for ask, key in product((by_menu, by_set_up, by_sessions), keys):
        run = ScriptedRun(320, 240, frames=60)
        window.model.factory._make = lambda run=run: run
        window.activateWindow()
        qtbot.waitUntil(window.isActiveWindow)
        ask(qtbot, window)
        dialog = asked(qtbot, window)
        qtbot.keyClick(dialog, Qt.Key.Key_F5)  # the run begins beside the question
        qtbot.waitUntil(lambda run=run: window.source is run and window._view is not None)
        assert run.started
        assert not run.called.is_set()
        if key is None:
            assert not dialog.isModal()
            qtbot.mousePress(window.top.stop_motion, LEFT)
        else:
            qtbot.keyClick(dialog.findChild(QLineEdit), key)
        qtbot.waitUntil(run.called.is_set)
        is_open = [one for one in window.findChildren(QFileDialog) if one.isVisible()]
        assert bool(is_open) == (key != Qt.Key.Key_Escape)  # Esc closes it as well
        for one in is_open:
            one.close()
        wait_for_end(qtbot, window)


def test_escape_only_closes_what_is_open_while_nothing_can_move(
    qtbot: QtBot, window: MainWindow, run: ScriptedRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent: list[object] = []
    monkeypatch.setattr(window._stops, "press", lambda *about: sent.append(about))
    dialogs = window.findChildren
    by_menu(qtbot, window)
    qtbot.waitUntil(lambda: isinstance(QApplication.activeWindow(), QFileDialog))
    qtbot.keyClick(QApplication.activeWindow(), Qt.Key.Key_Escape)
    qtbot.waitUntil(lambda: not any(one.isVisible() for one in dialogs(QFileDialog)))
    menu = window.menuWidget().findChild(QMenuBar).actions()[0].menu()
    with qtbot.waitSignal(window._timer.timeout):  # when the window has seen that it is open
        menu.popup(window.mapToGlobal(window.rect().center()))
    assert QApplication.activePopupWidget() is menu
    QTest.keyClick(menu.windowHandle(), Qt.Key.Key_Escape)
    qtbot.waitUntil(lambda: not menu.isVisible())
    assert sent == []
    window.show_keys()
    qtbot.waitUntil(window._keys.isActiveWindow)
    qtbot.keyClick(window._keys, Qt.Key.Key_F12)
    assert len(sent) == 1  # F12 always stops
    window._keys.close()
    window.activateWindow()
    qtbot.waitUntil(window.isActiveWindow)
    qtbot.keyClick(window, Qt.Key.Key_Escape)
    assert len(sent) == 2


def test_escape_stops_a_connected_bench_and_closes_the_dialog(
    qtbot: QtBot, window: MainWindow
) -> None:
    calls: list[str] = []

    def stop() -> Any:
        calls.append("stop")
        return at_rest("stage X", 12.5e-3)

    assert window.bench is not None
    link = window.bench.link
    link._preview, link.phase = SimpleNamespace(stop_motion=stop), LinkState.ON
    window.show_keys()
    qtbot.waitUntil(window._keys.isActiveWindow)
    qtbot.keyClick(window._keys, Qt.Key.Key_Escape)
    qtbot.waitUntil(lambda: calls == ["stop"])
    assert not window._keys.isVisible()
    link._preview, link.phase = None, LinkState.OFF


def test_a_session_that_is_chosen_during_a_run_does_not_take_its_place(
    qtbot: QtBot, window: MainWindow, run: ScriptedRun
) -> None:
    by_menu(qtbot, window)
    dialog = asked(qtbot, window)
    qtbot.keyClick(dialog, Qt.Key.Key_F5)
    qtbot.waitUntil(lambda: run.started and window._view is not None)
    dialog.fileSelected.emit("old.h5")
    assert "A run is going on" in window.notice.text.text()
    assert window.source is run
    dialog.close()


def ask_analysis(window: MainWindow) -> Callable[[], str]:
    assert window.sessions is not None
    panel = window.sessions
    panel.analysis_form.asked.emit(Path("old.h5"), [], Path("old-a.h5"))
    return panel.said.text


def test_a_session_is_not_analysed_again_during_a_run(
    qtbot: QtBot, analyses: list[Path], window: MainWindow, run: ScriptedRun
) -> None:
    qtbot.keyClick(window, Qt.Key.Key_F5)
    qtbot.waitUntil(lambda: run.started and window._view is not None)
    said = ask_analysis(window)
    assert "old.h5 was not analysed again: a run is going on" in said()
    assert not analyses
    finish(qtbot, window, run)
    ask_analysis(window)
    qtbot.waitUntil(lambda: analyses == [Path("old.h5")])


def test_a_run_that_begins_beside_a_further_analysis_says_so(
    qtbot: QtBot, window: MainWindow, run: ScriptedRun
) -> None:
    assert window.sessions is not None
    window.sessions.analysis_form.begin("old.h5 is being analysed again")
    qtbot.keyClick(window, Qt.Key.Key_F5)
    qtbot.waitUntil(lambda: run.started)
    sentence = window.notice.text.text()
    assert sentence.startswith("old.h5 is being analysed again, which takes processor time")
    assert window.sessions.said.text() == sentence
    finish(qtbot, window, run)
    window.sessions.analysis_form.end()
    window.begin()
    assert sentence not in window.notice.text.text()
