"""The keys of the window where something else would take them: those of STOP MOTION while a list or
a menu is open, and those by which a line of text is edited on some systems.
"""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import QEvent, QObject
from PySide6.QtGui import QAction, QKeyEvent, QKeySequence
from PySide6.QtWidgets import QApplication, QDialog, QWidget


class StopKey(QObject):
    """Triggers `actions` of `window` by their keys also where their shortcuts do not reach. The
    keys of all its actions win over a field that would edit by them, as by Ctrl+E with X11.
    """

    def __init__(self, window: QWidget, actions: Sequence[QAction]) -> None:
        super().__init__(window)
        self._window, self._actions = window, tuple(actions)
        application = QApplication.instance()
        assert isinstance(application, QApplication)
        application.focusWindowChanged.connect(self.watch_keys)  # on some screens to what opens

    def watch_keys(self) -> None:
        """Watch the keys of the window, which on some screens has them also while a list or a menu
        is open, and of that itself.
        """
        for widget in (self._window, QApplication.activePopupWidget()):
            if widget is not None and (surface := widget.windowHandle()) is not None:
                surface.installEventFilter(self)  # a second time is none

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Trigger the action of the key that is pressed; the event goes its way. A field hears of a
        key of the window, so that it hands on what was typed, and cannot have it.
        """
        if isinstance(event, QKeyEvent) and event.type() is QEvent.Type.ShortcutOverride:
            field, keys = QApplication.focusWidget(), QKeySequence(event.keyCombination())
            if field is not None and any(keys in one.shortcuts() for one in self._window.actions()):
                QApplication.sendEvent(field, event)
                event.ignore()
                return True
        if isinstance(event, QKeyEvent) and event.type() is QEvent.Type.KeyPress:
            for action in self._actions:
                is_meant = QKeySequence(event.key()) in action.shortcuts()
                if is_meant and not event.isAutoRepeat():
                    action.trigger()
        return super().eventFilter(watched, event)


def close_open() -> bool:
    """Close the dialog in front, if there is one; whether there is, or a list or a menu, which
    closes by the key itself.
    """
    front = QApplication.activeWindow()
    if QApplication.activePopupWidget() is not None:
        return True
    if isinstance(front, QDialog):
        front.reject()
        return True
    return False
