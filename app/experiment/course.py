"""A motion of the stage as decisions on what was just measured: whether it goes as it should,
whether a condition ends it, where it turns.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from analysis.arrays import F64
from analysis.options import quantity
from app.experiment.live_findings import Seen
from app.settings.protocol_steps import Motion, Step, Velocity
from app.settings.sections import Config

STALL_PATIENCE_S = 5.0
# without progress while it says that it moves, or the time for STANDSTILL_M if that is longer
STANDSTILL_S = 2.0
STANDSTILL_M = 2e-6  # well above what an encoder jitters
BEYOND_M = 5e-6  # the other way, or further than asked
ENCODER_M = 0.1e-6  # a stage that has arrived may read off by so much
ARRIVED = 0.98  # share of its travel from which a stage that stands has arrived


class ExperimentFailed(Exception):
    """The experiment cannot go on; the message is the reason the run ends with."""


@dataclass(frozen=True, slots=True)
class MeasuredBlock:
    """What is known at the end of a block: its forces (n, 2) in newtons, the stage, and whether the
    reference image was taken.

    `travel_m` is that of the stage along +x. `range_used` is the largest reading of the normal and
    the shear sensor, as a share of the range of its input. `age_s` is how old the newest force was
    at most that was known before them. `seen` is what the analysis has told so far, which is some
    frames behind; `volts` (n, 2) is what was read. `asked_sample` is when the stage was asked where
    it is: later than the end of a block that had to wait for this program.
    """

    end_sample: int
    forces: F64
    travel_m: float
    is_moving: bool
    has_reference: bool
    range_used: tuple[float, float] = (0.0, 0.0)
    age_s: float = 0.0
    seen: Callable[[], Seen] = Seen
    volts: F64 | None = None
    asked_sample: int = 0

    @property
    def placed_sample(self) -> int:
        """When the stage was at `travel_m`."""
        return max(self.end_sample, self.asked_sample)

    @property
    def mean(self) -> tuple[float, float]:
        """P and Q on average."""
        normal, shear = self.forces.mean(axis=0).tolist()
        return normal, shear

    @property
    def largest(self) -> tuple[float, float]:
        """P and Q where each is furthest from zero; not a number if one reading is none."""
        normal, shear = self.forces[np.abs(self.forces).argmax(axis=0), (0, 1)]
        return float(normal), float(shear)


@dataclass(frozen=True, slots=True)
class Go:
    """The stage is to go to `target_m` (along +x, from where its first motion began), and no
    further; with `is_turn`, back; with `is_jump`, at another velocity and without a stop.
    """

    target_m: float
    velocity_m_s: float
    is_turn: bool = False
    is_jump: bool = False


@dataclass(frozen=True, slots=True)
class Halt:
    """The stage is to stop where it is."""


class Course:
    """One step that moves the stage, leg by leg.

    Parameters
    ----------
    number : int
        Of the step.
    ends : list of float
        Where its legs end, metres.
    start_m : float
        Where the stage stands, or goes on from.
    further_m : float
        Signed travel of the steps that go on after it without a stop: it is sent to the end of
        these.
    began : int
        Sample.

    Attributes
    ----------
    order : Go or Halt or None
        What `advance` asks for.
    start_m, end_m, goal_m : float
        Of the leg: where it began and ends, and where the stage was sent.
    """

    def __init__(
        self,
        config: Config,
        number: int,
        step: Motion,
        ends: list[float],
        start_m: float,
        further_m: float,
        began: int,
    ) -> None:
        self.step, self.began = step, began
        self.start_m, self.end_m, self._ends = start_m, ends[0], ends[1:]
        self.order: Go | Halt | None = None
        self._config, self._number = config, number
        self._rate = config.forces.sample_rate
        self._further_m = further_m
        self._leg_began = began
        # sample and travel at which the stage was last seen to have moved on
        self._advanced = (0, -math.inf)
        self._greatest = -math.inf  # Q along the motion
        self._path: list[tuple[int, float]] = []  # sample and travel
        self._halted: int | None = None

    @property
    def goal_m(self) -> float:
        """Where the stage was sent."""
        return self.end_m + self._further_m

    @property
    def way(self) -> float:
        """Direction of the leg, 1.0 or -1.0."""
        return math.copysign(1.0, self.goal_m - self.start_m)

    def gone(self, now: MeasuredBlock) -> float:
        """How far the stage has gone on this leg, metres."""
        return self.way * (now.travel_m - self.start_m)

    def left_m(self, now: MeasuredBlock) -> float:
        """How far it has still to go in this step, metres."""
        places = [now.travel_m, self.end_m, *self._ends]
        return sum(abs(b - a) for a, b in pairwise(places))

    def check(self, now: MeasuredBlock) -> None:
        """Refuse a stage that is not on its way."""
        low, high = sorted((self.start_m, self.goal_m))
        if not low - BEYOND_M <= now.travel_m <= high + BEYOND_M:
            raise ExperimentFailed(
                f"actuator: the stage went {now.travel_m * 1e6:.1f} um, {self._asked()}; let"
                " nothing else move it, and check it and its line"
            )

    def _asked(self) -> str:
        run = self._config.run
        if not run.steps:
            return f"run.travel is {quantity(run, 'travel')}"
        return (
            f"step {self._number} goes from {self.start_m * 1e6:.1f} to {self.goal_m * 1e6:.1f} um"
        )

    def advance(self, now: MeasuredBlock) -> float | None:
        """Where the stage is or passes at the end of the step; None while that goes on.

        Raises
        ------
        ExperimentFailed
            The stage has stalled, or no condition was met and one must be.
        """
        self.order = None
        if self._halted is not None:
            return self._halting(now)
        if self._is_met(now):
            if self._further_m:  # it goes on from here
                return now.travel_m
            self._halted, self.order = now.placed_sample, Halt()
            return None
        gone, asked = self.gone(now), abs(self.end_m - self.start_m)
        if not now.is_moving:
            if gone < ARRIVED * asked - ENCODER_M:
                raise ExperimentFailed(
                    f"actuator: it stopped after {gone * 1e6:.1f} of {asked * 1e6:g} um;"
                    " check it for a stall or an end of run"
                )
            return self._arrived(now)
        if self._further_m and gone >= asked:
            return self._unmet_or(self.end_m)
        self._check_progress(now, gone)
        return None

    def _halting(self, now: MeasuredBlock) -> float | None:
        assert self._halted is not None
        if not now.is_moving:
            return now.travel_m
        if now.placed_sample - self._halted > STANDSTILL_S * self._rate:
            raise ExperimentFailed(
                f"actuator: it was commanded to stop {STANDSTILL_S:g} s ago and still moves, at"
                f" {now.travel_m * 1e6:.1f} um; check it and its line"
            )
        return None

    def _arrived(self, now: MeasuredBlock) -> float | None:
        if not self._ends:
            return self._unmet_or(self.end_m)
        self.start_m, self.end_m, self._ends = self.end_m, self._ends[0], self._ends[1:]
        self._leg_began, self._advanced = now.end_sample, (now.end_sample, -math.inf)
        self._greatest = -math.inf
        self.order = Go(self.goal_m, self.step.velocity, is_turn=True)
        return None

    def _unmet_or(self, place: float) -> float:
        if self.step.conditions and self.step.unmet == "fail":
            raise ExperimentFailed(
                f"step {self._number} ({self.step.kind}): its travel has ended and no condition of"
                f" it was met ({', '.join(self.step.conditions)}); let it go further, or on"
                " without it (unmet)"
            )
        return place

    def _is_met(self, now: MeasuredBlock) -> bool:
        """Whether a condition ends the step."""
        step = self.step
        if not step.conditions:
            return False
        normal, shear = now.mean
        along = self.way * shear
        self._greatest = max(self._greatest, along)
        drop = step.until_drop * self._greatest
        least = self._config.run.shear_tolerance * abs(normal)  # about 0, noise is a larger share
        met = (
            0 < step.until_time <= (now.end_sample - self.began) / self._rate,
            0 < step.until_force <= along,
            0 < step.until_ratio * normal <= along,
            drop > 0 and max(drop, least) <= self._greatest - along,
        )
        if any(met):
            return True
        if not step.looks:
            return False
        self._path.append((now.end_sample, now.travel_m))
        seen = now.seen()
        if seen.sample < self.began:  # of the time before this step
            return False
        if seen.stick_share < step.until_stick:  # False where it is NaN, as the next one
            return True
        at = bisect.bisect(self._path, (seen.onset_sample,))  # a drive may take days
        samples, travels = zip(*self._path[max(0, at - 1) : at + 1], strict=True)
        past = self.way * (now.travel_m - float(np.interp(seen.onset_sample, samples, travels)))
        return 0 <= step.until_slid <= past

    def _check_progress(self, now: MeasuredBlock, gone: float) -> None:
        velocity, seconds = self.step.velocity, (now.end_sample - self._leg_began) / self._rate
        if gone > self._advanced[1] + STANDSTILL_M / 4:
            self._advanced = (now.placed_sample, gone)
        patience = max(STANDSTILL_S, STANDSTILL_M / velocity)
        if now.placed_sample - self._advanced[0] > patience * self._rate:
            raise ExperimentFailed(
                f"actuator: it stands at {now.travel_m * 1e6:.1f} um of travel while it should move"
                " at"
                f" {quantity(self.step, 'velocity')}; check it for a stall"
            )
        asked = self.end_m - self.start_m
        expected = abs(asked) / velocity
        if seconds > 1.2 * expected + STALL_PATIENCE_S:
            raise ExperimentFailed(
                f"actuator: {gone * 1e6:.1f} of {asked * 1e6:g} um after {seconds:.0f} s,"
                f" {expected:.0f} s were expected; check it for a stall"
            )


def chain(steps: Sequence[Step]) -> float:
    """Travel (m) of the steps at the beginning of `steps` that go on without a stop."""
    travel = 0.0
    for step in steps:
        if not isinstance(step, Velocity):
            break
        travel += step.travel
    return travel
