"""A session as the stored devices of a bench need it: samples, images and positions by their
numbers.
"""

from __future__ import annotations

import weakref
from pathlib import Path
from typing import Any

import numpy as np

from analysis.arrays import Array
from app.session.reader import SessionReader


class SessionRecording:
    """The readings of a session, see `drivers.recorded.Recording`; its file stays open as long as
    anybody may ask for images, or until `close`.
    """

    def __init__(self, path: Path, pace: float | None) -> None:
        self._session = session = SessionReader(path)
        weakref.finalize(self, session.close)
        self.name, self.pace = path.name, pace
        self.volts = session.forces().volts
        self.sample_rate_hz = session.header.sample_rate_hz
        self.divisor = session.header.divisor
        self.shape = session.header.frame_shape
        self.dtype: np.dtype[Any] = np.dtype(session.header.frame_dtype)
        samples, metres = session.positions()
        known = np.isfinite(metres)
        self.position_samples, self.positions_m = samples[known], metres[known]
        self._lost = {index: reason for index, _, reason in session.lost_frames()}
        self._count = len(session.triggers())

    def image(self, index: int) -> Array | str | None:
        """The image of a trigger, why it has none, or None beyond the last one."""
        if index >= self._count:
            return None
        return self._lost[index] if index in self._lost else self._session.frame(index)[2]

    def close(self) -> None:
        """Let go of the file."""
        self._session.close()
