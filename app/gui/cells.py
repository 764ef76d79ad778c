"""The words and numbers around the plots, as plain values.

They are the readouts, the sentence for the operator, the counts, the settings and the result.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache

from analysis.options import quantity
from app.records.bench_view import Health
from app.records.effort import left_out
from app.records.quantities import decimals_for, upper_bound
from app.records.record_types import Conditions, Counts, Outcome, Phase
from app.settings.sections import Config
from app.system.disk import bytes_text

DASH = "–"  # stands for a value that is not known
QUEUE_WARNS, QUEUE_ALARMS = 0.5, 0.8  # share of the recorder's queue in use
DISK_WARNS_S, DISK_ALARMS_S = 600.0, 60.0  # seconds of images for which there is room
LEAST_LOAD_N = 0.02  # a ratio Q/P of less is noise


class Tone(StrEnum):
    """How a value or a state is coloured."""

    NEUTRAL = "neutral"
    GOOD = "good"
    BUSY = "busy"
    WARN = "warn"
    BAD = "bad"
    REPLAY = "replay"  # nothing of it happens now


STATES = {  # of runs, their steps and ends, of sessions, devices and stops
    Tone.GOOD: ("done", "complete", "imported", "ready", "at rest"),
    Tone.BUSY: ("running", "stopping", "under way", "connecting", "being recorded"),
    Tone.WARN: ("armed", "stopped", "cut short", "look", "sent"),
    Tone.BAD: ("failed", "FAILED"),
    Tone.REPLAY: ("played",),
}
TONES = {state: tone for tone, states in STATES.items() for state in states}


def tone_of(state: str, other: Tone = Tone.NEUTRAL) -> Tone:
    """The tone of a state, given by its word; that of an `other` one."""
    return TONES.get(state, other)


@dataclass(frozen=True, slots=True)
class Cell:
    """A named value with its unit; `detail` is its uncertainty or range, `hint` tells more."""

    name: str
    value: str
    unit: str = ""
    detail: str = ""
    tone: Tone = Tone.NEUTRAL
    hint: str = ""
    quantity: str = ""  # a colour of `theme.Palette`, whose colour its name has


Cells = tuple[Cell, ...]


PROPER = (
    (re.compile(r"\bu_x\b"), "uₓ"),
    (re.compile(r"(?<![\w/\\'.])mu(?![A-Za-z])"), "μ"),
    (re.compile(r"(?<![\w/\\'.])sigma(_xz)?(?![A-Za-z])"), "σ"),
    (re.compile(r"(?<![\w/\\'.])delta(?!\w)"), "δ"),
    (re.compile(r"(?<![A-Za-z])u(?=[mJN]\b)"), "µ"),
    (re.compile(r"(?<=J/m)2\b"), "²"),
    (re.compile(r"(?<=[tsQμ])_s\b"), "ₛ"),
    (re.compile(r"(?<=\bs)_0\b"), "₀"),
    (re.compile(r"(?<![\w.=\\])-(?=[\d.])"), "−"),
)
# what has versions of two numbers: programs, and what is made by a standard
VERSIONED = (
    "version|firmware|release|revision|slipscope|daqmx|python|numpy|scipy|numba|llvmlite|h5py|hdf5"
    "|opencv|matplotlib|pyside6|qt|pyqtgraph|pypylon|pylon|harvesters|genicam|gentl|sfnc|vision|usb"
)
# of a number; names of files, versions and what is written as in a settings file have others
POINT = re.compile(
    rf"(\b(?:{VERSIONED}) v?[\d.]+)|(?<![^\s(]-)(?<![\w./\\=])"
    r"(\d+)\.(?=\d+(?:e[-+−]?\d+)?(?![\w/\\-]|\.\w))",
    re.IGNORECASE,
)


_decimal_sign = ["."]


def set_decimal_sign(sign: str) -> None:
    """Have this sign before the decimals of all numbers from now on."""
    _decimal_sign[0] = sign
    typeset.cache_clear()


def localized(text: str) -> str:
    """A text whose numbers have the decimal sign of the operator's language."""
    if (sign := _decimal_sign[0]) == ".":
        return text
    return POINT.sub(lambda found: found[1] or f"{found[2]}{sign}", text)


@lru_cache(maxsize=512)  # most of what is typeset at a redraw was at the one before
def typeset(text: str) -> str:
    """A text whose symbols, units and negative numbers are as people print them; its words stay."""
    for plain, proper in PROPER:
        text = plain.sub(proper, text)
    return localized(text)


def as_sentence(text: str) -> str:
    """A text as a sentence begins, typeset."""
    return typeset(f"{text[:1].upper()}{text[1:]}")


def with_subscript(symbol: str) -> str:
    """``mu_s`` as rich text."""
    head, mark, tail = symbol.rpartition("_")
    return f"{typeset(head)}<sub>{tail}</sub>" if mark else typeset(symbol)


def number(value: float, decimals: int) -> str:
    """`value` with a true minus sign, which zero has not, and the decimal sign of the operator's
    language, or a dash for NaN.
    """
    if not math.isfinite(value):
        return DASH
    return localized(f"{value:z.{decimals}f}".replace("-", "−"))


def short(value: float, digits: int, sign: str = "-") -> str:
    """`value` with so many digits that count, and without an exponent up to a million; with "+" as
    `sign` also those above zero have one.
    """
    return f"{float(f'{value:.{digits}g}'):{sign}g}"


def grouped(count: int) -> str:
    """`count` with narrow spaces between its thousands."""
    return f"{count:,}".replace(",", "\u202f")


def readouts(
    normal_n: float, shear_n: float, travel_m: float, stick_m: float, stick_sd_m: float
) -> Cells:
    """The numbers of this instant: P, Q, Q/P, delta, and c or its bound where it is lost in its
    uncertainty.
    """
    ratio = shear_n / normal_n if normal_n > LEAST_LOAD_N else math.nan
    bound = upper_bound(stick_m, stick_sd_m)
    stick = (
        f"< {number(bound * 1e3, decimals_for(bound * 1e3, 1))}"
        if math.isfinite(bound)
        else number(stick_m * 1e3, 2)
    )
    return (
        Cell("normal force P", number(normal_n, 3), "N", quantity="normal"),
        Cell("shear force Q", number(shear_n, 3), "N", quantity="shear"),
        Cell("Q / P", number(ratio, 3), quantity="friction"),
        Cell("travel δ", number(travel_m * 1e6, 1), "µm", quantity="travel"),
        Cell("stick radius c", stick, "mm", quantity="stick"),
    )


def operator_sentence(
    health: Health, outcome: Outcome | None, normal_n: float, travel_m: float, config: Config
) -> str:
    """One sentence that says what goes on now, or why the run ended."""
    run, is_running = config.run, health.state == "running"
    if outcome is None and is_running and health.queue_fill > QUEUE_WARNS:
        return (
            f"The disk is slower than the data: {queue_cell(health).value} s of data wait to be"
            " recorded; the run ends when the queue is full."
        )
    if is_running and health.question:
        step, _, _ = health.step.partition(":")
        return f"{as_sentence(health.question)} (F8 answers yes; step {step})"
    if reason := (outcome or health).reason:
        return as_sentence(reason)
    if is_running and run.steps and health.step:
        return typeset(f"Step {health.doing}.")
    match health.phase if is_running else health.state:
        case "idle":
            return "Ready. Start (F5) begins the run."
        case "armed":
            return "The bench is being made ready."
        case Phase.BACKGROUND:
            return "The block hangs free: images without contact are taken."
        case Phase.CONTACT:
            target = f"P = {run.normal_force:.3f} N"
            return f"Press the contact to {target}; now {number(normal_n, 3)} N."
        case Phase.REFERENCE:
            return "At rest under load: the reference image is taken."
        case Phase.DRIVE:
            return f"The actuator pulls at {_drive(config, travel_m)}"
    return ""


def _drive(config: Config, travel_m: float) -> str:
    """How fast the stage drives, and how far it is."""
    velocity, travel = (typeset(quantity(config.run, name)) for name in ("velocity", "travel"))
    return f"{velocity}: {number(travel_m * 1e6, 0)} of {travel}."


def past_sentence(now: Conditions, config: Config, step: str = "") -> str:
    """What went on during an exposure of a recorded run, and at which step of its protocol."""
    run, normal = config.run, number(now.normal_force_n, 3)
    if run.steps and step:
        return f"step {step} was under way; P was {normal} N."
    match now.phase:
        case Phase.BACKGROUND:
            return "the block hung free: images without contact were taken."
        case Phase.CONTACT:
            return f"the contact was pressed to P = {run.normal_force:.3f} N; it was {normal} N."
        case Phase.REFERENCE:
            return "the contact was at rest under load: the reference image was taken."
        case Phase.DRIVE:
            return f"the actuator pulled at {_drive(config, now.travel_m)}"
    return "the experiment was over."


def count_cells(health: Health, shown: int = 0) -> Cells:
    """The account of triggers, frames and samples, and of images that were `shown`.

    Losses are red; an analysis that skips more than half of the frames, or leaves something out of
    each, is amber, and so are frames whose trigger is uncertain.
    """
    counts, losses = health.counts, health.losses
    uncertain, shed, exposures = health.uncertain, health.shed, health.exposures
    lost = Tone.BAD if counts.frames_lost else Tone.NEUTRAL
    samples_lost = Tone.BAD if counts.samples_lost else Tone.NEUTRAL
    skipped = counts.frames_skipped / max(1, counts.frames_received)
    return (
        Cell(
            "triggers",
            grouped(counts.triggers),
            detail=f"{grouped(exposures)} exposed" if exposures >= 0 else "",
            hint="Exposures that the board has counted stand beside, where a counter is wired.",
        ),
        Cell(
            "frames received",
            grouped(counts.frames_received),
            detail=f"{grouped(uncertain)} uncertain" if uncertain else "",
            tone=Tone.WARN if uncertain else Tone.NEUTRAL,
        ),
        Cell("recorded", grouped(counts.frames_recorded)),
        Cell(
            "analysed",
            grouped(counts.frames_analysed),
            detail="reduced" if shed else "",
            tone=Tone.WARN if shed else Tone.NEUTRAL,
            hint=f"left out: {left_out(shed)}; {health.shed_why}" if shed else "",
        ),
        Cell(
            "skipped live",
            grouped(counts.frames_skipped),
            detail=f"{skipped:.0%}" if counts.frames_skipped else "",
            tone=Tone.WARN if skipped > 0.5 else Tone.NEUTRAL,
        ),
        Cell("frames lost", grouped(counts.frames_lost), tone=lost, hint=losses),
        Cell("shown", grouped(shown), hint="Images that were painted in this window."),
        Cell("samples", grouped(counts.samples)),
        Cell("samples lost", grouped(counts.samples_lost), tone=samples_lost, hint=losses),
    )


def setting_cells(config: Config) -> Cells:
    """The settings of the run, shown until there is a result."""
    run, dic = config.run.as_planned, config.dic
    cells = []
    for name, key in (("normal force P", "normal_force"), ("velocity",) * 2, ("travel",) * 2):
        value, _, unit = typeset(quantity(run, key)).partition(" ")
        cells.append(Cell(name, value, unit))
    return (
        *cells,
        Cell("images", short(config.frame_rate_hz, 3), "per s"),
        Cell("box / step", f"{dic.box} / {dic.step}", "px"),
    )


def queue_cell(health: Health) -> Cell:
    """How full the recorder's queue is, in seconds of data."""
    fill = health.queue_fill
    tone = Tone.BAD if fill > QUEUE_ALARMS else Tone.WARN if fill > QUEUE_WARNS else Tone.GOOD
    waiting = localized(f"{fill * health.queue_seconds:.1f} of {health.queue_seconds:.1f}")
    return Cell("recorder queue", waiting, "s", tone=tone)


def disk_cell(health: Health, config: Config) -> Cell:
    """The free space; a dash where nothing is recorded, for which it is negative."""
    free, camera = health.disk_free_bytes, config.camera
    if free < 0:
        return Cell("disk left", DASH)
    image = camera.width * camera.height * camera.dtype.itemsize
    left_s = free / (image * config.frame_rate_hz)
    tone = Tone.BAD if left_s < DISK_ALARMS_S else Tone.WARN if left_s < DISK_WARNS_S else None
    return Cell("disk left", bytes_text(free), tone=tone or Tone.NEUTRAL)


LATE_S = 1.0  # an analysis that is further behind than this is no longer live


def latency_cell(behind_s: float) -> Cell:
    """How far the newest analysed frame is behind the newest force; a dash where nothing runs."""
    if not math.isfinite(behind_s):
        return Cell("analysis behind", DASH)
    tone = Tone.WARN if behind_s > LATE_S else Tone.NEUTRAL
    return Cell("analysis behind", number(behind_s, 2), "s", tone=tone)


def screen_cell(age_s: float) -> Cell:
    """How old an image is when it is seen; a dash where none is shown."""
    hint = "From the trigger of an image until it is painted."
    return Cell("delay trigger → screen", number(1e3 * age_s, 0), "ms", hint=hint)


def processor_cell(cores: float) -> Cell:
    """How many processor cores the program uses."""
    return Cell("processor", number(cores, 2), "cores", hint="This window and what it started.")


SKIPPED_WARNS = 0.01  # share of the frames that a live analysis may leave out unnoticed


def verdict_cell(health: Health, outcome: Outcome | None, queue: Cell, disk: Cell) -> Cell:
    """Whether all is well with the record of the run, in a sentence; the worst comes first. `queue`
    and `disk` are its own cells.
    """
    counts = health.counts
    is_under_way = outcome is None and health.state in ("running", "stopping")
    skipped = counts.frames_skipped / max(1, counts.frames_received)
    why = f": {typeset(health.losses)}" * bool(health.losses)
    for is_so, tone, sentence in (
        (
            counts.frames_lost,
            Tone.BAD,
            f"{grouped(counts.frames_lost)} of {grouped(counts.triggers)} triggers have no"
            f" image{why}.",
        ),
        (counts.samples_lost, Tone.BAD, f"{grouped(counts.samples_lost)} samples are lost{why}."),
        (
            is_under_way and queue.tone is not Tone.GOOD,
            queue.tone,
            f"The disk is slower than the data: {queue.value} s wait to be recorded.",
        ),
        (
            outcome is None and disk.tone is not Tone.NEUTRAL,
            disk.tone,
            f"The disk has {disk.value} left.",
        ),
        (
            outcome is not None and outcome.state == "failed",
            Tone.BAD,
            f"The run has failed; what came until then is kept: {_kept(counts)}.",
        ),
        (
            health.uncertain,
            Tone.WARN,
            f"{grouped(health.uncertain)} frames may be of another trigger.",
        ),
        (health.damage, Tone.WARN, f"{health.damage[:1].upper()}{health.damage[1:]}."),
        (
            health.shed,
            Tone.WARN,
            f"The live analysis leaves out {left_out(health.shed)}: {health.shed_why}.",
        ),
        (
            skipped > SKIPPED_WARNS,
            Tone.NEUTRAL,  # nothing is lost
            f"The analysis skips {skipped:.0%} of the frames live; all of them are recorded.",
        ),
    ):
        if is_so:
            return Cell("verdict", sentence, tone=tone)
    if not counts.triggers:
        return Cell("verdict", "Nothing has been measured yet.")
    return Cell("verdict", f"All is well: {_kept(counts)}.", tone=Tone.GOOD)


def _kept(counts: Counts) -> str:
    return (
        f"{grouped(counts.frames_received)} images of {grouped(counts.triggers)} triggers,"
        f" {grouped(counts.frames_recorded)} recorded, none lost"
    )
