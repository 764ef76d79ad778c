"""The controls of a replay: pause, single frames, pace, and the place that is shown."""

from __future__ import annotations

import math
import threading
import time

FASTEST = 10.0  # pace at which recorded frames are shown where none is set


class Playback:
    """Decides when the next frame of a replay may be played.

    The thread of the replay waits for its turn; the other methods may be called from any thread.

    Parameters
    ----------
    pace : float or None
        Seconds of the experiment per second; None: as fast as the machine.
    """

    def __init__(self, pace: float | None) -> None:
        self.pace = pace
        self.is_paused = False
        self._steps = 0
        # monotonic clock, and time of the experiment, when the present pace began
        self._began: tuple[float, float] | None = None
        self._until_s = -math.inf  # frames up to that time are due at once: one after is shown
        self._is_over = False
        self._changed = threading.Condition()

    def pause(self) -> None:
        """Stop after the current frame, until `resume` or `step`."""
        with self._changed:
            self.is_paused = True

    def resume(self) -> None:
        """Continue at the pace."""
        with self._changed:
            self.is_paused, self._began, self._steps = False, None, 0
            self._changed.notify_all()

    def resume_from(self, time_s: float) -> None:
        """Continue at the pace from that time of the experiment; what comes before it and has not
        been played is due at once.
        """
        with self._changed:
            self.is_paused, self._steps = False, 0
            self._began, self._until_s = (time.monotonic(), time_s), time_s
            self._changed.notify_all()

    def catch_up(self, time_s: float) -> None:
        """Let all frames up to that time of the experiment be due at once."""
        with self._changed:
            self._until_s = time_s
            self._changed.notify_all()

    @property
    def head_s(self) -> float:
        """The time of the experiment that the pace has come to; NaN before the first frame."""
        with self._changed:
            if self._began is None:
                return math.nan
            return self._began[1] + (self.pace or FASTEST) * (time.monotonic() - self._began[0])

    def step(self) -> None:
        """Play one more frame, then pause."""
        with self._changed:
            self.is_paused = True
            self._steps += 1
            self._changed.notify_all()

    def set_pace(self, pace: float | None) -> None:
        """Change the pace from the next frame on."""
        head_s = self.head_s
        with self._changed:
            goes_on = math.isfinite(head_s) and math.isfinite(self._until_s)
            self.pace, self._began = pace, (time.monotonic(), head_s) if goes_on else None
            self._changed.notify_all()

    def end(self) -> None:
        """End the replay: whoever waits for a turn gets none."""
        with self._changed:
            self._is_over = True
            self._changed.notify_all()

    def wait_for_turn(self, time_s: float) -> bool:
        """Wait until the frame of that time of the experiment is due; whether it is to be played:
        not if the replay has been ended.
        """
        with self._changed:
            while not self._is_over:
                if time_s <= self._until_s:
                    return True
                if self.is_paused:
                    if self._steps:
                        self._steps -= 1
                        return True
                    self._changed.wait()
                    continue
                if self.pace is None:
                    return True
                now = time.monotonic()
                if self._began is None:
                    self._began = now, time_s
                ahead = (time_s - self._began[1]) / self.pace - (now - self._began[0])
                if ahead <= 0:
                    return True
                self._changed.wait(ahead)
            return False
