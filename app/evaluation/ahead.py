"""Work on the next frame that goes on beside the work on the one before it."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import Generic, TypeVar

T = TypeVar("T")


class Ahead(Generic[T]):
    """Work of one kind, frame after frame, of which that on the next frame may be begun early, in a
    thread of its own. Used from one thread.
    """

    def __init__(self) -> None:
        self._pool: ThreadPoolExecutor | None = None
        self._frame = -1
        self._begun: Future[T] | None = None

    def begin(self, frame: int, work: Callable[[], T]) -> None:
        """Begin the work on a frame; returns at once."""
        self._pool = self._pool or ThreadPoolExecutor(1, "ahead")
        self._frame, self._begun = frame, self._pool.submit(work)

    def result(self, frame: int, work: Callable[[], T]) -> T:
        """What the work on a frame gives, which was begun early or is done now."""
        if self._begun is None or self._frame != frame:
            self.drop()
            return work()
        begun, self._begun = self._begun, None
        return begun.result()

    def drop(self) -> None:
        """Wait for what was begun, and leave its result."""
        if self._begun is not None:
            wait([self._begun])
        self._begun = None

    def close(self) -> None:
        """End the thread. May be called twice."""
        self.drop()
        if self._pool is not None:
            self._pool.shutdown()
