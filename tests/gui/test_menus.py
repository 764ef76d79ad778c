"""Buttons that open a menu."""

from operators import NO_KEYS
from PySide6.QtCore import QPoint, Qt, QTimer
from PySide6.QtGui import QCursor
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QStyle, QStyleOptionToolButton, QWidget
from pytestqt.qtbot import QtBot

from app.gui.widgets import column, menu_button

LEFT = Qt.MouseButton.LeftButton


def test_a_button_is_not_lit_any_more_after_its_menu(qtbot: QtBot) -> None:
    done: list[str] = []
    acts = {name: lambda name=name: done.append(name) for name in ("Open", "Save")}
    window, button = QWidget(), menu_button("File", "", acts)
    window.setLayout(column(button, 300))
    qtbot.addWidget(window)
    with qtbot.waitActive(window):
        window.show()
    place = button.geometry().center()

    def choose() -> None:
        menu = button.menu()
        assert QApplication.activePopupWidget() is menu
        item = menu.actionGeometry(menu.actions()[1]).center()
        QTest.mouseMove(menu.windowHandle(), item)
        QCursor.setPos(menu.mapToGlobal(item))  # which Qt asks once the menu is closed
        QTest.mouseClick(menu.windowHandle(), LEFT, NO_KEYS, item)

    for at in (QPoint(), place):  # a pointer that was there already would enter nothing
        QTest.mouseMove(window.windowHandle(), at)
    qtbot.waitUntil(button.underMouse)
    QTimer.singleShot(200, choose)  # the menu has a loop of its own
    QTest.mouseClick(window.windowHandle(), LEFT, NO_KEYS, place)
    qtbot.waitUntil(lambda: done == ["Save"])

    def is_lit() -> bool:
        option = QStyleOptionToolButton()
        button.initStyleOption(option)
        state = QStyle.StateFlag
        return bool(option.state & (state.State_MouseOver | state.State_Sunken))

    qtbot.waitUntil(lambda: not is_lit())  # without another move of the mouse
    assert not button.isDown()
