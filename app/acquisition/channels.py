"""The two ways from one thread to another: lossless to the disk, newest-wins to the analysis.

Both bounded, both counted.
"""

from __future__ import annotations

import math
import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from statistics import median
from typing import Generic, TypeVar

T = TypeVar("T")

JUDGED = 9  # items by whose median a receiver is too slow, so that a pause of it counts for one


class ChannelFull(RuntimeError):
    """A lossless channel has no room left: the receiver is slower than the data."""


class ChannelClosed(RuntimeError):
    """The receiver is gone; nothing can be handed over any more."""


class _Queue(ABC, Generic[T]):
    """A queue from one thread to another, with something about each item: its bytes, or when it
    was put.
    """

    def __init__(self, *, sender_waits: bool) -> None:
        self.sender_waits = sender_waits
        self._items: deque[tuple[T, float]] = deque()
        self._ended = False
        self._changed = threading.Condition()

    def get(self, timeout_s: float) -> T | None:
        """The oldest item that is there, or None when none came in `timeout_s` or the channel is at
        its end.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._items or self._ended, timeout_s)
            if not self._items:
                return None
            item, about = self._items.popleft()
            self._was_taken(about)
            self._changed.notify_all()
            return item

    @abstractmethod
    def _was_taken(self, about: float) -> None:
        """Account for an item that has left the queue."""

    def end(self) -> None:
        """No more items will be put; those that wait are still delivered."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    @property
    def is_drained(self) -> bool:
        """Ended, and everything delivered."""
        with self._changed:
            return self._ended and not self._items


class LosslessChannel(_Queue[T]):
    """A queue bounded in bytes that never drops: a sender waits for room, or is told that there is
    none.

    Parameters
    ----------
    capacity_bytes : int
        Data held at most.
    sender_waits : bool
        True where the source can wait (a free-running simulation), False where it cannot
        (hardware, real time).
    """

    def __init__(self, capacity_bytes: int, *, sender_waits: bool) -> None:
        super().__init__(sender_waits=sender_waits)
        self.capacity_bytes = capacity_bytes
        self._bytes = 0.0
        self._broken = False

    def put(self, item: T, nbytes: int) -> None:
        """Hand `item` over.

        Raises
        ------
        ChannelFull
            There is no room and the sender cannot wait.
        ChannelClosed
            The receiver gave up, or the channel was ended.
        """
        with self._changed:
            while (
                self._bytes
                and self._bytes + nbytes > self.capacity_bytes
                and not (self._ended or self._broken)
            ):
                if not self.sender_waits:
                    raise ChannelFull(
                        f"{self._bytes / 2**20:.0f} MiB wait and {self.capacity_bytes / 2**20:.0f}"
                        " MiB is the queue's limit"
                    )
                self._changed.wait()
            if self._ended or self._broken:
                raise ChannelClosed
            self._items.append((item, nbytes))
            self._bytes += nbytes
            self._changed.notify_all()

    def _was_taken(self, about: float) -> None:
        self._bytes -= about

    def break_off(self) -> list[T]:
        """The receiver can take no more: senders get `ChannelClosed`. What it has not taken."""
        with self._changed:
            self._broken = True
            left = [item for item, _ in self._items]
            self._items.clear()
            self._bytes = 0.0
            self._changed.notify_all()
        return left

    @property
    def fill(self) -> float:
        """Share of the capacity in use, 0 to 1."""
        return min(1.0, self._bytes / self.capacity_bytes)


class LatestChannel(_Queue[T]):
    """A queue where the newest wins: what does not fit pushes out the oldest, which is counted as
    skipped.

    A receiver that catches up after a pause loses nothing. One for which the queue was too short is
    too slow, and gets what is young, see `narrow`. With `sender_waits` nothing is ever pushed out.
    """

    def __init__(self, depth: int, *, sender_waits: bool) -> None:
        super().__init__(sender_waits=sender_waits)
        self.depth = self._young = depth
        self._is_cut = False
        self._every_s = math.inf
        self._taken_s = 0.0  # when the last item was taken
        self._took_s: deque[float] = deque(maxlen=JUDGED)  # by items while others waited
        self.skipped = 0
        self.waited_s = 0.0  # of the item that was taken last

    def narrow(self, depth: int, young: int, every_s: float) -> None:
        """From now on, `depth` items may wait. If more come, or more than a quarter wait for a
        receiver that takes longer than `every_s` for each, only the newest `young` do, until the
        queue has run empty.
        """
        with self._changed:
            self.depth, self._young, self._every_s, self._is_cut = depth, young, every_s, False

    def put(self, item: T) -> None:
        """Offer `item`; after the end it is counted as skipped."""
        with self._changed:
            if self.sender_waits:
                self._changed.wait_for(lambda: len(self._items) < self.depth or self._ended)
            if self._ended:
                self.skipped += 1
                return
            self._items.append((item, time.monotonic()))
            self._is_cut |= len(self._items) > (self.depth / 4 if self._is_slow else self.depth)
            while self._is_cut and len(self._items) > self._young:
                self._items.popleft()
                self.skipped += 1
            self._changed.notify_all()

    @property
    def _is_slow(self) -> bool:
        return len(self._took_s) == JUDGED and median(self._took_s) > self._every_s

    def _was_taken(self, about: float) -> None:
        now_s = time.monotonic()
        if about <= self._taken_s:  # it was there when the one before it was taken
            self._took_s.append(now_s - self._taken_s)
        else:
            self._took_s.clear()
        self._taken_s, self.waited_s = now_s, now_s - about
        self._is_cut &= bool(self._items)

    def abandon(self) -> None:
        """The receiver takes no more: what waits, and what comes, is counted as skipped."""
        with self._changed:
            self._ended = True
            self.skipped += len(self._items)
            self._items.clear()
            self._changed.notify_all()
