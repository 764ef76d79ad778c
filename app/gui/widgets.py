"""The small pieces that all parts of the window are made of."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any, TypeVar

from PySide6.QtCore import QEvent, QObject, QSize, Qt
from PySide6.QtGui import (
    QColor,
    QKeySequence,
    QPainter,
    QPaintEvent,
    QResizeEvent,
    QShortcut,
)
from PySide6.QtWidgets import (
    QAbstractButton,
    QAbstractItemView,
    QBoxLayout,
    QComboBox,
    QFormLayout,
    QFrame,
    QGraphicsWidget,
    QHBoxLayout,
    QHeaderView,
    QLabel,
    QLayout,
    QMenu,
    QProgressBar,
    QPushButton,
    QScrollArea,
    QSizePolicy,
    QToolButton,
    QTreeWidget,
    QTreeWidgetItem,
    QVBoxLayout,
    QWidget,
)

from app.gui import theme
from app.gui.background import Act
from app.gui.cells import Tone
from app.gui.number_boxes import NoWheel

# in a layout: a widget or a layout, with its share of the free space; a number is a gap in pixels
Part = QWidget | QLayout | tuple[QWidget | QLayout, int] | int
Editors = Mapping[str, QWidget | QLayout]  # by their names
SLACK = 40  # px that a part may have more than it needs
SPACING = 6  # px between two parts
BAR_STEPS = 1000
TONE_ROLE = Qt.ItemDataRole.UserRole  # of what a list keeps beside a text
Margins = tuple[int, int, int, int]  # left, top, right, bottom
STRETCH = -1  # in place of a gap: all the free space
Box = TypeVar("Box", bound=QBoxLayout)
Kind = TypeVar("Kind", bound=QObject)


class Panel(QFrame):
    """A framed part of the window."""

    def __init__(self) -> None:
        super().__init__()
        self.setObjectName("panel")

    def hold(self, *parts: Part, spacing: int = SPACING) -> None:
        """Have these parts one below the other, at some distance from the frame."""
        self.setLayout(column(*parts, spacing=spacing, margins=(10, 8, 10, 8)))


class SteadySize(QWidget):
    """Holds a part whose words change several times a second: the window about it is laid out
    again only where the part needs more room, or clearly less.
    """

    def __init__(self, part: QWidget | None = None) -> None:
        super().__init__()
        self._part, self._room = QWidget(self), QSize()
        if part is not None:
            self.setWidget(part)

    def setWidget(self, part: QWidget) -> None:
        """Hold this from now on."""
        self._part.deleteLater()
        self._part = part
        part.setParent(self)
        part.setGeometry(self.rect())
        if self.isVisible():
            part.resize(self.size().expandedTo(part.minimumSizeHint()))  # until all is laid out
            part.show()
        self.setSizePolicy(part.sizePolicy())
        self.updateGeometry()

    def sizeHint(self) -> QSize:
        """That of the part."""
        return self._part.sizeHint()

    def minimumSizeHint(self) -> QSize:
        """That of the part."""
        return self._part.minimumSizeHint().expandedTo(self._part.minimumSize())

    def hasHeightForWidth(self) -> bool:
        """Whether the part has words that go on in another line."""
        return self._part.hasHeightForWidth()

    def heightForWidth(self, width: int) -> int:
        """That of the part."""
        return self._part.heightForWidth(width)

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Give all the room to the part."""
        super().resizeEvent(event)
        self._part.setGeometry(self.rect())

    def event(self, event: QEvent) -> bool:
        """Hear that the part has changed."""
        is_plain = type(event) is QEvent  # the types of all others would take long to ask for
        if is_plain and event.type() == QEvent.Type.LayoutRequest and self._measure():
            self.updateGeometry()
        return super().event(event)

    def _measure(self) -> bool:
        """Whether the part needs other room than it had."""
        needed = self.minimumSizeHint()
        if self.hasHeightForWidth():
            needed.setHeight(self.heightForWidth(self.width()))
        more = (needed - self._room).toTuple()
        is_other = max(more) > 0 or min(more) < -SLACK
        if is_other:
            self._room = needed
        return is_other


class PanelLabel(QLabel):
    """A text on a panel with a ground of its own: as its words change, nothing of what it is in is
    painted below it.
    """

    def __init__(self, text: str, **properties: Any) -> None:
        super().__init__(text, **properties)
        self.setProperty("on", "panel")
        self.setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent)

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the text over its ground."""
        painter = QPainter(self)
        painter.fillRect(event.rect(), self.palette().window())
        painter.end()
        super().paintEvent(event)


class SteadyLine(QWidget):
    """Holds one line of words, which are cut short: as they change nothing is laid out again."""

    def __init__(self, line: QLabel) -> None:
        super().__init__()
        self._line = line
        line.setParent(self)
        self.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Fixed)
        self.resize(line.sizeHint())  # of which `QWidget.grab` tells also what is hidden

    def sizeHint(self) -> QSize:
        """That of the words."""
        return self._line.sizeHint()

    def resizeEvent(self, event: QResizeEvent) -> None:
        """Fix the size of the line, which then asks for no other."""
        super().resizeEvent(event)
        self._line.setFixedSize(self.size())


class EmptyNote(QLabel):
    """Says in a list or a table, as long as it has no row, what it is for."""

    def __init__(self, view: QAbstractItemView, text: str) -> None:
        super().__init__(text)
        self.setObjectName("muted")
        self.setWordWrap(True)
        self.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.setAttribute(Qt.WidgetAttribute.WA_TransparentForMouseEvents)
        view.viewport().setLayout(column(self, margins=(12, 12, 12, 12)))
        self._model = view.model()
        for changed in (self._model.rowsInserted, self._model.rowsRemoved, self._model.modelReset):
            changed.connect(self._look)

    def _look(self) -> None:
        self.setVisible(not self._model.rowCount())


class RowList(QTreeWidget):
    """Rows of texts below `heads`, and a note that says what they are while there are none.

    Parameters
    ----------
    right : collection of int, optional
        Columns of numbers, which end at the right.
    """

    def __init__(
        self,
        heads: Sequence[str],
        name: str,
        note: str,
        *,
        right: Collection[int] = (),
        **properties: Any,
    ) -> None:
        super().__init__(**properties)
        self._right = right
        self.setObjectName("rows")
        self.setHeaderLabels(list(heads))
        self.setRootIsDecorated(False)
        self.setUniformRowHeights(True)
        self.setAccessibleName(name)
        self.header().setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        EmptyNote(self, note)

    def put_row(
        self,
        row: int,
        texts: Sequence[str],
        tips: Mapping[int, str],
        tones: Mapping[int, Tone],
        *,
        bold: Collection[int] = (),
    ) -> None:
        """Have these texts in a row, with tooltips and tones by their columns, and in some columns
        bold; one behind the last is added.
        """
        if row == self.topLevelItemCount():
            self.addTopLevelItem(QTreeWidgetItem())
        item = self.topLevelItem(row)
        assert item is not None
        font = self.font()
        for at, text in enumerate(texts):
            font.setBold(at in bold)
            item.setText(at, text)
            item.setFont(at, font)
            if at in self._right:
                item.setTextAlignment(at, Qt.AlignmentFlag.AlignRight)
            item.setToolTip(at, tips.get(at, ""))
            item.setData(at, TONE_ROLE, tones.get(at))
        self._colour(item)

    def changeEvent(self, event: QEvent) -> None:
        """Have the tones of another look."""
        super().changeEvent(event)
        if event.type() == QEvent.Type.StyleChange:
            for row in range(self.topLevelItemCount()):
                self._colour(self.topLevelItem(row))

    def _colour(self, item: QTreeWidgetItem | None) -> None:
        assert item is not None
        for at in range(self.columnCount()):
            tone = item.data(at, TONE_ROLE)
            colour = QColor(theme.now().tones[tone]) if tone else None
            item.setData(at, Qt.ItemDataRole.ForegroundRole, colour)


def progress_bar(style: str = "") -> QProgressBar:
    """A thin bar, to be filled by `fill_bar`."""
    made = widget(QProgressBar, objectName=style, textVisible=False, maximum=BAR_STEPS)
    made.setFixedHeight(10)
    return made


def fill_bar(bar: QProgressBar, share: float) -> None:
    """Fill a bar, to be painted with all the rest: by itself it paints the window at once."""
    if (value := round(BAR_STEPS * share)) != bar.value():
        bar.setUpdatesEnabled(False)
        bar.setValue(value)
        bar.setUpdatesEnabled(True)


class Choice(NoWheel, QComboBox):
    """One of several, cut short rather than making its panel wider."""

    def __init__(self, choices: Sequence[str] = (), **properties: Any) -> None:
        super().__init__(**properties)
        self.addItems(choices)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        self.setMinimumContentsLength(6)

    def add(self, text: str, data: Any, tip: str = "") -> None:
        """Add what can be chosen, with a tooltip in the list."""
        self.addItem(text, data)
        self.setItemData(self.count() - 1, tip, Qt.ItemDataRole.ToolTipRole)


def by_pointer_only(*buttons: QAbstractButton) -> None:
    """Keep the keyboard focus from buttons that move something, or change what is measured: neither
    Tab nor the end of another widget's focus leads there, so that no key presses one unseen.
    """
    for button in buttons:
        button.setFocusPolicy(Qt.FocusPolicy.NoFocus)


def widget(kind: Callable[..., Kind], *args: Any, **properties: Any) -> Kind:
    """A widget, an action or a timer with properties of Qt by their names, and functions for its
    signals; those that are inherited, too, which the types of PySide6 do not know.
    """
    return kind(*args, **properties)


def scroll_area(**properties: Any) -> QScrollArea:
    """A frameless place in which a part is scrolled that needs more room."""
    frameless = QFrame.Shape.NoFrame
    return widget(QScrollArea, widgetResizable=True, frameShape=frameless, **properties)


def label(
    text: str,
    style: str,
    *,
    wraps: bool = False,
    is_cut: bool = False,
    kind: type[QLabel] = QLabel,
    **properties: Any,
) -> QLabel:
    """A text in one of the styles of `style.qss`, cut short rather than making its panel wider
    where that is said.
    """
    made = widget(kind, text, objectName=style, wordWrap=wraps, **properties)
    if is_cut:
        made.setSizePolicy(QSizePolicy.Policy.Ignored, QSizePolicy.Policy.Preferred)
    return made


def words(style: str) -> QLabel:
    """A sentence over as many lines as it needs, which can be copied."""
    by_mouse = Qt.TextInteractionFlag.TextSelectableByMouse
    return label("", style, wraps=True, textInteractionFlags=by_mouse)


def holding(layout: QLayout, style: str = "") -> QWidget:
    """A part that is filled by a layout, in one of the styles of `style.qss`."""
    made = widget(QWidget, objectName=style)
    made.setLayout(layout)
    return made


def keep_room(part: QWidget | QGraphicsWidget) -> None:
    """Let a part keep its place while it is hidden."""
    policy = part.sizePolicy()
    policy.setRetainSizeWhenHidden(True)
    part.setSizePolicy(policy)


def remove(part: QWidget) -> None:
    """Delete a part, which is gone at once from what it is in."""
    part.setParent(None)
    part.deleteLater()


def shortcut(
    key: QKeySequence | QKeySequence.StandardKey | Qt.Key | str, part: QWidget, act: Act
) -> QShortcut:
    """A key that does `act` while the focus is in `part`."""
    context = Qt.ShortcutContext.WidgetWithChildrenShortcut
    return widget(QShortcut, QKeySequence(key), part, context=context, activated=act)


def button(text: str, tip: str = "", act: Act | None = None, *, style: str = "") -> QPushButton:
    """A button that does `act`."""
    return _acting(QPushButton, text, tip, act, style)


def tool_button(
    text: str, tip: str = "", act: Act | None = None, *, style: str = "framed"
) -> QToolButton:
    """A small button that does `act`."""
    return _acting(QToolButton, text, tip, act, style)


def _acting(kind: Callable[..., Kind], text: str, tip: str, act: Act | None, style: str) -> Kind:
    name = "" if text[:1].isalpha() else tip  # of a symbol
    made = widget(kind, text=text, toolTip=tip, objectName=style, accessibleName=name)
    if act is not None:
        made.clicked.connect(lambda _=False: act())  # type: ignore[attr-defined]
    return made


def menu_button(text: str, tip: str, acts: Mapping[str, Act]) -> QToolButton:
    """A small button with a menu of what it does, by name."""
    made = tool_button(text, tip)
    made.setPopupMode(QToolButton.ToolButtonPopupMode.InstantPopup)
    menu = QMenu(made)
    made.setMenu(menu)
    for name, act in acts.items():
        menu.addAction(name, act)
    return made


def form(rows: Editors) -> QFormLayout:
    """Editors one below the other, each behind its name."""
    made = QFormLayout()
    made.setContentsMargins(0, 0, 0, 0)
    made.setSpacing(5)
    made.setFieldGrowthPolicy(QFormLayout.FieldGrowthPolicy.AllNonFixedFieldsGrow)
    for name, editor in rows.items():
        made.addRow(label(name, "name"), editor)
    return made


def row(*parts: Part, spacing: int = SPACING, margins: Margins = (0, 0, 0, 0)) -> QHBoxLayout:
    """`parts` side by side; `margins` are left, top, right, bottom."""
    return _filled(QHBoxLayout(), parts, spacing, margins)


def column(*parts: Part, spacing: int = SPACING, margins: Margins = (0, 0, 0, 0)) -> QVBoxLayout:
    """`parts` one below the other; `margins` are left, top, right, bottom."""
    return _filled(QVBoxLayout(), parts, spacing, margins)


def _filled(box: Box, parts: tuple[Part, ...], spacing: int, margins: Margins) -> Box:
    box.setContentsMargins(*margins)
    box.setSpacing(spacing)
    for part in parts:
        what, share = part if isinstance(part, tuple) else (part, 0)
        if isinstance(what, QWidget):
            box.addWidget(what, share)
        elif isinstance(what, QLayout):
            box.addLayout(what, share)
        elif what == STRETCH:
            box.addStretch(1)
        else:
            box.addSpacing(what)
    return box


def write(line: QLabel, text: str) -> None:
    """Write a text which, where there is no room for all of it, is whole under the pointer."""
    line.setText(text)
    line.setToolTip(text)


def write_or_hide(line: QLabel, text: str) -> None:
    """Write a text; without one its line is hidden."""
    line.setText(text)
    line.setVisible(bool(text))


def tint(widget: QWidget, tone: Tone | None) -> None:
    """Give a widget the colour of a tone, in the look of the window; None: its own again."""
    _polish(widget, "tone", str(tone or ""))


def colour_as(widget: QWidget, quantity: str) -> None:
    """Give the name of a quantity its colour in `theme.Palette`; empty: that of others."""
    _polish(widget, "quantity", quantity)


def restyle(widget: QWidget, style: str) -> None:
    """Give a widget another of the styles of `style.qss`."""
    _polish(widget, "objectName", style)


def _polish(widget: QWidget, name: str, value: str) -> None:
    if (widget.property(name) or "") != value:
        widget.setProperty(name, value)
        widget.style().unpolish(widget)
        widget.style().polish(widget)
