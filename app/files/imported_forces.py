"""The forces and places of an import as a session has them: volts by sample, phases, gaps."""

from __future__ import annotations

import math

import numpy as np

from analysis.arrays import F64
from analysis.options import quantity
from app.evaluation.setup import sensor_chain
from app.files.frames import ImportedTrigger, Sources
from app.files.phases import chosen_phases, listed_phases, listed_steps
from app.files.text_tables import TextTable, by_sample, clock_samples
from app.records.quantities import counted
from app.records.record_types import Event, Phase, Position
from app.replay.loop import Measurements
from app.session.checks import LONGEST_GAP_S
from app.settings.sections import Config
from app.system.errors import UserError

# largest difference, as a fraction of the largest force, between forces in newtons and those that
# follow from the readings in volts
DISAGREEMENT = 1e-3
FINEST_HZ = 500  # a slower clock of forces is divided, so that images have their place on it
# samples that were not measured are stored, too: beyond, an image lies at most 50 us off its place
MOST_HZ = 10_000
EVEN = 0.02  # a mean so close to the median is taken: times since 1970 are rounded to 0.24 us


def measurements_of(
    config: Config,
    frames: list[ImportedTrigger],
    table: TextTable | None,
    places: F64,
    forces: TextTable | None,
    sources: Sources,
    remarks: list[str],
) -> tuple[Measurements, float]:
    """What an import gives beside its images, and the standard uncertainty (s) of the start of a
    drive that was looked for; what is not known is among the remarks. `places` are those of the
    rows of `table` on the sample clock.
    """
    exposure, rate = config.exposure_samples, config.forces.sample_rate
    volts = np.empty((0, 2)) if forces is None else _volts(config, forces)
    end = max(len(volts), frames[-1].sample + exposure)
    volts = np.concatenate([volts, np.full((end - len(volts), 2), np.nan)])
    if forces is None:
        remarks.append(
            "no forces: P, Q and what follows from them are not known; the displacement fields are"
        )
    has_options = (sources.background, sources.reference, sources.drive) != (None, None, None)
    phases = [] if has_options else listed_phases(frames)
    start_sd_s = 0.0
    if not phases:
        phases, start_sd_s = chosen_phases(config, frames, volts, sources, remarks)
    if phases[-1][1] is not Phase.END:
        phases.append((end, Phase.END))
    # a phase is known from the end of the block before it, so that each begins a block
    ends = sorted(
        {*range(config.forces.block, end, config.forces.block), end}
        | {sample for sample, _ in phases if 0 < sample < end}
    )
    stage = np.full(len(ends), np.nan)
    for given in (forces, table):
        if given is not None and np.isfinite(given.numbers.get("stage", np.nan)).any():
            metres = given.numbers["stage"]
            at = clock_samples(given, float(rate)) if given is forces else places + exposure / 2
            assert at is not None  # forces have times or a rate
            known = np.isfinite(metres)
            stage = np.interp(np.array(ends), at[known], metres[known])
            break
    gaps = _gaps(volts, int(LONGEST_GAP_S * rate))
    events = [Event(sample, "phase", str(phase)) for sample, phase in phases]
    events += [] if has_options else listed_steps(frames)
    known = np.flatnonzero(np.isfinite(volts).all(axis=1))
    begins, ends_at = (int(known[0]), int(known[-1])) if len(known) else (end, 0)

    def fate(first: int) -> str:
        if forces is None:
            return "not there: no forces were given"
        if begins <= first <= ends_at:
            return "lost: not among the imported forces"
        return f"not there: the table {'begins later' if first < begins else 'ends earlier'}"

    events += [
        Event(first, "gap", f"{counted(count, 'sample')} {fate(first)}") for first, count in gaps
    ]
    positions = [Position(*one) for one in zip(ends, stage.tolist(), strict=True)]
    return Measurements(volts, gaps, positions, events), start_sd_s


def rate_of(sources: Sources, given: set[str], forces: TextTable | None) -> int | None:
    """The rate of the sample clock (Hz) where nobody gives it: that of the forces, or a small
    multiple of at most `MOST_HZ`, on whose samples the images lie if one is found; None without
    times of forces.
    """
    if sources.rate_hz is not None or "forces.sample_rate" in given:
        return sources.rate_hz
    if forces is None or not forces.has("time"):
        return None
    times_s = forces.numbers["time"]
    steps = np.diff(times_s[np.isfinite(times_s)])
    if not len(steps) or not (step := float(np.median(steps))) > 0:
        return None  # told by who reads the times
    if abs((mean := float(steps.mean())) / step - 1) < EVEN:
        step = mean
    rate = float(f"{1 / step:.3g}") if 1 / step >= 10 else 1 / step
    least = max(1, math.ceil(FINEST_HZ / rate))
    rows = rate / (sources.frame_rate or rate)  # from one image to the next
    near = (n for n in range(least, least + 8) if n * rate <= MOST_HZ)
    whole = (n for n in near if (n * rows).is_integer())
    return max(1, round(rate * next(whole, least)))


def _gaps(volts: F64, longest: int) -> list[tuple[int, int]]:
    """First sample and length of the stretches without readings, none longer than `longest`."""
    missing = np.isnan(volts).any(axis=1)
    edges = np.flatnonzero(np.diff(missing, prepend=False, append=False))
    return [
        (first, min(longest, end - first))
        for begin, end in edges.reshape(-1, 2).tolist()
        for first in range(begin, end, longest)
    ]


def _volts(config: Config, table: TextTable) -> F64:
    """Readings by sample; for forces in newtons, those that the sensors of the settings would have
    given.
    """
    chain, rate = sensor_chain(config), float(config.forces.sample_rate)
    newtons = by_sample(table, ("p", "q"), rate) if table.has("p", "q") else None
    if newtons is not None and not table.has("normal", "shear"):
        return chain.volts(newtons)
    volts = by_sample(table, ("normal", "shear"), rate)
    if newtons is not None:
        off = np.nanmax(np.abs(chain.forces(volts) - newtons), initial=0.0)
        if off > DISAGREEMENT * np.nanmax(np.abs(newtons), initial=1e-3):
            raise UserError(
                f"{table.path}: the readings in volts mean forces that are up to {off:.3g} N from"
                " those in newtons by the settings"
                f" ({quantity(config.forces, 'sensitivity_shear')},"
                f" {quantity(config.forces, 'stiffness_shear')} for Q); give the --settings of the"
                " bench, or leave the wrong columns out"
            )
    return volts
