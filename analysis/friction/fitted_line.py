"""A straight line through points whose errors may be alike from one to the next."""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

import numpy as np

from analysis.arrays import F64
from analysis.robust import MOST_CORRELATED, serial_correlation, serial_sum

MIN_POINTS = 12  # from which the correlation of successive errors is told
CERTAIN = 2.0  # standard deviations of the scatter by which it exceeds a known noise for certain


@dataclass(frozen=True, slots=True)
class FittedLine:
    """A least-squares line through points at `x`, whose errors have the standard deviation `noise`
    and, from one to the next, a correlation.
    """

    x: F64
    mean: float
    slope: float
    noise: float
    correlation: float

    @property
    def zero(self) -> float:
        """Where the line meets 0."""
        return float(self.x.mean()) - self.mean / self.slope

    @property
    def slope_sd(self) -> float:
        """Standard uncertainty of the slope."""
        x = self.x - self.x.mean()
        return self.noise * sqrt(serial_sum(x, self.correlation)) / float(x @ x)

    def sd_of_mean(self, count: int) -> float:
        """Of as many successive points."""
        return self.noise * sqrt(serial_sum(np.full(count, 1 / count), self.correlation))

    def at(self, x: F64 | float) -> F64:
        """The line there, shape of `x`."""
        return np.asarray(self.mean + self.slope * (x - self.x.mean()))

    def variance_at(self, x: float) -> float:
        """Of the line there."""
        off, middle = self.x - self.x.mean(), float(self.x.mean())
        weights = 1 / len(off) + (x - middle) * off / float(off @ off)
        return self.noise**2 * serial_sum(weights, self.correlation)


def fit_line(x: F64, y: F64, known: float = 0.0) -> FittedLine:
    """Least-squares line, with the noise and the serial correlation of its residuals; a noise that
    is known is taken unless there is certainly more.
    """
    off, mean = x - x.mean(), float(y.mean())
    spread = float(off @ off)
    slope = float(off @ (y - mean)) / spread
    residual = y - mean - slope * off
    columns = np.stack([np.full(len(x), len(x) ** -0.5), off / sqrt(spread)])
    return FittedLine(x, mean, slope, *noise_of(residual, columns, known))


def noise_of(residual: F64, columns: F64, known: float = 0.0) -> tuple[float, float]:
    """Standard deviation and serial correlation of the errors of which a fit of `columns`, shape
    (parameters, n), orthonormal, has left the residual, shape (n,).
    """
    parameters, n = columns.shape
    correlation = serial_correlation(residual, parameters) if n >= MIN_POINTS else 0.0
    # a fit follows more of slow errors than of white ones
    followed = sum(serial_sum(column, correlation) for column in columns)
    noise = sqrt(float(residual @ residual) / max(n - followed, 1.0))
    if known > 0:  # small steps between frames tell slow errors, even those that the line follows
        is_more = noise**2 > known**2 * (1 + CERTAIN * sqrt(2 / max(n - parameters, 1)))
        noise = noise if is_more else known
        step = float(np.mean(np.diff(residual) ** 2))
        correlation = min(max(1 - step / (2 * noise**2), 0.0), MOST_CORRELATED)
    return noise, correlation


def independent(count: int, correlation: float) -> float:
    """How many independent errors tell as much of their variance as so many of which each keeps
    that share of the one before.
    """
    return count * (1 - correlation**2) / (1 + correlation**2)
