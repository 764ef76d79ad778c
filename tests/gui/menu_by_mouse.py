"""Opens the menu of a button by mouse and chooses in it; exits with 1 if the button is lit
afterwards. A process of its own: Qt keeps where the mouse was in windows before.
"""

import os
from collections.abc import Callable

os.environ["QT_QPA_PLATFORM"] = "offscreen"  # before Qt loads

from PySide6.QtCore import Qt, QTimer
from PySide6.QtGui import QCursor
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QStyle, QStyleOptionToolButton, QWidget

from app.gui.widgets import column, menu_button

LEFT, NO_KEYS = Qt.MouseButton.LeftButton, Qt.KeyboardModifier.NoModifier
PATIENT_MS = 60_000


def wait_for(condition: Callable[[], bool]) -> None:
    """Let Qt work until it holds."""
    left = PATIENT_MS // 10
    while not condition():
        assert (left := left - 1) > 0, "the window does not answer, or the button stays lit"
        QTest.qWait(10)


def main() -> None:
    """Choose "Save", and do not move the mouse again."""
    application = QApplication([])
    done: list[str] = []
    acts = {name: lambda name=name: done.append(name) for name in ("Open", "Save")}
    window, button = QWidget(), menu_button("File", "", acts)
    window.setLayout(column(button, 300))
    window.show()
    assert QTest.qWaitForWindowActive(window, PATIENT_MS)
    place = button.geometry().center()

    def choose() -> None:
        menu = button.menu()
        assert application.activePopupWidget() is menu
        item = menu.actionGeometry(menu.actions()[1]).center()
        QTest.mouseMove(menu.windowHandle(), item)
        QCursor.setPos(menu.mapToGlobal(item))  # which Qt asks once the menu is closed
        QTest.mouseClick(menu.windowHandle(), LEFT, NO_KEYS, item)

    def is_lit() -> bool:
        option = QStyleOptionToolButton()
        button.initStyleOption(option)
        return bool(
            option.state & (QStyle.StateFlag.State_MouseOver | QStyle.StateFlag.State_Sunken)
        )

    QTest.mouseMove(window.windowHandle(), place)
    wait_for(is_lit)
    QTimer.singleShot(200, choose)  # the menu has a loop of its own
    QTest.mouseClick(window.windowHandle(), LEFT, NO_KEYS, place)
    wait_for(lambda: done == ["Save"])
    wait_for(lambda: not is_lit())


if __name__ == "__main__":
    main()
