"""An experiment that was measured elsewhere, recorded and analysed as a live run would have done
it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import closing
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from numpy.typing import NDArray

from analysis.dic import compile_kernels
from app.config import to_toml
from app.engine.feed import Feed
from app.engine.history import History
from app.engine.pipeline import Pipeline, sensor_chain, summarise
from app.engine.series import Series
from app.results import Counts, Event, Outcome, Phase, Snapshot
from app.session.versions import versions
from app.session.writer import LONGEST_GAP_S, SessionWriter
from app.settings import Config

FLUSH_EVERY = 16  # frames


@dataclass(frozen=True, slots=True)
class Measurements:
    """All of an experiment but its images.

    Attributes
    ----------
    volts : ndarray, shape (n, 2)
        Readings of the normal and the shear sensor, from sample 0 to the end of the last exposure
        or later; NaN where missing.
    positions : list of (int, float)
        Sample and position of the stage in metres, NaN where not known, at the end of each block;
        the last at the end of the readings.
    phases : list of (int, Phase)
        Sample on which each phase began.
    first_trigger : int
        Sample of trigger 0.
    source : str
        Where it came from, one sentence.
    """

    volts: NDArray[np.float64]
    positions: list[tuple[int, float]]
    phases: list[tuple[int, Phase]]
    first_trigger: int
    source: str


Taken = tuple[int, int, "NDArray[Any] | str"]  # trigger number, sample, image or why there is none


def analyse(
    config: Config,
    measured: Measurements,
    frames: Iterator[Taken],
    output: Path,
    on_frame: Callable[[int], None],
) -> Outcome:
    """How it ended, with the summary: a session at `output` with every frame analysed, which a
    replay repeats to the bit.

    `on_frame` is told the number of each frame when it is done. A file of that name is replaced.
    """
    process = psutil.Process()
    cpu, began = process.cpu_times(), time.monotonic()
    compile_kernels(config.correlation)
    pipeline = Pipeline(config, config.camera.shape)
    try:
        writer = _create(config, measured, pipeline, output)
    except BaseException:
        pipeline.close()
        raise
    with closing(writer):
        try:
            _write_measurements(config, measured, writer)
            counts, snapshots = _write_frames(config, measured, frames, pipeline, writer, on_frame)
        finally:
            pipeline.close()
        if pipeline.contact is not None:
            writer.write_contact(pipeline.contact)
        summary = summarise(config, snapshots, pipeline.contact, pipeline.notes)
        used = process.cpu_times()
        resources = {
            "cpu_s": round(used.user + used.system - cpu.user - cpu.system, 2),
            "wall_s": round(time.monotonic() - began, 2),
        }
        outcome = Outcome("done", measured.source, counts, summary, resources)
        writer.finish(outcome)
    return outcome


def _create(
    config: Config, measured: Measurements, pipeline: Pipeline, output: Path
) -> SessionWriter:
    return SessionWriter.create(
        output,
        config_toml=to_toml(config),
        sample_rate_hz=float(config.forces.sample_rate),
        frame_shape=config.camera.shape,
        frame_dtype=config.camera.dtype,
        exposure_samples=config.exposure_samples,
        divisor=config.camera.divisor,
        first_trigger=measured.first_trigger,
        pixel_m=config.camera.pixel,
        grid_x_px=pipeline.grid.x_px,
        grid_y_px=pipeline.grid.y_px,
        versions=versions(),
        compression=config.recording.compression,
        overwrite=True,
    )


def _write_measurements(config: Config, measured: Measurements, writer: SessionWriter) -> None:
    """Forces with their gaps, positions and phases."""
    volts = measured.volts
    forces = sensor_chain(config).forces(volts)
    missing = np.isnan(volts[:, 0]) | np.isnan(volts[:, 1])
    edges = [0, *(np.flatnonzero(np.diff(missing)) + 1).tolist(), len(volts)]
    longest = int(LONGEST_GAP_S * config.forces.sample_rate)
    for start, end in pairwise(edges):
        if not missing[start]:
            writer.append_samples(start, volts[start:end], forces[start:end])
            continue
        for first in range(start, end, longest):
            writer.append_gap(first, min(longest, end - first), "not among the imported forces")
    for sample, metres in measured.positions:
        writer.append_position(sample, metres)
    for sample, phase in measured.phases:
        writer.append_event(Event(sample, "phase", str(phase)))
    writer.append_event(Event(len(volts), "import", measured.source))
    writer.flush()


def _write_frames(
    config: Config,
    measured: Measurements,
    frames: Iterator[Taken],
    pipeline: Pipeline,
    writer: SessionWriter,
    on_frame: Callable[[int], None],
) -> tuple[Counts, list[Snapshot]]:
    history = History(float(config.forces.sample_rate), config.exposure_samples)
    feed = Feed(history, sensor_chain(config), measured.volts, measured.positions, measured.phases)
    series = Series()
    lost = 0
    for number, (index, sample, image) in enumerate(frames):
        if isinstance(image, str):
            lost += 1
            writer.append_lost_frame(index, sample, image)
        else:
            writer.append_frame(index, sample, image)
            feed.up_to(sample)
            snapshot = pipeline.step(index, sample, image, history.conditions(sample))
            if pipeline.reference_frame == index:
                writer.append_event(Event(sample, "reference", f"frame {index}"))
            writer.append_snapshot(snapshot)
            series.append(snapshot)
        if number % FLUSH_EVERY == 0:
            writer.flush()
        on_frame(index)
    received, samples = len(series), int(np.isfinite(measured.volts).all(axis=1).sum())
    counts = Counts(
        triggers=received + lost,
        frames_received=received,
        frames_recorded=received,
        frames_lost=lost,
        frames_analysed=received,
        samples=samples,
        samples_lost=len(measured.volts) - samples,
    )
    return counts, series.since(0)
