"""What tests of the whole window do: a run of 60 frames, and how it is begun."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TypeVar

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QWidget
from pytestqt.qtbot import QtBot
from scripted_run import ScriptedRun
from workshops import Makes

from app.gui.notice import Notice
from app.gui.source import setup_of
from app.gui.view_state import ViewState, read, resolve
from app.gui.window import MainWindow
from app.gui.window_model import WindowModel
from app.settings.sections import Config

Open = Callable[..., MainWindow]
Shown = TypeVar("Shown", bound=QWidget)


def make_run(kind: type[ScriptedRun] = ScriptedRun, title: str = "simulated bench") -> ScriptedRun:
    run = kind(320, 240, frames=60, title=title)
    run.config = replace(run.config, camera=replace(run.config.camera, width=320, height=240))
    return run


def model_of(make: Callable[[], ScriptedRun]) -> WindowModel:
    return WindowModel(Makes(make), Config())


def begin(qtbot: QtBot, window: MainWindow, run: ScriptedRun, frame: int) -> None:
    window.begin()
    run.at(frame)
    wait_for_frame(qtbot, window, frame)
    turns = window._redraws
    turns._turned = turns._counted_at = 0.0  # all parts have their turn now
    qtbot.waitUntil(lambda: turns._turned > 0)


def colour_of(notice: Notice) -> str:
    """That of what is said."""
    return notice.text.palette().windowText().color().name()


def click(qtbot: QtBot, widget: QWidget) -> None:
    """Click in the middle of a widget."""
    qtbot.mouseClick(widget, Qt.MouseButton.LeftButton)


def look(run: ScriptedRun, previous: ViewState | None = None) -> ViewState:
    """What a window shows of a run that it has seen before as `previous`."""
    return resolve(setup_of(run), read(run, previous.curves.seen if previous else 0), previous)


def finish(qtbot: QtBot, window: MainWindow, run: ScriptedRun) -> None:
    """Let a run come to its end, and the window see that."""
    run.at(run.frames)
    wait_for_end(qtbot, window)


def wait_for_end(qtbot: QtBot, window: MainWindow) -> None:
    """Wait until the window has seen the run end."""
    qtbot.waitUntil(lambda: window.outcome() is not None)


def wait_for_frame(qtbot: QtBot, window: MainWindow, frame: int) -> None:
    """Wait until the window has seen all frames before this one."""
    qtbot.waitUntil(lambda: window._view is not None and window._view.curves.seen == frame)


def wait_for_words(qtbot: QtBot, window: MainWindow, words: str) -> None:
    """Wait until the line for what is said contains these."""
    qtbot.waitUntil(lambda: words in window.notice.text.text())


def shown(qtbot: QtBot, widget: Shown, *size: int) -> Shown:
    """A widget that is on the screen until the test is over, of a size if one is given."""
    qtbot.addWidget(widget)
    if size:
        widget.resize(*size)
    with qtbot.waitActive(widget):
        widget.show()
    return widget
