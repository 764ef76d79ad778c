"""Q/P from the samples of the sensors, and its mean where a contact slides."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import F64, all_floats, floats
from analysis.friction.fitted_line import fit_line
from analysis.robust import serial_inflation

# a period of the hum of 50 Hz: a mean over it is free of that, and follows a peak or stick-slip
BLOCK_S = 0.02
# blocks of which a mean tells errors that last: in neighbouring blocks those of a second are all
# but the same, and white noise hides it
JOINED = 10
FEWEST_MEANS = 10  # from which their scatter is told: of fewer it is often far too small
FEWEST_POINTS = 3  # of a line with a scatter
ROUNDING = 1e-6  # of the number of a sample
WITHOUT_GAPS = 0.75  # least share of the samples of a time that are known


class Sliding(NamedTuple):
    """Q/P of a contact that slides: its mean with the standard uncertainty, least and greatest."""

    mean: float
    sd: float
    least: float
    greatest: float


def sample_ratios(
    samples: tuple[ArrayLike, ArrayLike, ArrayLike],
    begin_s: float,
    end_s: float,
    block_s: float = BLOCK_S,
) -> F64:
    """Q/P of the mean forces over successive blocks from one time up to another, shape (n,); NaN of
    blocks of which a quarter is missing. There are none where these are less than three quarters
    of that time, or the samples are further apart than blocks.

    Parameters
    ----------
    samples : tuple of array_like, each of shape (m,)
        Time (s), Q and P (N), evenly spaced; NaN where a sample is missing.
    """
    t, q, p = all_floats(*samples)
    nothing = np.empty(0)
    step = _step(t)
    if not step <= block_s * (1 + 1e-9):
        return nothing
    n = round(block_s / step)
    first, last = np.searchsorted(t, (begin_s, end_s))
    blocks = int(last - first) // n
    both = np.stack([q, p])[:, first : first + n * blocks].reshape(2, blocks, n)
    known = np.isfinite(both).all(axis=0)
    Q, P = np.where(known, both, 0.0).sum(axis=2)
    is_known = (known.sum(axis=1) >= WITHOUT_GAPS * n) & (P > 0)
    if is_known.sum() * n * step < WITHOUT_GAPS * (end_s - begin_s):
        return nothing
    ratios: F64 = np.divide(Q, P, out=np.full(blocks, np.nan), where=is_known)
    return ratios


def forces_around(
    samples: tuple[ArrayLike, ArrayLike, ArrayLike], time: ArrayLike, exposure_s: float = 0.0
) -> tuple[F64, F64]:
    """Mean Q and P over the samples about each of these times, each of shape (n,), over as many
    periods of the hum of 50 Hz as hold an exposure. NaN where a quarter of those is missing, and
    where the samples are too far apart for such a mean.

    Parameters
    ----------
    samples : tuple of array_like, each of shape (m,)
        Time (s), Q and P (N), evenly spaced; NaN where a sample is missing.
    time : array_like, shape (n,)
        Middle of the exposure of each frame, s.
    exposure_s : float
        What it lasts.

    Examples
    --------
    >>> import numpy as np
    >>> from analysis.friction.ratio import forces_around
    >>> t = np.arange(2000) / 1000
    >>> hum = 0.01 * np.sin(2 * np.pi * 50 * t + 1)
    >>> Q, P = forces_around((t, 0.2 * t + hum, 0.5 + hum), [0.5, 1.5], 0.01)
    >>> Q.round(4).tolist(), P.round(4).tolist()
    ([0.0999, 0.2999], [0.5, 0.5])
    """
    t, q, p = all_floats(*samples)
    at, step = floats(time), _step(t)
    nothing = np.full(at.shape, np.nan)
    if not step <= BLOCK_S / 2:
        return nothing, nothing
    n = round(BLOCK_S * max(math.ceil(exposure_s / BLOCK_S - 1e-9), 1) / step)
    known = np.isfinite(q) & np.isfinite(p)
    # an exposure of two samples, 7 and 8, has its middle at 8: there its second half begins
    middle, places = (at - t[0]) / step, np.arange(len(t) + 1)
    is_inside = (middle > n / 2 - ROUNDING) & (middle < len(t) - n / 2 + ROUNDING)

    def sum_of(y: F64) -> F64:
        so_far = np.append(0.0, np.cumsum(np.where(known, y, 0.0)))
        end, begin = (np.interp(middle + half, places, so_far) for half in (n / 2, -n / 2))
        return np.asarray(end - begin)

    count = sum_of(np.ones(len(t)))
    count = np.where(is_inside & (count > WITHOUT_GAPS * n - ROUNDING), count, np.nan)
    return sum_of(q) / count, sum_of(p) / count


def _step(t: F64) -> float:
    """From one sample to the next, s; infinite of fewer than two."""
    return float(t[-1] - t[0]) / (len(t) - 1) if len(t) > 1 else math.inf


def sliding_ratio(ratios: F64, joined: int = 1, steady: int = 0) -> Sliding:
    """What successive Q/P of a contact that slides come down to, shape (n,), NaN where there is
    none; of those from `steady` on, means of so many tell how they scatter, or of fewer if less
    than ten means would be left. The uncertainty is at least that of single values that are
    independent, and NaN of fewer than three.
    """
    known = np.isfinite(ratios)
    mean, later = float(ratios[known].mean()), ratios[steady:][known[steady:]]
    sd = np.nan
    if len(later) >= FEWEST_POINTS:
        joined = max(1, min(joined, len(later) // FEWEST_MEANS))
        each = later[: len(later) // joined * joined].reshape(-1, joined).mean(axis=1)
        scatter = fit_line(np.arange(float(len(each))), each)
        count = max(round(known.sum() / joined), 1)
        singly = later - fit_line(x := np.arange(float(len(later))), later).at(x)
        white = np.sqrt(singly @ singly / (len(later) - 2) / known.sum())
        sd = max(scatter.sd_of_mean(count), float(white))
    return Sliding(mean, sd, float(ratios[known].min()), float(ratios[known].max()))


def mean_friction(
    time: F64,
    Q: F64,
    P: F64,
    Q_sd: float,
    samples: tuple[ArrayLike, ArrayLike, ArrayLike] | None = None,
) -> tuple[float, float, str]:
    """Mean Q/P, its standard uncertainty and what it is of: of the samples, as for `sample_ratios`,
    between frames that slide, or else of these frames, shape (n,), whose successive values may be
    correlated; `Q_sd` is the noise of one in newtons.
    """
    if samples is not None:  # the last frame may lie beyond a turn of the stage
        ratios = sample_ratios(samples, float(time[0]), float(time[-2]))
        if len(ratios) >= FEWEST_MEANS:
            return *sliding_ratio(ratios, JOINED)[:2], "samples"
    each = Q / P
    mean, least = float(each.mean()), Q_sd / float(P.mean())
    wide = max(float(np.var(each, ddof=1)), least**2) * serial_inflation(each - mean)
    return mean, math.sqrt(wide / len(each)), "frames"
