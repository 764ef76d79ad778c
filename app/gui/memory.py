"""What the window remembers from one evening to the next: places, sizes, recent files, the look."""

from __future__ import annotations

from pathlib import Path
from typing import cast

from PySide6.QtCore import QByteArray, QSettings

LAYOUT = 1  # another number when docks come or go: then the layout of the program is used
MOST_RECENT = 12
SET_UP = ("settings", "session", "when")


class WindowMemory:
    """The window's own settings, in the folder where the system keeps those of programs.

    What bears on an experiment is here only as the set-up of the last evening, which is shown when
    the window is opened without any, and checked as a settings file is.
    """

    def __init__(self) -> None:
        self._settings = QSettings(
            QSettings.Format.IniFormat, QSettings.Scope.UserScope, "SlipScope", "SlipScope"
        )

    def recent(self, kind: str) -> list[Path]:
        """Files of a kind ("bench", "session", "campaign"), the newest first.

        Whether they are still there is not looked at: a folder may take long to answer.
        """
        return list(map(Path, self._texts(f"recent/{kind}")))

    def remember(self, kind: str, path: Path) -> None:
        """Put a file at the head of those of its kind."""
        name = str(path.absolute())
        others = [text for text in self._texts(f"recent/{kind}") if text != name]
        self._settings.setValue(f"recent/{kind}", [name, *others][:MOST_RECENT])

    @property
    def theme(self) -> str:
        """The look, "dark" or "light"."""
        return "light" if self._settings.value("theme") == "light" else "dark"

    @theme.setter
    def theme(self, name: str) -> None:
        """Keep the look."""
        self._settings.setValue("theme", name)

    def set_up(self) -> tuple[str, str, str] | None:
        """The set-up of the last evening: its settings as TOML, its session, and when it was kept;
        None for the first time.
        """
        if not self._settings.contains("set-up/when"):
            return None
        settings, session, when = (str(self._settings.value(f"set-up/{one}")) for one in SET_UP)
        return settings, session, when

    def keep_set_up(self, settings: str, session: str, when: str) -> None:
        """Keep the set-up, on the disk at once; may be called in any thread of its own."""
        for name, one in zip(SET_UP, (settings, session, when), strict=True):
            self._settings.setValue(f"set-up/{name}", one)
        self._settings.sync()

    def layout(self, docks: str) -> tuple[QByteArray, QByteArray] | None:
        """Place of the window and of its docks when one with these docks was closed last; None for
        the first time.
        """
        window, places = (
            self._settings.value(f"layout/{docks}/{part}") for part in ("window", "docks")
        )
        if not (isinstance(window, QByteArray) and isinstance(places, QByteArray)):
            return None
        return window, places

    def keep_layout(self, docks: str, window: QByteArray, places: QByteArray) -> None:
        """Keep the place of the window and of its docks."""
        for part, value in (("window", window), ("docks", places)):
            self._settings.setValue(f"layout/{docks}/{part}", value)

    def forget_layout(self) -> None:
        """Let the next window open as the first one did."""
        self._settings.remove("layout")

    def _texts(self, key: str) -> list[str]:
        """A list, of which one of a single text is kept as that text."""
        return list(map(str, cast("list[object]", self._settings.value(key, [], type=list))))
