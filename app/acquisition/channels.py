"""The two ways from one thread to another: lossless to the disk, newest-wins to the analysis.

Both bounded, both counted.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from typing import Generic, TypeVar

T = TypeVar("T")


class ChannelFull(RuntimeError):
    """A lossless channel has no room left: the receiver is slower than the data."""


class ChannelClosed(RuntimeError):
    """The receiver is gone; nothing can be handed over any more."""


class LosslessChannel(Generic[T]):
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
        self.capacity_bytes = capacity_bytes
        self.sender_waits = sender_waits
        self._items: deque[tuple[T, int]] = deque()
        self._bytes = 0
        self._ended = False
        self._broken = False
        self._changed = threading.Condition()

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

    def get(self, timeout_s: float) -> T | None:
        """The oldest item, or None when none came in `timeout_s` or the channel is at its end."""
        with self._changed:
            self._changed.wait_for(lambda: self._items or self._ended, timeout_s)
            if not self._items:
                return None
            item, nbytes = self._items.popleft()
            self._bytes -= nbytes
            self._changed.notify_all()
            return item

    def end(self) -> None:
        """No more items will be put; those that wait are still delivered."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def break_off(self) -> list[T]:
        """The receiver can take no more: senders get `ChannelClosed`. What it has not taken."""
        with self._changed:
            self._broken = True
            left = [item for item, _ in self._items]
            self._items.clear()
            self._bytes = 0
            self._changed.notify_all()
        return left

    @property
    def is_drained(self) -> bool:
        """Ended, and everything delivered."""
        with self._changed:
            return self._ended and not self._items

    @property
    def fill(self) -> float:
        """Share of the capacity in use, 0 to 1."""
        return min(1.0, self._bytes / self.capacity_bytes)


class LatestChannel(Generic[T]):
    """A short queue where the newest wins: what does not fit pushes out the oldest, which is
    counted as skipped.

    With `sender_waits` nothing is ever pushed out.
    """

    def __init__(self, depth: int, *, sender_waits: bool) -> None:
        self.depth = depth
        self._narrow_to = depth
        self._grace = 0  # items that may still be put at the old depth
        self.sender_waits = sender_waits
        self.skipped = 0
        self.waited_s = 0.0  # of the item that was taken last
        self._items: deque[tuple[T, float]] = deque()  # and when each was put
        self._ended = False
        self._changed = threading.Condition()

    def narrow(self, depth: int, grace: int) -> None:
        """Lower the depth once the queue has run empty, or after `grace` more items at the latest:
        what waits now is not pushed out.
        """
        with self._changed:
            self._narrow_to, self._grace = depth, grace
            if not self._items:
                self.depth = depth

    def put(self, item: T) -> None:
        """Offer `item`; after the end it is counted as skipped."""
        with self._changed:
            if self.sender_waits:
                self._changed.wait_for(lambda: len(self._items) < self.depth or self._ended)
            if self._ended:
                self.skipped += 1
                return
            self._items.append((item, time.monotonic()))
            self._grace -= 1
            if self._grace < 0:
                self.depth = self._narrow_to
            while len(self._items) > self.depth:
                self._items.popleft()
                self.skipped += 1
            self._changed.notify_all()

    def get(self, timeout_s: float) -> T | None:
        """The oldest item that was not pushed out, or None when none came in `timeout_s` or the
        channel is at its end.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._items or self._ended, timeout_s)
            if not self._items:
                return None
            item, since = self._items.popleft()
            self.waited_s = time.monotonic() - since
            if not self._items:
                self.depth = self._narrow_to
            self._changed.notify_all()
            return item

    def end(self) -> None:
        """No more items will be put; those that wait are still delivered."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def abandon(self) -> None:
        """The receiver takes no more: what waits, and what comes, is counted as skipped."""
        with self._changed:
            self._ended = True
            self.skipped += len(self._items)
            self._items.clear()
            self._changed.notify_all()

    @property
    def is_drained(self) -> bool:
        """Ended, and everything delivered."""
        with self._changed:
            return self._ended and not self._items
