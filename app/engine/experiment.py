"""The course of a loading experiment as decisions on what was just measured: no threads, no
devices, no clock but samples.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.options import quantity
from app.records import Phase
from app.settings import Config

TOUCH_FRACTION = 0.05  # P above this share of its target means that the contact is made
REFERENCE_PATIENCE_S = 30.0  # nothing moves meanwhile
STALL_PATIENCE_S = 5.0
# without progress while it says that it moves, or the time for STANDSTILL_M if that is longer
STANDSTILL_S = 2.0
STANDSTILL_M = 2e-6  # well above what an encoder jitters
BEYOND_M = 5e-6  # the other way, or further than asked
BEHIND_PATIENCE_S = 5.0  # for forces that are read too late, before the drive
SATURATED = 0.9995  # share of the range above which a reading says nothing


class ExperimentFailed(Exception):
    """The experiment can not go on; the message is the reason the run ends with."""


@dataclass(frozen=True, slots=True)
class Measured:
    """What is known at the end of a block: its forces (n, 2) in newtons, the stage, and whether the
    reference image was taken.

    `travel_m` is that of the stage along +x. `range_used` is the largest reading of the normal and
    the shear sensor, as a share of the range of its input. `age_s` is how old the newest force was
    at most that was known before them.
    """

    end_sample: int
    forces: NDArray[np.float64]
    travel_m: float
    is_moving: bool
    has_reference: bool
    range_used: tuple[float, float] = (0.0, 0.0)
    age_s: float = 0.0


class Experiment:
    """The phases of a loading experiment: free block, contact, reference at rest, drive, end.

    `advance` is called once per block and answers the phase from that block's end on. Entering
    `Phase.DRIVE` is the caller's order to move the actuator by ``run.travel``, and no further; a
    higher `leg` its order to turn back, and `Phase.END` to stop.

    Attributes
    ----------
    leg : int
        Number of reversals of the drive so far: the stage goes to ``run.travel`` on even ones, and
        to where it began on odd ones.
    """

    def __init__(self, config: Config) -> None:
        self.config = config
        self.rate = config.forces.sample_rate
        self.phase = Phase.BACKGROUND if config.run.background_time > 0 else Phase.CONTACT
        self.advice = ""
        self.leg = 0
        self._since = self._behind_since = 0
        self._settled_since: int | None = None
        # sample and travel at which the stage was last seen to have moved on
        self._advanced = (0, -math.inf)

    def advance(self, now: Measured) -> Phase:
        """The phase after a block.

        Raises
        ------
        ExperimentFailed
            A limit was passed, or a phase can not be completed.
        """
        self._check_limits(now)
        before = self.phase
        self.phase = getattr(self, f"_{before}")(now)
        if self.phase is not before:
            self._since = now.end_sample
            self.advice = ""
        return self.phase

    def begin_drive(self, now: Measured) -> None:
        """Go on with the drive, whatever comes before it in an experiment; see `advance`."""
        self.phase, self._since = Phase.DRIVE, now.end_sample
        self._check_limits(now)

    def progress(self, now: Measured) -> float:
        """Share of the experiment that is done, 0 to 1: 10 % up to the drive, then by travel."""
        if self.phase in (Phase.DRIVE, Phase.END):
            run = self.config.run
            legs = self.leg + self._gone(now) / abs(run.travel)
            return min(1.0, 0.1 + 0.9 * max(0.0, legs / (run.reversals + 1)))
        return 0.1 * list(Phase).index(self.phase) / 3

    def _gone(self, now: Measured) -> float:
        """How far the stage has gone since it last turned, metres."""
        run = self.config.run
        way = now.travel_m * run.direction
        return abs(run.travel) - way if self.leg % 2 else way

    def _seconds(self, now: Measured) -> float:
        return (now.end_sample - self._since) / self.rate

    def _check_limits(self, now: Measured) -> None:
        limits = self.config.limits
        normal, shear = float(now.forces[:, 0].max()), float(np.abs(now.forces[:, 1]).max())
        if not np.isfinite(now.forces).all():
            raise ExperimentFailed("forces: a reading is not a number; check the sensors")
        for name, used, volts in zip(
            ("normal", "shear"), now.range_used, self.config.forces.range, strict=True
        ):
            if used >= SATURATED:
                raise ExperimentFailed(
                    f"forces: the {name} sensor is at the end of its range of {volts:g} V, so its"
                    " force is not known;"
                    " check the sensor and its gap, or raise forces.range"
                )
        if normal > limits.normal_force:
            raise ExperimentFailed(
                f"limit: the normal force reached {normal:.3f} N, limits.normal_force is"
                f" {quantity(limits, 'normal_force')}"
            )
        if shear > limits.shear_force:
            raise ExperimentFailed(
                f"limit: the shear force reached {shear:.3f} N, limits.shear_force is"
                f" {quantity(limits, 'shear_force')}"
            )
        if self.phase is Phase.DRIVE:
            self._check_drive(now)

    def _check_drive(self, now: Measured) -> None:
        run, limits = self.config.run, self.config.limits
        went = f"the stage went {now.travel_m * 1e6:.1f} um"
        if abs(now.travel_m) > limits.travel:
            raise ExperimentFailed(f"limit: {went}, limits.travel is {quantity(limits, 'travel')}")
        if not -BEYOND_M <= now.travel_m * run.direction <= abs(run.travel) + BEYOND_M:
            raise ExperimentFailed(
                f"actuator: {went}, run.travel is {quantity(run, 'travel')}; let nothing else move"
                " it, and check it and its line"
            )
        if now.age_s > limits.age:
            raise ExperimentFailed(
                f"limit: {_behind(now)}, limits.age is {quantity(limits, 'age')}"
            )

    def _background(self, now: Measured) -> Phase:
        normal = float(now.forces[:, 0].mean())
        if normal > TOUCH_FRACTION * self.config.run.normal_force:
            raise ExperimentFailed(
                f"background: the normal force reads {normal:.3f} N while the block should hang"
                " free;"
                " lift it, or set run.background_time = 0"
            )
        return (
            Phase.CONTACT
            if self._seconds(now) >= self.config.run.background_time
            else Phase.BACKGROUND
        )

    def _contact(self, now: Measured) -> Phase:
        run = self.config.run
        normal, shear = (float(f) for f in now.forces.mean(axis=0))
        far = abs(normal - run.normal_force) > run.settle_tolerance * run.normal_force
        sheared = not far and abs(shear) > run.shear_tolerance * normal
        if far or sheared:
            self._settled_since = None
            self.advice = (
                f"press the contact to {run.normal_force:g} N (P is {normal:.3f} N)"
                if far
                else (
                    f"renew the contact: Q is {shear * 1e3:.1f} mN, more than"
                    f" {run.shear_tolerance:.0%} of P"
                )
            )
            if self._seconds(now) > run.contact_timeout:
                raise ExperimentFailed(
                    f"contact: not ready after run.contact_timeout = {run.contact_timeout:g} s;"
                    f" {self.advice}"
                )
            return Phase.CONTACT
        self.advice = "the contact settles"
        if self._settled_since is None:
            self._settled_since = now.end_sample - len(now.forces)
        return (
            Phase.REFERENCE
            if now.end_sample - self._settled_since >= run.settle_time * self.rate
            else Phase.CONTACT
        )

    def _reference(self, now: Measured) -> Phase:
        waited = self._seconds(now)
        if waited >= self.config.run.reference_time and now.has_reference:
            if now.age_s <= self.config.limits.age:
                return Phase.DRIVE
            self.advice = f"the drive waits: {_behind(now)}"
            self._behind_since = self._behind_since or now.end_sample
            if now.end_sample - self._behind_since > BEHIND_PATIENCE_S * self.rate:
                raise ExperimentFailed(
                    f"forces: the drive was not begun, {_behind(now)}, limits.age is"
                    f" {quantity(self.config.limits, 'age')}; check the way to the board and what"
                    " else this computer does"
                )
            return Phase.REFERENCE
        self._behind_since = 0
        if waited > self.config.run.reference_time + REFERENCE_PATIENCE_S:
            raise ExperimentFailed(
                f"reference: no image could be taken as reference in {waited:.1f} s; check the"
                " camera and its trigger"
            )
        return Phase.REFERENCE

    def _drive(self, now: Measured) -> Phase:
        run = self.config.run
        way, asked = self._gone(now), abs(run.travel)
        if not now.is_moving:
            if way < 0.98 * asked:
                raise ExperimentFailed(
                    f"actuator: it stopped after {way * 1e6:.1f} of {asked * 1e6:g} um;"
                    " check it for a stall or an end of run"
                )
            if self.leg == run.reversals:
                return Phase.END
            self.leg += 1
            self._since, self._advanced = now.end_sample, (now.end_sample, -math.inf)
            return Phase.DRIVE
        if way > self._advanced[1] + STANDSTILL_M / 4:
            self._advanced = (now.end_sample, way)
        patience = max(STANDSTILL_S, STANDSTILL_M / run.velocity)
        if now.end_sample - self._advanced[0] > patience * self.rate:
            raise ExperimentFailed(
                f"actuator: it stands at {now.travel_m * 1e6:.1f} um of travel while it should move"
                " at"
                f" {quantity(run, 'velocity')}; check it for a stall"
            )
        expected = asked / run.velocity
        if self._seconds(now) > 1.2 * expected + STALL_PATIENCE_S:
            raise ExperimentFailed(
                f"actuator: {way * 1e6:.1f} of {quantity(run, 'travel')} after"
                f" {self._seconds(now):.0f} s,"
                f" {expected:.0f} s were expected; check it for a stall"
            )
        return Phase.DRIVE

    def _end(self, now: Measured) -> Phase:
        del now
        return Phase.END


def _behind(now: Measured) -> str:
    return f"the newest force that was read was {now.age_s:.2g} s old"
