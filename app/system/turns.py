"""The time in which this process had its turns: what others did not do while it was suspended, or
the computer too busy for it, is not held against them.
"""

from __future__ import annotations

import threading
import time

LONGEST_S = 0.2


class TurnClock:
    """A clock for waiting, read ten times a second or more: of a longer pause between two readings,
    by any thread, only `LONGEST_S` count.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._read_at, self._past_s = time.monotonic(), 0.0

    def read(self) -> float:
        """Seconds since it was made."""
        with self._lock:
            now = time.monotonic()
            self._past_s += min(now - self._read_at, LONGEST_S)
            self._read_at = now
            return self._past_s
