"""What the slides of a protocol give: friction at each velocity, and its peak after each hold."""

from __future__ import annotations

import math
from dataclasses import astuple
from typing import Any, NamedTuple

import numpy as np

from analysis.friction.ageing import MIN_FRAMES, WINDOW, Slide, fit_ageing, slide_friction
from analysis.friction.ratio import BLOCK_S, JOINED, sample_ratios
from app.evaluation.budget import Measured
from app.evaluation.history import DriveForces
from app.records.record_types import Snapshot
from app.records.snapshot_numbers import all_series
from app.settings.protocol_steps import Hold, Motion

FEWEST_MOVING = 5  # frames of a step whose velocity is told
FEWEST_BLOCKS = 3 * MIN_FRAMES  # of samples in a slide
COLUMNS = (  # of the summary, a number for each slide
    "slide_step",
    "slide_hold_s",
    "slide_velocity_m_s",
    "slide_peak",
    "slide_peak_sd",
    "slide_mu_d",
    "slide_mu_d_sd",
    "slide_rise",
    "slide_rise_sd",
)


class _Slid(NamedTuple):
    """One motion of the protocol, as it was measured."""

    step: int
    began_s: float
    way: float
    velocity: float
    friction: Slide
    by_samples: bool


def slide_results(measured: Measured, notes: list[str], slip_m: float) -> dict[str, Any]:
    """Fields of the summary about the slides of a protocol, if it has several; what cannot be told
    is noted. Over `slip_m` of the stage's way no peak is missed: mu L, over which a contact yields.
    """
    run = measured.config.run
    if not run.steps:
        return {}
    frames: dict[int, list[Snapshot]] = {}
    for snapshot in measured.drive:
        frames.setdefault(snapshot.conditions.step, []).append(snapshot)
    steps = [
        number
        for number, step in enumerate(run.protocol, 1)
        if isinstance(step, Motion) and len(step.ends(0.0, 1.0, 1.0)) == 1 and number in frames
    ]
    if len(steps) < 2:
        return {}
    slides = [_slid(number, frames[number], measured.forces, slip_m) for number in steps]
    told = [slide for slide in slides if math.isfinite(slide.friction.peak)]
    lacking = [str(slide.step) for slide in told if not slide.by_samples]
    if 0 < len(lacking) < len(told):  # a peak by frames is lower: one law takes one kind
        slides = [_slid(number, frames[number], None, slip_m) for number in steps]
        notes.append(
            "slides: peaks and mu_d of all slides are those of frames, because samples of"
            f" {'step' if len(lacking) == 1 else 'steps'} {', '.join(lacking)} are missing or come"
            " after those that are kept; a peak between two frames is measured too low"
        )
    rows = []
    for i, slide in enumerate(slides):
        stopped = frames.get(slides[i - 1].step + 1) if i else None
        held = slide.began_s - _began_s(stopped) if stopped else 0.0
        before = slides[i - 1].friction if i and slides[i - 1].way == slide.way else Slide()
        now, rise = slide.friction, (math.nan, math.nan)
        if held > 0 and isinstance(run.protocol[slide.step - 2], Hold):
            rise = now.peak - before.mu_d, math.hypot(now.peak_sd, before.mu_d_sd)
        rows.append((slide.step, held, slide.velocity, *astuple(now), *rise))
    found: dict[str, Any] = dict(zip(COLUMNS, zip(*rows, strict=True), strict=True))
    if any(map(math.isfinite, found["slide_rise"])):
        ageing = fit_ageing(found["slide_hold_s"], found["slide_rise"], found["slide_rise_sd"])
        notes.extend(ageing.notes)
        found |= {
            "ageing_rate": ageing.rate,
            "ageing_rate_sd": ageing.rate_sd,
            "ageing_time_s": ageing.time,
            "ageing_time_sd_s": ageing.time_sd,
        }
    return found


def _began_s(frames: list[Snapshot]) -> float:
    """When a step began, in the time of the drive."""
    first = frames[0].conditions
    return first.time_s - first.step_time_s


def _slid(number: int, frames: list[Snapshot], forces: DriveForces | None, slip_m: float) -> _Slid:
    time, travel, P, Q = all_series(frames, "time_s", "travel_m", "normal_force_n", "shear_force_n")
    began_s, end_s, moved = _began_s(frames), float(time[-1]), abs(float(travel[-1] - travel[0]))
    way = math.copysign(1.0, travel[-1] - travel[0])
    ratio = np.divide(way * Q, P, out=np.full(len(P), np.nan), where=P > 0)
    velocity, joined, by_samples = math.nan, 1, False
    if len(frames) >= FEWEST_MOVING:  # the stage starts and stops within the first and the last
        velocity = float(np.polyfit(time[1:-1], travel[1:-1], 1)[0])
    if forces is not None and moved > 0 and slip_m > 0:
        most_s = (end_s - began_s) / FEWEST_BLOCKS
        block_s = min(slip_m / moved * float(time[-1] - time[0]) / WINDOW, most_s)
        sampled = way * sample_ratios(forces, began_s, end_s, block_s)
        by_samples = len(sampled) >= MIN_FRAMES
        if by_samples:
            ratio, joined = sampled, max(1, round(JOINED * BLOCK_S / block_s))
    return _Slid(number, began_s, way, velocity, slide_friction(ratio, joined), by_samples)
