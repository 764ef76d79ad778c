"""Scatter and weights that outliers hardly change."""

from __future__ import annotations

import numpy as np

from analysis.arrays import F64, Array

MOST_CORRELATED = 0.95
HUBER = 3.0
LAST_BITS = 4.0  # by which rounded numbers may be off what they were rounded to
SCALED = 1.4826  # sd of Gaussian noise over its median absolute deviation


def robust_sd(deviations: Array) -> float:
    """Standard deviation of the values about 0, from their median absolute value."""
    return SCALED * float(np.median(np.abs(deviations)))


def rounding_step(values: F64, per_unit: Array) -> float:
    """The step to which values, shape (n,), are rounded: the first of the fractions 1/`per_unit` of
    which all are whole multiples; 0 where they are of none.
    """
    least = LAST_BITS * np.spacing(np.abs(values).max(initial=0.0))
    for value in values:
        steps = value * per_unit
        per_unit = per_unit[np.abs(steps - np.rint(steps)) <= least * per_unit]
    return 1 / float(per_unit[0]) if per_unit.size else 0.0


def huber_fit(
    design: F64, target: Array, sweeps: int, *, least: float, wider: float = 1.0
) -> tuple[Array, F64, Array]:
    """A linear fit in which what stands out by more than `HUBER` standard deviations counts less.

    Parameters
    ----------
    design : ndarray, shape (n, p)
    target : ndarray, shape (n,)
        Real or complex.
    least, wider : float
        Least standard deviation that is taken for one, and by what factor its estimate is widened.

    Returns
    -------
    values : ndarray, shape (p,)
    covariance : ndarray, shape (p, p)
        Of the values, or of either part of complex ones, by what the fit leaves.
    residual : ndarray, shape (n,)
    """
    weight = np.ones(len(target))
    for _ in range(sweeps):
        root = np.sqrt(weight)
        values = np.linalg.lstsq(design * root[:, None], target * root, rcond=None)[0]
        residual = np.asarray(target - design @ values)
        scale = max(wider * robust_sd(residual.view(np.float64)), least)
        weight = 1 / np.maximum(np.abs(residual) / (HUBER * scale), 1.0)
    inverse = np.linalg.inv(design.T @ (weight[:, None] * design))
    power = float((weight * np.abs(residual) ** 2).sum())
    freedom = (1 + np.iscomplexobj(target)) * (len(target) - design.shape[1])
    return np.asarray(values), np.asarray(power / max(freedom, 1) * inverse), residual


def white_noise(y: Array) -> float:
    """Standard deviation of the noise on smooth signals, shape (..., n), from their second
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


def serial_correlation(residual: Array, parameters: int) -> float:
    """Correlation of successive errors of a series, 0 to `MOST_CORRELATED`, from its residuals
    about a fit of some parameters, which take a part of the slow errors away from them.

    References
    ----------
    Kendall, Biometrika 41 (1954) 403, and Marriott and Pope, ibid. 390: bias of the estimate.
    """
    power, n = float(residual @ residual), len(residual)
    if not power > 0 or n <= 4 * parameters:
        return 0.0
    seen = float(residual[1:] @ residual[:-1]) / power
    return min(max((seen + parameters / n) / (1 - (parameters + 2) / n), 0.0), MOST_CORRELATED)


def serial_sum(weights: F64, correlation: float) -> float:
    """Variance of the weighted sum, shape (n,), of errors of unit variance whose correlation falls
    by a factor from one to the next.
    """
    # scipy.signal, which has this sum, takes half a second to import; here each turn doubles how
    # many errors before its own a weight has taken up
    before, reach = weights.copy(), 1
    while reach < len(before) and (share := correlation**reach) > np.finfo(float).eps ** 2:
        before[reach:] += share * before[:-reach]
        reach *= 2
    return float(weights @ (2 * before - weights))
