"""The legs of a drive that turns back, and the instants of one that are shown."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.arrays import F64, floats
from analysis.friction.cycles import branches
from app.records.record_types import Phase, Snapshot
from app.records.snapshot_numbers import series_of
from app.records.summary import Summary

REVERSED_M = 3e-6  # way back of the stage from which it is a reversal
# five instants on the way to t_s, and one in sliding or at the end, as multiples of t_s
INSTANTS = (0.19, 0.38, 0.57, 0.76, 0.95, 1.4)


def legs_of(drive: Sequence[Snapshot]) -> list[slice]:
    """The parts of a drive between its reversals, each with the frame at which it turned."""
    return branches(series_of(drive, "travel_m"), least=REVERSED_M) if drive else []


def first_loading(drive: Sequence[Snapshot]) -> list[Snapshot]:
    """The frames of a drive up to its first reversal, and of its first step only: a hold or another
    velocity ends it too.
    """
    rows = first_loading_rows(series_of(drive, "travel_m"), [s.conditions.step for s in drive])
    return [drive[i] for i in rows.tolist()]


def first_loading_rows(travel_m: ArrayLike, step: ArrayLike) -> NDArray[np.intp]:
    """The same as places in a drive, of the stage's travel and the protocol's step in each of its
    frames.
    """
    travel, steps = floats(travel_m), np.asarray(step)
    legs = branches(travel, least=REVERSED_M) if len(travel) else []
    rows = np.arange(len(travel))[legs[0] if len(legs) > 1 else slice(None)]
    others = np.flatnonzero(steps[rows] != steps[rows[:1]])
    return rows[: others[0]] if len(others) else rows


def stage_travel(
    travel_m: ArrayLike, time_s: ArrayLike, step: ArrayLike, velocity_m_s: float
) -> tuple[F64, bool]:
    """Displacement of the stage (metres) in the frames of a drive, and whether it is v t: where
    nothing read the stage, as in imported data, the first loading is a steady drive at the velocity
    of sliding, and beyond it the displacement is NaN.
    """
    travel = np.array(travel_m, np.float64)
    if np.isfinite(travel).any():
        return travel, False
    rows = first_loading_rows(travel, step)
    travel[rows] = velocity_m_s * np.asarray(time_s, np.float64)[rows]
    return travel, bool(np.isfinite(travel).any())


def numbered_instants(snapshots: Sequence[Snapshot], summary: Summary | None) -> list[int]:
    """Positions in `snapshots` of the six instants that are shown.

    They have forces, if any frame has, and lie in the first loading; where t_s is not known, or
    not reached in it, they share the whole drive evenly. There are fewer than six in a drive of
    fewer frames.
    """
    driven = [
        i
        for i, s in enumerate(snapshots)
        if s.conditions.phase is Phase.DRIVE and math.isfinite(s.conditions.time_s)
    ]
    driven = [i for i in driven if snapshots[i].conditions.has_forces] or driven
    if not driven:
        return []
    drive = [snapshots[i] for i in driven]
    time_s = series_of(drive, "time_s")
    wanted = [time_s[-1] * k / 6 for k in range(1, 7)]
    onset = summary.onset_time_s if summary else math.nan
    loaded = first_loading(drive)[-1].conditions.time_s
    if 0 < onset < loaded:
        wanted = [min(loaded, share * onset) for share in INSTANTS]
    return sorted({driven[np.abs(time_s - t).argmin()] for t in wanted})
