"""Ranges of the plots and of their colours, as plain values.

A range grows in rounded steps, so that axes and colour bars seldom change while a run goes on.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

Range = tuple[float, float]
Ranges = tuple[Range, Range]  # of x and y

STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)  # times a power of ten
LEAST_USE = 0.3  # a range is left when less than this share of it is used
NOISE_SHARE = 0.04  # of the span: so much below zero is noise
ONE_SIGNED = 0.15  # values are of one sign where the other one reaches this share of them at most
ENOUGH = 6000  # values of which percentiles are taken
ROBUST = (1.0, 99.0)  # percentiles between which a colour scale must reach


def round_step(least: float) -> float:
    """The least of `STEPS`, times a power of ten, that is not below `least` > 0."""
    decade = 10.0 ** math.floor(math.log10(least))
    return next(step * decade for step in STEPS if least <= step * decade * (1 + 1e-9))


def round_range(low: float, high: float, held: Range | None = None) -> Range:
    """A range that holds `low` to `high` and ends on round numbers.

    It is `held` as long as that holds them and they use enough of it.
    """
    if not (math.isfinite(low) and math.isfinite(high)):
        return held or (0.0, 1.0)
    if high - low <= 1e-12 * max(abs(low), abs(high), 1e-12):
        margin = 0.1 * abs(low) or 1.0
        low, high = low - margin, high + margin
    span = high - low
    holds = held is not None and held[0] <= low and high <= held[1]
    if held is not None and holds and span >= LEAST_USE * (held[1] - held[0]):
        return held
    step = round_step(span / (8 if held is None or high - low < held[1] - held[0] else 5))
    first, last = math.floor(low / step + 1e-6) * step, math.ceil(high / step - 1e-6) * step
    # what is zero but for noise needs a margin below it, no step
    return (-NOISE_SHARE * span if -NOISE_SHARE * span <= low < 0 else first), last


def power_of_ten(ends: Range) -> int:
    """Of the unit in which the numbers between these ends are short; 0 where they are as it is."""
    reach = max(map(abs, ends))
    return 0 if 0.1 <= reach < 1e4 else math.floor(math.log10(reach))


def robust_range(values: NDArray[Any]) -> Range:
    """What nearly all finite values lie in; NaN where there are none. Of many values some are
    enough.
    """
    every = max(1, values.size // ENOUGH)
    some = values.ravel()[:: every | 1]  # an odd step meets all columns
    finite = some[np.isfinite(some)]
    if not finite.size and every > 1:
        finite = values[np.isfinite(values)]
    if not finite.size:
        return math.nan, math.nan
    low, high = np.percentile(finite, ROBUST)
    return float(low), float(high)


def is_one_signed(low: float, high: float) -> bool:
    """Whether a range of values lies on one side of zero, but for a little."""
    return min(abs(low), abs(high)) <= ONE_SIGNED * max(abs(low), abs(high)) or low * high > 0


def colour_range(low: float, high: float, held: Range | None, *, is_diverging: bool) -> Range:
    """Round ends of a colour scale: equally far from zero, or from zero to beyond the values where
    these are not far from it.
    """
    if is_diverging:
        half = (0.0, held[1]) if held and held[0] == -held[1] else None
        _, reach = round_range(0.0, max(abs(low), abs(high)), half)
        return -reach, reach
    if low * high <= 0 or min(abs(low), abs(high)) < 0.5 * max(abs(low), abs(high)):
        low, high = (0.0, high) if high > -low else (low, 0.0)
    return round_range(low, high, held)


def with_other_sign(held: Range, low: float, high: float) -> Range:
    """Ends of a colour scale that are kept; as far to both sides of zero where values `low` to
    `high` on its other side would have the colour of zero.
    """
    reach = max(map(abs, held))
    of_both = max(-reach, min(held[0], low)), min(reach, max(held[1], high))  # nor are they NaN
    return held if is_one_signed(*of_both) else (-reach, reach)
