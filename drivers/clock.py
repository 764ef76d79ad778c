"""What the devices of one bench know of the DAQ's sample clock: its rate, how far it has been read,
and on which samples the camera exposed.
"""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable

import numpy as np

from analysis.arrays import I64

DRIFT = 7e-4  # the board's clock and a computer's that is being slewed differ by no more
ANCHORED_S = 10.0  # so long the two clocks stay together within a few milliseconds


class Phased:
    """What runs once it is started, until it is stopped; threads wait for what changes in it.

    Attributes
    ----------
    phase : str
        "idle", "running" or "stopped".
    """

    def __init__(self) -> None:
        self.phase = "idle"
        self._changed = threading.Condition(threading.RLock())

    def stop(self) -> None:
        """End its time: nothing more will come, and nobody waits any longer."""
        with self._changed:
            self.phase = "stopped"
            self._changed.notify_all()

    def wait_for(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Whether a condition became true within `timeout_s` seconds of the wall clock; it is
        evaluated whenever something changes.
        """
        with self._changed:
            return self._changed.wait_for(condition, min(timeout_s, threading.TIMEOUT_MAX))


class SampleClock(Phased):
    """The sample counter, as far as the program has read it; advanced by whoever reads the forces,
    readable from any thread.

    Attributes
    ----------
    sample_rate_hz : float
    now : int
        Samples that were read or are known to be lost, counted from 0.
    pace : float or None
        Samples per second of the wall clock, in units of the rate; None: they are not bound to it.
    gaps : list of (int, int)
        Lost samples whose exposures are known only by their number: first, and first after them.
    counts_exposures : bool
        Whether the board counts the camera's exposures beside the samples, so that
        `exposures_from` gives the sample on which each of them began.
    """

    def __init__(self, sample_rate_hz: float, pace: float | None = None) -> None:
        super().__init__()
        self.sample_rate_hz = sample_rate_hz
        self.pace = pace
        self.gaps: list[tuple[int, int]] = []
        self.began_s = 0.0
        self.now = 0
        self.counts_exposures = False
        self._exposures: list[int] = []
        # by seconds, the most that newest samples were ahead of all that can have passed by then
        self._anchors: deque[tuple[int, float]] = deque()
        self._first_anchor = -math.inf  # the most of them in the first seconds
        self._late = 0.0  # how far the newest of them are behind those

    def start(self, *, counts_exposures: bool = False) -> None:
        """Begin a run: the next sample is sample 0, and it has not been taken yet."""
        with self._changed:
            self.began_s = time.monotonic()
            self._anchors.clear()
            self._first_anchor, self._late = -math.inf, 0.0
            self.gaps = []
            self.now, self.phase, self.counts_exposures = 0, "running", counts_exposures
            self._exposures.clear()
            self._changed.notify_all()

    def advance(self, now: int, counts: I64 | None = None) -> None:
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
                first = now - len(counts)
                if first > self.now:
                    self.gaps.append((self.now, first))
                if counts.max(initial=0) > len(self._exposures):  # it does not count down
                    steps = np.diff(counts.astype(np.int64), prepend=len(self._exposures))
                    began = np.repeat(np.arange(first, now), np.maximum(steps, 0))
                    self._exposures += began.tolist()
            self.now = now
            self._changed.notify_all()

    def exposures_from(self, k: int) -> list[int]:
        """Samples on which the exposures from number `k` (counted from 0) on began, so far."""
        with self._changed:
            return self._exposures[k:]

    def anchor(self, newest: int, asked_s: float, answered_s: float) -> None:
        """Note that the board had taken `newest` samples between two times of the wall clock.

        Such an answer is too small by the time that the board needs to hand samples over, and at
        times, when it or the computer is busy, by much more; the best of several seconds counts. By
        how much that is still too small is learned in the first seconds, in which the start bounds
        the clock. Later answers then bound it as closely, however long the run is.
        """
        if self.pace is None:
            return
        ahead, second = newest - self._passed(asked_s), math.floor(asked_s - self.began_s)
        with self._changed:
            if second < ANCHORED_S:
                least = newest - self._passed(answered_s)
                self._first_anchor = max(self._first_anchor, least)
            if self._anchors and self._anchors[-1][0] == second:
                ahead = max(ahead, self._anchors.pop()[1])
            self._anchors.append((second, ahead))
            while self._anchors[0][0] < second - ANCHORED_S:
                self._anchors.popleft()
            most = max(ahead for _, ahead in self._anchors)
            if math.isfinite(self._first_anchor):
                self._late = min(0.0, most - self._first_anchor)

    def latest(self, now_s: float) -> float:
        """No sample after this one can have been taken by a time of the wall clock."""
        if self.pace is None:
            return math.inf
        return self._passed(now_s) + self._late + 1

    def _passed(self, now_s: float) -> float:
        """Most samples that can have been taken since the start."""
        return (now_s - self.began_s) * self.sample_rate_hz * (self.pace or 1.0) * (1 + DRIFT)
