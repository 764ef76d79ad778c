"""The log of the program: a file beside each session that is recorded, and the terminal on request.

Every module that has something to log uses the logger of its own name. The log is for finding out
afterwards why a run went as it did; what the operator must know is in the window and the session.
"""

from __future__ import annotations

import logging
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from logging.handlers import QueueHandler
from pathlib import Path
from queue import SimpleQueue
from typing import Any, TextIO

from app.system.errors import spelled_out
from app.system.threads import start_thread

PACKAGES = ("app", "drivers")
WRITES_S = 3.0  # that the lines which wait have at the end
FORMAT = "%(asctime)s %(levelname)-7s %(threadName)s %(name)s: %(message)s"
_LINE = logging.Formatter(FORMAT)


class _Lines:
    """Writes what is logged to a stream, until that takes no more: a full disk ends a run by its
    own name. The name is that of a file, which is closed at the end.

    It is no handler of `logging`, which at the end of the program waits for each of them.
    """

    def __init__(self, stream: TextIO, name: str = "") -> None:
        self.name = name
        self._stream, self._is_given_up = stream, False

    def write(self, record: logging.LogRecord) -> None:
        """Write a line, or more for an exception."""
        if not self._is_given_up:
            try:
                self._stream.write(f"{spelled_out(_LINE.format(record))}\n")
                self._stream.flush()
            except (OSError, ValueError):
                self._is_given_up = True

    def close(self) -> None:
        """Let go of the file."""
        if self.name:
            with suppress(OSError):
                self._stream.close()


class _Waiting(QueueHandler):
    """Hands what is logged to a thread of its own, which writes it: whoever logs, be it on the way
    to a stop, never waits for a disk or a terminal that takes nothing.
    """

    def __init__(self, lines: _Lines) -> None:
        self._records: SimpleQueue[logging.LogRecord | None] = SimpleQueue()
        super().__init__(self._records)
        self.lines = lines
        self._thread = start_thread("log", self._write)
        self._is_closed = False
        for logger in map(logging.getLogger, PACKAGES):
            logger.setLevel(logging.DEBUG)
            logger.propagate = False
            logger.addHandler(self)

    def _write(self) -> None:
        while (record := self._records.get()) is not None:
            self.lines.write(record)
        self.lines.close()

    def close(self) -> None:
        """Write what waits, and no more; a disk that does not answer is not waited for. May be
        called twice.
        """
        for logger in map(logging.getLogger, PACKAGES):
            logger.removeHandler(self)
        if not self._is_closed:
            self._is_closed = True
            self._records.put(None)
            self._thread.join(WRITES_S)
            if self._thread.is_alive() and self.lines.name:
                print(
                    f"slipscope: {self.lines.name}: the log is incomplete, because its disk had not"
                    f" taken all lines after {WRITES_S:g} s",
                    file=sys.stderr,
                )
        super().close()


def to_terminal() -> None:
    """Show the log on standard error from now on."""
    _Waiting(_Lines(sys.stderr))


def is_on_terminal() -> bool:
    """Whether the log is shown on standard error; a session's own log file does not count."""
    handlers = logging.getLogger("app").handlers
    return any(isinstance(h, _Waiting) and not h.lines.name for h in handlers)


def tell_warnings(tell: Callable[[str], None]) -> None:
    """Give warnings that are meant for people to `tell`, as sentences, from now on."""
    show = warnings.showwarning

    def shown(message: Warning | str, category: type[Warning], *where: Any) -> None:
        if issubclass(category, UserWarning):
            tell(str(message))
        else:
            show(message, category, *where)

    warnings.showwarning = shown  # type: ignore[assignment]


@contextmanager
def beside(session: Path) -> Iterator[None]:
    """Everything that is logged meanwhile also goes to ``SESSION.h5.log`` beside the session.

    Where that file cannot be written the session cannot be either, which is reported elsewhere.
    """
    try:
        path = session.with_name(f"{session.name}.log")
        lines = _Lines(path.open("a", encoding="utf-8"), str(path))
    except OSError:
        yield
        return
    waiting = _Waiting(lines)
    try:
        yield
    finally:
        waiting.close()


def listed(values: Mapping[str, object]) -> str:
    """Numbers by their names, as a log has them: ``triggers 138; samples lost 0``."""
    return "; ".join(f"{name.replace('_', ' ')} {value}" for name, value in values.items())
