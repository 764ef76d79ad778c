"""What the window says of STOP MOTION: presses it in the background, and chooses among the answers
that come from there and from the run.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable
from typing import Protocol, TypeVar

from app.system.stopping import Stop, StopAnswer, failed, not_connected
from app.system.threads import start_thread

LOG = logging.getLogger(__name__)
ON_ITS_WAY = StopAnswer(Stop.SENT, "STOP MOTION is on its way to the actuator.", False)


NOTHING_MOVES = not_connected(
    "no bench is connected, and no run of yours is under way on this computer"
)


class Stoppable(Protocol):
    """A run, or a bench that is connected without one."""

    def stop_motion(self) -> StopAnswer:
        """Stop the actuator at once; what became of it."""


Found = TypeVar("Found", bound=StopAnswer | None)


def _answer(stop: Callable[[], Found]) -> Found | StopAnswer:
    try:
        return stop()
    except Exception as error:
        LOG.error("STOP MOTION failed", exc_info=error)
        return failed(error)


class StopAnswers:
    """Chooses which answers to the stops of one run are shown; none waits for another."""

    def __init__(self) -> None:
        self._asked_at = math.inf  # when the newest stop of this run was asked for here
        self._shown: StopAnswer | None = None
        self._newest: threading.Thread | None = None

    @property
    def is_waiting(self) -> bool:
        """Whether an answer to the newest stop is still to come."""
        return self._newest is not None and self._newest.is_alive()

    @property
    def is_answered(self) -> bool:
        """Whether an answer to a stop of this run was shown."""
        return self._shown is not None

    def begin(self) -> None:
        """A new run begins."""
        self._asked_at, self._shown = math.inf, None

    def press(
        self,
        source: Stoppable | None,
        came: Callable[[StopAnswer, float], object],
        others: Callable[[], StopAnswer | None] = lambda: None,
        beside: Callable[[StopAnswer], object] = lambda answer: None,
    ) -> float:
        """Stop the motion in a thread of its own, so that neither the window nor a slow device can
        delay it; and at the same time that of `others`, which is the answer where nothing could be
        sent to `source`. Else `beside` is told of it, in any thread, and `came` of the answer with
        the moment of this call, which is given back.
        """
        self._asked_at, self._shown = time.monotonic(), None
        found: list[StopAnswer | None] = []
        asked_at = self._asked_at

        def stop_others() -> None:
            found.append(_answer(others))

        def work() -> None:
            answer = NOTHING_MOVES if source is None else _answer(source.stop_motion)
            is_sent = answer.kind is not Stop.NOT_CONNECTED
            if is_sent:
                came(answer, asked_at)
            second.join()
            if not is_sent:
                came(found[0] or answer, asked_at)
            elif found[0] is not None:
                beside(found[0])

        second = start_thread("stop-others", stop_others)
        self._newest = start_thread("window-stop", work)
        return asked_at

    def is_news(self, answer: StopAnswer, asked_at: float) -> bool:
        """Whether an answer is to be shown; `asked_at` is when it was asked for, or the run was
        read.

        What was asked before the newest stop, or the newest run, is no answer to that. What was
        read of the position is not replaced by that the stop was sent. A stop that nobody has asked
        for here is shown if it has failed.
        """
        before = self._shown
        if not (asked_at >= self._asked_at or answer.has_failed) or answer == before:
            return False
        if before and before.is_final and not (answer.is_final or answer.has_failed):
            return False
        self._shown = answer
        return True
