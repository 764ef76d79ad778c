"""The curves of a run so far: Q(delta), c(Q), and P and Q against time."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.mechanics import cattaneo_mindlin
from app.gui.source import Setup
from app.legs import REVERSED_M
from app.numbers import series_of
from app.records import F64, Phase, Snapshot
from app.summary import Summary

DRAWN = (
    "travel_m",
    "shear_force_n",
    "stick_radius_m",
    "stick_radius_sd_m",
    "peak_radius_m",
    "peak_radius_sd_m",
)
MOST_UNCERTAIN = 0.2  # radii of the largest traction are left out beyond this share of uncertainty


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """The run so far, one point per analysed frame on which the quantity could be measured.

    Attributes
    ----------
    seen : int
        Snapshots up to now.
    loading : ndarray, shape (n, 2)
        Travel (um) and Q (N).
    sticking : ndarray, shape (n, 3)
        Q (N), and the stick radius c with its standard uncertainty (mm).
    peaks : ndarray, shape (n, 2)
        Q (N), and the radius of the largest shear traction (mm).
    drive_start_s : float
        On the sample clock; NaN until the drive begins.
    newest, newest_field : Snapshot or None
        The newest snapshot, and the newest one with a displacement field.
    """

    seen: int
    loading: F64
    sticking: F64
    peaks: F64
    drive_start_s: float
    newest: Snapshot | None
    newest_field: Snapshot | None


NO_CURVES = Curves(0, np.empty((0, 2)), np.empty((0, 3)), np.empty((0, 2)), math.nan, None, None)


@dataclass(frozen=True, slots=True, eq=False)
class ForceStrips:
    """P and Q against time."""

    time_s: F64
    normal_n: F64
    shear_n: F64
    time_label: str


def extended(curves: Curves, snapshots: tuple[Snapshot, ...], setup: Setup) -> Curves:
    """`curves` with the points of newer `snapshots`; the same object if there are none."""
    if not snapshots:
        return curves
    loaded = [s for s in snapshots if s.conditions.phase not in (Phase.BACKGROUND, Phase.CONTACT)]
    travel, shear, stick, stick_sd, peak, peak_sd = (series_of(loaded, name) for name in DRAWN)
    # c belongs to the first loading: not to what comes after the stage has turned back
    before = curves.loading[:, 0].max(initial=0.0) * 1e-6
    furthest = np.maximum.accumulate(np.append(before, np.nan_to_num(travel)))[1:]
    loads = ~(travel < furthest - REVERSED_M)
    is_certain = loads & (peak_sd < MOST_UNCERTAIN * peak)
    stick = np.where(loads, stick, np.nan)
    newest, start_s = snapshots[-1], curves.drive_start_s
    if math.isfinite(newest.conditions.time_s):
        middle = newest.sample + setup.config.exposure_samples / 2
        start_s = middle / setup.config.forces.sample_rate - newest.conditions.time_s
    return Curves(
        curves.seen + len(snapshots),
        _with_points(curves.loading, travel * 1e6, shear),
        _with_points(curves.sticking, shear, stick * 1e3, np.nan_to_num(stick_sd * 1e3)),
        _with_points(curves.peaks, shear[is_certain], peak[is_certain] * 1e3),
        start_s,
        newest,
        next((s for s in reversed(snapshots) if s.field), curves.newest_field),
    )


def _with_points(curve: F64, *columns: F64) -> F64:
    """`curve` with those points, given by their columns, that have no NaN."""
    new = np.column_stack(columns)
    return np.concatenate([curve, new[np.isfinite(new).all(axis=1)]])


def force_strips(
    forces: tuple[NDArray[Any], F64, F64], drive_start_s: float, setup: Setup
) -> ForceStrips:
    """P and Q against time, which counts from the start of the drive once that is known."""
    samples, normal, shear = forces
    time_s = np.asarray(samples, float) / setup.config.forces.sample_rate
    if math.isfinite(drive_start_s):
        label = "time t from the start of the drive (s)"
        return ForceStrips(time_s - drive_start_s, normal, shear, label)
    return ForceStrips(time_s, normal, shear, "time from the first sample (s)")


def model_curve(summary: Summary, points: int = 200) -> tuple[F64, F64]:
    """Q (N) and stick radius c (mm) of Cattaneo and Mindlin's contact that slides at Q_s.

    The points are evenly spaced in c; there are none where Q_s is not known.
    """
    limit, a = summary.static_force_n, summary.hertz_radius_m
    if not (limit > 0 and a > 0):
        return np.empty(0), np.empty(0)
    Q = limit * (1 - np.linspace(1.0, 0.0, points) ** 3)
    return Q, 1e3 * cattaneo_mindlin.stick_radius(Q, limit, a)
