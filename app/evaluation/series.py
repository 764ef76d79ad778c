"""The results of a run, however long, in little memory: the numbers of every frame, the rings of
some, all of the newest.
"""

from __future__ import annotations

import threading
from array import array
from dataclasses import replace
from typing import Any, TypeVar

import numpy as np

from app.records.record_types import Phase, RingProfile, Snapshot
from app.records.snapshot_numbers import NUMBERS, WHOLE, numbers_of, snapshot_of

MOST_RINGS = 1024  # an even number; more frames do not improve a local law
MOST_AT_REST = 128  # rings before the drive; they tell a drift
_PHASES = list(Phase)
T = TypeVar("T")


class Thinned(list[T]):
    """The items of a long series that are kept: all, or where there would be more than `most`, an
    even number, every second, fourth ...
    """

    def __init__(self, most: int) -> None:
        super().__init__()
        self._most, self._every, self._count = most, 1, 0

    def add(self, item: T) -> None:
        """Take the next item of the series."""
        if self._count % self._every == 0:
            self.append(item)
        self._count += 1
        if len(self) > self._most:
            del self[1::2]
            self._every *= 2


class Series:
    """One snapshot per analysed frame, in their order; written by one thread, read by any.

    The newest is as it was given. Of those before it only the numbers are kept, and the rings of
    frames whose traction is known, thinned to `MOST_RINGS`; and those of the first `MOST_AT_REST`
    at rest before the drive.
    """

    def __init__(self) -> None:
        self._rows = array("d")  # the numbers of each snapshot
        # rings by frame
        self._at_rest: dict[int, RingProfile] = {}
        self._inverted = Thinned[tuple[int, RingProfile]](MOST_RINGS)
        self._newest: Snapshot | None = None
        self._lock = threading.Lock()  # a row, its rings and the newest go together

    def __len__(self) -> int:
        """Frames so far."""
        return len(self._rows) // len(NUMBERS)

    def append(self, snapshot: Snapshot) -> None:
        """Add the snapshot of the next frame."""
        frame, rings, numbers = snapshot.frame, snapshot.rings, numbers_of(snapshot)
        is_at_rest = snapshot.conditions.phase is Phase.REFERENCE and not self._inverted
        numbers["phase"] = _PHASES.index(numbers["phase"])
        with self._lock:
            if rings is not None and snapshot.traction is not None:
                self._inverted.add((frame, rings))
            elif rings is not None and is_at_rest and len(self._at_rest) < MOST_AT_REST:
                self._at_rest[frame] = rings
            self._newest = snapshot
            self._rows.extend(array("d", numbers.values()))

    def since(self, n: int) -> list[Snapshot]:
        """The snapshots after the first `n`."""
        with self._lock:
            newest, after = self._newest, self._rows[n * len(NUMBERS) :]
            rings = self._at_rest | dict(self._inverted)
        rows = np.frombuffer(after).reshape(-1, len(NUMBERS)).tolist()
        found = [_snapshot(row, rings) for row in rows]
        if found and newest is not None and found[-1].frame == newest.frame:
            found[-1] = newest
        return found


def _snapshot(row: list[float], rings: dict[int, RingProfile]) -> Snapshot:
    numbers: dict[str, Any] = dict(zip(NUMBERS, row, strict=True))
    numbers["phase"] = _PHASES[int(numbers["phase"])]
    numbers |= {name: int(numbers[name]) for name in WHOLE}
    return replace(snapshot_of(numbers), rings=rings.get(numbers["frame"]))
