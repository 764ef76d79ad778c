"""Q/P from the samples of the sensors, and its mean where a contact slides."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import F64, all_floats
from analysis.friction.fitted_line import fit_line
from analysis.robust import serial_inflation

# a period of the hum of 50 Hz: a mean over it is free of that, and follows a peak or stick-slip
BLOCK_S = 0.02
# blocks of which a mean tells errors that last: in neighbouring blocks those of a second are all
# but the same, and white noise hides it
JOINED = 10
FEWEST_MEANS = 10  # from which their scatter is told: of fewer it is often far too small
FEWEST_POINTS = 3  # of a line with a scatter
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
    step = float(t[-1] - t[0]) / (len(t) - 1) if len(t) > 1 else np.inf
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


def friction_of_frames(
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
