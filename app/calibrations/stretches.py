"""Stretches of a session's forces: while its block is free, and while its contact is pressed."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from analysis.arrays import F64
from analysis.calibration.cross_talk import PressedShare, pressed_share
from app.calibrations.calibration import Data
from app.calibrations.session_readings import recorded_readings
from app.evaluation.setup import sensor_chain
from app.records.record_types import Phase
from app.settings.protocol_steps import Approach
from app.settings.sections import Config

BEFORE_S, BEHIND_S, LONGEST_S = 5.0, 2.0, 60.0
PRESSED = (Phase.CONTACT, Phase.REFERENCE, Phase.DRIVE)


def free_forces(path: Path) -> tuple[F64, int]:
    """P and Q (n, 2) while the block is free, the longest stretch without a gap, and the samples
    per second.

    Raises
    ------
    UserError
        The session cannot be read.
    ValueError
        The block is never free in it.
    """
    config, volts, events = recorded_readings(path)
    presses = any(isinstance(step, Approach) for step in config.run.protocol)
    phases = (e.sample for e in events if e.kind == "phase" and e.text in PRESSED and presses)
    end = min(phases, default=len(volts))
    if not end:
        raise ValueError(
            f"{path.name}: the block is not free at any time; give a session that begins before the"
            " contact is pressed"
        )
    forces = sensor_chain(config).forces(volts[:end])
    edges = np.flatnonzero(np.diff(np.isfinite(forces).all(axis=1), prepend=False, append=False))
    first, last = max(edges.reshape(-1, 2).tolist(), key=np.ptp, default=(0, 0))
    return forces[first:last], config.forces.sample_rate


def pressed_readings(path: Path) -> tuple[F64, Config]:
    """Readings in newtons (n, 2) without any cross-talk taken off, from the free block until the
    load is steady, and the settings of the session.

    Raises
    ------
    UserError
        The session cannot be read.
    ValueError
        The contact was not pressed in it.
    """
    config, volts, events = recorded_readings(path)
    forces, rate = config.forces, config.forces.sample_rate
    phases = {e.text: e.sample for e in reversed(events) if e.kind == "phase"}
    if Phase.CONTACT not in phases:
        raise ValueError(
            f"{path.name}: the contact was not pressed; give a session with an approach"
        )
    pressed = phases[Phase.CONTACT]
    moves = min(phases.get(one, len(volts)) for one in (Phase.DRIVE, Phase.END))
    end = min(moves, phases.get(Phase.REFERENCE, moves) + round(BEHIND_S * rate))
    start = max(0, pressed - round(BEFORE_S * rate), end - round(LONGEST_S * rate))
    newtons = volts[start:end] * np.multiply(forces.sensitivity, forces.stiffness)
    known = np.isfinite(newtons).all(axis=1)
    return newtons[known], config


def split(data: Data) -> list[F64]:
    """The readings of each pressing, (n, 2)."""
    parts = np.split(data["readings"].astype(np.float64), np.cumsum(data["counts"])[:-1])
    return [part - np.median(part[: len(part) // 20 + 1], axis=0) for part in parts]


def shares_of(data: Data) -> list[PressedShare]:
    """What each pressing says; ValueError as `pressed_share`."""
    shares = []
    for number, part in enumerate(split(data), 1):
        try:
            shares.append(pressed_share(part, data["rate"]))
        except ValueError as error:
            raise ValueError(f"record {number}: {error}") from None
    return shares
