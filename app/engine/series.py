"""The results of a run, however long, in little memory: the numbers of every frame, the rings of
some, the fields of the newest.
"""

from __future__ import annotations

import math
from array import array
from dataclasses import fields

import numpy as np
from numpy.typing import NDArray

from app.results import Phase, Snapshot

MOST_RINGS = 1024  # an even number; a local law is not told better by more frames
_PHASES = tuple(Phase)
_NUMBERS = tuple(field.name for field in fields(Snapshot) if field.type == "float")
_WIDTH = 3 + len(_NUMBERS)
_NO_RINGS = np.empty((3, 0))
_BARE: dict[str, NDArray[np.generic]] = {
    name: np.empty(0)
    if array_type == "F64"
    else np.empty((0, 0), np.float32 if array_type == "F32" else np.uint8)
    for name, array_type in ((field.name, field.type) for field in fields(Snapshot))
    if array_type not in ("int", "float", "Phase")
}


class Series:
    """One snapshot per analysed frame, in their order; written by one thread, read by any.

    The newest is as it was given. Of those before it the fields and the traction's profile are
    gone, and so are the rings but for those frames of the drive whose traction was found: of all of
    them, or where there are more than `MOST_RINGS` of every second, fourth ...
    """

    def __init__(self) -> None:
        self._rows = array("d")  # frame, sample, phase, numbers
        self._rings: dict[int, NDArray[np.float64]] = {}
        self._every = 1
        self._inverted = 0
        self._newest: Snapshot | None = None

    def __len__(self) -> int:
        """Frames so far."""
        return len(self._rows) // _WIDTH

    def append(self, snapshot: Snapshot) -> None:
        """Add the next frame's."""
        if math.isfinite(snapshot.stress_force_n):
            if self._inverted % self._every == 0:
                self._rings[snapshot.frame] = np.array(
                    [snapshot.ring_radius_m, snapshot.ring_ux_m, snapshot.ring_sd_m]
                )
            self._inverted += 1
            if len(self._rings) > MOST_RINGS:
                for frame in list(self._rings)[1::2]:
                    del self._rings[frame]
                self._every *= 2
        self._newest = snapshot
        numbers = (getattr(snapshot, name) for name in _NUMBERS)
        self._rows.extend(
            array("d", (snapshot.frame, snapshot.sample, _PHASES.index(snapshot.phase), *numbers))
        )

    def since(self, n: int) -> list[Snapshot]:
        """The snapshots after the first `n`."""
        newest = self._newest
        rows = np.frombuffer(self._rows[n * _WIDTH :]).reshape(-1, _WIDTH)
        return [
            newest if newest and row[0] == newest.frame else self._snapshot(*row)
            for row in rows.tolist()
        ]

    def _snapshot(self, frame: float, sample: float, phase: float, *numbers: float) -> Snapshot:
        rings = dict(
            zip(
                ("ring_radius_m", "ring_ux_m", "ring_sd_m"),
                self._rings.get(int(frame), _NO_RINGS),
                strict=True,
            )
        )
        given = {**_BARE, **rings, **dict(zip(_NUMBERS, numbers, strict=True))}
        return Snapshot(int(frame), int(sample), _PHASES[int(phase)], **given)
