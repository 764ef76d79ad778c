"""The key of STOP MOTION while a list or a menu is open, which takes all keys."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import QEvent, QObject
from PySide6.QtGui import QAction, QKeyEvent, QKeySequence
from PySide6.QtWidgets import QApplication, QWidget


class StopKey(QObject):
    """Stops the motion by the keys of an action of `window` also where its shortcuts do not reach.

    Parameters
    ----------
    window : QWidget
    action : QAction
        Whose keys they are.
    stop : callable
    """

    def __init__(self, window: QWidget, action: QAction, stop: Callable[[], object]) -> None:
        super().__init__(window)
        self._window, self._action, self._stop = window, action, stop

    def watch_popup(self) -> None:
        """Watch the keys of the list or menu that is open, if there is one."""
        popup = QApplication.activePopupWidget()
        if popup is not None and popup.windowHandle() is not None:
            for surface in (popup.windowHandle(), self._window.windowHandle()):
                surface.installEventFilter(self)  # a second time is none

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Stop the motion if one of the keys is pressed; the event goes its way."""
        if isinstance(event, QKeyEvent) and event.type() is QEvent.Type.KeyPress:
            is_meant = QKeySequence(event.key()) in self._action.shortcuts()
            if is_meant and not event.isAutoRepeat():
                self._stop()
        return super().eventFilter(watched, event)
