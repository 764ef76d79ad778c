"""How far the protocol of a run is, and what it waits for, as plain values."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import StrEnum
from functools import lru_cache

from app.experiment.decisions import TOUCH_FRACTION, phase_of
from app.gui.bench_cells import Gauge
from app.gui.bench_link import Pair
from app.gui.cells import Tone, localized, number, typeset
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

SMALL_N = 0.1  # a band below this is told in mN
STARTING = ("idle", "")  # states of a run that was not begun
PAUSE, ASKED = "Pause after this step", "Pauses after this step: withdraw"


class StepStatus(StrEnum):
    """What has become of a step."""

    TO_COME = "to come"
    UNDER_WAY = "under way"
    DONE = "done"
    STOPPED = "stopped"  # the run was ended in it
    FAILED = "failed"


@dataclass(frozen=True, slots=True)
class StepLine:
    """A step of the protocol; `note` is why it waits or ended, or the time left of it."""

    number: int
    text: str
    standing: StepStatus
    note: str = ""


@dataclass(frozen=True, slots=True)
class RunSteps:
    """The protocol of a run as it stands.

    Attributes
    ----------
    number : int
        Of the step under way, or in which the run ended; 0 before the first.
    bands : tuple of Gauge
        Forces that the step under way waits for.
    acts : str
        What the one key does now, or what the run `waits` for.
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
    bands: tuple[Gauge, ...]
    acts: str
    question: str = ""
    left: str = ""
    pause: str = PAUSE
    no_pause: str = "No run is under way that could wait."
    no_note: str = "A note goes into the session of a run, and none is under way."
    is_pause_asked: bool = False
    waits: bool = False


def planned(config: Config) -> RunSteps:
    """The steps of a run that is not begun."""
    return RunSteps(0, _lines(config, 0, StepStatus.TO_COME, ""), (), "Start (F5) begins it")


def run_steps(
    config: Config,
    health: Health,
    outcome: Outcome | None,
    newest: Conditions | None,
    forces_n: Pair,
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
        return RunSteps(at, lines, (), "Start (F5) begins the next run")
    if health.state in STARTING:
        return planned(config)
    number = _number(steps, health, newest) or (before.number if before else 0)
    step = steps[number - 1] if number else None
    advice = "" if health.question or health.state != "running" else typeset(health.reason)
    is_going_on = health.state == "running"  # what is read of the time left is of now
    left_s, all_left_s = (health.left_s, health.all_left_s) if is_going_on else (math.nan,) * 2
    note = "; ".join(filter(None, (typeset(advice), _left(left_s))))
    made = RunSteps(
        number,
        _lines(config, number, StepStatus.UNDER_WAY, note),
        _bands(config, step, *forces_n),
        _acts(health, step),
        health.question,
        _left(all_left_s) if all_left_s != left_s else "",
        waits=not health.question,
    )
    if not is_going_on:
        return made
    pause, why = _pause(steps[number:], health)
    is_asked = health.is_pause_asked
    return replace(made, pause=pause, no_pause=why, no_note="", is_pause_asked=is_asked)


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
    return tuple(str(step) for step in steps)


def _left(seconds: float) -> str:
    if not math.isfinite(seconds) or seconds < 0.5:
        return ""
    return localized(f"{duration(seconds)} left")


def _acts(health: Health, step: Step | None) -> str:
    """What the one key does, or what is waited for."""
    if health.state == "stopping":
        return "The run comes to its end"
    if health.question:
        return "Resume" if health.is_paused else "Answer and go on"
    match step:
        case Zero() | Background():
            return "The block hangs free"
        case Approach():
            return "Waits for the load"
        case Reference():
            return "Takes the reference"
        case Motion():
            return "The stage moves"
        case Ask():
            return "Asks"
        case None:
            return "The bench is made ready"
    return "The stage stands"


def band_gauge(name: str, quantity: str, value_n: float, low_n: float, high_n: float) -> Gauge:
    """A force, and the band that it must be in for the step to go on: in the middle half of what is
    drawn, beside zero.
    """
    width, is_small = high_n - low_n, high_n < SMALL_N
    factor, decimals, unit = (1e3, 1, "mN") if is_small else (1.0, 3, "N")
    now, low, high = (f"{number(n * factor, decimals)} {unit}" for n in (value_n, low_n, high_n))
    return Gauge(
        name,
        quantity,
        min(0.0, low_n - width / 2),
        high_n + max(width / 2, 0.15 * high_n),
        (low_n, high_n),
        hint=f"{name}: {now}, to be between {low} and {high}",
        text=now,
        tone=Tone.GOOD if low_n <= value_n <= high_n else Tone.WARN,
        value=value_n,
    )


def _bands(config: Config, step: Step | None, normal_n: float, shear_n: float) -> tuple[Gauge, ...]:
    """The forces that a step waits for, with their bands."""
    run = config.run
    if isinstance(step, Background):
        most = TOUCH_FRACTION * run.as_planned.normal_force
        return (band_gauge("P, block free", "normal", normal_n, -most, most),)
    if isinstance(step, Approach):
        load, most = step.normal_force, run.shear_tolerance * max(normal_n, 0.0)
        slack = run.settle_tolerance * load
        return (
            band_gauge("P, the load", "normal", normal_n, load - slack, load + slack),
            band_gauge(f"Q, within {run.shear_tolerance:.2g} P", "shear", shear_n, -most, most),
        )
    return ()
