"""How far the protocol of a run is, and what it waits for, as plain values."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache

from app.experiment.decisions import TOUCH_FRACTION, phase_of
from app.gui.cells import Tone, typeset
from app.records.bench_view import Health
from app.records.record_types import Conditions, Outcome
from app.settings.protocol_steps import (
    Approach,
    Ask,
    Background,
    Motion,
    Reference,
    Step,
    Velocity,
    Zero,
)
from app.settings.sections import Config
from app.system.durations import duration

STARTING = ("idle", "")  # states of a run that was not begun
PAUSE, ASKED = "Pause after this step", "Pauses after this step: withdraw"


class StepStatus(StrEnum):
    """What has become of a step."""

    TO_COME = "to come"
    UNDER_WAY = "under way"
    DONE = "done"
    STOPPED = "stopped"  # the run was ended in it
    FAILED = "failed"


TONES = {
    StepStatus.TO_COME: Tone.NEUTRAL,
    StepStatus.UNDER_WAY: Tone.BUSY,
    StepStatus.DONE: Tone.GOOD,
    StepStatus.STOPPED: Tone.WARN,
    StepStatus.FAILED: Tone.BAD,
}


@dataclass(frozen=True, slots=True)
class StepLine:
    """A step of the protocol; `note` is why it waits or ended, or the time left of it."""

    number: int
    text: str
    standing: StepStatus
    note: str = ""


@dataclass(frozen=True, slots=True)
class Band:
    """A force, and the band that it must be in for the step to go on."""

    name: str
    value_n: float
    low_n: float
    high_n: float

    @property
    def is_within(self) -> bool:
        """Whether it is in its band."""
        return self.low_n <= self.value_n <= self.high_n

    @property
    def span_n(self) -> tuple[float, float]:
        """What a drawing of it shows: the band in its middle half, and zero."""
        width = self.high_n - self.low_n
        return min(0.0, self.low_n - width / 2), self.high_n + max(width / 2, 0.15 * self.high_n)


class RunAction(StrEnum):
    """What the run waits for; only an answer is given in its panel."""

    BEGIN = "begin"
    ANSWER = "answer"
    WAIT = "wait"


@dataclass(frozen=True, slots=True)
class RunSteps:
    """The protocol of a run as it stands.

    Attributes
    ----------
    number : int
        Of the step under way, or in which the run ended; 0 before the first.
    bands : tuple of Band
        Forces that the step under way waits for.
    act, acts : RunAction, str
        What the one key does now, and in words.
    question : str
        That waits for an answer.
    left : str
        The time left of all steps.
    pause, no_pause : str
        What the key of a pause says, and why it cannot be used; empty if it can.
    no_note : str
        Why no note can be taken; empty if one can.
    is_pause_asked : bool
        Whether the run waits after this step unless that is withdrawn.
    """

    number: int
    lines: tuple[StepLine, ...]
    bands: tuple[Band, ...]
    act: RunAction
    acts: str
    question: str = ""
    left: str = ""
    pause: str = PAUSE
    no_pause: str = "No run is under way that could wait."
    no_note: str = "A note goes into the session of a run, and none is under way."
    is_pause_asked: bool = False


def planned(config: Config) -> RunSteps:
    """The steps of a run that is not begun."""
    return RunSteps(
        0,
        _lines(config, 0, StepStatus.TO_COME, ""),
        (),
        RunAction.BEGIN,
        "Start (F5) begins it",
    )


def run_steps(
    config: Config,
    health: Health,
    outcome: Outcome | None,
    newest: Conditions | None,
    forces_n: tuple[float, float],
    before: RunSteps | None,
) -> RunSteps:
    """The steps of a run as they stand, `before` at the last look; `newest` is what is known of its
    newest frame, and `forces_n` are P and Q.
    """
    steps = config.run.protocol
    if outcome is not None:
        is_whole = outcome.is_complete
        at = len(steps) if is_whole else before.number if before else 0
        how = StepStatus.FAILED if outcome.state == "failed" else StepStatus.STOPPED
        lines = _lines(config, at, StepStatus.DONE if is_whole else how, typeset(outcome.reason))
        return RunSteps(at, lines, (), RunAction.BEGIN, "Start (F5) begins the next run")
    if health.state in STARTING:
        return planned(config)
    number = _number(steps, health, newest) or (before.number if before else 0)
    step = steps[number - 1] if number else None
    advice = "" if health.question or health.state != "running" else typeset(health.reason)
    is_going_on = health.state == "running"  # what is read of the time left is of now
    left_s, all_left_s = (health.left_s, health.all_left_s) if is_going_on else (math.nan,) * 2
    note = "; ".join(filter(None, (typeset(advice), _left(left_s))))
    act, acts = _acts(health, step)
    return RunSteps(
        number,
        _lines(config, number, StepStatus.UNDER_WAY, note),
        _bands(config, step, *forces_n),
        act,
        acts,
        health.question,
        _left(all_left_s) if all_left_s != left_s else "",
        *((*_pause(steps[number:], health), "", health.is_pause_asked) if is_going_on else ()),
    )


def _pause(following: tuple[Step, ...], health: Health) -> tuple[str, str]:
    """What the key of a pause says, and why it cannot be used; empty if it can."""
    if health.is_paused:
        return "Paused", "The run waits already; the button above lets it go on."
    if health.is_pause_asked:
        return ASKED, ""
    if all(isinstance(step, Velocity) for step in following):
        return PAUSE, "No step follows before which the stage stands, so the run cannot wait."
    return PAUSE, ""


def _number(steps: tuple[Step, ...], health: Health, newest: Conditions | None) -> int:
    """Number of the step under way; 0 where none is. A replay knows it by its frames, an older
    session by its phases only.
    """
    if health.step:
        return health.step_number
    if newest is not None and newest.step:
        return newest.step
    phases = [str(phase_of(steps, number)) for number in range(1, len(steps) + 1)]
    return phases.index(health.phase) + 1 if health.phase in phases else 0


def _lines(config: Config, number: int, standing: StepStatus, note: str) -> tuple[StepLine, ...]:
    """All steps, the one of this number with its standing and note."""
    return tuple(
        StepLine(n, text, standing, note)
        if n == number
        else StepLine(n, text, StepStatus.DONE if n < number else StepStatus.TO_COME)
        for n, text in enumerate(_texts(config.run.protocol), 1)
    )


@lru_cache(maxsize=4)
def _texts(steps: tuple[Step, ...]) -> tuple[str, ...]:
    return tuple(typeset(str(step)) for step in steps)


def _left(seconds: float) -> str:
    if not math.isfinite(seconds) or seconds < 0.5:
        return ""
    return f"{duration(seconds)} left"


def _acts(health: Health, step: Step | None) -> tuple[RunAction, str]:
    """What the one key does, and in words; or what is waited for."""
    if health.state == "stopping":
        return RunAction.WAIT, "The run comes to its end"
    if health.question:
        return RunAction.ANSWER, "Resume" if health.is_paused else "Answer and go on"
    match step:
        case Zero() | Background():
            return RunAction.WAIT, "The block hangs free"
        case Approach():
            return RunAction.WAIT, "Waits for the load"
        case Reference():
            return RunAction.WAIT, "Takes the reference"
        case Motion():
            return RunAction.WAIT, "The stage moves"
        case Ask():
            return RunAction.WAIT, "Asks"
        case None:
            return RunAction.WAIT, "The bench is made ready"
    return RunAction.WAIT, "The stage stands"


def _bands(config: Config, step: Step | None, normal_n: float, shear_n: float) -> tuple[Band, ...]:
    """The forces that a step waits for, with their bands."""
    run = config.run
    if isinstance(step, Background):
        most = TOUCH_FRACTION * run.normal_force
        return (Band("P, block free", normal_n, -most, most),)
    if isinstance(step, Approach):
        load, most = step.normal_force, run.shear_tolerance * max(normal_n, 0.0)
        slack = run.settle_tolerance * load
        return (
            Band("P, the load", normal_n, load - slack, load + slack),
            Band(f"Q, within {run.shear_tolerance:.2g} P", shear_n, -most, most),
        )
    return ()
