"""The hands on a replay: pause, step, pace, and a look at any recorded frame while it stands."""

from __future__ import annotations

import threading
import time
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from app.records import Snapshot
from app.session.reader import SessionReader


class Playback:
    """Decides when the next frame of a replay may be played; asked by its thread, told from any.

    Parameters
    ----------
    pace : float or None
        Seconds of the experiment per second; None: as fast as the machine.
    """

    def __init__(self, pace: float | None) -> None:
        self.pace = pace
        self.is_paused = False
        self._steps = 0
        # the clock on the wall, and that of the experiment, where the pace began
        self._began: tuple[float, float] | None = None
        self._is_over = False
        self._changed = threading.Condition()

    def pause(self) -> None:
        """Stand after the frame in hand."""
        with self._changed:
            self.is_paused = True

    def resume(self) -> None:
        """Go on at the pace."""
        with self._changed:
            self.is_paused, self._began, self._steps = False, None, 0
            self._changed.notify_all()

    def step(self) -> None:
        """Play one more frame, and stand."""
        with self._changed:
            self.is_paused = True
            self._steps += 1
            self._changed.notify_all()

    def set_pace(self, pace: float | None) -> None:
        """Go on at another pace."""
        with self._changed:
            self.pace, self._began = pace, None
            self._changed.notify_all()

    def end(self) -> None:
        """Nobody waits any longer."""
        with self._changed:
            self._is_over = True
            self._changed.notify_all()

    def wait_for_turn(self, time_s: float) -> bool:
        """Whether the frame of that moment of the experiment is to be played, once its time has
        come; False: it is over.
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
    """Any recorded frame of a session, with the results it was recorded with; read when it is
    looked at, from one thread.
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
        """Look at analysed frame `number` (counted from 0) from now on; None: at none.

        From any thread, returns at once.
        """
        self._wanted = number

    def look(self) -> tuple[Snapshot, NDArray[Any]] | None:
        """Results and image of the frame that is looked at; None while none is.

        The same objects until it is another one.
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
