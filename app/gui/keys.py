"""What can be asked of the window, its menus and keys: said once, for menus, tooltips and F1."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from PySide6.QtCore import Qt
from PySide6.QtGui import QAction, QKeySequence
from PySide6.QtWidgets import QDialog, QMenu, QMenuBar, QScrollArea, QTextBrowser, QWidget

from app.gui.widgets import column, widget


@dataclass(frozen=True, slots=True)
class KeyAction:
    """Something that can be asked of the window, the menu where it is found, its keys and what it
    does.
    """

    name: str
    menu: str
    text: str
    keys: tuple[str, ...] = ()
    tip: str = ""


ACTS = (
    KeyAction("open_session", "&File", "&Open session …", ("Ctrl+O",), "Plays a recorded run."),
    KeyAction(
        "close", "&File", "&Quit", ("Ctrl+Q",), "Closes the window; a run that goes on is asked."
    ),
    KeyAction(
        "begin", "&Run", "&Start", ("F5",), "Begins the run with the settings of the set-up."
    ),
    KeyAction(
        "answer",
        "&Run",
        "&Confirm question",
        ("F8",),
        "Answers yes to the question of the step under way.",
    ),
    KeyAction(
        "pause",
        "&Run",
        "&Pause after this step",
        ("F9",),
        "Lets the run wait before its next step until you resume it; limits are watched meanwhile."
        " Before it waits, a second time withdraws that.",
    ),
    KeyAction(
        "note",
        "&Run",
        "&Note …",
        ("F4",),
        "Goes to the line whose text is recorded with the time, while a run is under way.",
    ),
    KeyAction(
        "end_run",
        "&Run",
        "&End run",
        ("Ctrl+E",),
        "Ends the run in good order: the actuator stops, the data are kept.",
    ),
    KeyAction(
        "stop_motion",
        "&Run",
        "STOP &MOTION",
        ("F12",),
        "Stops the actuator now and ends the run. A button on the screen is not an emergency stop.",
    ),
    KeyAction(
        "stop_or_close",
        "&Run",
        "Stop, and &close what is open",
        ("Esc",),
        "Stops as F12 does, and closes the list or the dialog that is open. With one open while"
        " nothing of this window can move, it only closes.",
    ),
    KeyAction(
        "toggle_theme", "&View", "&Light or dark", ("Ctrl+L",), "Changes the look of the window."
    ),
    KeyAction("full_screen", "&View", "&Full screen", ("F11",), "Fills the screen, and back."),
    KeyAction(
        "reset_layout", "&View", "&Reset layout", (), "Puts all parts where they were at first."
    ),
    KeyAction("show_keys", "&Help", "&Keys", ("F1",), "Lists the keys."),
    KeyAction("show_manual", "&Help", "&Manual", ("Shift+F1",), "Shows the pages of the manual."),
    KeyAction("show_about", "&Help", "&About", (), "Says which version this is, and whose method."),
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
    does: Mapping[str, Callable[[], object]],
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


def make_ways(
    window: QWidget, menu: QMenu, titles: Mapping[str, str], go: Callable[[str], object]
) -> None:
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


def _action(window: QWidget, text: str, act: Callable[[], object], **properties: Any) -> QAction:
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
