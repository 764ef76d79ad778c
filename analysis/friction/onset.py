"""Onset of sliding: t_s, Q_s, mu_s and mu_d from the central displacement and the forces (paper,
section 3, Figs 7 and 8).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import exp, hypot, isfinite, nan, sqrt
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from analysis.arrays import F64, all_floats, in_step
from analysis.friction.fitted_line import FittedLine, fit_line, independent, noise_of
from analysis.friction.ratio import (
    BLOCK_S,
    FEWEST_MEANS,
    JOINED,
    WITHOUT_GAPS,
    sample_ratios,
    sliding_ratio,
)
from analysis.robust import white_noise

MIN_FRAMES = 12  # least frames in the fit of the sliding part
FEWEST_SETTLED = 6  # least of them in steady sliding
BLOCK = 4  # frames by which the fit's window grows; in a long run a share of it
MOST_BLOCKS = 256
AGREE = 4.0  # standard deviations by which a block may leave the line and still belong to it
# of the constant-velocity part, next to the onset, that the fit leaves out
LEFT_OUT_SHARE = 0.2
STILL_LOADING = 0.2  # share of the mean loading rate above which Q counts as still rising
# frames on each side of the one nearest to t_s from which Q_s is interpolated: Q bends there
FORCE_FRAMES = 1
NORMAL_FRAMES = 8  # the same for P, which is nominally constant
# least and largest share of t_s before it whose samples tell the forces at t_s; what comes after
# t_s does not matter. Between both, the time of this share of the slip until sliding is steady:
# over it a parabola follows the bend of Q
SHARES_BEFORE = (0.01, 0.1)
BEND = 0.5
FEWEST_SAMPLES = 24  # in it; half as many rows of a table, which lie between samples
# standard deviations by which Q scatters more along sliding than along the loading for certain
FLUCTUATES = 3.0
# of a polynomial in sqrt(1 - t/t_s), which follows Q along the loading: in those of Cattaneo and
# Mindlin and of rough contacts, on any bench, it leaves less than the noise of samples
LOADING_ORDER = 5
SAME = 1e-9  # of the greatest Q: samples that bend by less only lie between readings


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
        Q_s, the shear force at t_s, N; `notes` says whether samples or frames give it.
    mu_s, mu_s_sd : float
        Q_s / P.
    mu_d, mu_d_sd : float
        Mean of Q/P from t_s on.
    mu_d_range : (float, float)
        Least and greatest Q/P from t_s on, the paper's error bar: of the means of samples over
        20 ms, or of frames.
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


def sliding_onset(
    time: ArrayLike,
    centre_ux: ArrayLike,
    shear_force: ArrayLike,
    normal_force: ArrayLike,
    *,
    shared_sd: float = 0.0,
    settled: float = 0.0,
    samples: tuple[ArrayLike, ArrayLike, ArrayLike] | None = None,
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
        Uncertainty of `centre_ux` that all frames share, m: that of the reference image, of whose
        noise each frame has as much itself. Where frames scatter by more about the line, that is
        taken for both. 0: there is none.
    settled : float
        u_x at the centre (m) from which sliding is steady: under the local law the whole traction
        is there only after some mu L of slip, and a line fitted before gives t_s too early.
    samples : tuple of array_like, each of shape (m,), optional
        Time (s), Q and P (N) of the readings of the sensors, evenly spaced from the start of the
        drive to the last frame; NaN where one is missing.

    Notes
    -----
    The line is fitted to the largest final part of the run over which u_x grows at constant
    velocity: starting from the last half of the rise of u_x, the part grows backwards as long as
    the next block of four agrees with the line within four standard deviations. Its first fifth,
    next to the rounded onset, is left out. Uncertainties allow for the correlation of successive
    residuals.

    Q_s is the end of a parabola through the samples before t_s, P that of a line: the samples of
    the time in which half of `settled` slides, at least 1 and at most 10 % of t_s. The scatter of
    the same parabola in steady sliding tells the noise of Q_s, or that along the loading where the
    friction in sliding fluctuates; its ends one uncertainty of t_s earlier and later tell what that
    adds. Where fewer than 24 samples are known, or less than
    three quarters of the samples, Q_s is that of a line through the three frames next to t_s, which
    is too low where Q bends between them; its uncertainty includes the bend. mu_d is the mean of
    all samples from t_s on, or of the frames where a quarter of those is missing, or where fewer
    than ten means over 20 ms slide steadily.

    References
    ----------
    Prevost et al. 2013, section 3, Fig. 7 (t_s, Q_s) and Fig. 8 (mu_s, mu_d).

    Examples
    --------
    >>> import numpy as np, analysis
    >>> time = np.arange(0.25, 20, 0.25)
    >>> ux = np.maximum(time - 10, 0) * 5e-6
    >>> Q = 0.4 * np.minimum(time / 10, 1)
    >>> found = analysis.sliding_onset(time, ux, Q, 0.5)
    >>> round(found.time, 2), round(found.mu_s, 2)
    (10.0, 0.79)
    """
    forces = {"shear_force": shear_force, "normal_force": normal_force}
    columns = in_step("onset", time=time, centre_ux=centre_ux, **forces)
    table = np.stack([np.ravel(c) for c in columns])
    t, u, q, p = table[:, np.isfinite(table).all(axis=0)]
    if len(t) < 2 * MIN_FRAMES:
        why = (
            f"onset: {len(t)} frames of the drive were measured; {2 * MIN_FRAMES} or more are"
            " needed for t_s"
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
    start = first + int(LEFT_OUT_SHARE * (len(t) - first - MIN_FRAMES))
    early = np.flatnonzero(u <= settled) if settled > 0 else np.empty(0, np.intp)
    slid = int(early[-1]) + 1 if len(early) else 0
    if len(t) - slid < FEWEST_SETTLED:
        why = (
            f"onset: {len(t) - slid} frames slid by more than {settled * 1e6:.3g} um, from where on"
            f" sliding is steady, and {FEWEST_SETTLED} are needed for t_s; drive further"
        )
        return Onset(notes=(why,))
    start = max(start, slid)
    line = fit_line(t[start:], u[start:])
    why = _not_sliding(t, q, start, line)
    if why:
        return Onset(notes=(why,))

    ts = line.zero
    if shared_sd > 0:  # each frame has the noise of one image, too
        line = fit_line(t[start:], u[start:], shared_sd)
        shared_sd = line.noise
    ts_sd = float(np.hypot(sqrt(line.variance_at(ts)), shared_sd)) / line.slope
    read = _between_frames(t, q, p, ts, ts_sd, start)
    if samples is not None:
        least, most = (share * ts for share in SHARES_BEFORE)
        span = min(max(BEND * settled / line.slope, least), most)
        read = _before_onset(samples, span, (ts, ts_sd), float(t[start]), read)
    after = np.empty(0) if samples is None else sample_ratios(samples, ts, float(t[-1]))
    sliding, by = sliding_ratio((q / p)[t >= ts]), "frames"
    steady = min(int((t[start] - ts) / BLOCK_S), len(after) // 2)
    if len(after) - steady >= FEWEST_MEANS:
        sliding, by = sliding_ratio(after, JOINED, steady), "samples"
    note = (
        f"onset: line through the central u_x from {t[start]:.2f} to {t[-1]:.2f} s ({len(line.x)}"
        f" frames); Q_s from {read.source}; mu_d from {by}"
    )
    return Onset(
        time=float(ts),
        time_sd=ts_sd,
        velocity=line.slope,
        velocity_sd=line.slope_sd,
        static_force=read.shear,
        static_force_sd=read.shear_sd,
        mu_s=read.shear / read.normal,
        mu_s_sd=hypot(read.shear_sd, read.shear / read.normal * read.normal_sd) / read.normal,
        mu_d=sliding.mean,
        mu_d_sd=sliding.sd,
        mu_d_range=(sliding.least, sliding.greatest),
        window=(float(t[start]), float(t[-1])),
        notes=(note,),
    )


def _constant_velocity_start(t: F64, u: F64) -> int:
    """Index of the first frame of the final part in which u grows at constant velocity."""
    # u grows from 0 at t_s, so the last half of its rise is the last half of the sliding; shorter
    # starts are at the mercy of slow errors
    final, block = float(np.median(u[-BLOCK:])), max(BLOCK, len(t) // MOST_BLOCKS)
    lower = np.flatnonzero(u <= 0.5 * final)
    start = min(lower[-1] + 1 if len(lower) else 0, len(t) - MIN_FRAMES)
    while start > 0:
        line = fit_line(t[start:], u[start:])
        before = slice(max(start - block, 0), start)
        miss = np.mean(u[before] - line.at(t[before]))
        block_variance = line.sd_of_mean(before.stop - before.start) ** 2
        if abs(miss) > AGREE * np.sqrt(block_variance + line.variance_at(float(t[before].mean()))):
            return start
        start = before.start
    return 0


def _not_sliding(t: F64, q: F64, start: int, line: FittedLine) -> str:
    """Why the end of the run is not steady sliding; empty if it is."""
    if line.slope < 10 * line.slope_sd or line.slope <= 0:
        return (
            f"onset: the centre moves at {line.slope * 1e6:.3g} +- {line.slope_sd * 1e6:.2g} um/s"
            " at the end of the run, so sliding was not reached; drive further"
        )
    if not t[FORCE_FRAMES] < line.zero < t[start]:
        return (
            f"onset: the line through the central u_x meets zero at {line.zero:.3g} s, outside the"
            f" {t[FORCE_FRAMES]:.3g} to {t[start]:.3g} s before its fit, so the onset was not seen;"
            " drive further"
        )
    rise = q[start:].mean() - q[0]
    loading = abs(rise) / (t[start:].mean() - t[0])
    rising = fit_line(t[start:], q[start:]).slope
    if rising * np.sign(rise) > STILL_LOADING * loading:
        return (
            f"onset: Q still rises at {abs(rising) * 1e3:.3g} mN/s at the end of the run"
            f" ({loading * 1e3:.3g} mN/s on average), so sliding was not reached; drive further"
        )
    return ""


class _AtOnset(NamedTuple):
    """Q and P at t_s with their standard uncertainties, newtons, and what tells them."""

    shear: float
    shear_sd: float
    normal: float
    normal_sd: float
    source: str


def _between_frames(t: F64, q: F64, p: F64, ts: float, ts_sd: float, start: int) -> _AtOnset:
    """The forces at t_s from the frames next to it; from `start` on they slide steadily."""
    at, near = _around(t, q, ts, FORCE_FRAMES)
    shear = fit_line(at, near)
    normal = fit_line(*_around(t, p, ts, NORMAL_FRAMES))
    steady = fit_line(t[start:], q[start:])
    white, slow = white_noise(q) / sqrt(len(shear.x)), steady.sd_of_mean(len(shear.x))
    # how far a line through the three passes from the middle one, noise taken off
    bend = max(float(np.diff(near, 2)[0]) ** 2 - 6 * white_noise(q) ** 2, 0.0) / 9
    static_sd = hypot(max(white, slow), shear.slope * ts_sd, sqrt(bend))
    load_sd = normal.sd_of_mean(len(normal.x))
    return _AtOnset(
        float(shear.at(ts)), static_sd, normal.mean, load_sd, "a line through three frames"
    )


def _before_onset(
    samples: tuple[ArrayLike, ArrayLike, ArrayLike],
    span: float,
    onset: tuple[float, float],
    steady_s: float,
    frames: _AtOnset,
) -> _AtOnset:
    """The forces at t_s, given with its uncertainty, from the samples of a span before it; from
    `steady_s` on they slide steadily. Those of the frames where samples are too few.
    """
    t, q, p = all_floats(*samples)
    ts, ts_sd = onset
    if not (len(t) and t[-1] >= ts):  # a curve is not continued beyond what is known
        return frames
    n = int(np.count_nonzero((t > ts - span) & (t <= ts)))

    def before(when: float) -> slice:
        stop = max(int(np.searchsorted(t, when, "right")), n)
        return slice(stop - n, stop)

    def end_of(y: F64, when: float, degree: int) -> tuple[float, F64]:
        """Where a curve through the `n` samples before a time ends, and their weights in it."""
        at, weights = before(when), np.zeros(n)
        known = np.isfinite(y[at])
        if known.sum() < max(FEWEST_SAMPLES, WITHOUT_GAPS * n):
            return nan, weights
        weights[known] = np.linalg.pinv(np.vander((t[at][known] - when) / span, degree + 1))[-1]
        return float(weights[known] @ y[at][known]), weights

    def noise(y: F64, weights: F64, otherwise: float) -> float:
        """Of the sum of `n` samples with these weights: that along steady sliding, or along the
        loading where that is certainly less, because friction fluctuates.
        """
        white = white_noise(y[np.isfinite(y)]) * sqrt(float(weights @ weights))

        def sums_of(part: F64) -> tuple[F64, NDArray[np.intp]]:
            """Of successive samples, as far as all are known, and their places among those."""
            each = sliding_window_view(np.append(part, np.full(n, nan)), n)[:: n // 2]
            whole = np.flatnonzero(np.isfinite(each).all(axis=1))
            return each[whole] @ weights, whole

        later, order = sums_of(y[t >= steady_s])
        if len(later) < FEWEST_SETTLED:
            return max(white, otherwise)
        line = fit_line(order.astype(float), later, white)
        before_ts = t <= ts - span  # what slides a little later is not there yet
        earlier, places = sums_of(y[before_ts])
        left = 1 - t[before_ts][places * (n // 2) + n - 1] / ts
        columns = np.linalg.qr(np.vander(np.sqrt(left), LOADING_ORDER + 1))[0].T
        if len(earlier) < FEWEST_SETTLED + len(columns):
            return line.noise
        residual = earlier - columns.T @ (columns @ earlier)
        loading, correlation = noise_of(residual, columns, white)
        # variances of the logarithms of both squares; errors that last leave few independent ones
        doubt = 2 / independent(len(later) - 2, line.correlation)
        doubt += 2 / independent(len(earlier) - len(columns), correlation)
        is_less = loading**2 * exp(FLUCTUATES * sqrt(doubt)) < line.noise**2
        return loading if is_less else line.noise

    (shear, weights), (normal, even) = end_of(q, ts, 2), end_of(p, ts, 1)
    bends = np.abs(np.diff(q[before(ts)], 2)) > SAME * abs(frames.shear)
    # a row between two samples bends the line through the samples twice
    if not isfinite(shear + normal) or np.count_nonzero(bends) < FEWEST_SAMPLES:
        return frames
    ends = (end_of(q, ts + off, 2)[0] - shear for off in (-ts_sd, ts_sd))
    moved = [off for off in ends if isfinite(off)]
    shear_sd = hypot(noise(q, weights, frames.shear_sd), *(np.array(moved) / sqrt(len(moved))))
    source = f"the samples of the {span:.3g} s before t_s"
    return _AtOnset(shear, shear_sd, normal, noise(p, even, frames.normal_sd), source)


def _around(t: F64, y: F64, ts: float, frames: int) -> tuple[F64, F64]:
    """The frames within `frames` of `ts`."""
    nearest = int(np.argmin(np.abs(t - ts)))
    near = slice(max(nearest - frames, 0), nearest + frames + 1)
    return t[near], y[near]
