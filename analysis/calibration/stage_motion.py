"""How a stage moves: its velocity, lost motion, periodic error and straightness, from its own
readings and from the pictures of a block that touches nothing; SI units.

References
----------
Prevost et al. 2013, section 3 (4.9 to 4.76 um/s for 5); ISO 230-2 (lost motion, straightness);
Zechmeister and Kuerster, Astron. Astrophys. 496 (2009) 577 (periodogram with a mean); Baluev, Mon.
Not. R. Astron. Soc. 385 (2008) 1279 (its false alarms).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize_scalar
from scipy.special import gammaln

from analysis.arrays import F64, I64, floats, in_step
from analysis.calibration.serial_fit import (
    LEAST_READINGS,
    SerialFit,
    finite_readings,
    serial_fit,
)
from analysis.robust import serial_correlation

SURE = 5.0  # standard deviations from which a departure is real
MOST_CHANGE = 0.01  # of a steady velocity over its record
LEAST_RATIO = 0.5  # of the velocity over the one asked: below it the stage stands or slips
TURN = 0.05  # share of the travel by which a stage has to go back for it to be a turn
LEAST_PERIODS = 1.5  # in the travel
OVERSAMPLED = 8
MOST_KINDS = 12  # of steps of an encoder in a steady motion
CHUNK = 256  # frequencies worked on together


@dataclass(frozen=True, slots=True)
class SteadyVelocity:
    """A steady velocity (m/s, signed), and over the one that was asked."""

    value_m_s: float
    sd_m_s: float
    ratio: float
    ratio_sd: float


@dataclass(frozen=True, slots=True)
class Backlash:
    """The motion that a stage loses at each turn (m); its motion per metre that it reads; the drift
    of the scene beside it (m/s).
    """

    lost_m: float
    sd_m: float
    scale: float
    scale_sd: float
    drift_m_s: float
    turns: int


@dataclass(frozen=True, slots=True)
class PeriodicError:
    """The strongest line in the deviations of a stage: amplitude and period (m), the position of a
    crest (m), and the probability that noise alone has as strong a line at any period.
    """

    amplitude_m: float
    amplitude_sd_m: float
    period_m: float
    period_sd_m: float
    crest_m: float
    false_alarm: float

    def at(self, position_m: ArrayLike) -> F64:
        """The line at positions of the stage, metres, in their shape."""
        turns = (floats(position_m) - self.crest_m) / self.period_m
        return np.asarray(self.amplitude_m * np.cos(2 * math.pi * turns))


@dataclass(frozen=True, slots=True)
class Straightness:
    """Direction of a travel in the picture (radians, from +x to +y), and what it leaves the
    straight line by: its bow (m, in the middle of the travel).
    """

    angle: float
    angle_sd: float
    bow_m: float
    bow_sd_m: float


def steady_velocity(
    time_s: ArrayLike, position_m: ArrayLike, asked_m_s: float, *, scale_sd: float = 0.0
) -> SteadyVelocity:
    """SteadyVelocity of a stage that moves steadily.

    Parameters
    ----------
    time_s, position_m : array_like, shape (n,)
        Readings of the stage, or displacements of a free block along the drive; NaN where missing.
        Of the motion only: neither its start nor its end.
    asked_m_s : float
        With the sign in which `position_m` should grow.
    scale_sd : float
        Relative standard uncertainty of the positions' scale: of the pixel, if they are pictures.

    Raises
    ------
    ValueError
        Too few readings or too many outliers; the stage went the other way, stood, or changed its
        velocity.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> time = np.arange(0, 20, 0.1)
    >>> found = analysis.stage_motion.steady_velocity(time, 4.85e-6 * time, 5e-6)
    >>> round(found.ratio, 4)
    0.97
    """
    t, x = in_step("velocity", time_s=time_s, position_m=position_m)
    if not (math.isfinite(asked_m_s) and asked_m_s):
        raise ValueError(f"velocity: {asked_m_s} m/s was asked; give the velocity of the drive")
    span = float(np.ptp(t[np.isfinite(t)])) if np.isfinite(t).any() else 0.0
    if not span > 0:
        raise ValueError("velocity: the times are all the same; give those of the readings")
    s = 2 * (t - np.nanmean(t)) / span  # -1 to 1
    resolution = encoder_step(x)
    fit = serial_fit("velocity", np.column_stack([np.ones_like(s), s]), x, resolution)
    value, sd = fit.of(1, span / 2)
    ratio = value / asked_m_s
    if ratio < LEAST_RATIO:
        what = "the other way" if ratio < -LEAST_RATIO else "the stage stands or slips"
        raise ValueError(
            f"velocity: {asked_m_s * 1e6:.4g} um/s was asked, {value * 1e6:.4g} um/s found:"
            f" {what}; check direction, block and stage"
        )
    bent = serial_fit("velocity", np.column_stack([np.ones_like(s), s, s * s]), x, resolution)
    change = 8 * float(bent.values[2]) / span / value  # from the first to the last reading
    is_sure = abs(bent.values[2]) > SURE * bent.sds[2] or abs(change) > SURE * MOST_CHANGE
    if abs(change) > MOST_CHANGE and is_sure:
        raise ValueError(
            f"velocity: it changes by {change:+.1%} from the first reading to the last, up to"
            f" {MOST_CHANGE:.0%} is steady; leave out the start and the end, and look for what"
            " holds the stage"
        )
    sd = math.hypot(sd, value * scale_sd)
    return SteadyVelocity(value, sd, ratio, sd / abs(asked_m_s))


def backlash(time_s: ArrayLike, position_m: ArrayLike, moved_m: ArrayLike) -> Backlash:
    """Lost motion of a stage that goes forth and back, once or more.

    Parameters
    ----------
    time_s, position_m, moved_m : array_like, shape (n,)
        Readings of the stage, and how far the block has moved along the drive in the picture of the
        same instant; NaN where missing. A steady drift of the scene is fitted, too.

    Raises
    ------
    ValueError
        No turn, too few readings beyond the slack, or a block that is ahead of its stage.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> stage = np.concatenate([np.arange(0, 50.0), np.arange(50.0, 0, -1)]) * 1e-6
    >>> block = np.where(np.arange(100) < 50, stage, np.minimum(49e-6, stage + 2e-6))
    >>> round(analysis.stage_motion.backlash(np.arange(100), stage, block).lost_m * 1e6, 6)
    2.0
    """
    t, s, x = finite_readings("backlash", time_s, position_m, moved_m)
    way, since, turns = way_of_legs(s)
    if not turns:
        raise ValueError(
            "backlash: the stage went one way only; let it go forth and back over the same travel"
        )
    span, lasts = float(np.ptp(s)), float(np.ptp(t))
    if not lasts > 0:
        raise ValueError("backlash: the times are all the same; give those of the readings")
    design = np.column_stack(
        [np.ones_like(s), (s - s.mean()) / span, -way / 2, (t - t.mean()) / lasts]
    )
    beyond = 0.5 * span
    for _ in range(3):
        free = since > beyond
        if min(np.sum(free & (way > 0)), np.sum(free & (way < 0))) < LEAST_READINGS // 4:
            raise ValueError(
                f"backlash: too few readings are further than {beyond * 1e6:.3g} um beyond a turn,"
                f" the travel is {span * 1e6:.3g} um; let the stage travel further"
            )
        fit = serial_fit("backlash", design[free], x[free])
        lost, sd = fit.of(2, 1.0)
        beyond = 1.2 * max(lost, 0.0) + 4 * fit.rms
    if lost > span / 2:
        raise ValueError(
            f"backlash: {lost * 1e6:.3g} um were lost of a travel of {span * 1e6:.3g} um; let the"
            " stage travel further"
        )
    if lost < -SURE * sd:
        raise ValueError(
            f"backlash: the block is ahead of the stage by {-lost * 1e6:.3g} um after a turn;"
            " check the sign of the drive and the times of pictures and readings"
        )
    return Backlash(lost, sd, *fit.of(1, span), fit.of(3, lasts)[0], turns)


def periodic_error(position_m: ArrayLike, deviation_m: ArrayLike) -> PeriodicError:
    """The strongest line, as of the pitch of a screw, in what a stage deviates by.

    Parameters
    ----------
    position_m, deviation_m : array_like, shape (n,)
        Travel, and how far the block is ahead of it, in the order of the motion; NaN where missing.
        A straight line in it is fitted, too. Periods from twice the spacing of the readings
        to two thirds of the travel are found.

    Raises
    ------
    ValueError
        Too few readings, or no travel.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> at = np.linspace(0, 2e-3, 400)
    >>> found = analysis.stage_motion.periodic_error(at, 2e-7 * np.sin(2 * np.pi * at / 5e-4))
    >>> round(found.period_m * 1e6), found.false_alarm < 1e-6
    (500, True)
    """
    s, d = in_step("periodic error", position_m=position_m, deviation_m=deviation_m)
    known = np.isfinite(s) & np.isfinite(d)
    s, d = s[known], d[known]
    span = float(np.ptp(s)) if len(s) else 0.0
    if len(s) < LEAST_READINGS or not span > 0:
        raise ValueError(
            f"periodic error: {len(s)} readings over {span * 1e6:.3g} um were taken;"
            f" {LEAST_READINGS} or more are needed, over two periods of the screw"
        )
    first, z = float(s.min()), (s - s.min()) / span
    fit, best, phase, trials = _strongest_line(z, d)
    if not fit.is_used.all():  # single outliers move the line that is found with them
        z, d = z[fit.is_used], d[fit.is_used]
        fit, best, phase, trials = _strongest_line(z, d)
    amplitude = float(fit.values[2])
    correlation = serial_correlation(fit.residual, len(fit.values))
    slip = float(fit.sds[4]) / (2 * math.pi * amplitude) if amplitude else math.inf
    return PeriodicError(
        amplitude,
        float(fit.sds[2]),
        span / best,
        span / best**2 * slip,
        first + phase / (2 * math.pi) * span / best,
        _false_alarm(z, d, trials, correlation),
    )


def _strongest_line(z: F64, d: F64) -> tuple[SerialFit, float, float, F64]:
    """The fit of the line of the most power to deviations at places from 0 to 1, its periods in
    the travel and its phase, and the numbers of periods that were tried.
    """
    trials = np.arange(LEAST_PERIODS, (len(z) - 1) / 2, 1 / OVERSAMPLED)
    best = float(trials[np.argmax(_shares(z, d, trials))])
    near = (best - 1 / OVERSAMPLED, best + 1 / OVERSAMPLED)
    best = float(
        minimize_scalar(lambda f: -_shares(z, d, np.array([f]))[0], bounds=near, method="bounded").x
    )
    turn = 2 * math.pi * best * z
    trend = [np.ones_like(z), z]
    waves = np.column_stack([*trend, np.cos(turn), np.sin(turn)])
    c, q = np.linalg.lstsq(waves, d)[0][2:]
    phase = math.atan2(q, c)
    # in phase, out of phase (where a change of the period is seen too), and that change
    out = np.sin(turn - phase)
    columns = [*trend, np.cos(turn - phase), out, z * out]
    return serial_fit("periodic error", np.column_stack(columns), d), best, phase, trials


def straightness(along_m: ArrayLike, across_m: ArrayLike) -> Straightness:
    """Direction and bow of a travel in the picture.

    Parameters
    ----------
    along_m, across_m : array_like, shape (n,)
        Displacements of a free block along x and y of the picture; NaN where missing.

    Raises
    ------
    ValueError
        Too few readings, or a travel across x rather than along it.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> x = np.linspace(0, 1e-4, 100)
    >>> found = analysis.stage_motion.straightness(x, 0.01 * x + 1e-7 * np.sin(np.pi * x / 1e-4))
    >>> round(found.angle, 4), found.bow_m > 5e-8
    (0.01, True)
    """
    x, y = in_step("straightness", along_m=along_m, across_m=across_m)
    span = float(np.nanmax(x) - np.nanmin(x)) if np.isfinite(x).any() else 0.0
    s = 2 * (x - np.nanmean(x)) / span if span > 0 else np.full_like(x, np.nan)
    fit = serial_fit("straightness", np.column_stack([np.ones_like(s), s, 1 - s * s]), y)
    slope, sd = fit.of(1, span / 2)
    if abs(slope) > 1:
        raise ValueError(
            f"straightness: the block goes {math.degrees(math.atan(slope)):.3g} degrees from the"
            " rows of the picture; turn the camera, or exchange its axes"
        )
    return Straightness(math.atan(slope), sd / (1 + slope**2), *fit.of(2, 1.0))


def way_of_legs(s: F64) -> tuple[F64, F64, int]:
    """Way of what goes forth and back at each reading (1 forth, -1 back), its distance since the
    last turn, both of shape (n,), and the number of turns; a way back of less than 5 % of the range
    is none.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> way, since, turns = analysis.stage_motion.way_of_legs(np.array([0.0, 1, 2, 1, 0]))
    >>> way.tolist(), since.tolist(), turns
    ([1.0, 1.0, -1.0, -1.0, -1.0], [0.0, 1.0, 0.0, 1.0, 2.0], 1)
    """
    least, first, way = TURN * float(np.ptp(s)), 0.0, 0.0
    turned: list[int] = []
    furthest = 0
    for i in range(len(s)):
        if way == 0:
            if abs(s[i] - s[0]) > least:
                first = way = math.copysign(1.0, s[i] - s[0])
                turned, furthest = [0], i
        elif (s[i] - s[furthest]) * way > 0:
            furthest = i
        elif (s[furthest] - s[i]) * way > least:
            way = -way
            turned.append(furthest)
            furthest = i
    if not turned:
        return np.ones_like(s), np.zeros_like(s), 0
    leg: I64 = np.searchsorted(turned, np.arange(len(s)), side="right") - 1
    return floats(first * (-1.0) ** leg), np.abs(s - s[np.array(turned)[leg]]), len(turned) - 1


def encoder_step(position_m: ArrayLike) -> float:
    """Step (m) of an encoder, by the differences between its readings, shape (n,), in the order of
    a motion: whole numbers of it; 0 where they tell none.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> read = 35e-9 * np.round(np.arange(50) * 10.3)
    >>> round(analysis.stage_motion.encoder_step(read) * 1e9, 3)
    35.0
    """
    x = floats(position_m)
    steps = np.abs(np.diff(x[np.isfinite(x)]))
    steps = steps[steps > 0]
    if not steps.size:
        return 0.0
    size = float(np.median(steps))
    kinds = np.unique(np.round(steps / size, 6))
    if len(kinds) > MOST_KINDS:  # of a scatter, not of an encoder
        return 0.0
    return size * float(np.diff(kinds).min() if len(kinds) > 1 else kinds[0])


def _shares(z: F64, d: F64, trials: F64) -> F64:
    """Share of the variance about a straight line that a line of each frequency (periods in the
    travel) explains.
    """
    q = np.linalg.qr(np.column_stack([np.ones_like(z), z]))[0]
    left = d - q @ (q.T @ d)
    power = float(left @ left)
    if not power > 0:
        return np.zeros(len(trials))
    shares = []
    for first in range(0, len(trials), CHUNK):
        turn = 2 * math.pi * np.multiply.outer(trials[first : first + CHUNK], z)
        c, s = (wave - (wave @ q) @ q.T for wave in (np.cos(turn), np.sin(turn)))
        cc, ss, cs = (np.einsum("ij,ij->i", a, b) for a, b in ((c, c), (s, s), (c, s)))
        yc, ys = c @ left, s @ left
        size = np.maximum(cc * ss - cs * cs, 1e-12 * len(z) ** 2)
        shares.append((yc * yc * ss + ys * ys * cc - 2 * yc * ys * cs) / size / power)
    return np.asarray(np.clip(np.concatenate(shares), 0.0, 1.0))


def _false_alarm(z: F64, d: F64, trials: F64, correlation: float) -> float:
    """Baluev's bound for the largest share, of deviations whose correlation with the one before is
    taken away.
    """
    z, d = z[1:], d[1:] - correlation * d[:-1]
    n = len(z)
    highest = float(_shares(z, d, trials).max())
    free, width = n - 2, float(trials[-1]) * math.sqrt(4 * math.pi * float(np.var(z)))
    gamma = math.exp(gammaln(free / 2) - gammaln((free - 1) / 2)) * math.sqrt(2 / free)
    left = 1 - highest
    crossings = gamma * width * left ** ((n - 5) / 2) * math.sqrt(free * highest / 2)
    return float(1 - (1 - left ** ((n - 4) / 2)) * math.exp(-crossings))
