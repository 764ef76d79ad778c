"""Ageing of a contact at rest: the peak of the friction after a hold, and how it grows with the
duration of the hold.

References
----------
Dieterich 1979, J. Geophys. Res. 84 (slide-hold-slide; beta ln t); Baumberger and Caroli 2006, Adv.
Phys. 55, section 5 (creep of the micro-contacts, the length D_c).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike

from analysis.arrays import F64, floats, in_step
from analysis.friction.fitted_line import fit_line
from analysis.friction.ratio import sliding_ratio
from analysis.robust import white_noise

WINDOW = 7  # values of the parabola whose top is the peak
MIN_FRAMES = 2 * WINDOW  # least values of a slide
MIN_HOLDS = 3
MAX_FRICTION_CHANGE = 0.03  # share by which the friction may change over its last third
SHORTEST, LONGEST = 1e-3, 10.0  # t0, in the shortest and the longest hold


@dataclass(frozen=True, slots=True)
class Slide:
    """The friction of one slide. Numbers are NaN where they are unknown.

    Attributes
    ----------
    peak, peak_sd : float
        Greatest Q/P.
    mu_d, mu_d_sd : float
        Mean Q/P of the last third, if it is steady.
    """

    peak: float = math.nan
    peak_sd: float = math.nan
    mu_d: float = math.nan
    mu_d_sd: float = math.nan


def slide_friction(ratio: ArrayLike, joined: int = 1) -> Slide:
    """The friction of a slide from Q/P of its frames, or of the means over as many samples each,
    evenly spaced, shape (n,); so many of them at most are joined to tell how they scatter.

    The peak is the greatest value of the parabolas through seven in a row: the greatest single
    value would be that of the noise. Its uncertainty is that by white noise, or the scatter of the
    parabolas along the last third.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> ratio = np.append(np.linspace(0, 1.1, 20), 0.9 + 0.2 * np.exp(-np.arange(60) / 8))
    >>> slide = analysis.slide_friction(ratio)
    >>> round(slide.peak, 2)
    1.1
    """
    q = floats(ratio)
    q = q[np.isfinite(q)]
    if len(q) < MIN_FRAMES:
        return Slide()
    last = q[-(len(q) // 3) :]
    x = np.arange(WINDOW) - WINDOW // 2
    weights = np.linalg.pinv(np.vander(x, 3))[2]  # of the value in the middle
    tops = np.convolve(q, weights[::-1], "valid")
    later = tops[-max(len(last) - WINDOW, 2) :]
    white = white_noise(q) * math.sqrt(float(weights @ weights))
    peak, peak_sd = float(tops.max()), fit_line(np.arange(float(len(later))), later, white).noise
    slides = sliding_ratio(last, joined)
    change = np.polyfit(np.linspace(0.0, 1.0, len(last)), last, 1)[0]
    if abs(change) > MAX_FRICTION_CHANGE * abs(slides.mean):
        return Slide(peak, peak_sd)
    return Slide(peak, peak_sd, slides.mean, slides.sd)


@dataclass(frozen=True, slots=True)
class Ageing:
    """How the static friction grows with a hold: ``beta ln(1 + t/t0)``. Numbers are NaN where the
    holds do not tell them, for the reason in `notes`.

    Attributes
    ----------
    rate, rate_sd : float
        beta, per e-fold of the duration.
    time, time_sd : float
        t0, s.
    notes : tuple of str
    """

    rate: float = math.nan
    rate_sd: float = math.nan
    time: float = math.nan
    time_sd: float = math.nan
    notes: tuple[str, ...] = ()


def fit_ageing(hold: ArrayLike, rise: ArrayLike, rise_sd: ArrayLike) -> Ageing:
    """The law of ageing that fits what friction rose by.

    Parameters
    ----------
    hold, rise, rise_sd : array_like, shape (n,)
        Duration of each hold (s), peak above the friction before it, its standard uncertainty.

    Raises
    ------
    ValueError
        Their shapes differ.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> hold = np.array([1.0, 3.0, 10.0, 30.0, 100.0])
    >>> found = analysis.fit_ageing(hold, 0.02 * np.log1p(hold / 0.5), np.full(5, 1e-3))
    >>> round(found.rate, 3), round(found.time, 2)  # seconds
    (0.02, 0.5)
    """
    t, y, sd = in_step("ageing", hold=hold, rise=rise, rise_sd=rise_sd)
    known = (t > 0) & np.isfinite(y) & (sd > 0)
    t, y, sd = t[known], y[known], sd[known]
    if len(np.unique(t.round(6))) < MIN_HOLDS:
        why = (
            f"ageing: {len(t)} slides after a hold in sliding were measured; {MIN_HOLDS} or more"
            " after holds of different length are needed for beta"
        )
        return Ageing(notes=(why,))

    def grown(p: F64) -> F64:
        return np.asarray(p[0] * np.log1p(t * math.exp(-p[1])))

    low, high = math.log(SHORTEST * t.min()), math.log(LONGEST * t.max())
    start = np.log1p(t)
    first = [float(start @ y / (start @ start)), 0.0 if low < 0 < high else (low + high) / 2]
    found = scipy.optimize.least_squares(
        lambda p: (grown(p) - y) / sd, first, bounds=([-np.inf, low], [np.inf, high]), x_scale="jac"
    )
    rate, log_time = found.x
    scatter = max(1.0, 2 * found.cost / max(len(t) - 2, 1))
    at_end = min(log_time - low, high - log_time) < 1e-3 * (high - low)
    information = found.jac.T @ found.jac
    if at_end or np.linalg.cond(information) > 1e12:
        why = "ageing: the holds do not determine t0, hence not beta; add shorter and longer ones"
        return Ageing(notes=(why,))
    variances = np.diag(np.linalg.inv(information)) * scatter
    time = math.exp(log_time)
    return Ageing(
        float(rate),
        float(np.sqrt(variances[0])),
        time,
        time * float(np.sqrt(variances[1])),
    )
