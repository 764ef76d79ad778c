"""Roughness from a map of heights: their standard deviation h and how well the map knows it, the
power spectrum, the correlation length (paper, section 2.2).

References
----------
Jacobs, Junge, Pastewka, Surf. Topogr.: Metrol. Prop. 5 (2017) 013001 (spectrum, window); Bendat,
Piersol, Random Data, section 8.2 (variance of the variance of correlated values); ISO 25178-2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import ArrayLike
from scipy.fft import fft2, irfft2, next_fast_len, rfft2

from analysis.arrays import F64, I64, Bool, floats
from analysis.robust import robust_sd

LEAST_POINTS = 64  # along each side
LEAST_KNOWN = 0.7  # share of the map
FORMS = {"none": 1, "plane": 3, "quadratic": 6}  # terms of each
POWERS = ((0, 0), (0, 1), (1, 0), (0, 2), (1, 1), (2, 0))  # of y and x
SPIKE = 8.0  # sds of a height from the median of its neighbours
LEAST_SPIKE = 0.1  # sd of the neighbours, in that of all heights
MOST_SPIKES = 0.05
FEWEST_ASPERITIES = 100.0  # independent heights: of fewer the form takes too much, and h is biased
LEAST_PIXELS = 2.0  # correlation length over the pitch
LARGEST_CLIPPED = 0.01  # share of the heights at the greatest or least of all
LARGEST_STRIPES = 0.03  # share of h^2 in steps between the lines of a scan
SIGNIFICANT = 5.0
RISING = 3.0  # of the spectrum, at the longest waves over those a few times shorter
FLAT = 0.7  # of the spectrum, in its last eighth over the eighth before the last but one


@dataclass(frozen=True, slots=True)
class Roughness:
    """The roughness of a map; SI units.

    Attributes
    ----------
    h, h_sd : float
        Standard deviation of the heights, form taken off, between the wavelengths below, and its
        standard uncertainty by the finite size of the map (and the scale of the heights).
    correlation_length : float
        Distance at which the autocorrelation has come down to 1/e.
    asperities : float
        Effective number of independent heights in the map, which gives the uncertainty.
    longest, shortest : float
        Wavelengths that h holds: of the map's smaller side, or what was asked for; twice the pitch,
        or what was asked for.
    wavenumber, spectrum : ndarray, shape (n,)
        2 pi/wavelength (rad/m) and mean over directions of the power spectral density (m^4), whose
        sum over the plane of wave vectors, over 4 pi^2, is h^2.
    known, spikes : float
        Share of the map that was measured, and that was left out as spikes.
    residual : ndarray, shape (ny, nx)
        Heights less the form, NaN where not known.
    notes : tuple of str
    """

    h: float
    h_sd: float
    correlation_length: float
    asperities: float
    longest: float
    shortest: float
    wavenumber: F64
    spectrum: F64
    known: float
    spikes: float
    residual: F64
    notes: tuple[str, ...]


def roughness(
    z: ArrayLike,
    pitch: float,
    *,
    form: str = "quadratic",
    longest: float = math.inf,
    shortest: float = 0.0,
    scale_sd: float = 0.0,
) -> Roughness:
    """Standard deviation, spectrum and correlation length of a map of heights.

    Parameters
    ----------
    z : array_like, shape (ny, nx)
        Heights (m) on a square grid; NaN where not measured.
    pitch : float
        Of the grid, metres.
    form : str
        What is taken off by least squares: "none" (the mean), "plane" or "quadratic".
    longest, shortest : float, optional
        Wavelengths (m) beyond and below which heights do not count.
    scale_sd : float
        Relative standard uncertainty of the scale of the heights.

    Raises
    ------
    ValueError
        The map is too small or holds too few heights, hills or points per hill; heights that are
        clipped, flat, full of spikes, or in steps from line to line of the scan.

    Notes
    -----
    Neighbouring heights are not independent: the variance of h^2 is ``2 h^4`` times the integral of
    the squared autocorrelation over the area of the map. The part of the hills that the fit of the
    form removes is added again. The spectrum has a Hann window; holes are filled by their
    surroundings for it, and for it only.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> y, x = np.mgrid[:256, :256] * 1e-6
    >>> waves = sum(np.sin(4e5 * (x * np.cos(t) + y * np.sin(t)) + t * t) for t in range(1, 200))
    >>> found = analysis.roughness(1e-7 * waves + 0.01 * x, 0.4e-6)
    >>> 0.8e-6 < found.h < 1.2e-6
    True
    """
    heights = np.array(floats(z))
    _check(heights, pitch, form, longest, shortest, scale_sd)
    heights[~np.isfinite(heights)] = np.nan
    known = np.isfinite(heights)
    residual = _levelled(heights, known, form)
    step = _step(heights[known])
    if not robust_sd(residual[known]) > step:
        raise ValueError(
            f"roughness: heights of standard deviation {np.nanstd(residual):.2g} m in steps of"
            f" {step:.2g} m are not resolved; use a finer scale of the heights"
        )
    known = _without_spikes(residual)
    spikes = float(np.mean(np.isfinite(heights) & ~known))
    if spikes > MOST_SPIKES:
        raise ValueError(
            f"roughness: {spikes:.0%} of the heights stand out of their neighbours,"
            f" {MOST_SPIKES:.0%} may; clean the surface, or measure it with more light"
        )
    heights[~known] = np.nan
    residual = _levelled(heights, known, form)
    variance = float(np.nanmean(residual**2))
    power, qx, qy = _periodogram(_filled(residual, known), pitch)
    notes: list[str] = []
    _check_stripes(power)
    q, spectrum, rings = _radial(power, qx, qy)
    cell = float(qx[1] * qy[1]) / (4 * np.pi**2)
    area = heights.size * pitch**2
    # heights and their uncertainty: of all that is known, without a window
    low = float(np.mean(spectrum[1:4]))
    taken = min(FORMS[form] * low / (area * variance), 0.5)
    variance /= 1 - taken
    band = (rings >= 2 * np.pi / longest) & (rings <= 2 * np.pi / max(shortest, 1e-300))
    share = float(power[band].sum() / power.sum())
    # ordinates of a periodogram are exponential: the mean of their squares is twice the square
    total = float(power[band].sum()) * cell
    squares = float((power[band] ** 2).sum()) / 2 * cell
    asperities = area * total**2 / squares * float(np.mean(known))
    if asperities < FEWEST_ASPERITIES:
        raise ValueError(
            f"roughness: the map holds {asperities:.0f} independent hills,"
            f" {FEWEST_ASPERITIES:.0f} are needed; measure a larger area, or leave out long waves"
        )
    length = _correlation_length(residual, known, pitch)
    if length < LEAST_PIXELS * pitch:
        raise ValueError(
            f"roughness: heights are correlated over {length:.2g} m at a pitch of {pitch:.2g} m:"
            " noise, or hills that are not resolved; use a larger magnification"
        )
    if share < 0.5:
        notes.append(f"roughness: the wavelengths asked for hold {share:.0%} of the variance")
    if low > RISING * float(np.mean(spectrum[6:10])):
        notes.append(
            "roughness: the spectrum still rises at the longest waves of the map: h grows with the"
            " area"
        )
    noise = _white(spectrum, pitch) / variance if shortest < 4 * pitch else 0.0
    if noise > 0.002:
        notes.append(
            "roughness: the spectrum is flat at its short end, as noise is: it would hold"
            f" {math.sqrt(noise * variance):.2g} m of h, which the uncertainty allows for; average"
            " several maps of the same place, or leave out short waves"
        )
    h = math.sqrt(variance * share)
    h_sd = h * math.hypot(math.sqrt(1 / (2 * asperities)), scale_sd, noise / 2)
    sides = min(heights.shape) * pitch
    return Roughness(
        h=h,
        h_sd=h_sd,
        correlation_length=length,
        asperities=asperities,
        longest=min(longest, sides),
        shortest=max(shortest, 2 * pitch),
        wavenumber=q,
        spectrum=spectrum,
        known=float(np.mean(known)) + spikes,
        spikes=spikes,
        residual=residual,
        notes=tuple(notes),
    )


def _check(
    z: F64, pitch: float, form: str, longest: float, shortest: float, scale_sd: float
) -> None:
    if z.ndim != 2 or min(z.shape) < LEAST_POINTS:
        raise ValueError(
            f"roughness: a map of shape {z.shape} found; give rows and columns of heights,"
            f" {LEAST_POINTS} or more of each"
        )
    if not 0 < pitch < np.inf:
        raise ValueError(f"roughness: a pitch of {pitch:g} m found; give a finite one above 0")
    if form not in FORMS:
        raise ValueError(f"roughness: the form '{form}' is not known; use {', '.join(FORMS)}")
    if not (0 <= shortest < longest and longest > 4 * pitch and scale_sd >= 0):
        raise ValueError(
            f"roughness: wavelengths from {shortest:g} to {longest:g} m were asked for at a pitch"
            f" of {pitch:g} m; give the shorter one first, and the longer above four pitches"
        )
    known = np.isfinite(z)
    if known.mean() < LEAST_KNOWN:
        raise ValueError(
            f"roughness: {known.mean():.0%} of the map was measured, {LEAST_KNOWN:.0%} are needed;"
            " use more light, or a part of the map"
        )
    heights = z[known]
    low, high = heights.min(), heights.max()
    if not high > low:
        raise ValueError("roughness: all heights are equal; give a map of heights")
    clipped = max(np.mean(heights == low), np.mean(heights == high))
    if clipped > LARGEST_CLIPPED:
        raise ValueError(
            f"roughness: {clipped:.1%} of the heights are the greatest or the least of all:"
            " clipped; use a larger range of the instrument"
        )


def _step(heights: F64) -> float:
    """Step in which heights are stored; 0 where they are too many to have one."""
    levels = np.unique(heights)
    return float(np.median(np.diff(levels))) if 1 < len(levels) < 1000 else 0.0


def _without_spikes(z: F64) -> Bool:
    """Which heights are known and no spikes."""
    known = np.isfinite(z)
    filled = np.where(known, z, 0.0)
    scale = float(np.abs(filled).max())
    off = np.abs(filled - scale * cv2.medianBlur((filled / scale).astype(np.float32), 5))[known]
    # a smooth surface is nearly the median of its neighbours, but for its tops: their scatter is
    # not that of most points, and what is small against the roughness does no harm
    sd = max(float(np.percentile(off, 90)) / 1.645, LEAST_SPIKE * robust_sd(z[known]))
    known[known] = off <= SPIKE * sd
    return known


def _levelled(z: F64, known: Bool, form: str) -> F64:
    """Heights less the polynomial through them; NaN where not known."""
    y, x = (np.vander(np.linspace(-1, 1, n), 5, increasing=True) for n in z.shape)
    middle = float(z[known].mean())
    moments = y.T @ known.astype(np.float64) @ x
    right = y[:, :3].T @ np.where(known, z - middle, 0.0) @ x[:, :3]
    powers = POWERS[: FORMS[form]]
    system = [[moments[i + k, j + n] for k, n in powers] for i, j in powers]
    values = np.linalg.solve(system, [right[i, j] for i, j in powers])
    terms = np.zeros((3, 3))
    terms[tuple(zip(*powers, strict=True))] = values
    return z - middle - y[:, :3] @ terms @ x[:, :3].T


def _filled(z: F64, known: Bool) -> F64:
    """Holes filled by the mean of what is known around, in squares that grow until there is any:
    the nearest height alone would make steps, which are summits.
    """
    filled, missing = np.where(known, z, 0.0), ~known
    size = 3
    while missing.any() and size < 2 * max(z.shape):
        share = cv2.blur(known.astype(np.float64), (size, size), borderType=cv2.BORDER_ISOLATED)
        mean = cv2.blur(np.where(known, z, 0.0), (size, size), borderType=cv2.BORDER_ISOLATED)
        found = missing & (share > 0.1)
        filled[found] = mean[found] / share[found]
        missing &= ~found
        size = 2 * size + 1
    return filled


def _periodogram(z: F64, pitch: float) -> tuple[F64, F64, F64]:
    """Power spectral density (m^4) under a Hann window, and the wave numbers along x and y."""
    rows, columns = z.shape
    window = np.outer(_hann(rows), _hann(columns))
    z = z - float((z * window).sum() / window.sum())
    transform = fft2(z * window)
    power = np.abs(transform) ** 2 * pitch**2 / float((window**2).sum())
    power[0, 0] = 0.0
    qx, qy = (floats(2 * np.pi * np.fft.fftfreq(n, pitch)) for n in (columns, rows))
    return power, qx, qy


def _hann(n: int) -> F64:
    return 0.5 - 0.5 * np.cos(2 * np.pi * (np.arange(n) + 0.5) / n)


def _radial(power: F64, qx: F64, qy: F64) -> tuple[F64, F64, F64]:
    """Mean over directions in rings as wide as the coarser step, up to the Nyquist wave number; and
    the wave number of each ordinate.
    """
    q = np.hypot(qx[None, :], qy[:, None])
    width = max(qx[1], qy[1])
    index = np.rint(q / width).astype(int)
    means, middles = _by_ring(index, power, q)
    last = int(min(np.abs(qx).max(), np.abs(qy).max()) / width)
    return middles[1:last], means[1:last], q


def _by_ring(index: I64, *values: F64) -> list[F64]:
    """Means of some values over the places of each index."""
    counts = np.bincount(index.ravel())
    return [np.bincount(index.ravel(), one.ravel()) / counts for one in values]


def _white(spectrum: F64, pitch: float) -> float:
    """Variance of white noise as high as the end of the spectrum, where that is flat; else 0."""
    eighth = len(spectrum) // 8
    end, before = np.mean(spectrum[-eighth:]), np.mean(spectrum[-3 * eighth : -2 * eighth])
    return float(end) / pitch**2 if end > FLAT * before else 0.0


def _check_stripes(power: F64) -> None:
    """Refuse lines of a scan that are shifted against each other: their power lies on an axis."""
    total = float(power.sum())
    for along, name in ((power[:, :2], "rows"), (power[:2].T, "columns")):
        # the window spreads each ordinate over its neighbours
        near = power[:, 3:5] if name == "rows" else power[3:5].T
        more = along @ [1.0, 2.0] - 1.5 * near.sum(axis=1)
        half = len(more) // 2
        far = slice(max(4, half // 4), half)
        extra = 2 * float(more[far].sum())
        noise = 5 * math.sqrt((near[far] ** 2).sum())
        if extra > LARGEST_STRIPES * total and extra > SIGNIFICANT * noise:
            raise ValueError(
                f"roughness: the {name} of the map are shifted against each other, by"
                f" {extra / total:.0%} of the variance; level the lines of the scan first"
            )


def _correlation_length(z: F64, known: Bool, pitch: float) -> float:
    """Distance at which the autocorrelation, mean over directions, is 1/e."""
    ny, nx = (n // 4 for n in z.shape)  # what is correlated further has too few hills
    shape = [
        next_fast_len(n + reach, real=True) for n, reach in zip(z.shape, (ny, nx), strict=True)
    ]
    heights, mask = np.where(known, z, 0.0), known.astype(np.float64)
    sums, pairs = (irfft2(np.abs(rfft2(v, shape)) ** 2, shape) for v in (heights, mask))
    correlation = sums[:ny, :nx] / np.maximum(pairs[:ny, :nx], 1.0)
    mirrored = sums[-ny:, :nx] / np.maximum(pairs[-ny:, :nx], 1.0)
    r = np.hypot(np.arange(ny)[:, None], np.arange(nx))
    back = np.hypot(np.arange(ny, 0, -1)[:, None], np.arange(nx))
    distance = np.concatenate([r, back]).ravel()
    index = np.rint(distance).astype(int)
    level = np.concatenate([correlation, mirrored]).ravel() / correlation[0, 0]
    profile, places = _by_ring(index, level, distance)
    below = np.flatnonzero(profile < 1 / math.e)
    if not len(below):
        return math.inf
    i = int(below[0])
    share = (profile[i - 1] - 1 / math.e) / (profile[i - 1] - profile[i])
    return float(places[i - 1] + share * (places[i] - places[i - 1])) * pitch
