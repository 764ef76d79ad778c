"""A linear fit to a record whose errors are correlated from one reading to the next."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import F64, Bool, in_step
from analysis.robust import MOST_CORRELATED, robust_sd, serial_correlation, serial_sum

MOST_OUTLIERS = 0.05  # share of the readings
FAR = 6.0  # standard deviations, from which a reading is an outlier
SLOWEST = slice(2, 10)  # Fourier frequencies of the record; the fit takes the first of them away
SURELY_SLOW = 2.2  # mean of so many exponentials of mean 1, which chance reaches in 0.4 %
IN_STEP = 0.8  # of the scatter of roundings that are independent
LEAST_READINGS = 40  # for those frequencies


@dataclass(frozen=True, slots=True)
class SerialFit:
    """Coefficients of the columns, with their standard uncertainties, both of shape (k,); the
    residual of the readings that were used, and which of all were.
    """

    values: F64
    sds: F64
    residual: F64
    is_used: Bool

    def of(self, i: int, unit: float) -> tuple[float, float]:
        """A coefficient, whose column counts in units of `unit`, and its standard uncertainty."""
        return float(self.values[i]) / unit, float(self.sds[i]) / unit

    @property
    def rms(self) -> float:
        """Of the residual."""
        return float(np.sqrt(np.mean(self.residual**2)))


def finite_readings(name: str, *columns: ArrayLike) -> list[F64]:
    """The rows of some columns, shape (n,) each, that are whole.

    Raises
    ------
    ValueError
        Their shapes differ, or they are too few; the message begins with `name`.
    """
    named = {f"column {number}": one for number, one in enumerate(columns, 1)}
    table = np.stack([np.ravel(one) for one in in_step(name, **named)])
    table = table[:, np.isfinite(table).all(axis=0)]
    if table.shape[1] < LEAST_READINGS:
        raise ValueError(
            f"{name}: {table.shape[1]} readings were taken; {LEAST_READINGS} or more are needed"
        )
    return list(table)


def serial_fit(name: str, design: F64, y: F64, resolution: float = 0.0) -> SerialFit:
    """Least squares of `y`, shape (n,), in the columns of `design`, shape (n, k), in the order in
    which they were read; single outliers are left out.

    The uncertainty is that of errors whose correlation falls by a factor from one to the next or,
    where the lowest frequencies of the residual have more power than such errors, that of this
    power. Readings of a `resolution` that hardly scatter, as of a motion in step with them, may be
    off by it together.

    Raises
    ------
    ValueError
        Too few readings, or too many outliers; the message begins with `name`.
    """
    known = np.isfinite(y) & np.isfinite(design).all(axis=1)
    if known.sum() < LEAST_READINGS:
        raise ValueError(
            f"{name}: {known.sum()} readings were taken; {LEAST_READINGS} or more are needed"
        )
    values = _least_absolute(design[known], y[known])
    is_used, residual = known, np.full(len(y), np.inf)
    # what is exact has the errors of its rounding
    rounding = max(1e-12 * float(np.abs(y[known]).max()), resolution / FAR)
    for _ in range(4):
        residual[known] = y[known] - design[known] @ values
        is_used = np.abs(residual) < FAR * max(robust_sd(residual[known]), rounding)
        values = np.linalg.lstsq(design[is_used], y[is_used])[0]
    lost = 1 - is_used.sum() / known.sum()
    if lost > MOST_OUTLIERS:
        raise ValueError(
            f"{name}: {lost:.0%} of the readings lie further from the fit than {FAR:g} times their"
            f" scatter; up to {MOST_OUTLIERS:.0%} are left out, so look at the record for what"
            " disturbed it"
        )
    inverse = np.linalg.pinv(design[is_used])
    values = inverse @ y[is_used]
    left = y[is_used] - design[is_used] @ values
    sds = np.sqrt([_variance_of_sum(w, left, len(values)) for w in inverse])
    # roundings of a slow motion change seldom from one reading to the next
    scatter = min(float(left.std()), float(np.diff(left).std()) / math.sqrt(2))
    if scatter < IN_STEP * resolution / math.sqrt(12):
        together = resolution / math.sqrt(12) * np.abs(inverse).sum(axis=1)
        sds = np.maximum(sds, together)
    return SerialFit(values, sds, left, is_used)


def _least_absolute(design: F64, y: F64) -> F64:
    """Coefficients of the least sum of absolute residuals, nearly, which outliers hardly move."""
    weight = np.ones(len(y))
    for _ in range(10):
        values = np.linalg.lstsq(design * weight[:, None], y * weight)[0]
        left = np.abs(y - design @ values)
        weight = 1 / np.sqrt(np.maximum(left, max(1e-3 * float(np.median(left)), 1e-30)))
    return np.asarray(values)


def _variance_of_sum(weights: F64, left: F64, k: int) -> float:
    """Variance of a weighted sum of errors of which the residual is known, after a fit of k
    parameters.
    """
    n = len(left)
    power = float(left @ left)
    near, far = serial_correlation(left, k), float(left[2:] @ left[:-2]) / power if power else 0.0
    far = (far + k / n) / (1 - (k + 2) / n)
    # white errors beside serial ones: the correlation falls more slowly than its first step
    share, factor = 1.0, near
    if far > max(near * near, 2 / math.sqrt(n)):
        factor = min(far / near, MOST_CORRELATED) if near else 0.0
        share = min(near / factor, 1.0) if factor else 1.0
    freedom = n / (1 + 2 * share * factor / (1 - factor))
    variance = power / n * freedom / max(freedom - k, 1.0)
    white, serial = float(weights @ weights), serial_sum(weights, factor)
    found = variance * ((1 - share) * white + share * serial)
    slow = float(np.mean(np.abs(np.fft.rfft(left)[SLOWEST]) ** 2)) / n
    return max(found, slow * white) if slow > SURELY_SLOW * found / white else found
