"""Ranges, ticks and colour maps of the plots, as plain values.

A range grows in rounded steps, so that axes and colour bars seldom change while a run goes on.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.gui.cells import number
from app.records.record_types import F64

Range = tuple[float, float]

STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)  # times a power of ten
LEAST_USE = 0.3  # a range is left when less than this share of it is used
NOISE_SHARE = 0.04  # of the span: so much below zero is noise
ONE_SIGNED = 0.15  # values are of one sign where the other one reaches this share of them at most
ENOUGH = 6000  # values of which percentiles are taken
ROBUST = (1.0, 99.0)  # percentiles between which a colour scale must reach

# colours through which a map goes, dark to light or dark to light to dark
_SEQUENTIAL = ((68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (253, 231, 37))
_DIVERGING = ((5, 48, 97), (67, 147, 195), (247, 247, 247), (214, 96, 77), (103, 0, 31))
_TO_XYZ = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]])
_WHITE = _TO_XYZ.sum(axis=1)


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


def ticks(low: float, high: float, most: int) -> list[tuple[float, str]]:
    """Round numbers from `low` to `high`, about `most` of them, with the decimals that they need
    and no more.
    """
    step = round_step((high - low) / max(1, most))
    digits, exponent = f"{step:.1e}".split("e")  # 2.5 needs a decimal more than 2 or 5
    decimals = max(0, -int(exponent) + (digits[2] != "0"))
    first, last = math.ceil(low / step - 1e-6), math.floor(high / step + 1e-6)
    return [(n * step, number(n * step + 0.0, decimals)) for n in range(first, last + 1)]


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


# ------------------------------------------------------------------ colours


@cache
def sequential() -> NDArray[np.uint8]:
    """256 colours of evenly rising lightness, blue to yellow, shape (256, 3)."""
    return _even(_SEQUENTIAL, 256)


@cache
def diverging() -> NDArray[np.uint8]:
    """256 colours, blue to white to red, whose lightness rises and falls evenly, (256, 3)."""
    half = len(_DIVERGING) // 2
    return np.concatenate([_even(_DIVERGING[: half + 1], 128), _even(_DIVERGING[half:], 128)])


def _even(knots: tuple[tuple[int, int, int], ...], count: int) -> NDArray[np.uint8]:
    """Colours through `knots` whose lightness changes evenly."""
    lab = np.array([_lab(np.array(knot)) for knot in knots])
    way = np.linspace(lab[0, 0], lab[-1, 0], count)
    order = np.argsort(lab[:, 0])
    a, b = (np.interp(way, lab[order, 0], lab[order, n]) for n in (1, 2))
    return _rgb(np.column_stack([way, a, b]))


def _lab(rgb: NDArray[Any]) -> F64:
    """CIE Lab of an sRGB colour of 0 to 255."""
    share = rgb / 255
    linear = np.where(share > 0.04045, ((share + 0.055) / 1.055) ** 2.4, share / 12.92)
    ratio = _TO_XYZ @ linear / _WHITE
    f = np.where(ratio > 216 / 24389, np.cbrt(ratio), (24389 / 27 * ratio + 16) / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


def _rgb(lab: F64) -> NDArray[np.uint8]:
    """The sRGB colours of Lab ones, shape (n, 3)."""
    y = (lab[:, 0] + 16) / 116
    f = np.column_stack([y + lab[:, 1] / 500, y, y - lab[:, 2] / 200])
    ratio = np.where(f > 6 / 29, f**3, (116 * f - 16) * 27 / 24389)
    linear = np.clip(np.linalg.solve(_TO_XYZ, (ratio * _WHITE).T).T, 0, 1)
    share = np.where(linear > 0.0031308, 1.055 * linear ** (1 / 2.4) - 0.055, 12.92 * linear)
    return np.asarray(np.rint(255 * share), np.uint8)
