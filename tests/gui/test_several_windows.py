"""One window after the other, and two at a time, in one process."""

from __future__ import annotations

import gc
from pathlib import Path

import pytest
import shiboken6
from PySide6.QtCore import QEvent
from PySide6.QtWidgets import QApplication, QTreeWidgetItem
from pytestqt.qtbot import QtBot
from scripted_run import ScriptedRun
from set_up_hands import heads_of_steps
from workshops import Makes

from app.gui.form import STEPS_KEY
from app.gui.settings_list import SettingsTable
from app.gui.window import MainWindow
from app.gui.window_model import WindowModel
from app.settings.sections import Config


def opened(qtbot: QtBot, tmp_path: Path) -> MainWindow:
    """A window all of whose parts were seen, with rows in all lists."""
    window = MainWindow(model=WindowModel(Makes(lambda: ScriptedRun(320, 240)), Config()))
    with qtbot.waitExposed(window):
        window.show()
    for name in window.docks.by_name:
        window.docks.show(name)
    for table in window.setup.settings.findChildren(SettingsTable):
        table.open()
    window.sessions.list.fill([tmp_path / f"{n}.h5" for n in range(20)])
    window.campaign.open(Path("six-loads"))
    qtbot.waitUntil(lambda: window.campaign.list.topLevelItemCount() == 6)
    assert window.calibration.list.topLevelItem(0).text(0)
    return window


def destroyed(window: MainWindow) -> None:
    """Delete what Qt has of a window, of which Python still has all names."""
    window.close()
    window.deleteLater()
    QApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
    assert not shiboken6.isValid(window)


def items_of_python() -> list[QTreeWidgetItem]:
    """Items of lists that Python knows: one whose list is gone would lend its type to whatever Qt
    puts in its place.
    """
    return [one for one in gc.get_objects() if isinstance(one, QTreeWidgetItem)]


@pytest.mark.slow
def test_windows_come_and_go_and_leave_no_item_of_a_list(qtbot: QtBot, tmp_path: Path) -> None:
    first = opened(qtbot, tmp_path)
    second = opened(qtbot, tmp_path)
    destroyed(first)
    # the other goes on as if it had been alone
    second.setup.row(STEPS_KEY).editor.setFocus()
    assert len(heads_of_steps(second.setup)) == 4
    assert "loads" in second.campaign.list.topLevelItem(5).text(1)
    destroyed(second)
    assert not items_of_python()
    for _ in range(2):
        destroyed(opened(qtbot, tmp_path))
        assert not items_of_python()
