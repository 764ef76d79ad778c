"""Images and forces of other benches and programs, made into a session: settings, times and phases."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.options import quantity
from app.config import load
from app.engine.pipeline import sensor_chain
from app.errors import UserError
from app.exchange.analysing import Measurements, analyse
from app.exchange.frames import (
    Sources,
    Trigger,
    files_of,
    first_image,
    image_or_reason,
    listed,
    numbered,
    with_lost,
)
from app.exchange.tables import FORCES, FRAMES, Table, by_sample, clock_samples, read_table
from app.results import Outcome, Phase
from app.session.files import check_new_session, new_session
from app.settings import Config

# between forces in newtons and those that the readings in volts mean, of the largest
DISAGREEMENT = 1e-3
FOOT = (0.05, 0.15)  # shares of the rise of Q through which a line leads back to its start
SMOOTH_S = 0.05  # Q is averaged over so much to find it
RISE = 6.0  # standard deviations of Q before it that are no rise


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
    """A session at `output` with all images, forces and results, complete or not there at all; what
    became of it.

    Raises
    ------
    UserError, ConfigError
        Something can not be used, or is needed and not known.
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
    _place(frames, table, config)
    frames = with_lost(frames)
    measured = _measurements(config, frames, table, forces, sources, remarks)
    taken = ((f.index, f.sample, image_or_reason(f, first)) for f in frames)
    with new_session(output, overwrite) as unfinished:
        outcome = analyse(
            config,
            measured,
            taken,
            unfinished,
            lambda index: on_progress(f"frame {index}", index / (frames[-1].index + 1)),
        )
    return Imported(outcome, tuple(remarks))


def _settings(
    sources: Sources, first: NDArray[Any], table: Table | None, forces: Table | None
) -> Config:
    """The settings of the analysis: those given, with what the images and the options say."""
    if sources.settings is None:
        is_timed = sources.divisor is not None or (
            table is not None and (table.has("sample") or table.has("time"))
        )
        for known, option, what in (
            (sources.pixel_um, "--pixel", "the size of a pixel, um"),
            (
                sources.rate_hz,
                "--rate",
                "the samples of the forces per second (without forces: of the times of images), Hz",
            ),
            (is_timed or None, "--divisor", "samples from one image to the next"),
        ):
            if known is None:
                raise UserError(f"import: {what}, is not known; give {option}, or --settings")
    asked: dict[str, Any] = {
        "camera.width": first.shape[1],
        "camera.height": first.shape[0],
        "camera.max_rate": 10000,  # they are taken already
        "camera.pixel": sources.pixel_um,
        "forces.sample_rate": sources.rate_hz,
        "camera.divisor": sources.divisor,
    }
    if forces is None:
        asked["sample.lens_compliance"] = 0  # without Q nobody knows how far the lens moved
    overrides = [f"{key}={value}" for key, value in asked.items() if value is not None]
    if sources.divisor is None and table is not None:
        rate = load(
            sources.settings, [*overrides, *sources.overrides, "camera.divisor=1000000"]
        ).forces.sample_rate
        at = clock_samples(table, float(rate))
        if at is not None and len(at) > 1:
            numbers = table.numbers.get("frame", np.arange(table.rows))
            overrides.append(
                f"camera.divisor={max(1, round(float(np.median(np.diff(at) / np.diff(numbers)))))}"
            )
    config = load(sources.settings, [*overrides, *sources.overrides])
    if config.camera.dtype != first.dtype:
        word = "Mono8" if first.dtype == np.uint8 else "Mono16"
        config = load(
            sources.settings, [*overrides, *sources.overrides, f"camera.pixel_format={word}"]
        )
    return config


def _place(frames: list[Trigger], table: Table | None, config: Config) -> None:
    """Give each frame its sample."""
    at = None if table is None else _samples(table, config)
    for i, frame in enumerate(frames):
        frame.sample = frame.index * config.camera.divisor if at is None else round(float(at[i]))


def _samples(table: Table, config: Config) -> NDArray[np.float64]:
    """The sample of each row; of images without times that of their number."""
    at = clock_samples(table, float(config.forces.sample_rate))
    return (
        table.numbers.get("frame", np.arange(table.rows, dtype=np.float64)) * config.camera.divisor
        if at is None
        else at
    )


def _measurements(
    config: Config,
    frames: list[Trigger],
    table: Table | None,
    forces: Table | None,
    sources: Sources,
    remarks: list[str],
) -> Measurements:
    exposure = config.exposure_samples
    volts = np.empty((0, 2)) if forces is None else _volts(config, forces)
    end = max(len(volts), frames[-1].sample + exposure)
    volts = np.concatenate([volts, np.full((end - len(volts), 2), np.nan)])
    if forces is None:
        remarks.append(
            "no forces: P, Q and what follows from them are not known; the displacement fields are"
        )
    phases = _listed_phases(frames) if table is not None and not _asked_phases(sources) else []
    phases = phases or _phases(config, frames, volts, sources, remarks)
    if phases[-1][1] is not Phase.END:
        phases.append((end, Phase.END))
    ends = [*range(config.forces.block, end, config.forces.block), end]
    stage = np.full(len(ends), np.nan)
    for found in (forces, table):
        if found is not None and found.has("stage") and np.isfinite(found.numbers["stage"]).any():
            at, known = _samples(found, config), np.isfinite(found.numbers["stage"])
            middle = exposure / 2 if found is table else 0.0
            stage = np.interp(np.array(ends), at[known] + middle, found.numbers["stage"][known])
            break
    missing = sum(frame.path is None for frame in frames)
    source = (
        f"imported: {len(frames) - missing} images, {missing} lost, from {sources.images[0]}"
        + (f", forces from {sources.forces}" if sources.forces else "")
    )
    first_trigger = max(0, frames[0].sample - frames[0].index * config.camera.divisor)
    return Measurements(
        volts, list(zip(ends, stage.tolist(), strict=True)), phases, first_trigger, source
    )


def _volts(config: Config, table: Table) -> NDArray[np.float64]:
    """Readings by sample; of forces in newtons those that the settings' sensors would have had."""
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
        off = np.abs(chain.forces(volts) - newtons)
        if off.size and np.nanmax(off, initial=0.0) > DISAGREEMENT * np.nanmax(
            np.abs(newtons), initial=1e-3
        ):
            raise UserError(
                f"{table.path}: the readings in volts mean forces that are up to"
                f" {np.nanmax(off):.3g} N from those in newtons by the"
                f" settings ({quantity(config.forces, 'sensitivity_shear')},"
                f" {quantity(config.forces, 'stiffness_shear')} for Q); give the --settings"
                " of the bench, or leave the wrong columns out"
            )
    return volts


def _asked_phases(sources: Sources) -> bool:
    return any(
        number is not None for number in (sources.background, sources.reference, sources.drive)
    )


def _listed_phases(frames: list[Trigger]) -> list[tuple[int, Phase]]:
    """The phases that the metadata names; none where it names none."""
    phases: list[tuple[int, Phase]] = []
    for frame in frames:
        if frame.phase and (not phases or frame.phase != phases[-1][1]):
            if frame.phase not in tuple(Phase):
                raise UserError(
                    f"metadata: phase '{frame.phase}' of frame {frame.index} is not known; there"
                    f" are {', '.join(Phase)}"
                )
            began = frame.phase_sample if 0 <= frame.phase_sample <= frame.sample else frame.sample
            phases.append((began if phases else 0, Phase(frame.phase)))
    if phases and Phase.REFERENCE not in [phase for _, phase in phases]:
        raise UserError("metadata: no frame is of phase reference; name one, or give --reference")
    return phases


def _phases(
    config: Config,
    frames: list[Trigger],
    volts: NDArray[np.float64],
    sources: Sources,
    remarks: list[str],
) -> list[tuple[int, Phase]]:
    """The phases by the frames that were asked for; without --drive from where Q rises."""
    there = {frame.index: frame.sample for frame in frames if frame.path is not None}
    first = (
        min(index for index in there if index != sources.background)
        if len(there) > 1
        else min(there)
    )
    asked = {
        "--background": sources.background,
        "--reference": sources.reference if sources.reference is not None else first,
    }
    for option, index in asked.items():
        if index is not None and index not in there:
            raise UserError(
                f"{option}: frame {index} was asked, there is no image of it; frames {min(there)}"
                f" to {max(there)} are there"
            )
    exposure, reference = config.exposure_samples, there[asked["--reference"] or 0]
    rest = reference + exposure
    phases = [(0, Phase.CONTACT), (reference, Phase.REFERENCE)]
    if asked["--background"] is not None:
        free = there[asked["--background"]] + exposure
        if free > reference:
            raise UserError(
                f"--background: frame {asked['--background']} does not come before the reference;"
                " choose another"
            )
        phases = [(0, Phase.BACKGROUND), (free, Phase.CONTACT), (reference, Phase.REFERENCE)]
    if sources.drive is not None:
        drive = next((frame.sample for frame in frames if frame.index == sources.drive), -1)
        if drive < rest:
            raise UserError(
                f"--drive: frame {sources.drive} is not one after the reference (frame"
                f" {asked['--reference']}); choose another"
            )
    elif np.isfinite(volts[rest:]).any():
        drive = rest + _rise(
            sensor_chain(config).forces(volts[rest:])[:, 1], config.forces.sample_rate
        )
        remarks.append(
            f"the drive begins at sample {drive} ({drive / config.forces.sample_rate:.3f} s), where"
            " Q begins to rise"
        )
    else:
        drive = next((frame.sample for frame in frames if frame.sample >= rest), rest)
        remarks.append(
            "the drive is taken to begin on the frame after the reference; --drive says another"
        )
    remarks.append(f"the reference is frame {asked['--reference']}")
    return [*phases, (drive, Phase.DRIVE)]


def _rise(shear: NDArray[np.float64], rate: float) -> int:
    """Sample on which Q leaves its rest: a line through 5 and 15 % of the rise to its greatest
    value, led back to 0.

    Raises
    ------
    UserError
        It does not rise.
    """
    width = max(1, round(SMOOTH_S * rate))
    blocks = shear[: len(shear) // width * width].reshape(-1, width)
    mean = blocks.mean(axis=1)[np.isfinite(blocks).all(axis=1)]
    middle = ((np.arange(len(blocks)) + 0.5) * width)[np.isfinite(blocks).all(axis=1)]
    if len(mean) < 4:
        raise UserError(
            "import: too few forces after the reference to find where Q rises; say where the drive"
            " begins with --drive"
        )
    top = int(np.argmax(np.abs(mean)))
    rest = np.median(mean[: max(1, int(np.argmax(np.abs(mean) > 0.5 * np.abs(mean[top]))))][:20])
    noise = float(np.nanstd(np.diff(shear)) / np.sqrt(2 * width))
    height = abs(mean[top] - rest)
    shares = np.abs(mean[: top + 1] - rest) / max(height, 1e-300)
    if top < 2 or height < RISE * noise or shares.min() >= FOOT[0]:
        raise UserError(
            f"import: Q does not rise after the reference (by {height:.3g} N at most); say where"
            " the drive begins with --drive"
        )
    feet = []
    for level in FOOT:
        below = int(np.flatnonzero(shares < level)[-1])
        step = (level - shares[below]) / (shares[below + 1] - shares[below])
        feet.append(middle[below] + step * (middle[below + 1] - middle[below]))
    start = feet[0] - FOOT[0] * (feet[1] - feet[0]) / (FOOT[1] - FOOT[0])
    return max(0, round(float(start)))
