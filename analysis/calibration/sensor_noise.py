"""Noise of a force sensor without a force: its standard deviation, the wander of its zero, and the
lines of its spectrum by name.

References
----------
Welch, IEEE Trans. Audio Electroacoust. 15 (1967) 70; Allan, Proc. IEEE 54 (1966) 221.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.fft import next_fast_len, rfft
from scipy.ndimage import median_filter
from scipy.optimize import minimize_scalar

from analysis.arrays import F64, Array, floats
from analysis.calibration.sensor_response import fit_beside_walk
from analysis.mechanics.hertz import check

MAINS_HZ = (50.0, 60.0)
MOST_OFF_MAINS = 0.004  # share by which the mains may be off its frequency
FEWEST_S = 5.0
SEGMENTS = 8  # of a record, half overlapping, or more
LONGEST_SEGMENT_S = 4.0
CHANCE = 1e-4  # that noise alone shows a line
NEIGHBOURS = (201, 2001)  # frequencies that tell what noise there is beside a line
MOST_LINES = 20
LONGEST_TAU = 1.05  # of the longest averaging time: a record may end a little early
PARTS = 32  # of a record, whose means tell the drift of the zero
HIGHEST = 0.495  # of the rate
LEAST_HZ, LEAST_PERIODS = 1.0, 10.0  # of a line: what is slower is a wander
MOST_CHANGE = 20.0  # standard deviations by which the mean of a second may change
LEAST_CHANGE_N = 0.02


@dataclass(frozen=True, slots=True)
class SpectralLine:
    """A line of the spectrum: its frequency, rms value, their uncertainties, and what it is."""

    hz: float
    hz_sd: float
    rms: float
    rms_sd: float
    name: str


@dataclass(frozen=True, slots=True)
class SensorNoise:
    """The noise of a sensor, in the unit of its readings.

    Attributes
    ----------
    sd, sd_sd : float
        Standard deviation about a straight line in time, all lines included, and its uncertainty.
    white, white_sd : float
        Of the noise between the lines, as if it were as high at all frequencies.
    drift, drift_sd : float
        Of the zero, per second.
    lines : tuple of SpectralLine
        The strongest first.
    hz, density : (k,)
        Spectral density, unit^2/Hz.
    tau, allan, allan_sd : (m,)
        Averaging times in seconds, Allan deviation of means of so long, and its uncertainty.
    """

    sd: float
    sd_sd: float
    white: float
    white_sd: float
    drift: float
    drift_sd: float
    lines: tuple[SpectralLine, ...]
    hz: F64
    density: F64
    tau: F64
    allan: F64
    allan_sd: F64

    def wander(self, seconds: float) -> float:
        """By how much the zero changes in so many seconds: root mean square of the difference of
        successive means of so long; NaN where the record is not four times as long.
        """
        if seconds > LONGEST_TAU * float(self.tau[-1]):
            return math.nan
        return math.sqrt(2) * float(np.exp(np.interp(
            math.log(seconds), np.log(self.tau), np.log(self.allan)
        )))  # fmt: skip


def sensor_noise(readings: ArrayLike, rate_hz: float) -> SensorNoise:
    """The noise of a sensor from a record without a force.

    Parameters
    ----------
    readings : array_like, shape (n,)
        Evenly sampled, without gaps.
    rate_hz : float

    Raises
    ------
    ValueError
        The record is too short, does not change at all, or is not that of a free block; the rate is
        none.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> t = np.arange(20000) / 1000
    >>> noise = np.random.default_rng(1).normal(0, 1e-3, t.size)
    >>> found = analysis.sensor_noise(noise + 1e-3 * np.sin(2 * np.pi * 50 * t), 1000)
    >>> [line.name for line in found.lines], round(found.white * 1e3, 1)
    (['mains, 50 Hz'], 1.0)
    """
    check("noise", rate_hz=rate_hz)
    y = floats(readings)
    n = len(y) if y.ndim == 1 else 0
    if n < FEWEST_S * rate_hz or not np.isfinite(y).all():
        raise ValueError(
            f"noise: {n / rate_hz:.3g} s of samples found, {np.count_nonzero(~np.isfinite(y))} of"
            f" them missing; {FEWEST_S:g} s or more without a gap are needed"
        )
    if np.ptp(y) == 0:
        raise ValueError(
            "noise: the reading does not change by one step of the converter; see whether anything"
            " is connected"
        )
    t = (np.arange(n) - (n - 1) / 2) / rate_hz
    drift, drift_sd = _drift(y, rate_hz)
    flat = y - y.mean() - float(t @ y / (t @ t)) * t
    lines, rest = _lines(t, flat, rate_hz)
    seconds = y[: n // round(rate_hz) * round(rate_hz)].reshape(-1, round(rate_hz)).mean(axis=1)
    change, quick = float(np.ptp(seconds)), float(np.diff(rest).std()) / math.sqrt(2)
    if change > max(MOST_CHANGE * quick, LEAST_CHANGE_N):
        raise ValueError(
            f"noise: the mean of a second changes by {change:.3g} N, {change / quick:.3g} times the"
            " noise; let the block hang free and still, and take a record in which it touches"
            " nothing"
        )
    hz, density = _spectrum(flat, rate_hz)
    power = _spectrum(rest, rate_hz)[1][1:-1]
    # the powers of all frequencies of white noise are distributed exponentially
    level = float(np.median(np.abs(rfft(rest)[1:-1]) ** 2)) / math.log(2) / n
    # those of white noise, fewer where a part of the frequencies has most of the power
    freedom = n * float(power.sum()) ** 2 / (len(power) * float(power @ power))
    white = math.sqrt(level)
    tau, allan, allan_sd = _allan(y, rate_hz)
    sd = float(flat.std())
    of_lines = math.hypot(*(line.rms * line.rms_sd for line in lines))
    return SensorNoise(
        sd=sd,
        sd_sd=math.hypot(rest.var() / math.sqrt(2 * freedom), of_lines) / sd,
        white=white,
        white_sd=white / (math.log(2) * math.sqrt(2 * n)),
        drift=drift,
        drift_sd=drift_sd,
        lines=lines,
        hz=hz,
        density=density,
        tau=tau,
        allan=allan,
        allan_sd=allan_sd,
    )


def _spectrum(y: F64, rate_hz: float) -> tuple[F64, F64]:
    from scipy.signal import welch  # here, for it takes long to load

    length = min(len(y) * 2 // (SEGMENTS + 1), round(LONGEST_SEGMENT_S * rate_hz))
    hz, density = welch(y, rate_hz, nperseg=length, detrend="linear")
    return np.asarray(hz), np.asarray(density)


def _drift(y: F64, rate_hz: float) -> tuple[float, float]:
    """Slope of a straight line through white noise and a random walk, and its uncertainty."""
    width = len(y) // PARTS
    means = y[: width * PARTS].reshape(PARTS, width).mean(axis=1)
    tau = np.linspace(-1, 1, PARTS)
    at, covariance, *_ = fit_beside_walk(np.column_stack([np.ones(PARTS), tau]), means, tau)
    half_s = (PARTS - 1) / 2 * width / rate_hz
    return float(at[1]) / half_s, math.sqrt(covariance[1, 1]) / half_s


def _allan(y: F64, rate_hz: float) -> tuple[F64, F64, F64]:
    """Averaging times, deviation of overlapping means, and its uncertainty by the degrees of
    freedom of white noise.
    """
    n, total = len(y), np.concatenate([[0.0], np.cumsum(y - y.mean())])
    widths = np.unique(np.geomspace(1, n // 4, 1 + math.floor(2 * math.log2(n / 4))).round())
    found = []
    for m in widths.astype(int):
        second = total[2 * m :] - 2 * total[m:-m] + total[: -2 * m]
        found.append(math.sqrt(float(np.mean(second**2)) / 2) / m)
    freedom = (1.5 * (n - 1) / widths - 2) * 4 * widths**2 / (4 * widths**2 + 5)
    allan = np.array(found)
    return widths / rate_hz, allan, allan / np.sqrt(2 * freedom)


def _waves(t: Array, hz: list[float]) -> F64:
    turns = 2 * math.pi * t[:, None] * np.array(hz)
    return np.hstack([np.cos(turns), np.sin(turns)])


def _lines(t: Array, y: Array, rate_hz: float) -> tuple[tuple[SpectralLine, ...], F64]:
    """The lines above the noise, the strongest first, and what is left without them; they are found
    and taken off one by one, and fitted together.
    """
    n, left, found = next_fast_len(len(y), real=True), y, list[float]()
    hz = np.fft.rfftfreq(n, 1 / rate_hz)
    window = np.hanning(len(y))
    usable = hz > max(LEAST_HZ, LEAST_PERIODS * rate_hz / len(y))
    usable &= hz < HIGHEST * rate_hz
    while True:
        power = np.abs(rfft(left * window, n)) ** 2
        # of the noise there, whose median by chance is low somewhere: not lower than that of more
        levels = [median_filter(power, width, mode="mirror") for width in NEIGHBOURS]
        level = np.maximum(*levels) / math.log(2)
        ratio = np.where(usable, power / level, 0.0)
        density = 2 * level / (rate_hz * float(window @ window))
        peak = int(ratio.argmax())
        if ratio[peak] < math.log(len(hz) / CHANCE) or len(found) == MOST_LINES:
            break

        def missed(f: float, left: F64 = left) -> float:
            return -float(np.abs(np.exp(-2j * math.pi * f * t) @ left))

        step = rate_hz / len(y)
        at = minimize_scalar(
            missed, bounds=(hz[peak] - step, hz[peak] + step), method="bounded",
            options={"xatol": 1e-4 * step},
        )  # fmt: skip
        found.append(float(at.x))
        waves = _waves(t, found)
        parts = np.linalg.solve(waves.T @ waves, waves.T @ y)
        left = y - waves @ parts
    if not found:
        return (), left
    rms = np.hypot(*parts.reshape(2, -1)) / math.sqrt(2)
    noise = np.interp(found, hz, density)  # one-sided
    duration = len(y) / rate_hz
    return tuple(
        SpectralLine(
            hz=f,
            hz_sd=math.sqrt(3 * s / duration**3) / (math.pi * math.sqrt(2) * r),
            rms=float(r),
            rms_sd=math.sqrt(s / duration / 2),
            name=_name(f, found, 1 / duration),
        )
        for r, f, s in sorted(zip(rms, found, noise, strict=True), reverse=True)
    ), left


def _name(hz: float, others: list[float], width: float) -> str:
    """What a line is: the mains, a multiple of it, or its frequency; a multiple of both is of the
    mains that has more lines.
    """

    def is_of(f: float, mains: float) -> bool:
        times = round(f / mains)
        return times > 0 and abs(f / times - mains) < MOST_OFF_MAINS * mains + width / times

    matches = [mains for mains in MAINS_HZ if is_of(hz, mains)]
    if not matches:
        return f"{hz:.4g} Hz"
    mains = max(matches, key=lambda one: sum(is_of(f, one) for f in others))
    times = round(hz / mains)
    return f"mains, {mains:g} Hz" if times == 1 else f"{times} x mains of {mains:g} Hz"
