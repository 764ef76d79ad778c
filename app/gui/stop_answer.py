"""What the window says of STOP MOTION: presses it in the background, and chooses among the answers
that come from there and from the run.
"""

from __future__ import annotations

import logging
import threading
from collections import deque
from collections.abc import Callable
from typing import Protocol, TypeVar

from app.gui.cells import Tone
from app.system.stopping import Stop, StopAnswer, failed, not_connected

LOG = logging.getLogger(__name__)
TONES = {
    Stop.SENT: Tone.WARN,
    Stop.AT_REST: Tone.GOOD,
    Stop.FAILED: Tone.BAD,
    Stop.NOT_CONNECTED: Tone.NEUTRAL,
}
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
    """The answers to the stops of one run, in the order in which they are to be shown."""

    def __init__(self) -> None:
        self._is_pressed = False
        self._shown: StopAnswer | None = None
        self._came: deque[StopAnswer] = deque()  # from other threads
        self._read: StopAnswer | None = None  # of the run, until it was shown

    @property
    def is_answered(self) -> bool:
        """Whether an answer to a stop of this run was shown."""
        return self._shown is not None

    def begin(self) -> None:
        """A new run begins."""
        self._is_pressed, self._shown, self._read = False, None, None

    def press(
        self,
        source: Stoppable | None,
        others: Callable[[], StopAnswer | None] = lambda: None,
        beside: Callable[[StopAnswer], object] = lambda answer: None,
    ) -> None:
        """Stop the motion in a thread of its own, so that neither the window nor a slow device can
        delay it; and at the same time that of `others`, which is the answer where nothing could be
        sent to `source`. Else `beside` is told of it, in any thread.
        """
        self._is_pressed, self._shown, self._read = True, None, None
        found: list[StopAnswer | None] = []

        def stop_others() -> None:
            found.append(_answer(others))

        def work() -> None:
            answer = NOTHING_MOVES if source is None else _answer(source.stop_motion)
            is_sent = answer.kind is not Stop.NOT_CONNECTED
            if is_sent:
                self._came.append(answer)
            second.join()
            if not is_sent:
                self._came.append(found[0] or answer)
            elif found[0] is not None:
                beside(found[0])

        if source is not None:
            self._came.append(ON_ITS_WAY)
        first = threading.Thread(target=work, name="slipscope-window-stop", daemon=True)
        second = threading.Thread(target=stop_others, name="slipscope-stop-others", daemon=True)
        second.start()
        first.start()

    def next(self, read: StopAnswer | None = None) -> StopAnswer | None:
        """The next answer to show, None if there is no new one; `read` is that of the run now, which
        is kept while others are shown first: the run may have ended, and is not read again.

        What was read of the position is not replaced by that the stop was sent. A stop that nobody
        has asked for here is shown if it has failed.
        """
        self._read = read or self._read
        if self._came:
            answer: StopAnswer | None = self._came.popleft()
        else:
            answer, self._read = self._read, None
        if answer is None or not (self._is_pressed or answer.kind is Stop.FAILED):
            return None
        before = self._shown
        if answer == before or (before and before.is_final and not answer.is_final):
            return None
        self._shown = answer
        return answer
