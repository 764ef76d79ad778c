"""The hands of an operator: one has a mouse, one has a keyboard, and both see what is in view."""

from __future__ import annotations

from PySide6.QtCore import QPoint, QPointF, Qt
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QApplication,
    QComboBox,
    QLabel,
    QScrollArea,
    QTabBar,
    QTextBrowser,
    QTreeWidget,
    QWidget,
)
from pytestqt.qtbot import QtBot

from app.gui.keys import GO_TO
from app.gui.window import MainWindow

NO_KEYS = Qt.KeyboardModifier.NoModifier
CTRL = Qt.KeyboardModifier.ControlModifier
SHIFT = Qt.KeyboardModifier.ShiftModifier
MOST_TABS = 120  # more than there are things in the window that take keys


def words(part: QWidget) -> str:
    """All that can be read on a part."""
    texts = [one.text() for one in part.findChildren(QLabel) if one.isVisible()]
    texts += [one.toPlainText() for one in part.findChildren(QTextBrowser) if one.isVisible()]
    return "\n".join(texts)


class Mouse:
    """Clicks where the pointer is, and on what lies there: the window finds out what that is."""

    def __init__(self, qtbot: QtBot, window: MainWindow) -> None:
        self._qtbot, self._window = qtbot, window

    def click(self, widget: QWidget, at: QPoint | None = None, key: Qt.KeyboardModifier = NO_KEYS):
        """Click on a widget, which is brought into view if it can be scrolled."""
        top = widget.window()
        area = widget.parent()
        while area is not None:
            if isinstance(area, QScrollArea) and area.widget().isAncestorOf(widget):
                area.ensureWidgetVisible(widget)
            area = area.parent()
        place = widget.mapTo(top, widget.rect().center() if at is None else at)
        there = top.childAt(place)
        assert widget.isVisible(), f"{widget} is not in view"
        assert widget.isEnabled(), f"{widget} is grey"
        assert there is widget or widget.isAncestorOf(there), f"{there} covers {widget}"
        QTest.mouseClick(top.windowHandle(), Qt.MouseButton.LeftButton, key, place)

    def wheel(self, widget: QWidget) -> None:
        """Turn the wheel towards the middle of a widget."""
        top, middle = widget.window(), widget.rect().center()
        place = widget.mapTo(top, middle)
        assert top.childAt(place) is widget
        QTest.wheelEvent(top.windowHandle(), QPointF(place), QPoint(0, 120))

    def go_to(self, part: str) -> None:
        """Bring a part to the front by its tab."""
        title = self._window.docks.by_name[part].windowTitle()
        for bar in self._window.findChildren(QTabBar):
            for k in range(bar.count()):
                if bar.tabText(k) == title and bar.isVisible():
                    self.click(bar, bar.tabRect(k).center())
        assert not self._window.docks.by_name[part].visibleRegion().isEmpty()

    def type(self, field: QWidget, text: str) -> None:
        """Click into a field, and type in place of what stands there."""
        self.click(field)
        assert QApplication.focusWidget() is field
        self._qtbot.keyClick(field, Qt.Key.Key_A, CTRL)
        self._qtbot.keyClicks(field, text)

    def press(self, button: QWidget) -> None:
        """Press a button."""
        self.click(button)

    def choose(self, choice: QComboBox, text: str) -> None:
        """Choose from a list that opens."""
        self.click(choice)
        view = choice.view()
        self._qtbot.waitUntil(view.isVisible)
        model = choice.model()
        place = view.visualRect(model.index(choice.findText(text), 0)).center()
        QTest.mouseMove(view.viewport(), place)
        self._qtbot.mouseClick(view.viewport(), Qt.MouseButton.LeftButton, pos=place)
        self._qtbot.waitUntil(lambda: choice.currentText() == text)

    def pick(self, found: QTreeWidget, *names: str) -> None:
        """Click on rows of a list, with Ctrl from the second on."""
        for k, name in enumerate(names):
            (item,) = found.findItems(name, Qt.MatchFlag.MatchExactly, 0)
            found.scrollToItem(item)
            place = found.visualItemRect(item).center()
            at = found.viewport().mapTo(found, place)
            self.click(found, QPoint(40, at.y()), CTRL if k else NO_KEYS)


class Keyboard:
    """Presses keys, which go where the focus is, in the window that is in front."""

    def __init__(self, qtbot: QtBot, window: MainWindow) -> None:
        self._qtbot, self._window = qtbot, window

    def key(self, key: Qt.Key, modifier: Qt.KeyboardModifier = NO_KEYS) -> None:
        """Press a key."""
        front = QApplication.activePopupWidget() or QApplication.activeWindow()
        assert front is not None
        QTest.keyClick(front.windowHandle(), key, modifier)

    def keys(self, text: str) -> None:
        """Type a text."""
        field = QApplication.focusWidget()
        assert field is not None
        self._qtbot.keyClicks(field, text)

    def tab_to(self, widget: QWidget) -> None:
        """Press Tab until something has the focus."""
        for _ in range(MOST_TABS):
            if QApplication.focusWidget() is widget:
                return
            self.key(Qt.Key.Key_Tab)
        raise AssertionError(f"{widget} cannot be reached by Tab")

    def go_to(self, part: str) -> None:
        """Bring a part to the front by its key."""
        number = int(GO_TO[part].removeprefix("Ctrl+"))
        self.key(Qt.Key(Qt.Key.Key_0 + number), CTRL)
        dock = self._window.docks.by_name[part]
        self._qtbot.waitUntil(lambda: not dock.visibleRegion().isEmpty())
        assert dock.isAncestorOf(QApplication.focusWidget())

    def type(self, field: QWidget, text: str) -> None:
        """Go to a field, and type in place of what stands there."""
        self.tab_to(field)
        self.key(Qt.Key.Key_A, CTRL)
        self.keys(text)

    def press(self, button: QWidget) -> None:
        """Press a button."""
        self.tab_to(button)
        self.key(Qt.Key.Key_Space)

    def choose(self, choice: QComboBox, text: str) -> None:
        """Choose from a list by arrow keys."""
        self.tab_to(choice)
        wanted = choice.findText(text)
        while (at := choice.currentIndex()) != wanted:
            self.key(Qt.Key.Key_Down if at < wanted else Qt.Key.Key_Up)
            assert choice.currentIndex() != at

    def pick(self, found: QTreeWidget, *names: str) -> None:
        """Select rows of a list that lie one below the other."""
        self.tab_to(found)
        rows = sorted(
            found.indexOfTopLevelItem(found.findItems(name, Qt.MatchFlag.MatchExactly, 0)[0])
            for name in names
        )
        assert rows == list(range(rows[0], rows[-1] + 1))
        self.key(Qt.Key.Key_Home)
        for _ in range(rows[0]):
            self.key(Qt.Key.Key_Down)
        for _ in rows[1:]:
            self.key(Qt.Key.Key_Down, SHIFT)


def large(window: MainWindow) -> None:
    """Show a window on a screen with room for all its docks."""
    window.showNormal()
    arrange(window, 1720, 1000)


def arrange(window: MainWindow, width: int, height: int) -> None:
    """Give a window its first places and a size, which those of a larger one may not allow."""
    window.resize(width, height)
    window.reset_layout()
    window.resize(width, height)
