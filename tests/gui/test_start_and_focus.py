"""A run begins only with what stands in the form, and no key presses a button that moves something
unless the operator meant it.
"""

from pathlib import Path

import pytest
from operators import CTRL, Keyboard, Mouse, arrange, large
from PySide6.QtCore import QEvent, QObject, Qt, QTimer
from PySide6.QtGui import QColor
from PySide6.QtWidgets import (
    QAbstractButton,
    QApplication,
    QComboBox,
    QLineEdit,
    QScrollArea,
    QTabBar,
    QWidget,
)
from pytestqt.qtbot import QtBot
from scripted_run import ScriptedRun
from set_up_hands import heads_of_steps, write
from window_hands import Open, finish, wait_for_end, wait_for_words
from workshops import Makes

from app.gui import theme
from app.gui.cells import Tone
from app.gui.setup_panel import SetupPanel
from app.gui.window import MainWindow
from app.gui.window_model import WindowModel
from app.settings.sections import Config


class Shop(Makes):
    """Keeps the settings of each run that was asked for."""

    def __init__(self) -> None:
        super().__init__(lambda: ScriptedRun(320, 240, frames=60))
        self.asked: list[tuple[Config, Path | None]] = []
        self.runs: list[ScriptedRun] = []

    def run(self, config: Config, session: Path | None) -> ScriptedRun:
        self.asked.append((config, session))
        self.runs.append(super().run(config, session))
        return self.runs[-1]


@pytest.fixture
def shop() -> Shop:
    return Shop()


@pytest.fixture
def window(
    open_window: Open, shop: Shop, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> MainWindow:
    monkeypatch.chdir(tmp_path)
    return open_window(model=WindowModel(shop, Config()), show=large)


def speed_of_drive(setup: SetupPanel) -> QLineEdit:
    """The field of the velocity of the fourth step."""
    heads_of_steps(setup)[3].click()
    return setup.row("run.steps.4.velocity").editor


def buttons_that_move(window: MainWindow) -> list[QAbstractButton]:
    top, bench = window.top, window.bench
    primary = (window.experiment.button, window.campaign.next)
    return [top.start, top.stop, top.stop_motion, bench.zero, *bench.stage.jogs, *primary]


def test_start_is_refused_while_a_field_is_and_goes_to_it(
    qtbot: QtBot, window: MainWindow, shop: Shop
) -> None:
    mouse, keyboard = Mouse(qtbot, window), Keyboard(qtbot, window)
    load = window.setup.row("run.normal_force").editor
    for begin in (
        lambda: mouse.click(window.top.start),
        lambda: keyboard.key(Qt.Key.Key_F5),
    ):
        mouse.go_to("setup")
        mouse.type(load, "0,7")
        begin()
        wait_for_words(qtbot, window, "The run was not started: Load P")
        assert shop.asked == []
        said = window.notice.text.text()
        assert "0,7" in said
        assert "with a point: 0.7" in said
        assert window._pending is None
        assert not window.docks.by_name["setup"].visibleRegion().isEmpty()
        assert QApplication.focusWidget() is load

        mouse.type(load, "0.7")
        qtbot.keyClick(load, Qt.Key.Key_Return)
        qtbot.waitUntil(lambda: not window.notice.isVisible())  # nothing is refused any more
    keyboard.key(Qt.Key.Key_F5)
    qtbot.waitUntil(lambda: bool(shop.asked))
    assert shop.asked[0][0].run.normal_force == 0.7
    qtbot.waitUntil(lambda: not window.notice.isVisible())


@pytest.mark.parametrize("part", ["session", "steps", "hidden table"])
def test_whatever_is_refused_is_gone_to(
    qtbot: QtBot, window: MainWindow, shop: Shop, tmp_path: Path, part: str
) -> None:
    mouse, setup = Mouse(qtbot, window), window.setup
    mouse.go_to("setup")
    if part == "session":
        mouse.type(setup.session, str(tmp_path / "no folder" / "x"))
        qtbot.keyClick(setup.session, Qt.Key.Key_Return)
        qtbot.waitUntil(lambda: bool(setup.refusal()))  # its folder is looked at beside the window
        wanted, name = setup.session, "Session"
    elif part == "steps":
        wanted, name = speed_of_drive(setup), "Protocol"
        wanted.setFocus()
        qtbot.keyClicks(wanted, "fast")
    else:
        mouse.type(setup.search, "gauge")
        setup.search.clear()
        setup.settings.table("camera").open()
        (row,) = setup.settings.rows("camera.exposure")
        wanted, name = row.editor, "exposure"
        write(qtbot, wanted, "long", end=None)
        mouse.click(setup.search)
        setup.settings.table("camera").open(False)
        assert not wanted.isVisible()
    mouse.click(window.top.start)
    qtbot.waitUntil(lambda: f"not started: {name}" in window.notice.text.text())
    assert shop.asked == []
    assert QApplication.focusWidget() is wanted
    assert wanted.isVisible()


def test_what_stands_in_a_field_is_taken_by_a_click_on_start(
    qtbot: QtBot, window: MainWindow, shop: Shop
) -> None:
    mouse = Mouse(qtbot, window)
    mouse.go_to("setup")
    mouse.type(window.setup.row("run.normal_force").editor, "0.25")
    mouse.click(window.top.start)  # which takes no focus from the field
    qtbot.waitUntil(lambda: bool(shop.asked))
    assert shop.asked[0][0].run.normal_force == 0.25


def test_an_exposure_that_was_not_left_is_taken_by_start(
    qtbot: QtBot, window: MainWindow, shop: Shop
) -> None:
    mouse = Mouse(qtbot, window)
    mouse.go_to("bench")
    write(qtbot, window.bench.exposure, "7.5", end=None)
    mouse.click(window.top.start)
    qtbot.waitUntil(lambda: bool(shop.asked))
    assert shop.asked[0][0].camera.exposure == pytest.approx(7.5e-3)


def test_tab_leads_to_nothing_that_moves(qtbot: QtBot, window: MainWindow, shop: Shop) -> None:
    keyboard = Keyboard(qtbot, window)
    for is_running in (False, True):
        if is_running:
            window.begin()
            qtbot.waitUntil(lambda: bool(shop.runs) and window.top.stop.isEnabled())
        for button in buttons_that_move(window):
            button.setEnabled(True)
        for part in ("bench", "setup", "experiment", "campaign"):
            window.docks.show(part)
            seen = set()
            for key in (Qt.Key.Key_Tab, Qt.Key.Key_Backtab):
                for _ in range(50):
                    keyboard.key(key)
                    seen.add(QApplication.focusWidget())
            assert len(seen) > 5
            assert not seen & set(buttons_that_move(window)), part


def test_a_button_that_is_pressed_and_turns_grey_leaves_the_focus_to_none_that_moves(
    qtbot: QtBot, window: MainWindow, shop: Shop
) -> None:
    mouse = Mouse(qtbot, window)
    for button in buttons_that_move(window):
        button.setEnabled(True)
    window.docks.show("bench")
    mouse.click(window.bench.zero)
    window.bench.zero.setEnabled(False)
    assert QApplication.focusWidget() not in buttons_that_move(window)
    window.begin()
    qtbot.waitUntil(lambda: bool(shop.runs))
    shop.runs[0].at(30)
    qtbot.waitUntil(lambda: window._view is not None and window._view.phase == "drive")
    Keyboard(qtbot, window).key(Qt.Key.Key_Space)
    qtbot.wait(200)
    assert shop.runs[0].calls == []


def test_the_keys_of_the_window_go_on_to_work(qtbot: QtBot, window: MainWindow, shop: Shop) -> None:
    keyboard = Keyboard(qtbot, window)
    keyboard.key(Qt.Key.Key_F5)
    qtbot.waitUntil(lambda: bool(shop.runs) and shop.runs[0].started)
    keyboard.key(Qt.Key.Key_E, CTRL)
    assert shop.runs[0].called.wait(60)
    assert shop.runs[0].calls == ["the operator ended the run"]
    wait_for_end(qtbot, window)
    keyboard.key(Qt.Key.Key_F5)
    qtbot.waitUntil(lambda: len(shop.runs) == 2 and shop.runs[1].started)
    keyboard.key(Qt.Key.Key_F12)
    assert shop.runs[1].called.wait(60)
    assert shop.runs[1].calls == ["stop_motion"]


class Edits(QObject):
    """Takes each key for a field, as one takes Ctrl+E with X11, where that goes to its end."""

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() is QEvent.Type.ShortcutOverride:
            event.accept()
            return True
        return False


def test_a_key_of_the_window_wins_over_a_field_that_edits_by_it(
    qtbot: QtBot, window: MainWindow, shop: Shop
) -> None:
    panel = window.experiment
    assert panel is not None
    window.begin()
    qtbot.waitUntil(lambda: bool(shop.runs) and panel.note.isEnabled())
    edits = Edits(window)
    panel.note.installEventFilter(edits)
    panel.note.setFocus()
    Keyboard(qtbot, window).key(Qt.Key.Key_E, CTRL)
    assert shop.runs[0].called.wait(60)
    assert shop.runs[0].calls == ["the operator ended the run"]


def test_a_protocol_that_is_refused_is_not_called_by_the_name_of_the_last(
    qtbot: QtBot, window: MainWindow
) -> None:
    choice = window.setup.row("run.steps").editor
    choice.setCurrentText("example of six steps")
    choice.textActivated.emit("example of six steps")
    assert choice.currentText() == "example of six steps"
    assert "the protocol among them" in window.setup.compared.text()
    Mouse(qtbot, window).go_to("setup")
    speed = speed_of_drive(window.setup)
    speed.setFocus()
    qtbot.keyClicks(speed, "fast")
    qtbot.keyClick(speed, Qt.Key.Key_Tab)
    assert window.setup.refusal()
    assert choice.currentText() == "own protocol"


def test_no_click_at_the_place_of_connect_begins_a_run(qtbot: QtBot, window: MainWindow) -> None:
    mouse, connect = Mouse(qtbot, window), window.bench.connect_button
    for size in ((1366, 768), (1720, 1000), (1024, 700)):
        arrange(window, *size)
        mouse.go_to("bench")
        qtbot.wait(100)
        place = connect.rect().translated(connect.mapTo(window, connect.rect().topLeft()))
        mouse.go_to("experiment")
        qtbot.wait(100)
        for button in buttons_that_move(window):
            if button.isVisible():
                there = button.rect().translated(button.mapTo(window, button.rect().topLeft()))
                assert not there.intersects(place), button.text()


def ring_px(widget: QWidget) -> int:
    """How thick the ring is above and below a widget, or the tab of it that is chosen."""
    place = widget.rect()
    if isinstance(widget, QTabBar):
        place = widget.tabRect(widget.currentIndex()).intersected(place)
    image, colour = widget.grab().toImage(), QColor(theme.now().tones[Tone.BUSY])
    middle = place.center()
    ways = (
        [image.pixelColor(middle.x(), place.top() + k) for k in range(6)],
        [image.pixelColor(middle.x(), place.bottom() - k) for k in range(6)],
    )
    return min(next(k for k, seen in enumerate(way) if seen != colour) for way in ways)


def test_what_has_the_focus_has_a_ring_and_does_not_change_its_size(window: MainWindow) -> None:
    check_rings(window)
    window.toggle_theme()
    check_rings(window)


def check_rings(window: MainWindow) -> None:
    seen: set[str] = set()
    checked: set[QWidget] = set()
    for part in window.docks.by_name:
        window.docks.go_to(part)
        for one in set(window.findChildren(QWidget)) - checked:
            takes_keys = one.focusPolicy() & Qt.FocusPolicy.TabFocus and not one.focusProxy()
            # an area that only scrolls does nothing else by its keys
            is_scrolled = isinstance(one, QScrollArea)
            if not takes_keys or not one.isVisible() or not one.isEnabled() or is_scrolled:
                continue
            window.setFocus()
            hint = one.sizeHint()
            one.setFocus()
            if one.hasFocus():
                # the list of a combo box opens where its rows are, which a wider line would move
                assert ring_px(one) == (1 if isinstance(one, QComboBox) else 2), (part, one)
                assert one.sizeHint() == hint, (part, one)
                seen.add(type(one).__name__)
                checked.add(one)
    wanted = {"QPushButton", "QToolButton", "QComboBox", "NumberBox", "QCheckBox", "QLineEdit"}
    assert wanted | {"QTabBar", "QPlainTextEdit", "CurvePlot"} <= seen


def test_the_focus_that_is_lost_goes_to_nothing_that_moves(
    qtbot: QtBot, window: MainWindow, shop: Shop
) -> None:
    def close_menu() -> None:  # one that a key opens has an event loop of its own
        if (menu := QApplication.activePopupWidget()) is not None:
            menu.close()

    closing = QTimer(window)
    closing.timeout.connect(close_menu)
    closing.start(100)
    for number, event in enumerate(("another dock", "the end of a run", "a run that is shown")):
        if event == "a run that is shown":
            window._make("The run under way", lambda: shop.run(Config(), None), is_live=True)
        else:
            window.begin()
        qtbot.waitUntil(lambda n=number: len(shop.runs) > n and window.top.stop.isEnabled())
        run = shop.runs[number].at(30)
        qtbot.waitUntil(lambda: window._view is not None and window._view.phase == "drive")
        for button in buttons_that_move(window):
            button.setEnabled(True)
        if event == "another dock":
            window.docks.go_to("setup")
            window.docks.show("bench")
        elif event == "the end of a run":
            window.docks.go_to("experiment")
            finish(qtbot, window, run)
        assert QApplication.focusWidget() not in buttons_that_move(window)
        for key in (Qt.Key.Key_Space, Qt.Key.Key_Return):
            Keyboard(qtbot, window).key(key)
        qtbot.wait(200)
        assert run.calls == []
        assert len(shop.runs) == number + 1
        finish(qtbot, window, run)


@pytest.mark.parametrize("goes_on", [False, True])
def test_the_runs_of_a_campaign_that_goes_on_by_itself_leave_it_in_view(
    qtbot: QtBot, window: MainWindow, shop: Shop, goes_on: bool
) -> None:
    campaign, curves = window.docks.by_name["campaign"], window.docks.by_name["curves"]
    window.docks.show("campaign")
    window.campaign.unattended.setChecked(goes_on)
    qtbot.waitUntil(lambda: not campaign.visibleRegion().isEmpty())
    Keyboard(qtbot, window).key(Qt.Key.Key_F5)
    qtbot.waitUntil(lambda: bool(shop.runs) and window._is_running())
    seen, hidden = (campaign, curves) if goes_on else (curves, campaign)
    qtbot.waitUntil(lambda: not seen.visibleRegion().isEmpty())
    assert hidden.visibleRegion().isEmpty()
