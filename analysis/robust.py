"""Scatter and weights that outliers hardly change."""

from __future__ import annotations

import numpy as np

from analysis.arrays import Array

SCALED = 1.4826  # from the median absolute deviation of Gaussian noise to its standard deviation


def robust_sd(deviations: Array) -> float:
    """Standard deviation of the values about 0, from their median absolute value."""
    return SCALED * float(np.median(np.abs(deviations)))


def white_noise(y: Array) -> float:
    """Standard deviation of the noise on a smooth signal, shape (n,), from its second
    differences.
    """
    return robust_sd(np.diff(y, 2)) / float(np.sqrt(6))


def serial_inflation(residual: Array) -> float:
    """Factor, at least 1, by which the correlation of successive residuals raises the variance of
    what is fitted to them.
    """
    power = float(residual @ residual)
    correlation = float(residual[1:] @ residual[:-1]) / power if power > 0 else 0.0
    return max(1.0, (1 + correlation) / (1 - correlation))
