"""The results of a run, however long, in little memory: the numbers of every frame, the rings of
some, all of the newest.
"""

from __future__ import annotations

import threading
from array import array
from dataclasses import replace
from typing import Any

import numpy as np

from app.records.record_types import (
    Phase,
    RingProfile,
    Snapshot,
)
from app.records.snapshot_numbers import NUMBERS, WHOLE, numbers_of, snapshot_of

MOST_RINGS = 1024  # an even number; more frames do not improve a local law
MOST_AT_REST = 128  # rings before the drive; they tell a drift
_PHASES = list(Phase)


class Series:
    """One snapshot per analysed frame, in their order; written by one thread, read by any.

    The newest is as it was given. Of those before it only the numbers are kept, and the rings of
    frames whose traction is known: of all such frames, or where there are more than `MOST_RINGS`
    of every second, fourth ...; and those of the first `MOST_AT_REST` at rest before the drive.
    """

    def __init__(self) -> None:
        self._rows = array("d")  # the numbers of each snapshot
        self._rings: dict[int, RingProfile] = {}  # by frame
        self._every = 1
        self._inverted = 0
        self._at_rest = 0  # of the rings: the first
        self._newest: Snapshot | None = None
        self._lock = threading.Lock()  # a row and the newest go together

    def __len__(self) -> int:
        """Frames so far."""
        return len(self._rows) // len(NUMBERS)

    def append(self, snapshot: Snapshot) -> None:
        """Add the snapshot of the next frame."""
        if snapshot.traction is not None and snapshot.rings is not None:
            if self._inverted % self._every == 0:
                self._rings[snapshot.frame] = snapshot.rings
            self._inverted += 1
            if len(self._rings) - self._at_rest > MOST_RINGS:
                for frame in list(self._rings)[self._at_rest :][1::2]:
                    del self._rings[frame]
                self._every *= 2
        elif (
            snapshot.conditions.phase is Phase.REFERENCE
            and snapshot.rings is not None
            and not self._inverted
            and self._at_rest < MOST_AT_REST
        ):
            self._rings[snapshot.frame] = snapshot.rings
            self._at_rest += 1
        numbers = numbers_of(snapshot)
        numbers["phase"] = _PHASES.index(numbers["phase"])
        with self._lock:
            self._newest = snapshot
            self._rows.extend(array("d", numbers.values()))

    def since(self, n: int) -> list[Snapshot]:
        """The snapshots after the first `n`."""
        with self._lock:
            newest, after = self._newest, self._rows[n * len(NUMBERS) :]
        rows = np.frombuffer(after).reshape(-1, len(NUMBERS)).tolist()
        found = [self._snapshot(row) for row in rows]
        if found and newest is not None and found[-1].frame == newest.frame:
            found[-1] = newest
        return found

    def _snapshot(self, row: list[float]) -> Snapshot:
        numbers: dict[str, Any] = dict(zip(NUMBERS, row, strict=True))
        numbers["phase"] = _PHASES[int(numbers["phase"])]
        numbers |= {name: int(numbers[name]) for name in WHOLE}
        return replace(snapshot_of(numbers), rings=self._rings.get(numbers["frame"]))
