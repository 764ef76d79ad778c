"""The course of an experiment, step by step, as decisions on what was just measured: no threads, no
devices, no clock but samples.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from analysis.options import quantity
from app.experiment.course import BEYOND_M, Course, ExperimentFailed, Go, Halt, MeasuredBlock, chain
from app.records.bench_view import END_OF_RANGE
from app.records.record_types import Phase
from app.settings.protocol_steps import (
    Approach,
    Ask,
    Background,
    Hold,
    Motion,
    Reference,
    Step,
    Velocity,
    Zero,
    durations,
)
from app.settings.sections import Config

__all__ = ["Begin", "Experiment", "ExperimentFailed", "MeasuredBlock", "Zeroed"]

TOUCH_FRACTION = 0.05  # P above this share of its target means that the contact is made
REFERENCE_PATIENCE_S, REFERENCE_PERIODS = 30.0, 3  # nothing moves meanwhile
LONGEST_NOTE = 500  # characters
BEHIND_PATIENCE_S = 5.0  # forces may be read late for so long before the drive


@dataclass(frozen=True, slots=True)
class Begin:
    """A step begins: its number, what it is, and the phase that begins with it, if one does."""

    number: int
    text: str
    phase: Phase | None


@dataclass(frozen=True, slots=True)
class Zeroed:
    """What the sensors read without a force, volts."""

    volts: tuple[float, float]


@dataclass(frozen=True, slots=True)
class Answered:
    """What the operator has answered; empty where the time was over."""

    text: str


@dataclass(frozen=True, slots=True)
class Noted:
    """What the operator has noted while the run goes on."""

    text: str


Order = Begin | Zeroed | Answered | Noted | Go | Halt


def phase_of(steps: Sequence[Step], number: int) -> Phase:
    """The phase of a step: its own, or else that of what was done before it."""
    own = {
        Background: Phase.BACKGROUND,
        Approach: Phase.CONTACT,
        Reference: Phase.REFERENCE,
        Motion: Phase.DRIVE,
    }
    for step in reversed(steps[:number]):
        for kind, phase in own.items():
            if isinstance(step, kind):
                is_past = phase is Phase.BACKGROUND and step is not steps[number - 1]
                return Phase.CONTACT if is_past else phase
    comes = any(isinstance(step, Background) for step in steps[number:])
    return Phase.BACKGROUND if comes else Phase.CONTACT


def broken_limit(config: Config, now: MeasuredBlock, most_shear_n: float) -> str:
    """Why a stage may not move, or move on, under these forces; empty if it may."""
    (normal, shear), limits = now.largest, config.limits
    if not math.isfinite(normal + shear):
        return "forces: a reading is not a number; check the sensors"
    ranges = zip(("normal", "shear"), now.range_used, config.forces.range, strict=True)
    for name, used, volts in ranges:
        if used >= END_OF_RANGE:
            return (
                f"forces: the {name} sensor is at the end of its range of {volts:g} V, so that"
                " the force is not known; check the sensor and its gap, or raise forces.range"
            )
    if abs(normal) > limits.normal_force:
        wrong = "; if the block is pressed, forces.sign is wrong" * (normal < 0)
        return (
            f"limit: the normal force reached {normal:.3f} N, limits.normal_force is"
            f" {quantity(limits, 'normal_force')}{wrong}"
        )
    if abs(shear) > most_shear_n:
        return (
            f"limit: the shear force reached {abs(shear):.3f} N, limits.shear_force is"
            f" {quantity(limits, 'shear_force')}"
        )
    return ""


class Experiment:
    """The steps of an experiment; its phases (free block, contact, reference at rest, drive, end)
    follow from them.

    `advance` is called once per block and answers the phase from that block's end on; what is to be
    done then is in `orders`.

    Attributes
    ----------
    number : int
        Of the step under way, from 1.
    leg : int
        Number of reversals of the stage so far.
    question : str
        That an operator is to answer; empty if there is none.
    """

    def __init__(self, config: Config) -> None:
        self.config, self.steps = config, config.run.protocol
        self.rate = config.forces.sample_rate
        self._is_free = not any(isinstance(step, Approach) for step in self.steps)
        self.number, self.leg = 1, 0
        self.phase = phase_of(self.steps, 1)
        self.advice = self.question = ""
        self._orders: list[Order] = []
        self._notes: deque[str] = deque()  # from other threads
        self.is_pause_asked = self.is_paused = False
        self._planned = durations(self.steps)
        self._since = self._behind_since = 0
        self._settled_since: int | None = None
        self._answer: str | None = None
        self._zeros: list[tuple[int, float, float]] = []
        self._course: Course | None = None
        # where the stage was at the end of the last motion, where that began, and its direction
        self._place = self._origin = self._began_m = self._stands_m = 0.0
        self._way = 0.0
        self._announce(self.phase)

    @property
    def step(self) -> Step | None:
        """The step under way; None once all are done."""
        return self.steps[self.number - 1] if self.number <= len(self.steps) else None

    @property
    def looks(self) -> bool:
        """Whether the step under way may end by what the analysis sees."""
        step = self.step
        return isinstance(step, Motion) and step.looks

    @property
    def is_moving(self) -> bool:
        """Whether the step under way moves the stage."""
        return self._course is not None

    @property
    def text(self) -> str:
        """The step under way for people, ``3 of 6: drive 190 um at 5 um/s``."""
        step = self.step
        return f"{self.number} of {len(self.steps)}: {step}" if step else ""

    @property
    def completed(self) -> str:
        """The reason of a run that has done all of it."""
        run = self.config.run
        if run.steps:
            steps = len(self.steps)
            return f"all {steps} steps are complete" if steps > 1 else "the only step is complete"
        return f"the drive of {quantity(run, 'travel')} is complete"

    def advance(self, now: MeasuredBlock) -> Phase:
        """The phase after a block.

        Raises
        ------
        ExperimentFailed
            A limit was passed, or a step cannot be completed.
        """
        self._check_limits(now)
        step = self.step
        if step is None:
            return self.phase
        if self.is_paused:
            is_over = self._answer is not None
        else:
            is_over = self._move(now) if isinstance(step, Motion) else self._stand(step, now)
        if is_over and not self._pauses():
            self._begin(self.number + 1, now)
        return self.phase

    def _pauses(self) -> bool:
        """Whether the run waits at the end of a step for the operator, who has asked for it: where
        a step follows, and the stage stands.
        """
        following = self.steps[self.number : self.number + 1]
        if self.is_paused:
            self.is_paused = False
            self.note(f"the run goes on with step {self.number + 1}")
        elif self.is_pause_asked and following and not isinstance(following[0], Velocity):
            self.is_pause_asked, self.is_paused, self._answer = False, True, None
            self._leave_course()
            self.question = self.advice = (
                f"the run is paused before step {self.number + 1}: {following[0]}; answer to go on"
            )
            self.note(f"the run is paused before step {self.number + 1}")
        return self.is_paused

    def _stand(self, step: Step, now: MeasuredBlock) -> bool:
        over: bool = getattr(self, f"_{step.kind}")(step, now)
        return over

    def orders(self) -> list[Order]:
        """What is to be done since this was last called, in order."""
        orders, self._orders = self._orders, []
        while self._notes:
            orders.append(Noted(self._notes.popleft()))
        return orders

    def answer(self, text: str, question: str = "") -> None:
        """Answer a question, if it is that of the step under way, or whatever that asks; may be
        called from any thread.
        """
        if self.question and question in ("", self.question):
            self._answer = text

    def pause(self) -> None:
        """Wait for the operator's answer before the next step; may be called from any thread."""
        self.is_pause_asked = True

    def cancel_pause(self) -> None:
        """Do not wait before the next step; a pause that has begun goes on until it is answered."""
        self.is_pause_asked = False

    def note(self, text: str) -> None:
        """Record a note with the next block; may be called from any thread."""
        if text := " ".join(text.split())[:LONGEST_NOTE]:
            self._notes.append(text)

    def begin_drive(self, now: MeasuredBlock) -> None:
        """Go on with the first motion, whatever comes before it; see `advance`."""
        is_motion = [isinstance(step, Motion) for step in self.steps]
        self._begin(is_motion.index(True) + 1, now)
        self._check_limits(now)

    def progress(self, now: MeasuredBlock) -> float:
        """Share of the experiment that is done, 0 to 1: 10 % up to the drive, then by time as
        planned.
        """
        if self.phase in (Phase.DRIVE, Phase.END):
            motions = (i for i, step in enumerate(self.steps) if isinstance(step, Motion))
            first = next(motions, 0)
            whole = float(np.nansum(self._planned[first:]))
            return min(1.0, 0.1 + 0.9 * max(0.0, 1 - self.left_s(now)[1] / whole)) if whole else 1.0
        return 0.1 * list(Phase).index(self.phase) / 3

    def left_s(self, now: MeasuredBlock) -> tuple[float, float]:
        """Seconds left of this step, NaN where the operator decides, and of all, without the time
        that an operator takes.
        """
        step = self.step
        if step is None:
            return 0.0, 0.0
        if self._course is not None:
            here = self._course.left_m(now) / self._course.step.velocity
        else:
            planned = self._planned[self.number - 1]  # NaN where the operator decides
            here = float(np.maximum(0.0, planned - self._seconds(now)))
        return here, float(np.nansum([here, *self._planned[self.number :]]))

    # ------------------------------------------------------------------ from step to step

    def _announce(self, phase: Phase | None) -> None:
        self._orders.append(Begin(self.number, self.text, phase))

    def _begin(self, number: int, now: MeasuredBlock) -> None:
        """Begin a step, or end where there is none left."""
        self.number, self._since = number, now.end_sample
        self.advice = self.question = ""
        self._answer, self._settled_since, self._behind_since = None, None, 0
        before, step = self.phase, self.step
        self.phase = phase_of(self.steps, number) if step else Phase.END
        self._announce(self.phase if self.phase is not before else None)
        is_jump = isinstance(step, Velocity)
        if not is_jump:
            self._leave_course()
        self._course = None
        if isinstance(step, Motion):
            self._set_out(step, now, is_jump=is_jump)

    def _leave_course(self) -> None:
        """The motion under way, if there is one, is over, and the stage stands."""
        if self._course is not None:
            self._origin, self._course = self._began_m, None

    def _set_out(self, step: Motion, now: MeasuredBlock, *, is_jump: bool) -> None:
        if not is_jump:
            self._began_m = self._place
        ends = step.ends(self._place, self._origin, self._way)
        further = chain(self.steps[self.number :])
        way = math.copysign(1.0, ends[0] - self._place) if ends[0] != self._place else self._way
        course = Course(
            self.config, self.number, step, ends, self._place, way * further, now.end_sample
        )
        is_turn = self._way * way < 0
        self._course, self._way = course, way
        self.leg += is_turn
        self._orders.append(Go(course.goal_m, step.velocity, is_turn, is_jump))

    def _move(self, now: MeasuredBlock) -> bool:
        course = self._course
        assert course is not None
        place = course.advance(now)
        if course.order is not None:
            self._orders.append(course.order)
            if isinstance(course.order, Go):
                self.leg += 1
                self._way = course.way
                self._began_m = course.start_m
        if place is None:
            return False
        self._place, self._stands_m = place, now.travel_m
        return True

    def _seconds(self, now: MeasuredBlock) -> float:
        return (now.end_sample - self._since) / self.rate

    # ------------------------------------------------------------------ limits

    def _check_limits(self, now: MeasuredBlock) -> None:
        if problem := broken_limit(self.config, now, self.config.limits.shear_force):
            raise ExperimentFailed(problem)
        if self.phase is Phase.DRIVE:
            self._check_drive(now)
            if self._is_free:
                self._check_free("drive", now)

    def _check_drive(self, now: MeasuredBlock) -> None:
        limits = self.config.limits
        went = f"the stage went {now.travel_m * 1e6:.1f} um"
        if abs(now.travel_m) > limits.travel:
            raise ExperimentFailed(f"limit: {went}, limits.travel is {quantity(limits, 'travel')}")
        if self._course is not None:
            self._course.check(now)
        elif abs(now.travel_m - self._stands_m) > BEYOND_M:
            raise ExperimentFailed(
                f"actuator: {went}, but it stood at {self._stands_m * 1e6:.1f} um when step"
                f" {self.number} began; let nothing else move it, and check it and its line"
            )
        if now.age_s > limits.age:
            raise ExperimentFailed(
                f"limit: {_behind(now)}, limits.age is {quantity(limits, 'age')}"
            )

    # ------------------------------------------------------------------ steps in which it stands

    def _zero(self, step: Zero, now: MeasuredBlock) -> bool:
        if now.volts is not None:
            normal, shear = (float(v) for v in now.volts.sum(axis=0))
            self._zeros.append((len(now.volts), normal, shear))
        if self._seconds(now) < step.time:
            return False
        samples, normal, shear = map(math.fsum, zip(*self._zeros, strict=True))
        self._zeros.clear()
        self._orders.append(Zeroed((normal / samples, shear / samples)))
        return True

    def _background(self, step: Background, now: MeasuredBlock) -> bool:
        self._check_free("background", now)
        return self._seconds(now) >= step.time

    def _check_free(self, when: str, now: MeasuredBlock) -> None:
        normal = float(now.forces[:, 0].mean())
        if normal > TOUCH_FRACTION * self.config.run.as_planned.normal_force:
            else_ = "" if self._is_free else ", or set run.background_time = 0"
            raise ExperimentFailed(
                f"{when}: the normal force reads {normal:z.3f} N while the block should hang"
                f" free; lift it{else_}"
            )

    def _approach(self, step: Approach, now: MeasuredBlock) -> bool:
        run, load = self.config.run, step.normal_force
        normal, shear = now.mean
        far = abs(normal - load) > run.settle_tolerance * load
        sheared = not far and abs(shear) > run.shear_tolerance * normal
        if far or sheared:
            self._settled_since = None
            self.advice = (
                f"press the contact to {load:g} N (P is {normal:z.3f} N)"
                if far
                else (
                    f"renew the contact: Q is {shear * 1e3:.1f} mN, more than"
                    f" {run.shear_tolerance:.0%} of P"
                )
            )
            if self._seconds(now) > step.timeout:
                is_own = step.timeout != run.contact_timeout
                source = f"timeout (step {self.number})" if is_own else "run.contact_timeout"
                raise ExperimentFailed(
                    f"contact: not ready after {source} = {step.timeout:g} s; {self.advice}"
                )
            return False
        self.advice = "the contact settles"
        if self._settled_since is None:
            self._settled_since = now.end_sample - len(now.forces)
        return now.end_sample - self._settled_since >= run.settle_time * self.rate

    def is_reference_due(self, now: MeasuredBlock) -> bool:
        """Whether the rest before the reference is over with this block."""
        step = self.step
        is_due = isinstance(step, Reference) and self._seconds(now) >= step.time
        return is_due and not self.is_paused

    def _reference(self, step: Reference, now: MeasuredBlock) -> bool:
        waited = self._seconds(now)
        if waited >= step.time and now.has_reference:
            if now.age_s <= self.config.limits.age:
                return True
            self.advice = f"the drive waits: {_behind(now)}"
            self._behind_since = self._behind_since or now.end_sample
            if now.end_sample - self._behind_since > BEHIND_PATIENCE_S * self.rate:
                raise ExperimentFailed(
                    f"forces: the drive was not begun, {_behind(now)}, limits.age is"
                    f" {quantity(self.config.limits, 'age')}; check the way to the board and what"
                    " else this computer does"
                )
            return False
        self._behind_since = 0
        period_s = self.config.camera.divisor / self.rate
        if waited > step.time + max(REFERENCE_PATIENCE_S, REFERENCE_PERIODS * period_s):
            raise ExperimentFailed(
                f"reference: no image could be taken as reference in {waited:.1f} s; check the"
                " camera and its trigger"
            )
        return False

    def _hold(self, step: Hold, now: MeasuredBlock) -> bool:
        return self._seconds(now) >= step.time

    def _ask(self, step: Ask, now: MeasuredBlock) -> bool:
        self.question = step.question
        self.advice = f"{step.question} (answer to go on)"
        if self._answer is not None:
            self._orders.append(Answered(self._answer))
            return True
        if self._seconds(now) < step.timeout:
            return False
        if step.unanswered == "fail":
            raise ExperimentFailed(
                f"step {self.number} (ask): nobody has answered in {step.timeout:g} s:"
                f" {step.question}"
            )
        self._orders.append(Answered(""))
        return True


def _behind(now: MeasuredBlock) -> str:
    return f"the newest force that was read was {now.age_s:.2g} s old"
