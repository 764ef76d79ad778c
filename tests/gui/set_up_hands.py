"""The set-up form by keyboard and mouse: what types, opens and sees there."""

from pathlib import Path

from pyqtgraph.parametertree.parameterTypes import GroupParameterItem
from PySide6.QtCore import Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QLineEdit,
)
from pytestqt.qtbot import QtBot

from app.gui.form import STEPS_KEY
from app.gui.setting_row import SettingItem
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
    made = SetupPanel(model)
    qtbot.addWidget(made)
    made.resize(340, 900)
    with qtbot.waitExposed(made):
        made.show()
    made.activateWindow()
    return made


def write(qtbot: QtBot, editor: QLineEdit, text: str, end: Qt.Key | None = Qt.Key.Key_Tab) -> None:
    editor.setFocus()
    qtbot.keyClick(editor, Qt.Key.Key_A, Qt.KeyboardModifier.ControlModifier)
    qtbot.keyClick(editor, Qt.Key.Key_Delete)
    qtbot.keyClicks(editor, text)
    if end is not None:
        qtbot.keyClick(editor, end)


def click(qtbot: QtBot, widget: object) -> None:
    qtbot.mouseClick(widget, Qt.MouseButton.LeftButton)


def in_tables(panel: SetupPanel) -> list[SettingItem]:
    """The rows in the tables below those on top."""
    return [one for one in panel.tree.rows() if isinstance(one.parent(), GroupParameterItem)]


def visible(panel: SetupPanel) -> set[str]:
    rows = in_tables(panel)
    return {one.field.key for one in rows if panel.tree.visualItemRect(one).isValid()}


def open_table(panel: SetupPanel, name: str) -> None:
    """Open a table by a click on its head."""
    (item,) = (one for one in panel.tree.tables() if one.text(0) == name)
    panel.tree.scrollToItem(item)
    place = panel.tree.visualItemRect(item).center()
    QTest.mouseClick(panel.tree.viewport(), Qt.MouseButton.LeftButton, pos=place)


def steps_of(panel: SetupPanel) -> list[str]:
    """The steps in words, as they stand below the protocol."""
    row = panel.row(STEPS_KEY)
    items = (row.child(n) for n in range(row.childCount()))
    return [one.text(0) for one in items if isinstance(one, GroupParameterItem)]
