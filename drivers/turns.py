"""The time in which this process had its turns: what others did not do while it was suspended, or
the computer too busy for it, is not held against them.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, wait
from typing import TypeVar

T = TypeVar("T")
LONGEST_S = 0.2
POLL_S = 0.02


class TurnClock:
    """A clock for waiting: of a longer pause between two readings, by any thread, only `longest_s`
    count.

    Parameters
    ----------
    pause_s : float
        Usual pause between two readings; one of 0.1 s or less need not be given. `longest_s` is
        `pause_s` or, if that is more, `LONGEST_S`.
    """

    def __init__(self, pause_s: float = 0.0) -> None:
        self._lock, self._longest_s = threading.Lock(), max(pause_s, LONGEST_S)
        self._read_at, self._past_s = time.monotonic(), 0.0

    def read(self, longest_s: float = math.inf) -> float:
        """Seconds since it was made; of the pause before this reading at most `longest_s` count."""
        with self._lock:
            now = time.monotonic()
            self._past_s += min(now - self._read_at, self._longest_s, longest_s)
            self._read_at = now
            return self._past_s


def settle(call: Future[T], step: Callable[[], T]) -> None:
    """Do a step with a device, for a thread that waits for what it returns or raises."""
    try:
        call.set_result(step())
    except BaseException as error:
        call.set_exception(error)


def done_beside(step: Callable[[], T], patience_s: float) -> Future[T]:
    """A step with a device in a thread of its own, which may never return; it is not done yet if it
    takes longer than `patience_s` of the turns of this process.
    """
    call: Future[T] = Future()
    threading.Thread(target=settle, args=(call, step), name="slipscope-asks", daemon=True).start()
    turns = TurnClock()
    while not wait([call], min(POLL_S, patience_s)).done and turns.read() <= patience_s:
        pass
    return call
