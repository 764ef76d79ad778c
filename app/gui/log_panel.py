"""What was said and logged, with the details of each error, to be copied."""

from __future__ import annotations

import logging
import re
import time
from collections import deque
from pathlib import Path

from PySide6.QtGui import QFontDatabase, QGuiApplication
from PySide6.QtWidgets import QCheckBox, QPlainTextEdit

from app.gui.background import BackgroundWork
from app.gui.widgets import STRETCH, Panel, button, row, widget
from app.system import logs

LogLine = tuple[bool, str]  # whether it is a trouble, and its text
MOST_LINES, LOOK_S = 2000, 1.0  # from look to look
MOST_READ = 1 << 16  # bytes of a session's log that are taken at once
# what a line of a log tells those who look for the cause in the program, as of `logs.FORMAT`
FOR_PROGRAMMERS = re.compile(r"^\S+ (\d\d:\d\d:\d\d),\d+ (INFO|WARNING|ERROR) +[^:]*: ", re.M)


class LogStore(logging.Handler):
    """Keeps what the program logs, from any thread, until a window shows it."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self.setFormatter(logging.Formatter(logs.FORMAT))
        self._lines: deque[LogLine] = deque(maxlen=MOST_LINES)  # needs no lock

    def emit(self, record: logging.LogRecord) -> None:
        """Keep a record: whether it is a trouble, and its text with its traceback."""
        self._lines.append((record.levelno >= logging.WARNING, self.format(record)))

    def say(self, sentence: str, *, is_trouble: bool) -> None:
        """Keep a sentence that the window showed."""
        self._lines.append((is_trouble, f"{time.strftime('%H:%M:%S')} {sentence}"))

    def take(self) -> list[LogLine]:
        """What came since the last call."""
        return [self._lines.popleft() for _ in range(len(self._lines))]


def for_people(lines: str) -> str:
    """Lines of a log without the date, the thread and the module; of a warning it says so."""
    return FOR_PROGRAMMERS.sub(
        lambda line: f"{line[1]} " + f"{line[2].lower()}: " * (line[2] != "INFO"), lines
    )


def _whole_lines(file: Path, start: int) -> bytes:
    """What a file has from there on, as far as its lines are whole."""
    with file.open("rb") as opened:
        opened.seek(start)
        new = opened.read(MOST_READ)
    return new[: new.rfind(b"\n") + 1]


class LogPanel(Panel):
    """The log of this window and of the run that it shows."""

    name, title = "log", "Log"

    def __init__(self, store: LogStore) -> None:
        super().__init__()
        self._store = store
        self._file: Path | None = None
        self._read, self._looked_at = 0, 0.0
        self._background, self._is_reading = BackgroundWork(self), False
        self._lines: deque[LogLine] = deque(maxlen=MOST_LINES)
        self.text = widget(
            QPlainTextEdit,
            readOnly=True,
            maximumBlockCount=MOST_LINES,
            font=QFontDatabase.systemFont(QFontDatabase.SystemFont.FixedFont),
            accessibleName="Log",
            placeholderText="What the window and the run have said, with the details of each error",
        )
        self.troubles = widget(QCheckBox, "Only warnings and errors", toggled=self._show_all)
        self.copy = button("Copy all", "Copies the log with all its details.", self._copy_all)
        top = row(self.troubles, STRETCH, self.copy, spacing=8)
        self.hold(top, (self.text, 1))

    def follow(self, session: Path | None) -> None:
        """Show also the log beside this session from now on; None: beside none."""
        self._file, self._read = session and session.with_name(f"{session.name}.log"), 0
        self._is_reading = False  # what is still read is of the last session

    def look(self) -> None:
        """Show what came, from time to time while it can be seen."""
        if self.isVisible() and time.monotonic() - self._looked_at > LOOK_S:
            self._looked_at = time.monotonic()
            self.refresh()

    def refresh(self) -> None:
        """Show what came since the last call; what the session's log has got once it was read,
        beside the window.
        """
        self._append(self._store.take())
        if self._file is None or self._is_reading:
            return
        self._is_reading = True
        file, start = self._file, self._read

        def take(whole: bytes) -> None:
            if file != self._file:
                return
            self._is_reading = False
            self._read = start + len(whole)
            lines = whole.decode("utf-8", "replace").splitlines()
            self._append([(" WARNING " in line or " ERROR " in line, line) for line in lines])

        self._background.start_anew(lambda: _whole_lines(file, start), take, lambda _: take(b""))

    def _append(self, lines: list[LogLine]) -> None:
        self._lines += lines
        for is_trouble, text in lines:
            if is_trouble or not self.troubles.isChecked():
                self.text.appendPlainText(for_people(text))

    def _show_all(self) -> None:
        lines = list(self._lines)
        self._lines.clear()
        self.text.clear()
        self._append(lines)

    def _copy_all(self) -> None:
        QGuiApplication.clipboard().setText("\n".join(text for _, text in self._lines))

    keys = (("Ctrl+A, Ctrl+C", "Copies the text of the log."),)
