"""Where the parts of the window are: the picture in the middle, all others in docks about it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from PySide6.QtCore import QObject, QSize, Qt, QTimer, Signal
from PySide6.QtGui import QGuiApplication, QResizeEvent
from PySide6.QtWidgets import (
    QDockWidget,
    QMainWindow,
    QMenu,
    QTabBar,
    QTabWidget,
    QWidget,
)

from app.gui.keys import focus_first
from app.gui.memory import LAYOUT, WindowMemory
from app.gui.widgets import SteadySize, scroll_area, widget

LEAST_PX = 240  # width of a dock
FIRST_PX = (1920, 1080)  # that of the first evening, if the screen has room
LEFT = Qt.DockWidgetArea.LeftDockWidgetArea
RIGHT = Qt.DockWidgetArea.RightDockWidgetArea
BOTTOM = Qt.DockWidgetArea.BottomDockWidgetArea
NARROW_PX = 1150  # a window of less has room for docks on one side only
SHARES = {LEFT: 0.21, RIGHT: 0.28}  # of the window, at first


@dataclass(frozen=True, slots=True)
class DockPlace:
    """A part and the side of the window where it is at first, before or behind its neighbours: the
    class of the part, which has a name and a title, and what the part is made of.
    """

    kind: Any
    made_of: tuple[Any, ...]
    side: Qt.DockWidgetArea
    scrolls: bool = True
    least_px: int = LEAST_PX  # width of the dock, also while the part is not made


class PartDock(QDockWidget):
    """A dock whose part is made when it comes into view or is asked for: most take long."""

    resized = Signal()

    def __init__(self, window: QMainWindow, place: DockPlace) -> None:
        super().__init__(place.kind.title, window)
        self.setObjectName(place.kind.name)
        self._place = place
        self.made: Any = None  # its part, once that is there
        self._held = scroll_area() if place.scrolls else SteadySize()
        self._held.setMinimumWidth(place.least_px)
        self.setWidget(self._held)

    def make(self) -> None:
        """Make its part."""
        self.made = self._place.kind(*self._place.made_of)
        self._held.setWidget(self.made)
        self.made.setAutoFillBackground(False)  # as it has one of the style

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Tell of it."""
        super().resizeEvent(event)
        self.resized.emit()


class Docks(QObject):
    """The docks of a window; parts of one side share it as tabs. A side that had to give way in a
    small window has its share again in a larger one.

    Attributes
    ----------
    by_name : dict
        The docks by the names of their parts.
    kind : str
        Which of them there are: a window that only shows a run has fewer, and a layout of its own.
    """

    made = Signal(QWidget)  # a part that was not there before

    def __init__(self, window: QMainWindow, places: Sequence[DockPlace]) -> None:
        super().__init__(window)
        self._window, self._places = window, tuple(places)
        self._shares: dict[Qt.DockWidgetArea, float] = {}  # of the window, by the operator's choice
        self._size = QSize()  # of the window for which they were noted
        self._is_sharing = False  # the docks are being given their shares
        window.setDockOptions(
            QMainWindow.DockOption.AllowTabbedDocks | QMainWindow.DockOption.AllowNestedDocks
        )
        window.setTabPosition(Qt.DockWidgetArea.AllDockWidgetAreas, QTabWidget.TabPosition.North)
        self.by_name = {place.kind.name: PartDock(window, place) for place in places}
        self.kind, self.kinds = "-".join(self.by_name), [place.kind for place in places]
        self._titling = widget(QTimer, self, singleShot=True, timeout=self._show_titles)
        for dock in self.by_name.values():
            dock.resized.connect(partial(self._note_share, dock))
            for moved in (dock.visibilityChanged, dock.topLevelChanged, dock.dockLocationChanged):
                moved.connect(lambda _: self._titling.start())

    def part(self, name: str) -> Any:
        """The part of this name, made by now; None: this window has none."""
        if name in self.by_name and self.if_made(name) is None:
            self.by_name[name].make()
            self.made.emit(self.if_made(name))
        return self.if_made(name)

    def if_made(self, name: str) -> Any:
        """The part of this name, if it is there: else nobody has done anything in it."""
        return self.by_name[name].made if name in self.by_name else None

    def arrange(self) -> None:
        """Put all parts where they are at first."""
        window = self._window
        first: dict[Qt.DockWidgetArea, PartDock] = {}
        for dock in self.by_name.values():
            window.removeDockWidget(dock)  # a dock that is a tab already would be one twice
        for place in self._places:
            dock, side = self.by_name[place.kind.name], self._side(place)
            dock.setFloating(False)
            window.addDockWidget(side, dock)
            if side in first:
                window.tabifyDockWidget(first[side], dock)
            first.setdefault(side, dock)
            dock.show()
        for side, dock in first.items():
            dock.raise_()
            window.resizeDocks([dock], [round(_length(window, side) * SHARES[side])], _way(side))

    def _side(self, place: DockPlace) -> Qt.DockWidgetArea:
        """A narrow window has room for docks on one side only."""
        return RIGHT if self._window.width() < NARROW_PX else place.side

    def _show_titles(self) -> None:
        """Leave the name of a part to its tab, if it has one; a double click there takes the part
        out of the tabs, as one on a title does. What has come into view is made.
        """
        for name, dock in self.by_name.items():
            if not dock.visibleRegion().isEmpty():
                self.part(name)
            is_tab = not dock.isFloating() and bool(self._window.tabifiedDockWidgets(dock))
            bare: QWidget | None = dock.titleBarWidget()
            if is_tab and bare is None:
                dock.setTitleBarWidget(QWidget())
            elif bare is not None and not is_tab:
                dock.setTitleBarWidget(None)  # type: ignore[arg-type]
                bare.deleteLater()
        for bar in self._window.findChildren(
            QTabBar, options=Qt.FindChildOption.FindDirectChildrenOnly
        ):
            if not bar.toolTip():
                bar.setToolTip("Double click: the part becomes a window of its own")
                bar.setElideMode(Qt.TextElideMode.ElideNone)  # rather scrolled than cut short
                bar.tabBarDoubleClicked.connect(partial(self._take_out, bar))

    def _take_out(self, bar: QTabBar, tab: int) -> None:
        title = bar.tabText(tab)  # the next tab takes the place of one that is taken out
        for dock in self.by_name.values():
            if dock.windowTitle() == title:
                dock.setFloating(True)

    def follow_window(self) -> None:
        """Keep the share of each side in the window, which has been resized."""
        if self._window.isVisible():
            QTimer.singleShot(0, self, self._share_out)

    def _note_share(self, dock: QDockWidget) -> None:
        """Note the share of a side that alone has been resized."""
        is_alone = self._window.size() == self._size and not self._is_sharing
        if is_alone and not (dock.isFloating() or dock.visibleRegion().isEmpty()):
            side = self._window.dockWidgetArea(dock)
            self._shares[side] = _length(dock, side) / max(1, _length(self._window, side))

    def _share_out(self) -> None:
        """Give each side its share of the window, which has another size."""
        is_first, self._size = self._size.isEmpty(), self._window.size()
        self._is_sharing = not is_first
        for dock in self.by_name.values():
            side = self._window.dockWidgetArea(dock)
            if is_first:
                self._note_share(dock)
            elif side in self._shares and not dock.isFloating():
                wanted = round(self._shares[side] * _length(self._window, side))
                tabs = self._window.findChild(QTabBar)
                if side == BOTTOM and tabs and self._window.tabifiedDockWidgets(dock):
                    wanted += tabs.height()  # Qt counts them as well
                self._window.resizeDocks([dock], [wanted], _way(side))
        QTimer.singleShot(0, self, lambda: setattr(self, "_is_sharing", False))

    def open(self, memory: WindowMemory) -> None:
        """Give the window its place on the screen and its docks theirs, as they were left; at
        first, or where that is not known, as large as the screen allows.
        """
        window, layout = self._window, memory.layout(self.kind)
        if layout is not None and window.restoreGeometry(layout[0]):
            if not window.restoreState(layout[1], LAYOUT):
                self.arrange()
        else:
            room = QGuiApplication.primaryScreen().availableSize()
            window.resize(min(FIRST_PX[0], room.width()), min(FIRST_PX[1], room.height()))
            if FIRST_PX[0] >= room.width() or FIRST_PX[1] >= room.height():
                window.setWindowState(Qt.WindowState.WindowMaximized)
            self.arrange()

    def show(self, name: str) -> None:
        """Bring a part to the front."""
        self.part(name)
        dock = self.by_name[name]
        dock.show()
        dock.raise_()

    def go_to(self, name: str) -> None:
        """Bring a part to the front, and put the keys into it."""
        self._window.activateWindow()
        self.show(name)
        focus_first(self.by_name[name])

    def add_to(self, menu: QMenu) -> None:
        """List the parts in a menu, to be shown or hidden."""
        menu.addSeparator()
        for dock in self.by_name.values():
            menu.addAction(dock.toggleViewAction())


def _way(side: Qt.DockWidgetArea) -> Qt.Orientation:
    return Qt.Orientation.Vertical if side == BOTTOM else Qt.Orientation.Horizontal


def _length(widget: QWidget, side: Qt.DockWidgetArea) -> int:
    """Of the window, or of a dock at that side of it, across the side."""
    return widget.height() if side == BOTTOM else widget.width()
