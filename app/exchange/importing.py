"""Images and forces of other benches and programs, made into a session: settings, times, phases."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.options import quantity
from app.config import load
from app.engine.analyst import Analysis
from app.engine.pipeline import Pipeline
from app.engine.setup import header_of, sensor_chain
from app.errors import UserError
from app.exchange.frames import (
    ImportedTrigger,
    Sources,
    files_of,
    first_image,
    image_or_reason,
    listed,
    numbered,
    with_lost,
)
from app.exchange.phases import chosen_phases, listed_phases, listed_steps
from app.exchange.tables import FORCES, FRAMES, Table, by_sample, clock_samples, read_table
from app.offline.loop import Measurements, Trigger, record_analysis
from app.records import Event, LostTrigger, Outcome, Phase, Position, ReceivedFrame
from app.session.checks import LONGEST_GAP_S
from app.session.files import check_new_session
from app.session.versions import versions
from app.settings import Config

F64 = NDArray[np.float64]

# largest difference, as a fraction of the largest force, between forces in newtons and those that
# follow from the readings in volts
DISAGREEMENT = 1e-3


@dataclass(frozen=True, slots=True)
class Imported:
    """How the import ended, and what was assumed, a sentence each."""

    outcome: Outcome
    remarks: tuple[str, ...]


def import_files(
    sources: Sources,
    output: Path,
    *,
    overwrite: bool = False,
    on_progress: Callable[[str, float], None] = lambda text, share: None,
) -> Imported:
    """Make a session at `output` of all images and forces, analysed as in a live run; it is
    complete or not there at all.

    Raises
    ------
    UserError, ConfigError
        Something can not be used, or is needed and missing.
    """
    check_new_session(output, overwrite, has_picture=False)
    remarks: list[str] = []
    sources, files = files_of(sources, remarks)
    table = read_table(sources.metadata, FRAMES) if sources.metadata else None
    frames = numbered(files, remarks) if table is None else listed(table, files, remarks)
    first = first_image(frames)
    forces = read_table(sources.forces, FORCES) if sources.forces else None
    config = _settings(sources, first, table, forces)
    if sources.settings is None:
        remarks.append(
            "no settings: the sample, the lens and the sensors are those that `slipscope config`"
            " prints"
        )
    places = None if table is None else _samples(table, config)
    for n, frame in enumerate(frames):
        frame.sample = frame.index * config.camera.divisor if places is None else round(places[n])
    frames = with_lost(frames)
    measured = _measurements(config, frames, table, forces, sources, remarks)
    missing = sum(frame.path is None for frame in frames)
    reason = f"imported: {len(frames) - missing} images, {missing} lost, from {sources.images[0]}"
    reason += f", forces from {sources.forces}" if sources.forces else ""
    measured.events.append(Event(len(measured.volts), "import", reason))

    def triggers() -> Iterator[Trigger]:
        for frame in frames:
            image = image_or_reason(frame, first)
            if isinstance(image, str):
                yield LostTrigger(frame.index, frame.sample, image), None
            else:
                yield ReceivedFrame(frame.index, frame.sample, image), image
            on_progress(f"frame {frame.index}", frame.index / (frames[-1].index + 1))

    first_trigger = max(0, frames[0].sample - frames[0].index * config.camera.divisor)
    outcome = record_analysis(
        Analysis(config, Pipeline(config)),
        measured,
        triggers(),
        header_of(config, versions(), first_trigger),
        output,
        lambda: reason,
        overwrite=overwrite,
    )
    return Imported(outcome, tuple(remarks))


def _settings(
    sources: Sources, first: NDArray[Any], table: Table | None, forces: Table | None
) -> Config:
    """The settings of the analysis: those given, with what the images and the options say."""
    if sources.settings is None:
        is_timed = table is not None and (table.has("sample") or table.has("time"))
        for given, option, what in (
            (sources.pixel_um, "--pixel", "the size of a pixel, um"),
            (
                sources.rate_hz,
                "--rate",
                "the samples of the forces per second (without forces: of the times of images), Hz",
            ),
            (
                sources.divisor or is_timed or None,
                "--divisor",
                "samples from one image to the next",
            ),
        ):
            if given is None:
                raise UserError(f"import: {what}, is not known; give {option}, or --settings")
    known: dict[str, Any] = {
        "camera.width": first.shape[1],
        "camera.height": first.shape[0],
        "camera.max_rate": 10000,  # they are taken already
        "camera.pixel": sources.pixel_um,
        "forces.sample_rate": sources.rate_hz,
        "camera.divisor": sources.divisor,
    }
    if forces is None:
        known["sample.lens_compliance"] = 0  # without Q nobody knows how far the lens moved
    overrides = [f"{key}={value}" for key, value in known.items() if value is not None]

    def loaded(*more: str) -> Config:
        return load(sources.settings, [*overrides, *sources.overrides, *more], recorded=True)

    if sources.divisor is None and table is not None:
        rate = loaded("camera.divisor=1000000").forces.sample_rate
        at = clock_samples(table, float(rate))
        if at is not None and len(at) > 1:
            numbers = table.numbers.get("frame", np.arange(table.rows))
            apart = float(np.median(np.diff(at) / np.diff(numbers)))
            overrides.append(f"camera.divisor={max(1, round(apart))}")
    config = loaded()
    if config.camera.dtype != first.dtype:
        word = "Mono8" if first.dtype == np.uint8 else "Mono16"
        config = loaded(f"camera.pixel_format={word}")
    return config


def _samples(table: Table, config: Config) -> F64:
    """The sample of each row; where the table has no times, that of its number."""
    at = clock_samples(table, float(config.forces.sample_rate))
    if at is not None:
        return at
    rows = np.arange(table.rows, dtype=np.float64)
    return table.numbers.get("frame", rows) * config.camera.divisor


def _measurements(
    config: Config,
    frames: list[ImportedTrigger],
    table: Table | None,
    forces: Table | None,
    sources: Sources,
    remarks: list[str],
) -> Measurements:
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
    phases = phases or chosen_phases(config, frames, volts, sources, remarks)
    if phases[-1][1] is not Phase.END:
        phases.append((end, Phase.END))
    ends = [*range(config.forces.block, end, config.forces.block), end]
    stage = np.full(len(ends), np.nan)
    for given in (forces, table):
        if given is not None and np.isfinite(given.numbers.get("stage", np.nan)).any():
            metres = given.numbers["stage"]
            at, known = _samples(given, config), np.isfinite(metres)
            middle = exposure / 2 if given is table else 0.0
            stage = np.interp(np.array(ends), at[known] + middle, metres[known])
            break
    gaps = _gaps(volts, int(LONGEST_GAP_S * rate))
    events = [Event(sample, "phase", str(phase)) for sample, phase in phases]
    events += [] if has_options else listed_steps(frames)
    events += [
        Event(first, "gap", f"{count} samples lost: not among the imported forces")
        for first, count in gaps
    ]
    positions = [Position(*one) for one in zip(ends, stage.tolist(), strict=True)]
    return Measurements(volts, gaps, positions, events)


def _gaps(volts: F64, longest: int) -> list[tuple[int, int]]:
    """First sample and length of the stretches without readings, none longer than `longest`."""
    missing = np.isnan(volts).any(axis=1)
    edges = np.flatnonzero(np.diff(missing, prepend=False, append=False))
    return [
        (first, min(longest, end - first))
        for begin, end in edges.reshape(-1, 2).tolist()
        for first in range(begin, end, longest)
    ]


def _volts(config: Config, table: Table) -> F64:
    """Readings by sample; for forces in newtons, those that the sensors of the settings would have
    given.
    """
    chain, rate = sensor_chain(config), float(config.forces.sample_rate)
    newtons = by_sample(table, ("p", "q"), rate) if table.has("p", "q") else None
    if not table.has("normal", "shear"):
        if newtons is None:
            raise UserError(
                f"{table.path}: the header has neither P_N and Q_N nor normal_V and shear_V; name"
                " the columns so"
            )
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
