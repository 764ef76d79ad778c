"""Work in a thread of its own, whose result comes back to the thread of the window."""

from __future__ import annotations

import logging
import threading
import weakref
from collections.abc import Callable
from contextlib import suppress
from functools import cache, partial
from typing import Any

import shiboken6
from PySide6.QtCore import QObject, Qt, Signal

from app.system.errors import UserError, in_full
from app.system.threads import start_thread

LOG = logging.getLogger(__name__)
Act = Callable[[], Any]
Take = Callable[[Any], object]  # what came of it


class CallsInWindowThread(QObject):
    """Makes calls in the thread of the window. It is never deleted: a signal of an object that the
    window deletes at the same moment would end the program.
    """

    _asked = Signal(object)

    def __init__(self) -> None:
        super().__init__()
        self._asked.connect(lambda act: act(), Qt.ConnectionType.QueuedConnection)

    def ask(self, act: Act) -> None:
        """Call `act` there; from any thread, returns at once."""
        with suppress(RuntimeError):  # Qt has deleted it: the program ends, and nobody listens
            self._asked.emit(act)


@cache
def _calls_in_window_thread() -> CallsInWindowThread:
    return CallsInWindowThread()


class BackgroundWork:
    """Starts work in threads, which are daemons: none keeps the program alive.

    What comes back after the owner is gone is dropped. Make it in the thread of the window.
    """

    def __init__(self, owner: QObject) -> None:
        self._owner, self._calls = weakref.ref(owner), _calls_in_window_thread()
        self._newest = 0
        self._last: threading.Thread | None = None  # of what is done in order

    def start(
        self,
        work: Act,
        done: Take,
        failed: Take,
        *,
        in_order: bool = False,
        patience_s: float | None = None,
    ) -> None:
        """Call `work` in a thread, then `done` with its result, or `failed` with a sentence, in the
        thread of the window; where that is said, after all that was started so before, for which
        it waits `patience_s` at most. What is started so later waits for all of them.
        """
        before = self._last if in_order else None

        def run() -> None:
            if before is not None:
                before.join(patience_s)
            try:
                result = work()
            except (UserError, OSError, ValueError) as error:  # their words are for people
                self.tell(partial(failed, str(error)))
            except Exception as error:
                LOG.warning("work for the window failed", exc_info=error)
                self.tell(partial(failed, in_full(error)))
            else:
                self.tell(partial(done, result))
            finally:
                if before is not None:  # which this may have overtaken, but not what follows
                    before.join()

        thread = start_thread("window-work", run)
        if in_order:
            self._last = thread

    def start_anew(self, work: Act, done: Take, failed: Take, *, in_order: bool = False) -> None:
        """As `start`, and what was started so before is dropped when it comes back."""
        self._newest = mine = self._newest + 1

        def if_newest(act: Take) -> Take:
            return lambda result: act(result) if mine == self._newest else None

        self.start(work, if_newest(done), if_newest(failed), in_order=in_order)

    def drop(self) -> None:
        """Let what was started anew be dropped when it comes back."""
        self._newest += 1

    def tell(self, act: Act) -> None:
        """Call `act` in the thread of the window; from any thread, returns at once."""

        def if_owned() -> None:
            owner = self._owner()
            if owner is not None and shiboken6.isValid(owner):
                act()

        self._calls.ask(if_owned)
