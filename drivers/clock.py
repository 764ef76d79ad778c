"""What the devices of one bench know of the DAQ's sample clock: its rate, how far it has been read,
and on which samples the camera exposed.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray


class SampleClock:
    """The sample counter, as far as the program has read it; advanced by whoever reads the forces,
    readable from any thread.

    Attributes
    ----------
    sample_rate_hz : float
    now : int
        Samples that were read or are known to be lost, counted from 0.
    phase : str
        "idle", "running" or "stopped".
    counts_exposures : bool
        Whether the board counts the camera's exposures beside the samples, so that `exposure` gives
        the sample on which each of them began.
    """

    def __init__(self, sample_rate_hz: float) -> None:
        self.sample_rate_hz = sample_rate_hz
        self.now = 0
        self.phase = "idle"
        self.counts_exposures = False
        self._exposures: list[int] = []
        self._changed = threading.Condition()

    def start(self, *, counts_exposures: bool = False) -> None:
        """Begin a run: the next sample is sample 0."""
        with self._changed:
            self.now, self.phase, self.counts_exposures = 0, "running", counts_exposures
            self._exposures.clear()
            self._changed.notify_all()

    def advance(self, now: int, counts: NDArray[np.int64] | None = None) -> None:
        """Account for all samples before `now`.

        Parameters
        ----------
        now : int
        counts : ndarray, shape (n,), optional
            How many exposures had begun by each of the newest n samples, the last of which is
            ``now - 1``. An exposure that began in lost samples is put on the first sample after
            them.
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
        """End the run: no more samples will come, and nobody waits any longer."""
        with self._changed:
            self.phase = "stopped"
            self._changed.notify_all()

    def exposure(self, k: int) -> int | None:
        """Sample on which exposure `k` (counted from 0) began; None if it has not begun yet."""
        with self._changed:
            return self._exposures[k] if k < len(self._exposures) else None

    def wait_for(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Whether a condition became true within `timeout_s` seconds of the wall clock; it is
        evaluated whenever the clock changes.
        """
        with self._changed:
            return self._changed.wait_for(condition, min(timeout_s, threading.TIMEOUT_MAX))
