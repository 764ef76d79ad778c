"""What the bench has measured so far, by sample: the place where a frame finds its forces, its
travel and its phase.
"""

from __future__ import annotations

import math
import threading
from bisect import bisect_left, bisect_right
from typing import NamedTuple

import numpy as np

from analysis.arrays import F64
from app.evaluation.series import Thinned
from app.records.record_types import Conditions, Phase
from app.records.run_view import Forces

# full-rate forces kept for frames still to be analysed; far longer than any queue before the
# analysis
KEPT_SECONDS = 60.0
MOST_MEANS = 4096  # an even number; twice the points of a plot
# samples of the drive that are kept: 17 minutes at 1 kHz; of a later onset, frames tell the forces
MOST_DRIVEN = 1 << 20


class DriveForces(NamedTuple):
    """The forces of the samples of a drive, each of shape (n,): time in seconds from its start, Q
    along it and P in newtons, NaN where a sample is missing.
    """

    time_s: F64
    shear_n: F64
    normal_n: F64


class History:
    """Forces, stage positions and phases on the sample clock; written by one thread, read by any.

    The last minute is kept at full rate in a ring, with the positions that go with it, and so is
    the beginning of the drive; for plots of the whole run there is one mean per block, or per
    second block, per fourth ... in a long run.

    Parameters
    ----------
    sample_rate_hz : float
    exposure_samples : int
    direction : float
        -1.0 for a drive against +x: the conditions of a frame are those along the drive.
    """

    def __init__(
        self, sample_rate_hz: float, exposure_samples: int, direction: float = 1.0
    ) -> None:
        self.sample_rate_hz = sample_rate_hz
        self._direction = direction
        self.exposure_samples = exposure_samples
        self._ring = np.full((int(KEPT_SECONDS * sample_rate_hz), 2), np.nan)
        self._end = 0
        self._driven: list[F64] = []
        self._means = Thinned[tuple[int, float, float]](MOST_MEANS)
        self._position_samples: list[int] = []
        self._positions: list[float] = []
        self._start_m = 0.0
        self._phase_samples: list[int] = []
        self._phases: list[Phase] = []
        self._step_samples: list[int] = []
        self._steps: list[int] = []
        self._ended = False
        self._changed = threading.Condition()

    @property
    def end(self) -> int:
        """Number of samples so far."""
        return self._end

    @property
    def has_ended(self) -> bool:
        """Whether no more samples will come."""
        return self._ended

    def append(self, first: int, forces: F64, position_m: float, position_sample: int) -> None:
        """Add one block of forces, shape (n, 2) in newtons (P, Q), and a position of the stage,
        read at its end or later.
        """
        with self._changed:
            end = first + len(forces)
            self._ring[np.arange(first, end) % len(self._ring)] = forces
            self._keep_driven(first, forces)
            if len(forces):
                normal, shear = (float(force.mean()) for force in forces.T)
                self._means.add((first + len(forces) // 2, normal, shear))
            if not self._positions:
                self._start_m = position_m
            self._position_samples.append(position_sample)
            self._positions.append(position_m)
            if self._position_samples[0] < end - 2 * len(self._ring):  # a ring's at a time
                old = bisect_left(self._position_samples, end - len(self._ring)) - 1
                del self._position_samples[:old], self._positions[:old]
            self._end = end
            self._changed.notify_all()

    def _keep_driven(self, first: int, forces: F64) -> None:
        start = self.phase_start(Phase.DRIVE)
        if start is not None and first < start + MOST_DRIVEN:
            self._driven.append(forces[max(start - first, 0) :])

    def begin(self, phase: Phase, sample: int) -> None:
        """From `sample` on the experiment is in `phase`."""
        with self._changed:
            self._phase_samples.append(sample)
            self._phases.append(phase)
            if phase is Phase.DRIVE and sample < self._end and not self._driven:
                after = np.arange(sample, self._end)
                self._keep_driven(sample, self._ring[after % len(self._ring)])

    def begin_step(self, number: int, sample: int) -> None:
        """From `sample` on the experiment is in that step of its protocol."""
        with self._changed:
            self._step_samples.append(sample)
            self._steps.append(number)

    def finish(self) -> None:
        """No more samples will come."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def wait_for(self, sample: int, timeout_s: float | None = None) -> bool:
        """Whether everything up to `sample` is known, once it is, or once no more samples will
        come or the time is over.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._end >= sample or self._ended, timeout_s)
            return self._end >= sample

    def last(self, seconds: float) -> F64:
        """The forces (n, 2) of the last seconds, or of what there is and is kept of them."""
        with self._changed:
            n = min(self._end, round(seconds * self.sample_rate_hz), len(self._ring))
            return self._ring[np.arange(self._end - n, self._end) % len(self._ring)]

    def shift(self, forces: F64) -> None:
        """Add these to all forces that are kept: the readings without a force are others."""
        with self._changed:
            self._ring += forces

    def wait_for_end(self) -> None:
        """Return when no more samples will come."""
        with self._changed:
            self._changed.wait_for(lambda: self._ended)

    def phase_start(self, phase: Phase) -> int | None:
        """Sample on which `phase` began, None if it did not."""
        with self._changed:
            return self._phase_samples[self._phases.index(phase)] if phase in self._phases else None

    def phase_at(self, sample: int) -> Phase:
        """Phase that `sample` belongs to."""
        with self._changed:
            return self._phases[max(0, bisect_right(self._phase_samples, sample) - 1)]

    def conditions(self, sample: int) -> Conditions:
        """The state of the bench during the exposure that starts at `sample`; without forces where
        they are not known up to its end (`wait_for`).
        """
        with self._changed:
            last = sample + self.exposure_samples
            if self._end - sample > len(self._ring):
                raise RuntimeError(
                    f"history: sample {sample} was asked {self._end - sample} samples later;"
                    f" {len(self._ring)} are kept"
                )
            mean = np.full(2, np.nan)
            if last <= self._end:  # beyond, the ring holds what was a minute before
                mean = self._ring[np.arange(sample, last) % len(self._ring)].mean(axis=0)
        phase = self.phase_at(sample)
        middle = sample + self.exposure_samples / 2
        drive = self.phase_start(Phase.DRIVE)
        time_s = (
            (middle - drive) / self.sample_rate_hz
            if drive is not None and sample >= drive
            else float("nan")
        )
        normal, shear = float(mean[0]), self._direction * float(mean[1])
        travel = self._direction * self._travel(middle)
        number, began = self._step_at(sample)
        in_step_s = (middle - began) / self.sample_rate_hz if number else math.nan
        return Conditions(phase, time_s, normal, shear, travel, number, in_step_s)

    def drive_forces(self, end: int) -> DriveForces:
        """The forces of the samples of the drive before that one, as far as they are kept."""
        with self._changed:
            blocks, start = [np.empty((0, 2)), *self._driven], self.phase_start(Phase.DRIVE)
        known = min(max(end - (start or 0), 0), MOST_DRIVEN)
        normal, shear = np.concatenate(blocks)[:known].T
        time_s = np.arange(len(shear)) / self.sample_rate_hz
        return DriveForces(time_s, self._direction * shear, normal)

    def _step_at(self, sample: int) -> tuple[int, float]:
        """The step that `sample` belongs to, and the sample on which it began; 0 and NaN where that
        is not known.
        """
        with self._changed:
            last = bisect_right(self._step_samples, sample) - 1
            return (self._steps[last], self._step_samples[last]) if last >= 0 else (0, math.nan)

    def _travel(self, sample: float) -> float:
        """Stage displacement since the first reading, linear between the readings; NaN without."""
        with self._changed:
            if not self._positions:
                return math.nan
            after = min(bisect_left(self._position_samples, sample), len(self._positions) - 1)
            before = max(0, after - 1)
            s0, s1 = self._position_samples[before], self._position_samples[after]
            x0, x1 = self._positions[before], self._positions[after]
        share = (sample - s0) / (s1 - s0) if s1 > s0 else 0.0
        return x0 + (x1 - x0) * min(1.0, max(0.0, share)) - self._start_m

    def block_means(self, n: int) -> Forces:
        """About `n` points of the whole run for a plot: samples, P, Q (means over a block, every
        k-th block).
        """
        with self._changed:
            kept = self._means[:: max(1, len(self._means) // max(1, n))]
        table = np.array(kept, dtype=np.float64).reshape(-1, 3)
        return table[:, 0].astype(np.int64), table[:, 1], table[:, 2]
