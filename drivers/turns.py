"""The time in which this process had its turns: what others did not do while it was suspended, or
the computer too busy for it, is not held against them.
"""

from __future__ import annotations

import math
import threading
import time

LONGEST_S = 0.2


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
