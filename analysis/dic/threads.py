"""A fixed number of threads that share the rows of a grid."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import TypeVar

T = TypeVar("T")
Rows = tuple[int, int]  # the first, and one past the last


def together(works: Sequence[Callable[[], T]], number: int) -> list[T]:
    """What several pieces of work give, done by so many threads."""
    if number < 2:
        return [work() for work in works]
    with ThreadPoolExecutor(number, "analysis") as pool:
        return list(pool.map(lambda work: work(), works))


class Threads:
    """The calling thread and as many more as make up `number`, 1 or more."""

    def __init__(self, number: int) -> None:
        self.number = number
        self._pool = ThreadPoolExecutor(number - 1, "dic") if number > 1 else None

    def bands(self, rows: int, per_thread: int = 1) -> list[Rows]:
        """`rows` rows cut into bands of nearly equal height, `per_thread` for each thread.

        With a single thread there is nothing to balance, and one band.
        """
        n = self.number * per_thread if self.number > 1 else 1
        edges = [rows * k // n for k in range(n + 1)]
        return [(a, b) for a, b in pairwise(edges) if b > a]

    def share(self, work: Callable[[Rows], None], bands: Sequence[Rows]) -> None:
        """Call `work` with every band, each on the thread that is free first; wait for all."""
        waiting = iter(bands)  # taking the next item of a list's iterator is atomic

        def work_on() -> None:
            for band in waiting:
                work(band)

        extra = min(self.number, len(bands)) - 1
        others = [self._pool.submit(work_on) for _ in range(extra)] if self._pool else []
        work_on()
        for other in others:
            other.result()

    def close(self) -> None:
        """End the threads. May be called twice."""
        if self._pool is not None:
            self._pool.shutdown()
