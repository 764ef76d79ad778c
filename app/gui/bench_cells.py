"""What the bench panel says and draws of a connected bench, as plain values."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

from analysis.options import quantity
from app.gui.bench_link import Pair, ZeroedForces
from app.gui.cells import DASH, Cell, Cells, Tone, number, short, tone_of, typeset
from app.gui.charts import NOTHING
from app.records.bench_view import (
    END_OF_RANGE,
    BenchView,
    DeviceState,
    ForcesView,
    PictureView,
    StageTask,
    StageView,
)
from app.records.record_types import F64
from app.settings.protocol_steps import Zero
from app.settings.sections import Config
from app.system.disk import bytes_text

ToldIn = tuple[str, Tone]  # a text, and its colour
LABELS = {"forces": "Forces", "camera": "Camera", "actuator": "Stage"}
SOURCES = {"sim": "simulated", "replay": "replay of a session"}  # others have their own names
NATURES = {
    "real": "Driver of a device at this computer",
    "emulated": "Driver of a real device, beside a simulated one",
    "simulated": "No device: readings and images of a simulated contact",
    "stored": "No device: what a recorded session holds (replay.session)",
    "": "Driver of an installed package",
}
MARKS = {  # so that a state is not told by its colour alone
    Tone.BUSY: "…",
    Tone.GOOD: "✓",
    Tone.WARN: "!",
    Tone.BAD: "✗",
    Tone.NEUTRAL: "–",
}
TASKS = {StageTask.JOG: "jogging", StageTask.MOVE: "moving", StageTask.HOME: "homing"}
FASTEST_JOG_M_S, SLOWER = 100e-6, 10.0  # the fast jog, and how much slower the other is
TOO_BRIGHT = 0.02  # share of the pixels, as of `slipscope check`
NEAR_LIMIT = 0.9
TOUCHES = 0.05  # share of the load above which the block may touch, as for a run's background
NOISY_N = 5e-3  # five times the resolution of the bench of the paper
OLD_S = 2.0  # of a picture
DISK_WARNS_MIN, DISK_ALARMS_MIN = 30.0, 5.0


@dataclass(frozen=True, slots=True)
class DeviceLine:
    """A device, its state, and the sentence that says so."""

    kind: str
    name: str
    word: str
    sentence: str
    tone: Tone


@dataclass(frozen=True, slots=True, eq=False)
class Gauge:
    """A force with its scale: limits, the band where it should be, and its last ten seconds.

    Attributes
    ----------
    text : str
        What is said of it, in the colour `tone`; its number is in the strip over the picture.
    quantity : str
        A colour of `theme.Palette`.
    legend : str
        The numbers of band and limits.
    """

    name: str
    quantity: str
    low: float
    high: float
    band: Pair
    limits: tuple[float, ...] = ()
    legend: str = ""
    hint: str = ""
    text: str = DASH
    tone: Tone = Tone.NEUTRAL
    value: float = math.nan
    time_s: F64 = field(default_factory=lambda: NOTHING)
    history: F64 = field(default_factory=lambda: NOTHING)


def device_lines(view: BenchView | None) -> tuple[DeviceLine, ...]:
    """A line for each device."""
    lines = []
    for kind, label in LABELS.items():
        device = view.devices.get(kind) if view else None
        if device is None:
            lines.append(DeviceLine(kind, label, "not connected", "", Tone.NEUTRAL))
            continue
        word = "look at it" if device.state is DeviceState.LOOK else str(device.state)
        lines.append(
            DeviceLine(
                kind,
                f"{label}: {device.name}",
                word,
                typeset(device.sentence.removeprefix(f"{device.name}: ")),
                tone_of(device.state),
            )
        )
    return tuple(lines)


def gauges(forces: ForcesView | None, config: Config) -> tuple[Gauge, Gauge]:
    """P and Q."""
    run, limits = config.run.as_planned, config.limits
    load = run.normal_force
    most, least = limits.normal_force, -0.1 * limits.normal_force
    width = run.settle_tolerance * load
    normal = Gauge(
        "normal force P",
        "normal",
        least,
        1.1 * most,
        (load - width, load + width),
        (most,),
        f"{load:g} ± {short(width, 2)} N · limit {most:g} N",
        f"Normal force; the band is {load:g} N ± {run.settle_tolerance:.0%}, the red line"
        f" limits.normal_force = {quantity(limits, 'normal_force')}",
    )
    most, width = limits.shear_force, run.shear_tolerance * load
    shear = Gauge(
        "shear force Q",
        "shear",
        -1.1 * most,
        1.1 * most,
        (-width, width),
        (-most, most),
        f"± {short(width * 1e3, 2)} mN · limit ± {most:g} N",
        f"Shear force; the band is ± {run.shear_tolerance:.0%} of {load:g} N, in which a run"
        f" begins, the red lines limits.shear_force = {quantity(limits, 'shear_force')}",
    )
    if forces is None:
        return normal, shear
    return _measured(normal, forces, 0), _measured(shear, forces, 1)


def _measured(gauge: Gauge, forces: ForcesView, column: int) -> Gauge:
    value, noise, used = forces.newest[column], forces.noise[column], forces.used[column]
    limit = max(gauge.limits)
    said = f"noise {number(noise * 1e3, 1)} mN" if math.isfinite(noise) else ""
    tone, note = Tone.NEUTRAL, said
    if gauge.band[0] <= value <= gauge.band[1]:
        tone, note = Tone.GOOD, ", ".join(filter(None, ("in its band", said)))
    if noise > NOISY_N:
        tone, note = Tone.WARN, f"{said}: too much"
    if abs(value) > NEAR_LIMIT * limit:
        tone, note = Tone.WARN, f"near its limit of {limit:g} N"
    if used >= END_OF_RANGE:
        tone, note = Tone.BAD, "sensor at the end of its range"
    elif abs(value) > limit:
        tone, note = Tone.BAD, f"beyond its limit of {limit:g} N"
    if forces.age_s > 1.0:
        tone, note = Tone.BAD, f"no reading for {forces.age_s:.0f} s"
    return replace(
        gauge,
        text=note,
        tone=tone,
        value=value,
        time_s=forces.time_s,
        history=forces.history[:, column],
    )


def picture_cells(picture: PictureView | None) -> Cells:
    """Brightness, saturated pixels and focus of the live picture."""
    hint = (
        "Variance of the Laplacian over the square of the mean grey level, in thousandths"
        " (Pech-Pacheco et al., ICPR 2000): focus until it is greatest. It compares pictures of the"
        " same scene only, so it changes with the contact"
    )
    if picture is None:
        return Cell("mean grey", DASH), Cell("saturated", DASH), Cell("focus", DASH, hint=hint)
    bright = Tone.WARN if picture.saturated > TOO_BRIGHT else Tone.NEUTRAL
    dim = Tone.WARN if not 0.05 <= picture.mean <= 0.9 else Tone.NEUTRAL
    of_grey = "Share of the grey scale; less than 5 % or more than 90 % is a wrong exposure"
    of_ends = (
        f"Pixels at the end of the grey scale, red in the picture; more than {TOO_BRIGHT:.0%}:"
        " shorten the exposure, or dim the light"
    )
    return (
        Cell("mean grey", f"{picture.mean:.0%}", tone=dim, hint=of_grey),
        Cell("saturated", f"{picture.saturated:.2%}", tone=bright, hint=of_ends),
        Cell("focus", number(picture.focus, 2 if picture.focus < 100 else 0), hint=hint),
    )


def picture_note(view: BenchView | None) -> str:
    """Why the picture that is shown is not live; empty if it is, or if there is none."""
    age_s = view.picture_age_s if view else math.inf
    return f"not live: {age_s:.0f} s old" if OLD_S < age_s < math.inf else ""


def task_text(stage: StageView) -> str:
    """What the stage does, in a word; empty where it stands."""
    return TASKS[stage.task] if stage.task else "moving" if stage.is_moving else ""


def stage_text(stage: StageView | None) -> ToldIn:
    """Where the stage is, and whether it moves."""
    if stage is None:
        return DASH, Tone.NEUTRAL
    word = "moving" if stage.is_moving else "at rest"
    return f"{number(stage.position_m * 1e3, 4)} mm, {word}", (
        Tone.BUSY if stage.is_moving else Tone.NEUTRAL
    )


def room_text(stage: StageView | None) -> str:
    """How far the stage can be jogged."""
    if stage is None:
        return ""
    back, on = ((end - stage.position_m) * 1e6 for end in (stage.low_m, stage.high_m))
    return f"can be jogged by {number(back, 0)} to +{number(on, 0)} µm"


def goal_text(stage: StageView | None) -> str:
    """Where the stage goes; where it is sent nowhere, how far it can be."""
    if stage is None:
        return ""
    if stage.task in (None, StageTask.JOG):
        low, high = (number(end * 1e3, 4) for end in (stage.low_m, stage.high_m))
        return f"{room_text(stage)}, sent to {low} to {high} mm"
    place = f"goes to {number(stage.goal_m * 1e3, 4)} mm"
    going = place if stage.task is StageTask.MOVE else "searches its origin"
    return f"{going}; STOP MOTION (Esc) stops it"


def disk_text(bytes_per_s: float, free_bytes: int) -> ToldIn:
    """Minutes of recording for which there is room."""
    if free_bytes < 0 or not bytes_per_s > 0:
        return DASH, Tone.NEUTRAL
    minutes = free_bytes / bytes_per_s / 60
    tone = Tone.NEUTRAL
    if minutes < DISK_WARNS_MIN:
        tone = Tone.BAD if minutes < DISK_ALARMS_MIN else Tone.WARN
    text = f"{minutes:.0f} min" if minutes < 600 else f"{minutes / 60:.0f} h"
    return f"{text} of recording, {bytes_text(free_bytes)} free", tone


def jog_speeds(config: Config) -> Pair:
    """The slow and the fast one, m/s."""
    fast = min(FASTEST_JOG_M_S, config.actuator.max_velocity)
    return fast / SLOWER, fast


def zeroed_text(zeroed: ZeroedForces, config: Config) -> ToldIn:
    """What came of zeroing, and what the run makes of it."""
    load = config.run.as_planned.normal_force
    is_doubtful = abs(zeroed.before_n[0]) > TOUCHES * load
    normal, shear = (typeset(f"{volts:+.4f}") for volts in zeroed.volts)
    p, q = (typeset(f"{force:+.3f}") for force in zeroed.before_n)
    text = (
        f"Zeroed: P had read {p} N and Q {q} N; without a force the sensors read {normal} V and"
        f" {shear} V, which is forces.zero of the next run."
    )
    if is_doubtful:
        text += " If the block was not free, lift it and zero again."
    steps = config.run.protocol
    first = next((i for i, step in enumerate(steps, 1) if isinstance(step, Zero)), None)
    if first:
        text += f" Its step {first} zeroes once more."
    return text, Tone.WARN if is_doubtful else Tone.GOOD


def is_outdated(connected: Config, now: Config) -> bool:
    """Whether the bench was connected with other settings than those of the next run."""
    zero = connected.forces.zero
    now = replace(now, forces=replace(now.forces, zero=zero))
    return any(
        getattr(connected, part) != getattr(now, part)
        for part in ("forces", "camera", "actuator", "limits", "sim", "sample", "replay")
    )


def jog_texts(arrow: str, speed_m_s: float) -> tuple[str, str, str]:
    """What stands on a button that jogs, what it does, and its tooltip."""
    speed, is_back = f"{speed_m_s * 1e6:g}", arrow in "«‹"
    does = f"jog {'against' if is_back else 'along'} the drive at {speed} µm/s"
    tip = f"Hold: {does}, within limits.travel and while forces are read; letting go stops it"
    return f"{arrow} {speed}" if is_back else f"{speed} {arrow}", does, tip
