"""The motion of the simulated stage: what it reports, and where its spindle carries the block."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from analysis.arrays import F64, I64
from drivers.sim.settings import SimSettings


@dataclass(frozen=True, slots=True)
class SpindleMove:
    """The motion of the stage after a command: from `start_m` on `sample` to `target_m` at `speed`
    (metres per sample, signed); what its spindle moves begins at `carried_m`.
    """

    sample: int
    start_m: float
    target_m: float
    speed: float
    carried_m: float

    def at(self, samples: I64) -> F64:
        """What the stage reports."""
        low, high = sorted((self.start_m, self.target_m))
        return np.asarray(np.clip(self.start_m + self.speed * (samples - self.sample), low, high))

    def carried(self, samples: I64, backlash_m: float) -> F64:
        """Where a nut with this play is, which is behind by it when it goes back."""
        at = self.at(samples)
        return np.asarray(np.clip(self.carried_m, at, at + backlash_m))

    def place(self, samples: I64, sim: SimSettings) -> F64:
        """Where the block is carried to."""
        at = self.carried(samples, sim.backlash)
        return at + sim.screw_error * np.sin(2 * math.pi / sim.screw_pitch * at)
