"""The steps of a protocol: what a run does, one after the other.

Each kind of step is a section of settings. What a step leaves out (0) is that of the table [run].
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, NamedTuple

from analysis.options import Section, option, quantity
from app.settings.toml_text import MOST_DOTS

if TYPE_CHECKING:
    from app.settings.sections import Limits, RunSettings

MOST_STEPS = 200
LONGEST_QUESTION = 200  # characters
APPROACH_S = 2.0  # time that an operator takes for an approach, about
ROUNDING_M = 1e-12
SLACK = 1.06  # a stage takes up to so many times the time of a move


@dataclass(frozen=True, kw_only=True)
class Step(Section):
    """One step of a protocol.

    Attributes
    ----------
    kind : str
        Its name in the settings: `do`.
    needs : tuple of str
        Keys that have no default.
    like_run : dict
        Key -> the key of [run] that holds where it is 0.
    words : str
        What it does, for people; ``{key}`` stands for the value of a key with its unit.
    """

    kind: ClassVar[str] = ""
    needs: ClassVar[tuple[str, ...]] = ()
    like_run: ClassVar[dict[str, str]] = {}
    words: ClassVar[str] = ""

    def __str__(self) -> str:
        return re.sub(r"{(\w+)}", lambda key: quantity(self, key[1]), self.words)

    def given(self, run: RunSettings) -> Step:
        """The step with what it leaves out taken from [run]."""
        left = {k: getattr(run, of) for k, of in self.like_run.items() if not getattr(self, k)}
        return replace(self, **left)


@dataclass(frozen=True, kw_only=True)
class Zero(Step):
    """Zero the sensors: their mean readings during this time become the readings without force. The
    block must hang free.
    """

    kind = "zero"
    words = "zero the sensors, {time}"
    time: float = option(1.0, "Averaging time", "s", gt=0, le=60)


@dataclass(frozen=True, kw_only=True)
class Background(Step):
    """Take images of the free block."""

    kind = "background"
    words = "background, {time}"
    like_run: ClassVar[dict[str, str]] = {"time": "background_time"}
    time: float = option(0.0, "Duration; 0: run.background_time", "s", ge=0, le=60)


@dataclass(frozen=True, kw_only=True)
class Approach(Step):
    """Press the contact to a load by hand; the step ends when P has settled (run.settle_time,
    run.settle_tolerance, run.shear_tolerance).
    """

    kind = "approach"
    words = "approach to {normal_force}"
    like_run: ClassVar[dict[str, str]] = {
        "normal_force": "normal_force",
        "timeout": "contact_timeout",
    }
    normal_force: float = option(0.0, "Load P; 0: run.normal_force", "N", ge=0, le=10)
    timeout: float = option(0.0, "Time allowed for it; 0: run.contact_timeout", "s", ge=0, le=3600)


@dataclass(frozen=True, kw_only=True)
class Reference(Step):
    """Take the reference image at rest under load; displacements count from it."""

    kind = "reference"
    words = "reference, {time}"
    like_run: ClassVar[dict[str, str]] = {"time": "reference_time"}
    time: float = option(0.0, "Rest under load; 0: run.reference_time", "s", ge=0, le=60)


@dataclass(frozen=True, kw_only=True)
class Hold(Step):
    """Hold the stage at rest."""

    kind = "hold"
    words = "hold for {time}"
    needs = ("time",)
    time: float = option(1.0, "Duration", "s", gt=0, le=1e5)


@dataclass(frozen=True, kw_only=True)
class Ask(Step):
    """Ask the operator a question and wait for the answer."""

    kind = "ask"
    needs = ("question",)
    question: str = option("", f"The question, at most {LONGEST_QUESTION} characters")
    timeout: float = option(300.0, "Time allowed for the answer", "s", gt=0, le=1e5)
    unanswered: str = option(
        "fail", "Without an answer the run fails or continues", choices=("fail", "go on")
    )
    weight: float = option(
        -1.0, "Weight requested in a calibration of the forces; below 0: none", "N", ge=-1
    )
    axis: str = option(
        "normal", "Force sensor to load with the weight", choices=("normal", "shear")
    )

    def __str__(self) -> str:
        return f"ask: {self.question}"


UNTIL = {  # conditions that end a motion, in words before their value
    "until_time": "",
    "until_force": "Q = ",
    "until_ratio": "Q/P = ",
    "until_slid": "t_s + ",
    "until_stick": "c/a = ",
    "until_drop": "a drop of Q by ",
}


@dataclass(frozen=True, kw_only=True)
class Motion(Step):
    """A step in which the stage moves, until one of its conditions is met or its travel ends."""

    like_run: ClassVar[dict[str, str]] = {"velocity": "velocity"}
    velocity: float = option(0.0, "Velocity; 0: run.velocity", "um/s", ge=0, le=1000)
    until_time: float = option(0.0, "Ends after this time; 0: no such condition", "s", ge=0, le=1e5)
    until_force: float = option(
        0.0, "Ends when Q along the motion reaches this; 0: no such condition", "N", ge=0
    )
    until_ratio: float = option(
        0.0, "Ends when Q/P along the motion reaches this; 0: no such condition", ge=0, le=10
    )
    until_slid: float = option(
        -1.0,
        "Ends at this distance after t_s, if the analysis has found t_s; below 0: no such"
        " condition",
        "um",
        ge=-1,
        le=20000,
    )
    until_stick: float = option(
        0.0,
        "Ends when c falls below this share of Hertz's contact radius; 0: no such condition",
        ge=0,
        lt=1,
    )
    until_drop: float = option(
        0.0,
        "Ends when Q along the motion has fallen by this share of its largest value, and by"
        " run.shear_tolerance of P; 0: no such condition",
        ge=0,
        lt=1,
    )
    unmet: str = option(
        "go on",
        "If the travel ends before a condition is met, the run continues or fails",
        choices=("go on", "fail"),
    )

    @property
    def conditions(self) -> tuple[str, ...]:
        """The keys of its conditions."""
        return tuple(
            key
            for key in UNTIL
            if getattr(self, key) > 0 or (key == "until_slid" and self.until_slid == 0)
        )

    @property
    def looks(self) -> bool:
        """Whether a condition is one of what the analysis sees."""
        return self.until_stick > 0 or self.until_slid >= 0

    def __str__(self) -> str:
        ends = " or ".join(UNTIL[key] + quantity(self, key) for key in self.conditions)
        return super().__str__() + (ends and f" until {ends}")

    def ends(self, here: float, origin: float, way: float) -> list[float]:
        """Where its legs end (m), given where it stands, where it last set out one way, and that
        way, 1.0 or -1.0.
        """
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True)
class Drive(Motion):
    """Move the stage by a travel."""

    kind = "drive"
    words = "drive {travel} at {velocity}"
    like_run: ClassVar[dict[str, str]] = {"velocity": "velocity", "travel": "travel"}
    travel: float = option(
        0.0, "Travel, negative in the opposite direction; 0: run.travel", "um", ge=-20000, le=20000
    )

    def ends(self, here: float, origin: float, way: float) -> list[float]:
        """See `Motion`."""
        return [here + self.travel]


@dataclass(frozen=True, kw_only=True)
class Velocity(Motion):
    """Continue at another velocity without a stop, right after a drive or a velocity step."""

    kind = "velocity"
    words = "go on at {velocity} for {travel}"
    needs = ("velocity", "travel")
    velocity: float = option(5.0, "Velocity", "um/s", gt=0, le=1000)
    travel: float = option(10.0, "Further travel in the same direction", "um", gt=0, le=20000)

    def ends(self, here: float, origin: float, way: float) -> list[float]:
        """See `Motion`."""
        return [here + math.copysign(self.travel, way)]


@dataclass(frozen=True, kw_only=True)
class Reverse(Motion):
    """Return to the start of the last motion; with more than one turn, go forth and back again."""

    kind = "reverse"
    words = "reverse at {velocity}"
    times: int = option(1, "Number of turns", ge=1, le=2000)

    def __str__(self) -> str:
        often = f"reverse {self.times} times" if self.times > 1 else "reverse"
        return super().__str__().replace("reverse", often, 1)

    def ends(self, here: float, origin: float, way: float) -> list[float]:
        """See `Motion`."""
        return [here if leg % 2 else origin for leg in range(self.times)]


@dataclass(frozen=True, kw_only=True)
class Cycle(Motion):
    """Move the stage forth and back; a condition ends the whole step."""

    kind = "cycle"
    words = "cycle {times} times by {travel} at {velocity}"
    needs = ("times",)
    like_run: ClassVar[dict[str, str]] = {"velocity": "velocity", "travel": "travel"}
    times: int = option(1, "Number of cycles", ge=1, le=1000)
    travel: float = option(
        0.0,
        "Travel forth, negative in the opposite direction; 0: run.travel",
        "um",
        ge=-20000,
        le=20000,
    )

    def ends(self, here: float, origin: float, way: float) -> list[float]:
        """See `Motion`."""
        return [here + self.travel, here] * self.times


KINDS: dict[str, type[Step]] = {
    step.kind: step
    for step in (
        Zero, Background, Approach, Reference, Drive, Hold, Velocity, Reverse, Cycle, Ask,
    )
}  # fmt: skip
DO = "do"  # the key that names the kind

EXAMPLE = """\
[[run.steps]]
do = "background"

[[run.steps]]
do = "approach"

[[run.steps]]
do = "reference"

[[run.steps]]
do = "drive"
travel = 100

[[run.steps]]
do = "hold"
time = 10

[[run.steps]]
do = "drive"
travel = 50
until_ratio = 0.8
"""


def protocol_of(run: RunSettings) -> tuple[Step, ...]:
    """The steps of a run; where none are given, those that the other settings of [run] stand for:
    background, approach, reference, drive, reverse.
    """
    steps: list[Step] = list(run.steps)
    if not steps:
        steps = [Background()] if run.background_time > 0 else []
        steps += [Approach(), Reference(), Drive()]
        steps += [Reverse(times=run.reversals)] if run.reversals else []
    return tuple(step.given(run) for step in steps)


class Leg(NamedTuple):
    """A motion one way: the number of its step, and between which places (m) it begins and ends,
    from where the first one begins.
    """

    number: int
    start: tuple[float, float]
    end: tuple[float, float]


def legs(steps: Sequence[Step], *, as_planned: bool = False) -> Iterator[Leg]:
    """All motions of a protocol; what a condition may end can end anywhere on its way, unless it is
    to be `as_planned`.
    """
    low = high = origin_low = origin_high = 0.0
    way = 1.0
    for number, step in enumerate(steps, 1):
        if not isinstance(step, Motion):
            continue
        both = step.ends(low, origin_low, way), step.ends(high, origin_high, way)
        starts = []
        for end_low, end_high in zip(*both, strict=True):
            start = low, high
            starts.append(start)
            way = math.copysign(1.0, end_low - low) if end_low != low else way
            low, high = min(end_low, end_high), max(end_low, end_high)
            if step.conditions and not as_planned:
                low, high = min(low, start[0]), max(high, start[1])
            yield Leg(number, start, (low, high))
        if not isinstance(step, Velocity):
            last = starts if step.conditions and not as_planned else starts[-1:]
            origin_low, origin_high = min(s[0] for s in last), max(s[1] for s in last)


def reach(steps: Sequence[Step]) -> tuple[float, float]:
    """Least and greatest place of the stage (m), at the worst, from where its first motion
    begins.
    """
    places = [place for leg in legs(steps) for place in (*leg.start, *leg.end)]
    return min(places, default=0.0), max(places, default=0.0)


def durations(steps: Sequence[Step]) -> list[float]:
    """Seconds that each step takes as planned; NaN where the operator decides."""
    seconds = [float(getattr(step, "time", math.nan)) for step in steps]
    for leg in legs(steps, as_planned=True):
        at, step = leg.number - 1, steps[leg.number - 1]
        assert isinstance(step, Motion)
        before = 0.0 if math.isnan(seconds[at]) else seconds[at]
        seconds[at] = before + abs(leg.end[0] - leg.start[0]) / step.velocity
    return seconds


# ---------------------------------------------------------------- checks


def check(
    steps: Sequence[Step], limits: Limits, max_velocity: float, *, is_experiment: bool = True
) -> None:
    """Refuse steps that cannot be done one after the other, or not within the limits; ValueError
    names the step by its number. What is no experiment needs neither a contact nor a drive.
    """
    if len(steps) > MOST_STEPS:
        raise ValueError(
            f"run.steps: {len(steps)} steps found, {MOST_STEPS} is the most; cycle and reverse"
            " repeat themselves"
        )
    seen = set() if any(isinstance(step, Approach) for step in steps) else {"free"}
    if is_experiment:
        seen.discard("free")
    for number, step in enumerate(steps, 1):
        before = steps[number - 2] if number > 1 else None
        why = _misplaced(step, before, seen) or _impossible(step, limits, max_velocity)
        if why:
            raise ValueError(f"run.steps: step {number} ({step.kind}) {why}")
        seen.add("drive" if isinstance(step, Motion) else step.kind)
    if "drive" not in seen and is_experiment:
        raise ValueError("run.steps: no step moves the stage; add a drive")
    for leg in legs(steps):
        furthest = max(leg.end, key=abs)
        if abs(furthest) > limits.travel + ROUNDING_M:
            step = steps[leg.number - 1]
            raise ValueError(
                f"run.steps: step {leg.number} ({step.kind}) can end {furthest * 1e6:g} um from"
                " where the first motion begins, which is beyond limits.travel ="
                f" {quantity(limits, 'travel')}; go less far, or back before it"
            )


def _misplaced(step: Step, before: Step | None, seen: set[str]) -> str:
    """Why a step cannot come where it is; empty if it can."""
    is_early = isinstance(step, Zero | Background)
    if is_early and "approach" in seen:
        return "needs the free block, but the contact is pressed by then; put it before it"
    if isinstance(step, Background | Reference) and step.kind in seen:
        return "is there a second time; take it once"
    if isinstance(step, Approach) and "reference" in seen:
        return "would move the contact after its reference image; put it before the reference"
    if isinstance(step, Reference) and not {"approach", "free"} & seen:
        return "comes before the contact is made; put an approach before it"
    if isinstance(step, Motion) and "reference" not in seen:
        return "moves the stage before the reference image is taken; put a reference before it"
    if isinstance(step, Velocity) and not isinstance(before, Drive | Velocity):
        return "goes on with a motion, but none is under way; put it right after a drive"
    if isinstance(step, Reverse | Velocity) and "drive" not in seen:
        return "comes before any drive; put a drive before it"
    return ""


def _impossible(step: Step, limits: Limits, max_velocity: float) -> str:
    """Why a step cannot be done, or not within the limits; empty if it can."""
    if isinstance(step, Approach) and step.normal_force >= limits.normal_force:
        given, most = quantity(step, "normal_force"), quantity(limits, "normal_force")
        return f"presses to {given}, which is not below limits.normal_force = {most}"
    if isinstance(step, Background) and not step.time:
        return "lasts 0 s, as run.background_time; give its time"
    if isinstance(step, Ask) and not step.question.isprintable():
        return "asks a question with a character that cannot be printed; write it in one line"
    if isinstance(step, Ask) and not 0 < len(step.question.strip()) <= LONGEST_QUESTION:
        return (
            f"asks a question of {len(step.question.strip())} characters; write 1 to"
            f" {LONGEST_QUESTION}"
        )
    if isinstance(step, Ask) and step.question.count(".") > MOST_DOTS:
        return f"asks a question with more than {MOST_DOTS} full stops; leave some out"
    if not isinstance(step, Motion):
        return ""
    if step.velocity > max_velocity:
        most = f"{max_velocity * 1e6:g} um/s"
        return (
            f"goes at {quantity(step, 'velocity')}, which is beyond actuator.max_velocity = {most}"
        )
    if getattr(step, "travel", 1.0) == 0:
        return "has a travel of 0 um, as run.travel; give the way of the stage"
    if step.until_force >= limits.shear_force:
        given, most = quantity(step, "until_force"), quantity(limits, "shear_force")
        return f"goes on until Q = {given}, which is not below limits.shear_force = {most}"
    if step.unmet == "fail" and not step.conditions:
        return "fails where no condition is met, and has none; give one, or leave unmet out"
    return ""
