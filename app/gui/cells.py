"""The words and numbers around the plots: readouts, the operator's sentence, the account of frames,
settings and results.
"""

from __future__ import annotations

import math

from analysis.options import Section, quantity
from app.gui.numbers import NOT_KNOWN, Cell, Tone, disk_text, grouped, measured, number
from app.results import Counts, Health, Outcome, Phase, Snapshot, Summary
from app.settings import Config

QUEUE_WARNS = 0.5  # share of the recorder's queue from which the operator is told


def readouts(normal_n: float, shear_n: float, newest: Snapshot | None) -> tuple[Cell, ...]:
    """The numbers of this instant: P, Q, Q/P, delta, c."""
    ratio = shear_n / normal_n if normal_n > 0.02 else math.nan
    travel_um = newest.travel_m * 1e6 if newest else math.nan
    stick_mm = newest.stick_radius_m * 1e3 if newest else math.nan
    return (
        Cell("normal force P", number(normal_n, 3), "N"),
        Cell("shear force Q", number(shear_n, 3), "N"),
        Cell("Q / P", number(ratio, 3), ""),
        Cell("travel δ", number(travel_um, 1), "µm"),
        Cell("stick radius c", number(stick_mm, 2), "mm"),
    )


def operator_sentence(
    health: Health,
    outcome: Outcome | None,
    normal_n: float,
    newest: Snapshot | None,
    config: Config,
) -> str:
    """One sentence: what goes on now, or why it ended."""
    reason = outcome.reason if outcome is not None else health.reason
    if outcome is None and health.state == "running" and health.queue_fill > QUEUE_WARNS:
        behind = f"the recorder is {queue_cell(health).value} s behind"
        return (
            f"The disk is slower than the data: {behind}; with a full queue the run can not go on."
        )
    if reason:
        return reason[0].upper() + reason[1:]
    if health.state != "running":
        return {
            "idle": "Ready. Start (F5) begins the run.",
            "armed": "The bench is being made ready.",
        }.get(health.state, "")
    travel = number(newest.travel_m * 1e6 if newest else math.nan, 0)
    return {
        Phase.BACKGROUND: "The block hangs free: images without contact are taken.",
        Phase.CONTACT: (
            f"Press the contact to P = {config.run.normal_force:.3f} N; now {number(normal_n, 3)}"
            " N."
        ),
        Phase.REFERENCE: "At rest under load: the reference image is taken.",
        Phase.DRIVE: (
            f"The actuator pulls at {_setting(config.run, 'velocity')}: {travel} of"
            f" {_setting(config.run, 'travel')}."
        ),
    }.get(Phase(health.phase) if health.phase in set(Phase) else Phase.END, "")


def health_cells(counts: Counts) -> tuple[Cell, ...]:
    """The account of triggers, frames and samples; a loss is red, an analysis that skips more than
    half of the frames amber.
    """
    lost = Tone.BAD if counts.frames_lost else Tone.NEUTRAL
    samples_lost = Tone.BAD if counts.samples_lost else Tone.NEUTRAL
    skipped = counts.frames_skipped / max(1, counts.frames_received)
    return (
        Cell("triggers", grouped(counts.triggers)),
        Cell("frames received", grouped(counts.frames_received)),
        Cell("recorded", grouped(counts.frames_recorded)),
        Cell("analysed", grouped(counts.frames_analysed)),
        Cell(
            "skipped live",
            grouped(counts.frames_skipped),
            detail=f"{skipped:.0%}" if counts.frames_skipped else "",
            tone=Tone.WARN if skipped > 0.5 else Tone.NEUTRAL,
        ),
        Cell("frames lost", grouped(counts.frames_lost), tone=lost),
        Cell("samples", grouped(counts.samples)),
        Cell("samples lost", grouped(counts.samples_lost), tone=samples_lost),
    )


def result_cells(summary: Summary | None) -> tuple[Cell, ...]:
    """a, Q_s, mu_s, mu_d, t_s with their uncertainties; a dash where the run did not go far enough."""
    if summary is None:
        return tuple(
            Cell(name, NOT_KNOWN)
            for name in (
                "apparent radius a",
                "static force Q_s",
                "μ_s",
                "μ_d",
                "onset of sliding t_s",
            )
        )
    low, high = summary.mu_d_range
    spread = f"{low:.3f} to {high:.3f}" if math.isfinite(low) and math.isfinite(high) else ""
    return (
        measured(
            "apparent radius a",
            summary.apparent_radius_m * 1e3,
            summary.apparent_radius_sd_m * 1e3,
            2,
            "mm",
        ),
        Cell("static force Q_s", number(summary.static_force_n, 3), unit="N"),
        measured("μ_s", summary.mu_s, summary.mu_s_sd, 3),
        Cell("μ_d", number(summary.mu_d, 3), detail=spread),
        measured("onset of sliding t_s", summary.onset_time_s, summary.onset_time_sd_s, 2, "s"),
    )


def setting_cells(config: Config) -> tuple[Cell, ...]:
    """The settings of the run, in the place where its result will be."""
    return (
        _setting_cell("normal force P", config.run, "normal_force"),
        _setting_cell("velocity", config.run, "velocity"),
        _setting_cell("travel", config.run, "travel"),
        Cell("images", f"{config.frame_rate_hz:.3g}", "per s"),
        Cell("box / step", f"{config.dic.box} / {config.dic.step}", "px"),
    )


def _setting_cell(label: str, section: Section, name: str) -> Cell:
    value, unit = _setting(section, name).split()
    return Cell(label, value, unit)


def _setting(section: Section, name: str) -> str:
    return quantity(section, name).replace("um", "µm")


def state_tone(state: str) -> Tone:
    """The colour of the state badge."""
    tones = {
        "running": Tone.BUSY,
        "armed": Tone.WARN,
        "stopping": Tone.WARN,
        "done": Tone.GOOD,
        "failed": Tone.BAD,
    }
    return tones.get(state, Tone.NEUTRAL)


def queue_cell(health: Health) -> Cell:
    """How full the recorder's queue is, in seconds of data."""
    tone = (
        Tone.BAD
        if health.queue_fill > 0.8
        else Tone.WARN
        if health.queue_fill > QUEUE_WARNS
        else Tone.GOOD
    )
    return Cell(
        "recorder queue",
        f"{health.queue_fill * health.queue_seconds:.1f} of {health.queue_seconds:.1f}",
        "s",
        tone=tone,
    )


def disk_cell(health: Health, config: Config) -> Cell:
    """The space left; amber below ten minutes of 8-bit images, red below one."""
    per_second = config.camera.width * config.camera.height * config.frame_rate_hz
    seconds = health.disk_free_bytes / per_second
    tone = Tone.BAD if seconds < 60 else Tone.WARN if seconds < 600 else Tone.NEUTRAL
    return Cell(
        "disk left",
        disk_text(health.disk_free_bytes),
        tone=tone if health.disk_free_bytes >= 0 else Tone.NEUTRAL,
    )
