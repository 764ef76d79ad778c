"""What a session says at the times of its pictures, and how well its forces are known."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from analysis.arrays import F64
from app.evaluation.setup import sensor_chain
from app.records.record_types import Event
from app.session.reader import SessionReader
from app.settings.config import settings_of
from app.settings.sections import Config
from app.system.errors import UserError

HALF = 5  # samples of a mean, on either side


@contextmanager
def opened(path: Path) -> Iterator[tuple[SessionReader, Config]]:
    """A session, and its settings; UserError if it cannot be read."""
    with SessionReader(path) as reader:
        yield reader, settings_of(reader)


def recorded_readings(path: Path) -> tuple[Config, F64, list[Event]]:
    """The settings of a session, the volts that its sensors read, shape (n, 2), and its events.

    Raises
    ------
    UserError
        It cannot be read.
    """
    with opened(path) as (reader, config):
        return config, reader.forces().volts, list(reader.events())


def times_of_frames(reader: SessionReader, most: int, from_s: float = 0.0) -> dict[int, float]:
    """Number and middle of the exposure (s) of up to so many frames, evenly chosen.

    Raises
    ------
    ValueError
        There are no pictures.
    """
    rate = reader.header.sample_rate_hz
    late = settings_of(reader).camera.exposure_samples(rate) / 2
    triggers = reader.triggers()
    triggers = triggers[triggers["received"] & (triggers["sample"] >= from_s * rate)]
    if not len(triggers):
        later = f" after {from_s:.3g} s" if from_s else ""
        raise ValueError(
            f"pictures: {reader.path} has none{later}; give a session whose camera took pictures"
        )
    every = max(1, -(-len(triggers) // most))
    return {int(t["index"]): (float(t["sample"]) + late) / rate for t in triggers[::every]}


def travel_of(reader: SessionReader, least_m: float = 0.0) -> tuple[F64, F64]:
    """Times (s, from the first sample) at which the stage was read, and its positions (m).

    Raises
    ------
    ValueError
        It was not read, or moves by less than `least_m`.
    """
    samples, position = reader.positions()
    moved = float(position.max() - position.min()) if len(position) else -1.0
    if moved < least_m:
        found = f"moves by {moved * 1e6:.3g} um" if len(position) else "was not read"
        raise ValueError(
            f"travel: the stage {found} in {reader.path}, {least_m * 1e6:.3g} um or more are"
            " needed; give a session in which it drives"
        )
    return samples / reader.header.sample_rate_hz, position


def readings_at(reader: SessionReader, time_s: F64, channel: str = "") -> list[F64]:
    """Mean Q (N) and, where it is named, a further channel around these times, each of shape (n,).

    Raises
    ------
    UserError
        There is no such channel.
    """
    header, samples = reader.header, reader.forces()
    columns = [samples.forces[:, 1]]
    if channel:
        names = list(header.auxiliary.name) if header.auxiliary else []
        if channel not in names or samples.auxiliary is None:
            raise UserError(
                f"{reader.path}: it has no channel '{channel}', but {', '.join(names) or 'none'};"
                " name one of forces.auxiliary"
            )
        columns.append(samples.auxiliary[:, names.index(channel)])
    middle = np.rint(time_s * header.sample_rate_hz).astype(int)
    return [
        np.array([column[max(0, at - HALF) : at + HALF].mean() for at in middle])
        for column in columns
    ]


def relative_sd_of_forces(config: Config) -> tuple[float, float]:
    """Relative standard uncertainties of P and Q, by the settings."""
    by_stiffness = sensor_chain(config).relative_uncertainty()
    normal, shear = (math.hypot(one, config.uncertainty.sensitivity) for one in by_stiffness)
    return normal, shear
