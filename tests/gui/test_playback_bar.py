"""The bar under a replay: what it does to the replay, and when it is there."""

import pytest
from PySide6.QtCore import Qt
from scripted_run import ScriptedRun

from app.gui.window import MainWindow


class Playback:
    def __init__(self):
        self.pace, self.is_paused, self.calls = 1.0, False, []

    def pause(self):
        self.is_paused = True
        self.calls.append("pause")

    def resume(self):
        self.is_paused = False
        self.calls.append("resume")

    def step(self):
        self.calls.append("step")

    def set_pace(self, pace):
        self.pace = pace


class Browser:
    number = None

    def show(self, number):
        self.number = number


class ScriptedReplay(ScriptedRun):
    """A run of which any frame can be shown."""

    can_browse = True

    def __init__(self):
        super().__init__(width=480, height=360)
        self.playback, self.browser, self.frame_count = Playback(), Browser(), 330

    @property
    def is_browsing(self):
        return self.browser.number is not None

    @property
    def place(self):
        return self.frame if self.browser.number is None else self.browser.number

    def browsed(self):
        return None if self.browser.number is None else self._snapshots[self.browser.number]


@pytest.fixture
def shown(qtbot):
    """Opens windows, and closes them."""
    opened = []

    def open_on(source):
        window = MainWindow(source)
        with qtbot.waitActive(window):
            window.show()
        opened.append(window)
        return window

    yield open_on
    for window in opened:
        window._must_close = True
        window.close()
        window.deleteLater()


def test_a_live_run_has_no_bar(shown):
    assert not shown(ScriptedRun(width=480, height=360)).playback.isVisible()


def test_keys_and_slider_move_through_the_frames(shown, qtbot):
    source = ScriptedReplay().at(200)
    window = shown(source)
    assert window.playback.isVisible()
    window.activateWindow()
    bar = window.playback
    bar.toggle()
    assert source.playback.is_paused
    bar.go_forward()
    assert source.playback.calls[-1] == "step"
    bar.go_back()
    assert source.browser.number == 199
    bar.go_forward()
    assert source.browser.number == 200
    bar.slider.setValue(30)
    assert source.browser.number == 30
    qtbot.mouseClick(bar.slider, Qt.MouseButton.LeftButton, pos=bar.slider.rect().center())
    assert abs(source.browser.number - 164) <= 2  # the middle of 330
    bar.pace.textActivated.emit("0.25 x")
    assert source.playback.pace == 0.25
    bar.toggle()
    assert (source.playback.calls[-1], source.browser.number) == ("resume", None)
    assert bar.slider.focusPolicy() == Qt.FocusPolicy.NoFocus  # the arrows belong to the frames


def test_where_no_frame_can_be_browsed_yet_the_slider_is_off(shown):
    source = ScriptedReplay().at(200)
    source.can_browse = False
    bar = shown(source).playback
    assert not bar.slider.isEnabled()
    bar.go_back()
    assert source.browser.number is None
    source.can_browse = True
    bar.refresh()
    assert bar.slider.isEnabled()


def test_the_window_shows_the_frame_that_is_browsed(shown, qtbot):
    source = ScriptedReplay().at(300)
    window = shown(source)
    source.start()
    qtbot.waitUntil(
        lambda: (
            "frame 299" in window.interface.caption.text()
            or "frame 300" in window.interface.caption.text()
        ),
        timeout=60_000,
    )
    window.playback.slider.setValue(150)
    qtbot.waitUntil(lambda: "frame 150" in window.interface.caption.text(), timeout=60_000)
    window.playback.slider.setValue(2)  # before the reference there is no field
    qtbot.waitUntil(
        lambda: "frame" not in window.interface.caption.text() and not window._parts, timeout=60_000
    )
    assert window.curves.stress_curve.xData is None or not len(window.curves.stress_curve.xData)
