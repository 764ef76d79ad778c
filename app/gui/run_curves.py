"""What the curves of a run are made of so far: numbers of each analysed frame, and P and Q."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.robust import robust_sd
from app.gui.frame_results import full_slip
from app.gui.source import Setup
from app.records.legs import REVERSED_M
from app.records.record_types import F64, Phase, Snapshot
from app.records.snapshot_numbers import RADII, ring_displacements, series_of

DRAWN = (
    "travel_m",
    "shear_force_n",
    "normal_force_n",
    "stick_radius_m",
    "stick_radius_sd_m",
    "peak_radius_m",
    "peak_radius_sd_m",
)
MOST_UNCERTAIN = 0.2  # radii of the largest traction are left out beyond this share of uncertainty
MOST_POINTS = 16384  # of a curve: then every second one is kept


@dataclass(frozen=True, slots=True, eq=False)
class Curves:
    """The run so far, one point per analysed frame on which the quantity could be measured.

    Attributes
    ----------
    seen : int
        Snapshots up to now.
    every : int
        One frame of so many has a point: more of them in a long run.
    loading : ndarray, shape (n, 4)
        Travel (um), NaN where nothing read the stage, Q (N), time (s) and step of the protocol.
    sticking : ndarray, shape (n, 4)
        Q (N), the stick radius c with its standard uncertainty (mm), and P (N).
    peaks : ndarray, shape (n, 3)
        Q (N), the radius of the largest shear traction (mm), and P (N).
    sliding : ndarray, shape (n, 5)
        Time (s), and u_x (um) at `RADII` of a.
    noise : ndarray, shape (n, 3)
        Time on the sample clock (s), the noise of u_x (px), and the floor that the images set.
    full_slip : float
        Friction coefficient of the newest profile that gave c.
    drive_start_s : float
        On the sample clock; NaN until the drive begins, of a recorded run at once.
    newest, newest_field : Snapshot or None
        The newest snapshot, and the newest one with a displacement field.
    first_step : int or None
        Of the protocol, in which the drive began; None until it does.
    has_turned : bool
        Whether the first loading is over.
    """

    seen: int
    every: int
    loading: F64
    sticking: F64
    peaks: F64
    sliding: F64
    noise: F64
    full_slip: float
    drive_start_s: float
    newest: Snapshot | None
    newest_field: Snapshot | None
    first_step: int | None
    has_turned: bool


POINTS = ("loading", "sticking", "peaks", "sliding", "noise")
NO_CURVES = Curves(
    seen=0,
    every=1,
    loading=np.empty((0, 4)),
    sticking=np.empty((0, 4)),
    peaks=np.empty((0, 3)),
    sliding=np.empty((0, 1 + len(RADII))),
    noise=np.empty((0, 3)),
    full_slip=math.nan,
    drive_start_s=math.nan,
    newest=None,
    newest_field=None,
    first_step=None,
    has_turned=False,
)


def no_curves(setup: Setup) -> Curves:
    """Those of a run of which nothing was seen yet; a recorded one has the start of its drive."""
    line = setup.timeline
    if line is None or line.drive_start is None:
        return NO_CURVES
    return replace(NO_CURVES, drive_start_s=line.drive_start / line.sample_rate_hz)


@dataclass(frozen=True, slots=True, eq=False)
class ForceStrips:
    """P and Q against time."""

    time_s: F64
    normal_n: F64
    shear_n: F64
    time_label: str


def extended(
    curves: Curves, snapshots: tuple[Snapshot, ...], setup: Setup, radius_m: float = math.nan
) -> Curves:
    """`curves` with the points of newer `snapshots`; the same object if there are none. `radius_m`
    is a, where it is known.
    """
    if not snapshots:
        return curves
    at = np.array(RADII) * radius_m
    loaded = [
        s
        for n, s in enumerate(snapshots, curves.seen)
        if n % curves.every == 0 and s.conditions.phase not in (Phase.BACKGROUND, Phase.CONTACT)
    ]
    travel, shear, normal, stick, stick_sd, peak, peak_sd = (series_of(loaded, n) for n in DRAWN)
    # c belongs to the first loading: it ends where the stage turns back, and with the first step
    before = np.fmax.reduce(curves.loading[:, 0], initial=0.0) * 1e-6
    furthest = np.fmax.accumulate(np.append(before, travel))[1:]
    drives = np.array([s.conditions.phase is Phase.DRIVE for s in loaded], bool)
    steps = np.array([s.conditions.step for s in loaded], np.int64)
    time_s, first_step = series_of(loaded, "time_s"), curves.first_step
    is_placed = np.isfinite(shear) & (np.isfinite(travel) | np.isfinite(time_s))
    if first_step is None and drives.any():
        first_step = int(steps[drives][0])
    ends = (travel < furthest - REVERSED_M) | (drives & (steps != first_step))
    has_ended = np.logical_or.accumulate(np.append(curves.has_turned, ends))
    loads = ~has_ended[1:]
    is_certain = loads & (peak_sd < MOST_UNCERTAIN * peak)
    stick = np.where(loads, stick, np.nan)
    newest, start_s = snapshots[-1], curves.drive_start_s
    if math.isfinite(newest.conditions.time_s):
        start_s = middle_s(newest, setup) - newest.conditions.time_s
    longer = Curves(
        curves.seen + len(snapshots),
        curves.every,
        np.append(
            curves.loading, np.column_stack([travel * 1e6, shear, time_s, steps])[is_placed], axis=0
        ),
        _with_points(curves.sticking, shear, stick * 1e3, np.nan_to_num(stick_sd * 1e3), normal),
        _with_points(curves.peaks, *(values[is_certain] for values in (shear, peak * 1e3, normal))),
        _with_rows(
            curves.sliding,
            ([s.conditions.time_s, *1e6 * ring_displacements(s, at)] for s in loaded if s.rings),
        ),
        _with_rows(curves.noise, (_noise(s, setup) for s in loaded if s.field)),
        _full_slip(loaded, setup, curves.full_slip),
        start_s,
        newest,
        next((s for s in reversed(snapshots) if s.field), curves.newest_field),
        first_step,
        bool(has_ended[-1]),
    )
    kept = {name: getattr(longer, name) for name in POINTS}
    if max(map(len, kept.values())) <= MOST_POINTS:
        return longer
    halves = {name: points[::2].copy() for name, points in kept.items()}
    return replace(longer, every=2 * longer.every, **halves)


def middle_s(snapshot: Snapshot, setup: Setup) -> float:
    """Middle of the exposure on the sample clock."""
    middle = snapshot.sample + setup.config.exposure_samples / 2
    return middle / setup.config.forces.sample_rate


def _noise(snapshot: Snapshot, setup: Setup) -> list[float]:
    """Time, noise of u_x, and its floor. The noise is what differs between boxes that do not
    overlap: the median of second differences, in which the displacement hardly shows.
    """
    field, dic = snapshot.field, setup.config.dic
    assert field is not None
    apart = math.ceil(dic.box / dic.step)
    ux = field.ux_px[::apart]  # the boxes of rows between share their pixels
    if ux.shape[1] <= 2 * apart:
        return [math.nan] * 3
    second = ux[:, 2 * apart :] - 2 * ux[:, apart:-apart] + ux[:, : -2 * apart]
    second = second[np.isfinite(second)]
    floor = field.ux_std_px[::apart]
    floor = floor[np.isfinite(floor)]
    if not second.size:
        return [math.nan] * 3
    spread = robust_sd(second) / math.sqrt(6.0)
    lowest = float(np.median(floor)) if floor.size else math.nan
    return [middle_s(snapshot, setup), spread, lowest]


def _full_slip(snapshots: list[Snapshot], setup: Setup, before: float) -> float:
    """The friction coefficient of the newest profile that gave c, of `before` where none did."""
    for snapshot in reversed(snapshots):
        mu = full_slip(snapshot, setup.config)
        if snapshot.stick and snapshot.stick.stick_radius_m > 0 and math.isfinite(mu):
            return mu
    return before


def _with_rows(curve: F64, rows: Iterable[list[float]]) -> F64:
    """`curve` with those rows whose first number, a time, is known."""
    new = [row for row in rows if math.isfinite(row[0])]
    return np.concatenate([curve, np.array(new)]) if new else curve


def _with_points(curve: F64, *columns: F64) -> F64:
    """`curve` with those points, given by their columns, that have no NaN."""
    new = np.column_stack(columns)
    return np.concatenate([curve, new[np.isfinite(new).all(axis=1)]])


def force_strips(
    forces: tuple[NDArray[Any], F64, F64], drive_start_s: float, setup: Setup
) -> ForceStrips:
    """P and Q against time, which counts from the start of the drive once that is known."""
    samples, normal, shear = forces
    begins_s, label = time_axis(drive_start_s)
    time_s = np.asarray(samples, float) / setup.config.forces.sample_rate
    return ForceStrips(time_s - begins_s, normal, shear, label)


def time_axis(drive_start_s: float) -> tuple[float, str]:
    """From when on the sample clock times of a run count, and how their axis is called."""
    if math.isfinite(drive_start_s):
        return drive_start_s, "time t from the start of the drive (s)"
    return 0.0, "time from the first sample (s)"
