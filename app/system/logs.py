"""The log of the program: a file beside each session that is recorded, and the terminal on request.

Every module that has something to log uses the logger of its own name. The log is for finding out
afterwards why a run went as it did; what the operator must know is in the window and the session.
"""

from __future__ import annotations

import logging
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from logging.handlers import QueueHandler, QueueListener
from pathlib import Path
from queue import SimpleQueue
from typing import Any

PACKAGES = ("app", "drivers")
FORMAT = "%(asctime)s %(levelname)-7s %(threadName)s %(name)s: %(message)s"


class _SessionLog(logging.FileHandler):
    """A log file that gives up once it cannot be written: a full disk ends a run by its own
    name.
    """

    def handleError(self, record: logging.LogRecord) -> None:
        """Write no more."""
        del record
        self.addFilter(lambda _: False)


class _Waiting(QueueHandler):
    """Hands what is logged to a thread of its own, which writes it: whoever logs, be it on the way
    to a stop, never waits for a disk or a terminal that takes nothing.
    """

    def __init__(self, writer: logging.Handler) -> None:
        super().__init__(SimpleQueue())
        writer.setFormatter(logging.Formatter(FORMAT))
        self.writer = writer
        self._thread = QueueListener(self.queue, writer)
        self._thread.start()
        self._is_closed = False
        for logger in map(logging.getLogger, PACKAGES):
            logger.setLevel(logging.DEBUG)
            logger.propagate = False
            logger.addHandler(self)

    def close(self) -> None:
        """Write what waits, and no more. May be called twice."""
        for logger in map(logging.getLogger, PACKAGES):
            logger.removeHandler(self)
        if not self._is_closed:
            self._is_closed = True
            self._thread.stop()
            self.writer.close()
        super().close()


def to_terminal() -> None:
    """Show the log on standard error from now on."""
    _Waiting(logging.StreamHandler())


def is_on_terminal() -> bool:
    """Whether the log is shown on standard error; a session's own log file does not count."""
    handlers = logging.getLogger("app").handlers
    return any(
        isinstance(h, _Waiting) and type(h.writer) is logging.StreamHandler for h in handlers
    )


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
        handler = _SessionLog(session.with_name(f"{session.name}.log"), encoding="utf-8")
    except OSError:
        yield
        return
    waiting = _Waiting(handler)
    try:
        yield
    finally:
        waiting.close()


def listed(values: Mapping[str, object]) -> str:
    """Numbers by their names, as a log has them: ``triggers 138; samples lost 0``."""
    return "; ".join(f"{name.replace('_', ' ')} {value}" for name, value in values.items())
