"""Penalised least squares, smoothed as the data call for, with noise that neighbours share."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from analysis.arrays import F64

# by which a degree of freedom counts more: plain cross-validation fits noise once in a while
CAUTION = 1.4
TRIED = np.linspace(0, 1, 60)  # strengths, logarithmically between the least and the greatest


@dataclass(frozen=True, slots=True)
class SmoothFit:
    """Coefficients with their covariance (noise and smoothing), and chi2 per degree of freedom."""

    coefficients: F64
    covariance: F64
    chi2: float
    freedom: float  # degrees of freedom that are left

    def sd(self, rows: F64) -> F64:
        """Standard uncertainty of each of several sums of the coefficients; rows of shape (n, k) to
        (n,).
        """
        variance = np.einsum("ij,ij->i", rows, rows @ self.covariance)
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def smooth_fit(
    gram: F64, shared: F64, right: F64, power: float, penalty: F64, count: int
) -> SmoothFit:
    """Least ``|y - X b|^2 + lambda b penalty b`` with lambda from generalised cross-validation.

    Parameters
    ----------
    gram, right, power : ndarray (k, k), ndarray (k,), float
        X'X, X'y and y'y, in units of the uncertainty of each y.
    shared : ndarray, shape (k, k)
        X' C X, where C is the noise's correlation matrix; X'X for independent noise.
    penalty : ndarray, shape (k, k)
        Zero along what is free.
    count : int
        Of measurements.

    Raises
    ------
    ValueError
        The measurements do not determine the coefficients.

    Notes
    -----
    Where noise is shared, the degrees of freedom that a fit takes are the trace of its hat matrix
    times C (Altman). The covariance is that of the noise through the fit plus that of a random b
    whose inverse covariance is the penalty: Bayesian intervals (Wahba), which cover the bias of
    smoothing on average.

    References
    ----------
    Wahba (1983); Altman (1990); Kim and Gu (2004), for the factor `CAUTION`.
    """
    scale = 1 / np.sqrt(np.maximum(np.diag(gram), 1e-300))
    scale[np.diag(gram) == 0] = 0.0
    square = np.outer(scale, scale)
    gram, shared, penalty = gram * square, shared * square, penalty * square
    floor = 1e-13 * len(gram) / np.trace(penalty)
    g, V, failed = linalg.lapack.dsygvd(penalty, gram + floor * penalty + 1e-13 * np.eye(len(gram)))
    if failed:
        raise ValueError(
            "smooth fit: the measurements do not determine the unknowns; measure more points, or"
            " widen the field"
        )
    g = np.maximum(g, 0.0)
    data = np.maximum(1 - floor * g, 0.0)  # V' gram V
    spread = np.einsum("ij,ij->j", V, shared @ V)
    z = V.T @ (scale * right)
    strength = floor * (1e3 / (floor * np.min(g[g > 1e-9 * g[-1]]))) ** TRIED
    passed = 1 / (1 + np.outer(strength - floor, g))
    left = count - passed @ spread
    misfit = np.maximum(power - (passed * (2 - passed * data)) @ z**2, 0.0)
    taken = CAUTION * (count - left)
    score = np.where(taken < count, misfit / (count - taken) ** 2, np.inf)
    best = int(np.argmin(score))
    chosen = V * passed[best]
    b = chosen @ z
    freedom = max(float(left[best]), 1e-9)
    chi2 = max(power - 2 * b @ (scale * right) + b @ gram @ b, 0.0) / freedom
    covariance = chosen @ (V.T @ shared @ V + np.diag(strength[best] * g)) @ chosen.T
    return SmoothFit(scale * b, max(chi2, 1.0) * covariance * square, float(chi2), freedom)


def overlaps(pitch: float, box: float) -> list[tuple[int, int, float]]:
    """Steps down and across a grid to the boxes that overlap one, itself among them, and the
    correlation of their noise with its.
    """
    if box == 0:
        return [(0, 0, 1.0)]
    reach = range(-math.ceil(box / pitch), math.ceil(box / pitch) + 1)
    share = {k: max(1 - abs(k * pitch) / box, 0.0) for k in reach}
    return [(j, i, share[j] * share[i]) for j in reach for i in reach if share[j] * share[i] > 0]


def shared_noise(fields: F64, pitch: float, box: float) -> F64:
    """Fields of shape (..., ny, nx) times the correlation matrix of the noise of overlapping boxes
    on their grid.

    Along each axis the noise of two boxes is correlated by the share of the box that they have in
    common; with a `box` of 0 the noise is independent.
    """
    if box == 0:
        return fields
    n = int(np.ceil(box / pitch))
    for axis in (-1, -2):
        size = fields.shape[axis]
        along = np.moveaxis(fields, axis, -1)
        total = np.zeros_like(fields)
        sums = np.moveaxis(total, axis, -1)
        for k in range(-n, n + 1):
            value = max(1 - abs(k * pitch) / box, 0.0)
            if value > 0 and abs(k) < size:
                to, since = slice(max(k, 0), size + min(k, 0)), slice(max(-k, 0), size - max(k, 0))
                sums[..., to] += value * along[..., since]
        fields = total
    return fields
