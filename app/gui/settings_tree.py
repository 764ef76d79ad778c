"""Settings as a pyqtgraph ParameterTree: rows on top, and tables that are filled when opened."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

from pyqtgraph.parametertree import Parameter, ParameterTree
from pyqtgraph.parametertree.parameterTypes import GroupParameter, GroupParameterItem
from PySide6.QtCore import QEvent, QModelIndex, QObject, QRect, QSize, Qt, QTimer, Signal
from PySide6.QtGui import QKeyEvent, QPainter, QResizeEvent
from PySide6.QtWidgets import (
    QAbstractItemView,
    QHeaderView,
    QLabel,
    QPlainTextEdit,
    QTreeWidgetItem,
    QWidget,
)

from app.gui.form import FormField, FormGroup
from app.gui.setting_row import RowState, SettingItem, parameter

NAME_SHARE = 0.4  # of the width of the tree
INDENTATION = 14


class SettingsTree(ParameterTree):  # type: ignore[misc]
    """A tree of settings; the rows of a table are made when it is first opened.

    Parameters
    ----------
    state : callable
        What the row of a field shows.
    """

    entered = Signal(object, str)  # the FormField, and what was typed
    reset_asked = Signal(object)
    focused = Signal(object)

    def __init__(self, state: Callable[[FormField], RowState]) -> None:
        super().__init__(showHeader=False)
        self._state = state
        self._spans: list[tuple[QTreeWidgetItem, QWidget]] = []
        self._chain = QTimer(self, singleShot=True)
        self._chain.timeout.connect(self._set_tab_order)
        self.setAlternatingRowColors(False)
        self.setRootIsDecorated(True)
        self.setIndentation(INDENTATION)
        self.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
        self.setDragDropMode(QAbstractItemView.DragDropMode.NoDragDrop)
        self.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
        self.header().setSectionResizeMode(0, QHeaderView.ResizeMode.Fixed)
        self.header().setSectionResizeMode(1, QHeaderView.ResizeMode.Stretch)
        self.header().setMinimumSectionSize(20)
        self._open: set[str] = set()  # tables that the operator has opened
        self._is_searched = False
        self.itemExpanded.connect(self._opened)
        self.itemCollapsed.connect(self._closed)
        self.itemClicked.connect(self._go_into)
        self.itemActivated.connect(self._go_into)

    # ------------------------------------------------------------------ what there is

    def rows(self, key: str = "") -> list[SettingItem]:
        """The rows there are, from top to bottom; those of one setting where `key` is given."""
        made = [one for one in self.listAllItems() if isinstance(one, SettingItem)]
        return [one for one in made if one.field.key == key] if key else made

    def tables(self) -> Iterator[GroupParameterItem]:
        """The tables on top."""
        return (one for one in self.topLevelItems() if isinstance(one, GroupParameterItem))

    def add_row(self, field: FormField, name: str = "", **opts: Any) -> SettingItem:
        """Add a row on top of all tables."""
        self.addParameters(made := parameter(field, name, **opts))
        item: SettingItem
        (item,) = made.items
        self._show((item,))
        return item

    def put_groups(self, groups: Iterable[FormGroup]) -> None:
        """Have these tables at the end; those that are there are kept where they are the same."""
        there = {item.param.name(): item for item in self.tables()}
        for group in groups:
            if group.table not in there:
                self.addParameters(made := table(group.table, group.title, group.fields))
                self._decorate(made)
                continue
            item = there[group.table]
            if item.param.opts["fields"] != group.fields:  # another driver has other options
                item.param.setOpts(fields=group.fields)
                item.param.clearChildren()
                if item.isExpanded():
                    self.fill(item)

    def put_tables(self, below: SettingItem, tables: Iterable[Parameter]) -> None:
        """Have these tables, and no others, below a row."""
        below.param.clearChildren()
        for one in tables:
            below.param.addChild(one)
            self._decorate(one)

    def fill(self, item: Any) -> None:
        """Make the rows of a table, if they are not there."""
        param = getattr(item, "param", None)
        if param is not None and not param.hasChildren() and (new := param.opts.get("fields")):
            param.addChildren([parameter(field) for field in new])
            self._show(item.child(n) for n in range(item.childCount()))

    def span(self, widget: QWidget, below: QTreeWidgetItem | None = None) -> QTreeWidgetItem:
        """Add a row for a widget, over both columns."""
        item = QTreeWidgetItem()
        item.setFlags(Qt.ItemFlag.ItemIsEnabled)
        (below or self.invisibleRootItem()).addChild(item)
        item.setFirstColumnSpanned(True)
        if isinstance(widget, QLabel):
            widget.setWordWrap(True)
        if below is not None:
            below.setExpanded(True)
        self.setItemWidget(item, 0, widget)
        self._spans.append((item, widget))
        widget.installEventFilter(self)
        self._chain.start()
        return item

    # ------------------------------------------------------------------ showing

    def refresh(self) -> None:
        """Show all rows anew, where they have changed."""
        for one in self.rows():
            one.show(self._state(one.field))

    def show_only(self, words: Sequence[str], changed: set[str] | None) -> None:
        """Show the settings that these words mean and that are `changed`, if that is given; their
        tables are open while some are looked for, and what stands on top is hidden.
        """
        self._is_searched = bool(words) or changed is not None
        for item in self.topLevelItems():
            item.setHidden(self._is_searched)
        for item in self.tables():
            meant = {
                field.key
                for field in item.param.opts["fields"]
                if field.is_like(words) and (changed is None or field.key in changed)
            }
            item.setHidden(not meant)
            is_open = bool(meant) if self._is_searched else item.param.name() in self._open
            if is_open:
                self.fill(item)
            for one in (item.child(n) for n in range(item.childCount())):
                one.setHidden(one.field.key not in meant)
            item.setExpanded(is_open)

    def open(self, table: str) -> None:
        """Open a table."""
        for item in self.tables():
            if item.param.name() == table:
                item.setExpanded(True)

    def _opened(self, item: QTreeWidgetItem) -> None:
        self.fill(item)
        if not self._is_searched and isinstance(item, GroupParameterItem):
            self._open.add(item.param.name())

    def _closed(self, item: QTreeWidgetItem) -> None:
        if isinstance(item, SettingItem) and not item.param.hasChildren():
            item.setExpanded(True)  # its sentence stays
        elif not self._is_searched and isinstance(item, GroupParameterItem):
            self._open.discard(item.param.name())

    def enter(self, item: SettingItem) -> None:
        """A row has the keys now."""
        self.setCurrentItem(item)
        self.scrollToItem(item)
        self.focused.emit(item.field)

    def go_to(self, item: SettingItem) -> None:
        """Put the keys into a row, and bring it into view."""
        above = item.parent()
        while above is not None:
            above.setHidden(False)
            above.setExpanded(True)
            above = above.parent()
        item.setHidden(False)
        self.scrollToItem(item)
        item.editor.setFocus()

    def _show(self, new: Iterable[SettingItem]) -> None:
        for one in new:
            one.show(self._state(one.field))
        self._chain.start()

    def _decorate(self, made: Parameter) -> None:
        for item in made.items:
            item.setToolTip(0, made.opts["tip"])
            self._set_font(item)
            item.setChildIndicatorPolicy(QTreeWidgetItem.ChildIndicatorPolicy.ShowIndicator)

    def _go_into(self, item: QTreeWidgetItem) -> None:
        if isinstance(item, SettingItem):
            item.editor.setFocus()
        elif isinstance(item, GroupParameterItem):
            item.setExpanded(not item.isExpanded())

    def _set_tab_order(self) -> None:
        """Let Tab go from top to bottom, whenever a row was made."""
        before: QWidget = self
        for item in self.listAllItems():
            held = self.itemWidget(item, 0) or self.itemWidget(item, 1)
            for one in held.findChildren(QWidget) if held else ():
                takes_keys = one.focusPolicy() & Qt.FocusPolicy.TabFocus
                if takes_keys and one.window() is self.window():
                    self.setTabOrder(before, one)
                    before = one

    # ------------------------------------------------------------------ sizes and looks

    def fit(self) -> None:
        """Give what spans both columns the height that it needs."""
        self._spans = [one for one in self._spans if one[0].treeWidget() is self]
        for item, widget in self._spans:
            depth = 0
            above = item.parent()
            while above is not None:
                depth, above = depth + 1, above.parent()
            width = self.viewport().width() - (depth + 1) * self.indentation()
            high = widget.heightForWidth(width) if widget.hasHeightForWidth() else -1
            need = QSize(width, high if high >= 0 else widget.sizeHint().height())
            if item.sizeHint(0) != need:
                item.setSizeHint(0, need)
                self.scheduleDelayedItemsLayout()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Hear that a widget over both columns needs another height, and that an editor has the
        keys; take what stands in it before a key of the window acts, and where a page is left.
        """
        kind = event.type()
        if kind == QEvent.Type.LayoutRequest:
            self.fit()
        is_taken = is_command(event) or (
            kind == QEvent.Type.FocusOut and isinstance(watched, QPlainTextEdit)
        )
        if is_taken or kind == QEvent.Type.FocusIn:
            for item in (one for one in self.rows() if one.editor is watched):
                if is_taken:
                    item.take()
                else:
                    self.enter(item)
        return False

    def drawBranches(self, painter: QPainter, rect: QRect, index: QModelIndex) -> None:
        """Draw an arrow where there is something to be opened."""
        item = self.itemFromIndex(index)[0]
        if not isinstance(item, SettingItem) or item.param.hasChildren():
            super().drawBranches(painter, rect, index)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Share the width among the columns."""
        super().resizeEvent(event)
        self.header().resizeSection(0, round(NAME_SHARE * self.viewport().width()))
        self.fit()

    def event(self, event: QEvent) -> bool:
        """Mark the rows in the colours and the font of another look: pyqtgraph has bold ones."""
        is_taken = bool(super().event(event))
        looks = (QEvent.Type.StyleChange, QEvent.Type.FontChange)
        if event.type() in looks and hasattr(self, "_state"):
            for one in self.listAllItems():
                if isinstance(one, SettingItem):
                    one.mark()
                elif isinstance(one, GroupParameterItem):
                    self._set_font(one)
        return is_taken

    def _set_font(self, item: GroupParameterItem) -> None:
        """Let what stands on top be bold only."""
        font = self.font()
        font.setBold(item.parent() is None)
        item.setFont(0, font)


def is_command(event: QEvent) -> bool:
    """Whether a key may be one of the window's: what was typed is to be taken before it acts."""
    if event.type() != QEvent.Type.ShortcutOverride or not isinstance(event, QKeyEvent):
        return False
    is_function = Qt.Key.Key_F1 <= event.key() <= Qt.Key.Key_F35
    return is_function or bool(event.modifiers() & Qt.KeyboardModifier.ControlModifier)


def table(name: str, tip: str, fields: Iterable[FormField], **opts: Any) -> GroupParameter:
    """A table of settings, closed."""
    return GroupParameter(name=name, tip=tip, expanded=False, fields=tuple(fields), **opts)
