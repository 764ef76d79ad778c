"""How often the window is drawn anew: ten times a second, and less often where the analysis needs
the core.
"""

from __future__ import annotations

import math
import time

from app.gui.view_state import ViewState

REFRESH_S = 0.1  # from the beginning of one redraw to the next
# after a redraw the window rests this many times as long as it took, the longer the more often
# frames wait for the analysis: it needs the core
RESTS, MOST_RESTS, MOST_BEHIND = 3.0, 10.0, 2
MOST_REST_S = 1.0


class Pace:
    """When the next redraw is due; used in the thread of the window only.

    What a redraw has used of this thread's time includes the painting by Qt.
    """

    def __init__(self) -> None:
        self._rests = RESTS
        self._sparing = 1  # the time between redraws is so many times as long
        self.hurry()

    def hurry(self) -> None:
        """Let the next redraw be due at once."""
        self.begin(-math.inf)

    def left_s(self, now: float) -> float:
        """How long the last redraw is still to be rested from; below zero: the next is due."""
        used, since = time.thread_time() - self._used, now - self._began
        rest_s = min(MOST_REST_S, (1 + self._rests) * used)
        return max(REFRESH_S * self._sparing, rest_s) - since

    def follow(self, view: ViewState) -> None:
        """Rest the longer the more the analysis has to do."""
        self._sparing = 2 if view.shed else 1
        change = 1.5 if view.behind > MOST_BEHIND else 0.97
        self._rests = min(MOST_RESTS, max(RESTS, self._rests * change))

    def begin(self, now: float) -> None:
        """Take the next redraw to begin now."""
        # by the clock, and in processor time of this thread
        self._began, self._used = now, time.thread_time()
