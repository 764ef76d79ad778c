import gc
import os
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

os.environ["QT_QPA_PLATFORM"] = "offscreen"  # before Qt loads

from functools import partial

import pytest
from PySide6.QtCore import QCoreApplication, QEvent, QLocale, QSettings
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot
from scripted_run import ScriptedRun
from set_up_hands import Shop, shown_panel
from window_hands import Open, make_run

from app.gui import theme
from app.gui.cells import set_decimal_sign
from app.gui.setup_panel import SetupPanel
from app.gui.window import MainWindow
from app.gui.window_model import WindowModel
from app.settings.sections import Config

PATIENCE_MS = int(os.environ.get("PATIENCE_MS", "240000"))  # with a busy machine


@pytest.fixture(autouse=True)
def forgetful(tmp_path_factory: pytest.TempPathFactory) -> None:
    """A window that remembers nothing of earlier evenings, nor of the one who runs the tests."""
    folder = str(tmp_path_factory.mktemp("memory"))
    QSettings.setPath(QSettings.Format.IniFormat, QSettings.Scope.UserScope, folder)


@pytest.fixture(autouse=True)
def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """STOP in a window stops every bench of its user; those of other programs are not the
    test's.
    """
    for which in ("running", "reachable"):
        monkeypatch.setattr(f"app.processes.launch.{which}", lambda: [])


@pytest.fixture(autouse=True)
def unhurried(monkeypatch: pytest.MonkeyPatch) -> None:
    """A busy machine is no fault: nothing is reported as late unless that is what is tested."""
    for late in (
        *("gui.window.SILENT_S", "gui.window.GIVE_UP_S", "gui.bench_link.SILENT_S"),
        "acquisition.receiver.PATIENCE_S",
    ):
        monkeypatch.setattr(f"app.{late}", PATIENCE_MS / 1e3)


@pytest.fixture(autouse=True)
def dark(qapp: QApplication) -> None:
    """The look of a first evening, whatever the test before has chosen."""
    if theme.now().name != "dark":
        theme.apply(qapp, "dark")


@pytest.fixture(autouse=True, scope="module")
def window_thread() -> Iterator[None]:
    """As in the program, no thread but that of the window deletes what nothing refers to; what is
    there before the tests of a file stays, and need not be looked at after each.
    """
    gc.collect()
    gc.freeze()
    gc.disable()
    before = set(threading.enumerate())  # one that never ends waits for a source
    yield
    for thread in set(threading.enumerate()) - before:
        if thread.name.startswith("slipscope-window"):
            thread.join(5.0)
    gc.collect()
    gc.enable()


@pytest.fixture(autouse=True)
def swept(window_thread: None) -> Iterator[None]:
    """What nothing refers to does not wait for the next test, nor does what is to be deleted."""
    yield
    QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
    gc.collect()


@pytest.fixture
def qtbot(qtbot: QtBot, monkeypatch: pytest.MonkeyPatch) -> QtBot:
    """The robot that uses a window, with patience for a busy machine."""
    for wait in ("waitUntil", "waitSignal", "waitActive", "waitExposed"):
        monkeypatch.setattr(qtbot, wait, partial(getattr(qtbot, wait), timeout=PATIENCE_MS))
    return qtbot


@pytest.fixture
def open_window(qtbot: QtBot) -> Iterator[Open]:
    """Opens windows, which are closed whatever runs in them."""
    opens: list[MainWindow] = []

    def make(
        *args: object, show: Callable[[MainWindow], object] = MainWindow.show, **kwargs: object
    ) -> MainWindow:
        window = MainWindow(*args, **kwargs)  # type: ignore[arg-type]
        with qtbot.waitActive(window):
            show(window)
        opens.append(window)
        return window

    yield make
    for window in opens:
        window._must_close = True
        window.close()
        window.deleteLater()


@pytest.fixture
def beeps(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What would have been heard."""
    heard: list[str] = []
    monkeypatch.setattr(QApplication, "beep", lambda: heard.append("beep"))
    return heard


@pytest.fixture
def model() -> WindowModel:
    """A model with the default settings."""
    return WindowModel(Shop(), Config())  # type: ignore[arg-type]


@pytest.fixture
def said(model: WindowModel) -> list[str]:
    """What the parts of the window say through its model."""
    told: list[str] = []
    model.said.connect(lambda text, _: told.append(text))
    return told


@pytest.fixture
def panel(
    qtbot: QtBot, model: WindowModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> SetupPanel:
    """The form of its settings, on the screen, in a folder of its own."""
    monkeypatch.chdir(tmp_path)
    return shown_panel(qtbot, model)


@pytest.fixture
def run() -> ScriptedRun:
    """A scripted run of 60 frames, not begun."""
    return make_run()


@pytest.fixture
def window(open_window: Open, run: ScriptedRun) -> MainWindow:
    """A window that shows this run."""
    return open_window(run)


@pytest.fixture
def german() -> Iterator[None]:
    """Windows have the language of an operator whose decimal sign is a comma."""
    before = QLocale()
    QLocale.setDefault(QLocale(QLocale.Language.German, QLocale.Country.Germany))
    yield
    QLocale.setDefault(before)
    set_decimal_sign(".")
