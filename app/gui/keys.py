"""What can be asked of the window, its menus and keys: said once, for menus, tooltips and F1."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from PySide6.QtCore import Qt
from PySide6.QtGui import QAction, QKeySequence
from PySide6.QtWidgets import QDialog, QMenu, QMenuBar, QScrollArea, QTextBrowser, QWidget

from app.gui.background import Act, Take
from app.gui.widgets import column, widget


@dataclass(frozen=True, slots=True)
class KeyAction:
    """Something that can be asked of the window, the menu where it is found, its keys and what it
    does.
    """

    name: str
    menu: str
    text: str
    keys: Sequence[str] = ()
    tip: str = ""


ACTS = tuple(
    KeyAction(**given)
    for given in tomllib.loads(
        Path(__file__).with_name("actions.toml").read_text(encoding="utf-8")
    )["action"]
)

LEFT_PARTS = ("bench", "setup", "experiment", "sessions")
PARTS = (*LEFT_PARTS, "curves", "region", "result", "health", "log", "campaign")
GO_TO = {part: f"Ctrl+{(n + 1) % 10}" for n, part in enumerate(PARTS)} | {
    "picture": "Ctrl+P",
    "calibration": "Ctrl+K",
}
WAY = "go_to_"  # the names of the actions that go to a part begin with it


def make_actions(
    window: QWidget,
    bar: QMenuBar,
    acts: Sequence[KeyAction],
    does: Mapping[str, Act],
) -> tuple[dict[str, QAction], dict[str, QMenu]]:
    """Actions of `window` by their names, and the menus of `bar` by their titles; `does` says what
    each action does.
    """
    made: dict[str, QAction] = {}
    menus = {title: bar.addMenu(title) for title in dict.fromkeys(act.menu for act in acts)}
    for act in acts:
        action = _action(
            window,
            act.text,
            does[act.name],
            objectName=act.name,
            toolTip=act.tip,
            statusTip=act.tip,
            autoRepeat=False,
        )
        action.setShortcuts([QKeySequence(key) for key in act.keys])
        menus[act.menu].addAction(action)
        made[act.name] = action
    return made, menus


def make_ways(window: QWidget, menu: QMenu, titles: Mapping[str, str], go: Take) -> None:
    """Fill a menu with the ways to the parts of `window`, given by their names and titles."""
    for name, title in titles.items():
        way = _action(
            window,
            title,
            partial(go, name),
            objectName=f"{WAY}{name}",
            toolTip="Brings it to the front and puts the keys into it.",
            shortcut=QKeySequence(GO_TO[name]),
        )
        menu.addAction(way)


def _action(window: QWidget, text: str, act: Act, **properties: Any) -> QAction:
    """An action of `window`, also while another window of the program is in front."""
    context = Qt.ShortcutContext.ApplicationShortcut
    made = widget(QAction, text, window, shortcutContext=context, **properties)
    made.triggered.connect(lambda _=False: act())
    window.addAction(made)
    return made


def focus_first(part: QWidget) -> None:
    """Give the focus to the first thing in `part` that takes keys; what only scrolls comes last."""
    found: list[QWidget] = []
    one = part.nextInFocusChain()
    while one is not None and one is not part:
        takes_keys = bool(one.focusPolicy() & Qt.FocusPolicy.TabFocus) and one.isEnabled()
        if takes_keys and one.isVisible() and part.isAncestorOf(one):
            found.append(one)
        one = one.nextInFocusChain()
    found.sort(key=lambda one: isinstance(one, QScrollArea))
    if found:
        found[0].setFocus(Qt.FocusReason.ShortcutFocusReason)


class KeyList(QDialog):
    """The keys of the window and of its parts; F1 shows it, and the window stays in use."""

    def __init__(self, parent: QWidget, parts: Iterable[type]) -> None:
        super().__init__(parent)
        self.setWindowTitle("Keys")
        self.resize(560, 520)
        rows = [(", ".join(act.keys), _plain(act.text), act.tip) for act in ACTS if act.keys]
        ways = [one for one in parent.findChildren(QAction) if one.objectName().startswith(WAY)]
        rows += [(one.shortcut().toString(), one.text(), one.toolTip()) for one in ways]
        rows += [
            (key, getattr(part, "title", part.__name__), what)
            for part in parts
            for key, what in getattr(part, "keys", ())  # that act in it only
        ]
        cells = (f"<td><b>{key}</b></td><td>{what}</td><td>{tip}</td>" for key, what, tip in rows)
        page = widget(QTextBrowser, accessibleName="Keys")
        page.setHtml(f"<table cellpadding='3'><tr>{'</tr><tr>'.join(cells)}</tr></table>")
        self.setLayout(column(page))


def _plain(text: str) -> str:
    return text.replace("&", "").replace(" …", "")
