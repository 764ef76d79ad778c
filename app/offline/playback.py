"""The controls of a replay: pause, single frames, pace, and any recorded frame to look at."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from app.records import Snapshot
from app.session.reader import SessionReader


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

    def step(self) -> None:
        """Play one more frame, then pause."""
        with self._changed:
            self.is_paused = True
            self._steps += 1
            self._changed.notify_all()

    def set_pace(self, pace: float | None) -> None:
        """Change the pace from the next frame on."""
        with self._changed:
            self.pace, self._began = pace, None
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


class Browser:
    """Shows any recorded frame of a session with its recorded results.

    The file is read by `look`, which one thread calls; `show` may be called from any.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._session: SessionReader | None = None
        self._wanted: int | None = None
        self._shown: tuple[int, Snapshot, NDArray[Any]] | None = None

    @property
    def number(self) -> int | None:
        """The frame that is looked at."""
        return self._wanted

    def show(self, number: int | None) -> None:
        """Choose the analysed frame to look at, counted from 0; None: no frame. Returns at once."""
        self._wanted = number

    def look(self) -> tuple[Snapshot, NDArray[Any]] | None:
        """Results and image of the frame that is looked at, or None.

        The same objects as before until another frame is chosen.
        """
        wanted = self._wanted
        if wanted is None:
            return None
        if self._shown is None or self._shown[0] != wanted:
            self._session = self._session or SessionReader(self._path)
            snapshot = self._session.snapshot(wanted)
            self._shown = wanted, snapshot, self._session.frame(snapshot.frame)[2]
        return self._shown[1:]

    def close(self) -> None:
        """Let go of the file."""
        if self._session is not None:
            self._session.close()
