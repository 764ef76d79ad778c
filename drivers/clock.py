"""What the devices of one bench may know of the DAQ's sample clock: how far it has been read, and
on which samples the camera exposed.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray


class SampleClock:
    """The sample counter, as far as the program has read it; fed by whoever reads the forces, seen
    from any thread.

    Attributes
    ----------
    sample_rate_hz : float
    now : int
        Samples read or known to be lost, counted from 0.
    phase : str
        "idle", "running" or "stopped".
    counts_exposures : bool
        Whether the board counts the camera's exposures beside the samples; then `exposure` knows
        where each of them began.
    """

    def __init__(self, sample_rate_hz: float) -> None:
        self.sample_rate_hz = sample_rate_hz
        self.now = 0
        self.phase = "idle"
        self.counts_exposures = False
        self._exposures: list[int] = []
        self._changed = threading.Condition()

    def start(self, *, counts_exposures: bool = False) -> None:
        """Sample 0 is next."""
        with self._changed:
            self.now, self.phase, self.counts_exposures = 0, "running", counts_exposures
            self._exposures.clear()
            self._changed.notify_all()

    def advance(self, now: int, counts: NDArray[np.int64] | None = None) -> None:
        """All samples before `now` are known; `counts` is how many exposures had begun by each of
        the newest ones, its last is ``now - 1``.

        An exposure whose beginning lies in lost samples is put on the first sample after them.
        """
        with self._changed:
            if counts is not None:
                steps = np.diff(counts, prepend=len(self._exposures))
                self._exposures += np.repeat(
                    np.arange(now - len(counts), now), np.maximum(steps, 0)
                ).tolist()
            self.now = now
            self._changed.notify_all()

    def stop(self) -> None:
        """No more samples will come; nobody waits any longer."""
        with self._changed:
            self.phase = "stopped"
            self._changed.notify_all()

    def exposure(self, k: int) -> int | None:
        """Sample on which exposure `k` (counted from 0) began; None where it is not known to have."""
        with self._changed:
            return self._exposures[k] if k < len(self._exposures) else None

    def wait_for(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Whether a condition came true in `timeout_s` seconds of the wall clock; it is looked at
        whenever the clock changes.
        """
        with self._changed:
            return self._changed.wait_for(condition, min(timeout_s, threading.TIMEOUT_MAX))
