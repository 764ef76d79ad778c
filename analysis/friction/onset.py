"""Onset of sliding: t_s, Q_s, mu_s and mu_d from the central displacement and the forces (paper,
section 3, Figs 7 and 8).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import F64
from analysis.robust import serial_inflation, white_noise

FEWEST = 12  # frames in the fit of the sliding part
FEWEST_SETTLED = 6  # of them in steady sliding
BLOCK = 4  # frames by which the fit's window grows; in a long run a share of it
MOST_BLOCKS = 256
AGREE = 4.0  # standard deviations by which a block may leave the line and still belong to it
MARGIN = 0.2  # share of the constant-velocity part, next to the onset, that the fit leaves out
STILL_LOADING = 0.2  # share of the mean loading rate above which Q counts as still rising
# frames on each side of the one nearest to t_s from which Q_s is interpolated: Q bends there
FORCE_FRAMES = 1
NORMAL_FRAMES = 8  # the same for P, which is nominally constant


@dataclass(frozen=True, slots=True, kw_only=True)
class Onset:
    """The transition to sliding. Every number is NaN where the run did not reach sliding; `notes`
    then gives the reason.

    Attributes
    ----------
    time, time_sd : float
        t_s: where the straight line through the central u_x at long times meets u_x = 0, and its
        standard uncertainty, s.
    velocity, velocity_sd : float
        Slope of that line, m/s.
    static_force, static_force_sd : float
        Q_s, the shear force at t_s, N.
    mu_s, mu_s_sd : float
        Q_s / P.
    mu_d, mu_d_sd : float
        Mean of Q/P from t_s on.
    mu_d_range : (float, float)
        Least and greatest Q/P from t_s on, the paper's error bar.
    window : (float, float)
        First and last time of the fit, s.
    notes : tuple of str
        What the numbers rest on, or why there are none.
    """

    time: float = np.nan
    time_sd: float = np.nan
    velocity: float = np.nan
    velocity_sd: float = np.nan
    static_force: float = np.nan
    static_force_sd: float = np.nan
    mu_s: float = np.nan
    mu_s_sd: float = np.nan
    mu_d: float = np.nan
    mu_d_sd: float = np.nan
    mu_d_range: tuple[float, float] = (np.nan, np.nan)
    window: tuple[float, float] = (np.nan, np.nan)
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class _Line:
    """A least-squares line through points that scatter by `noise` about it; `spread` is the sum of
    squared distances from `middle`.
    """

    middle: float
    mean: float
    slope: float
    noise: float
    spread: float
    count: int

    @property
    def zero(self) -> float:
        """Where the line meets 0."""
        return self.middle - self.mean / self.slope

    def at(self, x: F64 | float) -> F64:
        return np.asarray(self.mean + self.slope * (x - self.middle))

    def variance_at(self, x: float) -> float:
        return float(self.noise**2 * (1 / self.count + (x - self.middle) ** 2 / self.spread))


def sliding_onset(
    time: ArrayLike,
    centre_ux: ArrayLike,
    shear_force: ArrayLike,
    normal_force: ArrayLike,
    *,
    shared_sd: float = 0.0,
    settled: float = 0.0,
) -> Onset:
    """Time, static force and friction coefficients of the transition to sliding.

    Parameters
    ----------
    time : array_like, shape (n,)
        Time of each frame from the start of the drive, s, increasing.
    centre_ux : array_like, shape (n,)
        u_x at the contact's centre, m; frames with a NaN anywhere are ignored.
    shear_force, normal_force : array_like, shape (n,) or scalar
        Q and P during each frame, N.
    shared_sd : float
        Uncertainty of `centre_ux` that all frames share, m: that of the reference image.
    settled : float
        u_x at the centre (m) from which sliding is steady: under the local law the whole traction
        is there only after some mu L of slip, and a line fitted before gives t_s too early.

    Notes
    -----
    The line is fitted to the largest final part of the run over which u_x grows at constant
    velocity: starting from the last half of the rise of u_x, the part grows backwards as long as
    the next block of four agrees with the line within four standard deviations. Its first fifth,
    next to the rounded onset, is left out. Uncertainties allow for the correlation of successive
    residuals.

    References
    ----------
    Prevost et al. 2013, section 3, Fig. 7 (t_s, Q_s) and Fig. 8 (mu_s, mu_d).
    """
    columns = (np.asarray(v, float) for v in (time, centre_ux, shear_force, normal_force))
    table = np.stack([np.ravel(c) for c in np.broadcast_arrays(*columns)])
    t, u, q, p = table[:, np.isfinite(table).all(axis=0)]
    if len(t) < 2 * FEWEST:
        why = (
            f"onset: {len(t)} frames of the drive were measured; {2 * FEWEST} or more are needed"
            " for t_s"
        )
        return Onset(notes=(why,))
    if not (np.diff(t) > 0).all():
        return Onset(notes=("onset: the times of the frames do not increase; give them in order",))
    if not (p > 0).all():
        why = (
            f"onset: the normal force falls to {p.min():.3g} N during the drive; without contact"
            " there is no friction"
        )
        return Onset(notes=(why,))

    first = _constant_velocity_start(t, u)
    start = first + int(MARGIN * (len(t) - first - FEWEST))
    early = np.flatnonzero(u <= settled) if settled > 0 else np.empty(0, np.intp)
    slid = int(early[-1]) + 1 if len(early) else 0
    if len(t) - slid < FEWEST_SETTLED:
        why = (
            f"onset: {len(t) - slid} frames slid by more than {settled * 1e6:.3g} um, from where on"
            f" sliding is steady, and {FEWEST_SETTLED} are needed for t_s; drive further"
        )
        return Onset(notes=(why,))
    start = max(start, slid)
    line = _fit(t[start:], u[start:])
    why = _not_sliding(t, q, start, line)
    if why:
        return Onset(notes=(why,))

    ts = line.zero
    ts_sd = float(np.hypot(np.sqrt(line.variance_at(ts)), shared_sd)) / line.slope
    shear = _fit(*_around(t, q, ts, FORCE_FRAMES))
    normal = _fit(*_around(t, p, ts, NORMAL_FRAMES))
    static, load = float(shear.at(ts)), float(normal.mean)
    static_sd = float(np.hypot(white_noise(q) / np.sqrt(shear.count), shear.slope * ts_sd))
    load_sd = normal.noise / np.sqrt(normal.count)
    dynamic = (q / p)[t >= ts]
    scatter = _fit(t[t >= ts], dynamic)
    note = (
        f"onset: line through the central u_x from {t[start]:.2f} to {t[-1]:.2f} s ({line.count}"
        " frames)"
    )
    return Onset(
        time=float(ts),
        time_sd=ts_sd,
        velocity=line.slope,
        velocity_sd=line.noise / np.sqrt(line.spread),
        static_force=static,
        static_force_sd=static_sd,
        mu_s=static / load,
        mu_s_sd=float(np.hypot(static_sd, static / load * load_sd) / load),
        mu_d=float(dynamic.mean()),
        mu_d_sd=scatter.noise / np.sqrt(scatter.count),
        mu_d_range=(float(dynamic.min()), float(dynamic.max())),
        window=(float(t[start]), float(t[-1])),
        notes=(note,),
    )


def _fit(x: F64, y: F64) -> _Line:
    """Least-squares line; its noise is widened for the correlation of successive residuals."""
    middle, mean = float(x.mean()), float(y.mean())
    dx = x - middle
    spread = float(dx @ dx)
    slope = float(dx @ (y - mean)) / spread
    residual = y - mean - slope * dx
    power = float(residual @ residual)
    inflation = serial_inflation(residual) if len(x) >= FEWEST else 1.0
    noise = float(np.sqrt(power / max(len(x) - 2, 1) * inflation))
    return _Line(middle, mean, slope, noise, spread, len(x))


def _constant_velocity_start(t: F64, u: F64) -> int:
    """Index of the first frame of the final part in which u grows at constant velocity."""
    # u grows from 0 at t_s, so the last half of its rise is the last half of the sliding; shorter
    # starts are at the mercy of slow errors
    final, block = float(np.median(u[-BLOCK:])), max(BLOCK, len(t) // MOST_BLOCKS)
    lower = np.flatnonzero(u <= 0.5 * final)
    start = min(lower[-1] + 1 if len(lower) else 0, len(t) - FEWEST)
    while start > 0:
        line = _fit(t[start:], u[start:])
        before = slice(max(start - block, 0), start)
        miss = np.mean(u[before] - line.at(t[before]))
        block_variance = line.noise**2 / (before.stop - before.start)
        if abs(miss) > AGREE * np.sqrt(block_variance + line.variance_at(float(t[before].mean()))):
            return start
        start = before.start
    return 0


def _not_sliding(t: F64, q: F64, start: int, line: _Line) -> str:
    """Why the end of the run is not steady sliding; empty if it is."""
    slope_sd = line.noise / np.sqrt(line.spread)
    if line.slope < 10 * slope_sd or line.slope <= 0:
        return (
            f"onset: the centre moves at {line.slope * 1e6:.3g} +- {slope_sd * 1e6:.2g} um/s at the"
            " end of the run, so sliding was not reached; drive further"
        )
    if not t[FORCE_FRAMES] < line.zero < t[start]:
        return (
            f"onset: the line through the central u_x meets zero at {line.zero:.3g} s, outside the"
            f" {t[FORCE_FRAMES]:.3g} to {t[start]:.3g} s before its fit, so the onset was not seen;"
            " drive further"
        )
    rise = q[start:].mean() - q[0]
    loading = abs(rise) / (t[start:].mean() - t[0])
    rising = _fit(t[start:], q[start:]).slope
    if rising * np.sign(rise) > STILL_LOADING * loading:
        return (
            f"onset: Q still rises at {abs(rising) * 1e3:.3g} mN/s at the end of the run"
            f" ({loading * 1e3:.3g} mN/s on average), so sliding was not reached; drive further"
        )
    return ""


def _around(t: F64, y: F64, ts: float, frames: int) -> tuple[F64, F64]:
    """The frames within `frames` of `ts`."""
    nearest = int(np.argmin(np.abs(t - ts)))
    near = slice(max(nearest - frames, 0), nearest + frames + 1)
    return t[near], y[near]
