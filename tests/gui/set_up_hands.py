"""The set-up form by keyboard and mouse: what types, opens and sees there."""

from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QToolButton, QWidget
from pytestqt.qtbot import QtBot
from window_hands import shown

from app.gui.settings_list import SettingsTable
from app.gui.setup_panel import SetupPanel
from app.gui.window_model import WindowModel
from app.settings.sections import Config, RunSettings


class Shop:
    """Knows the settings of one recorded run."""

    def settings_of(self, session: Path) -> Config:
        if session.name != "old.h5":
            raise ValueError(f"{session}: not a session")
        return Config(run=RunSettings(normal_force=0.2))

    preview = None


def shown_panel(qtbot: QtBot, model: WindowModel) -> SetupPanel:
    """The form of a model, on the screen."""
    made = shown(qtbot, SetupPanel(model), 340, 900)
    made.activateWindow()
    return made


def write(qtbot: QtBot, editor: QWidget, text: str, end: Qt.Key | None = Qt.Key.Key_Tab) -> None:
    editor.setFocus()
    qtbot.keyClick(editor, Qt.Key.Key_A, Qt.KeyboardModifier.ControlModifier)
    qtbot.keyClick(editor, Qt.Key.Key_Delete)
    qtbot.keyClicks(editor, text)
    if end is not None:
        qtbot.keyClick(editor, end)


def visible(panel: SetupPanel) -> set[str]:
    """Keys of the rows in the tables below those on top that can be seen."""
    own = panel.protocol.findChildren(SettingsTable)
    tables = [one for one in panel.settings.findChildren(SettingsTable) if one not in own]
    return {row.field.key for one in tables for row in one.rows if row.isVisible()}


def open_table(panel: SetupPanel, name: str) -> None:
    """Open a table by a click on its head."""
    click_in_view(panel, panel.settings.table(name).head)


def click_in_view(panel: SetupPanel, head: QWidget) -> None:
    """Scroll to a head, and click on it where it is seen."""
    QTest.qWait(1)  # what was opened just now has its place
    panel.settings.ensureWidgetVisible(head)
    window = panel.window()
    place = head.mapTo(window, head.rect().center())
    assert window.childAt(place) is head
    QTest.mouseClick(window.windowHandle(), Qt.MouseButton.LeftButton, pos=place)


def heads_of_steps(panel: SetupPanel) -> list[QToolButton]:
    return [one.head for one in panel.protocol.findChildren(SettingsTable)]


def steps_of(panel: SetupPanel) -> list[str]:
    """The steps in words, as they stand below the protocol."""
    return [head.text() for head in heads_of_steps(panel)]
