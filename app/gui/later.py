"""Work that takes a while, done in a thread of its own; the window gets its result."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable
from typing import Any

from PySide6.QtCore import QObject, QTimer

LOG = logging.getLogger(__name__)
LOOK_MS = 30


class Later(QObject):
    """Does one thing at a time for a part of the window; a later one takes the place of an earlier
    one, whose result is dropped.
    """

    def __init__(self, parent: QObject) -> None:
        super().__init__(parent)
        self._ended: list[tuple[int, Any, Exception | None]] = []
        self._number = 0
        self._done: Callable[[Any], object] = lambda _: None
        self._failed: Callable[[str], object] = lambda _: None
        self._timer = QTimer(self)
        self._timer.timeout.connect(self._look)

    @property
    def is_busy(self) -> bool:
        """Whether something is under way."""
        return self._timer.isActive()

    def do(
        self,
        work: Callable[[], Any],
        done: Callable[[Any], object],
        failed: Callable[[str], object],
    ) -> None:
        """Do `work`; then call `done` with its result, or `failed` with a sentence."""
        self._number += 1
        number, ended = self._number, self._ended
        self._done, self._failed = done, failed

        def run() -> None:
            try:
                ended.append((number, work(), None))
            except Exception as error:
                LOG.info("work for the window failed", exc_info=error)
                ended.append((number, None, error))

        threading.Thread(target=run, name="slipscope-window-work", daemon=True).start()
        self._timer.start(LOOK_MS)

    def _look(self) -> None:
        while self._ended:
            number, result, error = self._ended.pop(0)
            if number != self._number:
                continue
            self._timer.stop()
            if error is None:
                self._done(result)
            else:
                self._failed(str(error))
