"""When things happen that a bench takes for simultaneous: the exposure after its trigger, the
second of two channels that one converter reads in turn, and the camera's clock beside the
board's, in seconds.

References
----------
Bendat and Piersol, Random Data, section 9.2 (uncertainty of a phase); Carter, Proc. IEEE 75 (1987)
236 (delay from a cross-spectrum).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import chdtrc, ndtr

from analysis.arrays import F64, all_floats, floats, in_step
from analysis.calibration.serial_fit import LEAST_READINGS, SerialFit, serial_fit
from analysis.mechanics.hertz import check
from analysis.robust import rounding_step

MIN_EXPOSURES = 10
MOST_ODD = 0.05  # share of the exposures that are far from the others
FAR_SAMPLES = 3.0
MEANS, WIDTHS, ZOOMS, NARROWEST = 60, 40, 3, 1e-2  # of a normal distribution, in samples
SEGMENTS = 32  # of a record whose coherence is estimated
LEAST_COHERENCE = 0.5
LEAST_BINS = 8
HANN = 1.944  # frequencies that a Hann window makes one of
MOST_CHI2 = 4.0  # of the phases about a straight line
STAMP_S = 1e-6  # resolution of a camera's times, where they scatter by less
# of coarser clocks, per second, those first that are taken where several fit: of decimals, of
# Windows (64), of the buses of cameras (8000 and 90000)
TICKS = np.array([10.0, 100, 1000, 64, 8000, 1e4, 9e4, 1e5])
PARTS, UNLIKELY = 8, 1e-4  # of a record, whose drifts differ so much by chance
LARGEST_DRIFT = 1e-2  # of two clocks: beyond it one rate is not what it was taken for


@dataclass(frozen=True, slots=True)
class ExposureLag:
    """Lag of the exposures after their triggers and its standard uncertainty, seconds; standard
    deviation and range from one to the next, at the resolution of a sample; how many were odd.
    """

    lag_s: float
    sd_s: float
    jitter_s: float
    range_s: float
    odd: int


@dataclass(frozen=True, slots=True)
class ChannelSkew:
    """How much later the second channel is read than the first, seconds, and its standard
    uncertainty; whether the common signal is inverted in one of them.
    """

    skew_s: float
    sd_s: float
    is_inverted: bool


@dataclass(frozen=True, slots=True)
class ClockDrift:
    """By which share a clock runs fast against the samples, with its standard uncertainty for any
    part of the record; the furthest that it was from this steady drift (s); and the standard
    deviation of this share over the record, as with the temperature, 0 where it is not seen.
    """

    drift: float
    sd: float
    furthest_s: float
    wander: float


def exposure_lags(counts: ArrayLike, first: int, divisor: int) -> F64:
    """Samples from each trigger to the sample by which its exposure had begun.

    Parameters
    ----------
    counts : array_like of int, shape (samples,)
        Exposures that had begun by each sample, from sample 0.
    first, divisor : int
        Sample of the first trigger, and samples between triggers.

    Raises
    ------
    ValueError
        A count is missing.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> analysis.timing.exposure_lags((np.arange(100) - 2) // 10 + 1, 0, 10)[:3].tolist()
    [2, 2, 2]
    """
    counted = floats(counts)
    if not (counted.shape == (counted.size,) and counted.size and np.isfinite(counted).all()):
        raise ValueError(
            f"exposure lag: counts of shape {counted.shape}; give one finite count for each sample"
        )
    began = np.searchsorted(counted, np.arange(1, counted[-1] + 1))
    lags = (began - first) % divisor
    return np.where(lags > divisor - 2, lags - divisor, lags)


def exposure_lag(lags: ArrayLike, sample_rate_hz: float) -> ExposureLag:
    """Lag and jitter of exposures.

    Parameters
    ----------
    lags : array_like, shape (n,)
        Samples from the trigger to the sample by which its exposure had begun; NaN where it was not
        seen. The exposure began within the sample before: half of one is taken away.
    sample_rate_hz : float

    Raises
    ------
    ValueError
        Too few exposures, too many that are late, or a rate that is none.

    Examples
    --------
    >>> import analysis
    >>> found = analysis.timing.exposure_lag([2] * 40, 1000.0)
    >>> round(found.lag_s * 1e3, 3), round(found.sd_s * 1e3, 2)
    (1.5, 0.26)
    """
    check("exposure lag", sample_rate_hz=sample_rate_hz)
    lag = floats(lags)
    lag = lag[np.isfinite(lag)]
    if len(lag) < MIN_EXPOSURES:
        raise ValueError(
            f"exposure lag: {len(lag)} exposures were counted; {MIN_EXPOSURES} or more are needed:"
            " check the exposure wire and forces.exposure_counter"
        )
    usual = np.abs(lag - np.median(lag)) <= FAR_SAMPLES
    odd = int(np.sum(~usual))
    if odd > MOST_ODD * len(lag):
        raise ValueError(
            f"exposure lag: {odd} of {len(lag)} exposures began {FAR_SAMPLES:g} samples or more"
            " from the others; check the trigger's wire and mode, and the camera's exposure"
        )
    near = lag[usual]
    began, sd = _begun(near)
    return ExposureLag(
        began / sample_rate_hz,
        sd / sample_rate_hz,
        float(near.std()) / sample_rate_hz,
        float(np.ptp(lag)) / sample_rate_hz,
        odd,
    )


def _begun(lags: F64) -> tuple[float, float]:
    """Mean of what is known only by the sample after it, and its standard uncertainty, in samples.

    By how often each sample was seen, under a normal distribution whose width is not known: none is
    as likely beforehand as all others together, so that what never changes lies anywhere within one
    sample.
    """
    sample, count = np.unique(lags, return_counts=True)
    widest = 1.0 + float(np.ptp(lags))
    found, span, sd, low, high = float(lags.mean()) - 0.5, 1.0, 0.0, NARROWEST, widest
    for _ in range(ZOOMS):  # to where the likelihood is
        width = np.append(NARROWEST, np.linspace(low, high, WIDTHS))
        mean = found + span * np.linspace(-1.0, 1.0, MEANS)
        from_mean = (sample - [[1], [0]] - mean[:, None, None]) / width[:, None, None, None]
        likely = np.log(np.maximum(np.diff(ndtr(from_mean), axis=-2), 1e-300))[..., 0, :] @ count
        weight = np.exp(likely - likely.max())
        weight[1:] *= (high - low) / widest / WIDTHS
        of_mean = weight.sum(axis=0)
        found = float(np.average(mean, weights=of_mean))
        sd = math.sqrt(np.average((mean - found) ** 2, weights=of_mean))
        span = max(5 * sd, span / MEANS)
        of_width = weight[1:].max(axis=1)
        step, there = (high - low) / WIDTHS, width[1:][of_width > 1e-6 * of_width.max()]
        low, high = max(NARROWEST, there.min() - step), there.max() + step
    return found, sd


def channel_skew(first: ArrayLike, second: ArrayLike, sample_rate_hz: float) -> ChannelSkew:
    """How much later one channel is read than another, from a signal on both: the slope of the
    phase of their cross-spectrum.

    Parameters
    ----------
    first, second : array_like, shape (n,)
        Readings of one source, such as noise or a sweep, that is wired to both inputs. It must not
        hold frequencies above half of the rate.
    sample_rate_hz : float

    Raises
    ------
    ValueError
        Too short, no common signal, a phase that is no delay, or a rate that is none.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> wave = np.cumsum(np.random.default_rng(0).standard_normal(8000))
    >>> found = analysis.timing.channel_skew(wave[1:], wave[:-1], 1000.0)
    >>> round(found.skew_s * 1e3, 1)
    -1.0
    """
    from scipy.signal import coherence, csd  # here, for they take long to load

    check("skew", sample_rate_hz=sample_rate_hz)
    a, b = all_floats(first, second)
    is_whole = a.shape == b.shape == (a.size,) and np.isfinite(a + b).all()
    if not is_whole or a.size < 64 * SEGMENTS:
        raise ValueError(
            f"skew: {a.size} and {b.size} readings were taken; {64 * SEGMENTS} or more of each are"
            " needed, none missing"
        )
    length = len(a) // SEGMENTS
    how = {"fs": sample_rate_hz, "nperseg": length, "noverlap": 0, "detrend": "linear"}
    frequency, cross = csd(a, b, **how)
    with np.errstate(invalid="ignore"):  # a channel that never changes is like no other
        alike = coherence(a, b, **how)[1]
    # the ends have leakage of the trend, and no phase; chance has a coherence of 1/SEGMENTS
    use = (alike > LEAST_COHERENCE) & (np.arange(len(frequency)) >= 2)
    use[-1] = False
    if use.sum() < LEAST_BINS:
        raise ValueError(
            f"skew: the channels have a signal in common at {use.sum()} frequencies; {LEAST_BINS}"
            " or more are needed: wire one source of noise to both inputs"
        )
    is_inverted = float(np.sum(cross.real[use])) < 0
    f, phase = frequency[use], np.angle(-cross[use] if is_inverted else cross[use])
    share = np.clip(alike[use], 0.0, 1 - 1e-12)
    weight = 2 * SEGMENTS * share / (1 - share)
    phase = np.unwrap(phase)
    omega = 2 * math.pi * f
    slope = float(np.sum(weight * omega * phase) / np.sum(weight * omega**2))
    off = phase - slope * omega
    power = float(np.sum(weight * off**2)) / (len(f) - 1)
    # what is exact on both has no other noise than the window's leakage
    if power > MOST_CHI2 and (furthest := float(np.abs(off).max())) > 0.05:
        raise ValueError(
            f"skew: the phase of the cross-spectrum is off a straight line by {furthest:.2g} rad:"
            " this is no delay; give both inputs the same filter"
        )
    sd = math.sqrt(HANN * max(power, 1.0) / float(np.sum(weight * omega**2)))
    return ChannelSkew(slope, sd, is_inverted)


def clock_drift(samples: ArrayLike, stamps_s: ArrayLike, sample_rate_hz: float) -> ClockDrift:
    """By which share a clock, such as the camera's, runs fast against the board's.

    Parameters
    ----------
    samples : array_like, shape (n,)
        Numbers of the samples on which frames were triggered.
    stamps_s : array_like, shape (n,)
        Times that the clock gave to these frames, seconds; NaN where it gave none.
    sample_rate_hz : float
        Of the board: its clock is the one that counts.

    Raises
    ------
    ValueError
        Too few stamps, too many that came late, a rate that is none, or two that are no two clocks'
        of one second.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> sample = np.arange(0, 3_600_000, 1000)
    >>> round(analysis.timing.clock_drift(sample, sample * 1.00002e-3, 1000.0).drift * 1e6, 3)
    20.0
    """
    check("clock drift", sample_rate_hz=sample_rate_hz)
    sample, stamps = map(np.ravel, in_step("clock drift", samples=samples, stamps_s=stamps_s))
    board = sample / sample_rate_hz
    if not (np.isfinite(board).all() and len(board) and np.ptp(board) > 0):
        raise ValueError(
            "clock drift: a sample is not known, or all stamps are of one sample; give those of a"
            " session"
        )
    from_start = stamps - np.nanmin(stamps) if np.isfinite(stamps).any() else stamps
    ahead = from_start - (board - board[0])
    step = max(STAMP_S, rounding_step(stamps[np.isfinite(stamps)], TICKS))
    drift, sd, fit = _drift(board, ahead, step)
    if abs(drift) > LARGEST_DRIFT:
        raise ValueError(
            f"clock drift: one clock runs {drift:+.2%} fast, up to {LARGEST_DRIFT:.0%} is a drift;"
            " check the unit of the stamps and the sample rate"
        )
    wander = _wander(board[fit.is_used], ahead[fit.is_used], step)
    furthest = float(np.abs(fit.residual).max())
    return ClockDrift(drift, math.hypot(sd, wander), furthest, wander)


def _drift(board: F64, ahead: F64, step: float) -> tuple[float, float, SerialFit]:
    """Drift, its standard uncertainty by noise and by stamps of a step, and the fit."""
    span = float(np.ptp(board))
    place = 2 * (board - board.mean()) / span
    fit = serial_fit("clock drift", np.column_stack([np.ones_like(place), place]), ahead, step)
    return *fit.of(1, span / 2), fit


def _wander(board: F64, ahead: F64, step: float) -> float:
    """Standard deviation of the drift from part to part of a record, beyond that by noise; 0 where
    it is no more than chance makes, or the record is too short for parts.
    """
    if len(board) < PARTS * LEAST_READINGS:
        return 0.0
    parts = np.array_split(np.stack([board, ahead], axis=1), PARTS)
    drifts, sds, _ = zip(*(_drift(part[:, 0], part[:, 1], step) for part in parts), strict=True)
    off = (PARTS - 1) * float(np.var(drifts, ddof=1)) / float(np.mean(np.square(sds)))
    if chdtrc(PARTS - 1, off) > UNLIKELY:
        return 0.0
    return float(np.std(drifts, ddof=1))
