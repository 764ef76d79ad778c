"""Where the parts of the window are: on a screen of any size, again and again."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from operators import Mouse, arrange, large, words
from PySide6.QtCore import QByteArray, Qt
from PySide6.QtWidgets import QTabBar
from pytestqt.qtbot import QtBot
from scripted_run import ScriptedRun
from set_up_hands import heads_of_steps
from window_hands import Open, begin, make_run, model_of

from app.gui.cells import Tone
from app.gui.keys import KeyList
from app.gui.window import MainWindow
from app.records.record_types import Phase

SMALLEST = (960, 540)  # a screen of 1920 x 1080 at 200 %


@pytest.fixture
def window(open_window: Open) -> MainWindow:
    return open_window(model=model_of(make_run), show=MainWindow.showNormal)


def test_stop_is_in_view_in_a_window_of_any_usual_size(qtbot: QtBot, window: MainWindow) -> None:
    button = window.top.stop_motion

    def is_all_in_view() -> bool:
        corners = button.rect().topLeft(), button.rect().bottomRight()
        return all(window.rect().contains(button.mapTo(window, corner)) for corner in corners)

    for size in (SMALLEST, (1180, 660), (1366, 768), (1920, 1080)):
        arrange(window, *size)
        qtbot.waitUntil(
            lambda at=size: (window.width(), window.height()) == at and is_all_in_view()
        )


def test_each_part_has_one_tab_however_often_the_layout_is_reset(
    qtbot: QtBot, window: MainWindow
) -> None:
    for size in ((1920, 1080), (1366, 768), (1920, 1080)):
        window.resize(*size)
        window.reset_layout()
        qtbot.wait(50)
        titles = sorted(
            bar.tabText(k)
            for bar in window.findChildren(QTabBar)
            if bar.isVisible()
            for k in range(bar.count())
        )
        assert len(titles) == len(set(titles))
        assert set(titles) <= {dock.windowTitle() for dock in window.docks.by_name.values()}


def test_a_window_with_fewer_parts_leaves_the_layout_of_the_others_alone(
    qtbot: QtBot, window: MainWindow
) -> None:
    shows_a_run_only = MainWindow()
    shows_a_run_only.show()
    shows_a_run_only.close()
    again = MainWindow(model=window.model)
    with qtbot.waitExposed(again):
        again.show()
    left = again.docks.by_name["bench"]
    assert {dock.objectName() for dock in again.tabifiedDockWidgets(left)} >= {"setup", "sessions"}
    again._timer.stop()
    for one in (shows_a_run_only, again):
        one.deleteLater()


def test_the_layout_is_remembered(qtbot: QtBot, window: MainWindow) -> None:
    window.docks.by_name["log"].hide()
    window.close()
    again = MainWindow(model=window.model)
    assert again.docks.by_name["log"].isHidden()
    assert not again.docks.by_name["health"].isHidden()
    again.memory.keep_layout(again.docks.kind, QByteArray(b"broken"), QByteArray(b"broken"))
    again._timer.stop()
    third = MainWindow(model=window.model)
    assert not third.docks.by_name["log"].isHidden()
    third._timer.stop()
    for one in (again, third):
        one.deleteLater()


def test_a_window_that_was_small_has_its_layout_again(qtbot: QtBot, window: MainWindow) -> None:
    arrange(window, 1900, 1000)
    docks = window.docks.by_name

    def lengths() -> list[int]:
        sides = docks["bench"].width(), docks["curves"].width(), docks["result"].height()
        return [*sides, window.interface.width()]

    def settled() -> list[int]:
        came = [lengths()]
        qtbot.waitUntil(lambda: came.append(lengths()) or came[-10:] == 10 * [came[-1]])
        return came[-1]

    first = settled()
    for _ in range(2):
        window.resize(window.minimumSizeHint())
        qtbot.waitUntil(lambda: lengths()[1] < 0.8 * first[1])
        settled()
        window.resize(1900, 1000)
        qtbot.waitUntil(lambda: lengths() == pytest.approx(first, abs=6))

    window.resizeDocks([docks["curves"]], [500], Qt.Orientation.Horizontal)  # as the mouse does
    qtbot.waitUntil(lambda: docks["curves"].width() == pytest.approx(500, abs=6))
    window.resize(1500, 800)
    settled()
    window.resize(1900, 1000)
    qtbot.waitUntil(lambda: docks["curves"].width() == pytest.approx(500, abs=6))


def test_the_name_of_a_part_is_said_once_and_a_double_click_there_takes_it_out(
    qtbot: QtBot, window: MainWindow
) -> None:
    large(window)
    docks = window.docks.by_name
    qtbot.waitUntil(lambda: all(dock.titleBarWidget() is not None for dock in docks.values()))
    health = docks["health"]
    (bar, tab) = next(
        (bar, tab)
        for bar in window.findChildren(QTabBar)
        for tab in range(bar.count())
        if bar.tabText(tab) == health.windowTitle() and bar.isVisible()
    )
    qtbot.waitUntil(lambda: "Double click" in bar.toolTip())
    place = bar.tabRect(tab).center()
    qtbot.mouseDClick(bar, Qt.MouseButton.LeftButton, pos=place)
    qtbot.waitUntil(health.isFloating)
    qtbot.waitUntil(lambda: health.titleBarWidget() is None)  # its own title, to put it back by
    health.setFloating(False)
    qtbot.waitUntil(lambda: health.titleBarWidget() is not None)


def test_a_double_click_on_a_tab_takes_out_no_other_part(window: MainWindow) -> None:
    docks = window.docks.by_name.values()

    def title(tab: int) -> str:
        return [dock.windowTitle() for dock in docks if not dock.isFloating()][tab]

    wanted = title(1)
    window.docks._take_out(SimpleNamespace(tabText=title), 1)
    assert [dock.windowTitle() for dock in docks if dock.isFloating()] == [wanted]


def test_the_phase_under_way_is_not_cut_short_in_a_narrow_window(
    qtbot: QtBot, window: MainWindow
) -> None:
    phases = window.top.phases
    window.top.show_state("running", Tone.BUSY, Phase.REFERENCE)
    for size, count in ((SMALLEST, 1), ((1366, 768), len(Phase))):
        arrange(window, *size)
        qtbot.waitUntil(lambda n=count: sum(one in phases.text() for one in Phase) == n)
        assert Phase.REFERENCE in phases.text()
        qtbot.waitUntil(lambda: phases.width() >= phases.sizeHint().width())
        assert window.docks.by_name["result"].isVisible()


def test_the_keys_are_those_of_the_picture_at_first(window: MainWindow) -> None:
    assert window.focusWidget() is window.interface.canvas


def test_a_part_is_made_when_it_comes_into_view_and_shows_the_run_by_then(
    qtbot: QtBot, open_window: Open, run: ScriptedRun
) -> None:
    window = open_window(run, model_of(lambda: run))
    large(window)
    begin(qtbot, window, run, 50)
    behind = ("setup", "health", "log", "calibration")
    assert not any(map(window.docks.if_made, behind))
    for part in behind:
        Mouse(qtbot, window).go_to(part)
        qtbot.waitUntil(lambda part=part: window.docks.if_made(part) is not None)
    numbers = {view.name.text(): view.value.text() for view in window.health.cells.views}
    assert numbers["frames received"] == "50"
    assert not any(head.font().bold() for head in heads_of_steps(window.setup))
    window.show_keys()
    assert "Ctrl+R" in words(window._keys), "of a part that may not be made yet"
    window._keys.close()
    window.show_keys()
    assert window._keys.isVisible()
    assert len(window.findChildren(KeyList)) == 1
