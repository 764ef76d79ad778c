"""Penalised least squares whose smoothing is chosen from the data, for noise that neighbours share."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import linalg

F64 = NDArray[np.float64]

# by which a degree of freedom counts more: plain cross-validation fits noise once in a while
CAUTION = 1.4
_TRIED = np.linspace(0, 1, 60)


@dataclass(frozen=True, slots=True)
class Smooth:
    """Coefficients with their covariance (noise and smoothing), and chi2 per degree of freedom
    left.
    """

    coefficients: F64
    covariance: F64
    chi2: float
    freedom: float  # degrees of freedom that are left

    def sd(self, rows: F64) -> F64:
        """Standard uncertainty of each of several sums of the coefficients; rows of shape (n, k) to
        (n,).
        """
        return np.asarray(
            np.sqrt(np.maximum(np.einsum("ij,ij->i", rows, rows @ self.covariance), 0.0))
        )


def smooth_fit(
    gram: F64, shared: F64, right: F64, power: float, penalty: F64, count: int
) -> Smooth:
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
    strength = floor * (1e3 / (floor * np.min(g[g > 1e-9 * g[-1]]))) ** _TRIED
    passed = 1 / (1 + np.outer(strength - floor, g))
    left = count - passed @ spread
    misfit = np.maximum(power - (passed * (2 - passed * data)) @ z**2, 0.0)
    score = np.where(
        CAUTION * (count - left) < count, misfit / (count - CAUTION * (count - left)) ** 2, np.inf
    )
    best = int(np.argmin(score))
    chosen = V * passed[best]
    b = chosen @ z
    freedom = max(float(left[best]), 1e-9)
    chi2 = max(power - 2 * b @ (scale * right) + b @ gram @ b, 0.0) / freedom
    covariance = chosen @ (V.T @ shared @ V + np.diag(strength[best] * g)) @ chosen.T
    return Smooth(scale * b, max(chi2, 1.0) * covariance * square, float(chi2), freedom)


def box_correlation(distance: NDArray[np.floating], box: float) -> F64:
    """Correlation between the noise of two boxes that far apart along one axis: the share of the
    box that they have in common.
    """
    return (
        np.maximum(1 - np.abs(distance) / box, 0.0)
        if box > 0
        else np.asarray(distance == 0, dtype=np.float64)
    )


def shared_noise(fields: F64, pitch: float, box: float) -> F64:
    """Fields of shape (..., ny, nx) times the correlation matrix of the noise of overlapping boxes
    on their grid.
    """
    n = int(np.ceil(box / pitch)) if box > 0 else 0
    kernel = box_correlation(np.arange(-n, n + 1, dtype=np.float64) * pitch, box)
    for axis in (-1, -2):
        size = fields.shape[axis]
        total = np.zeros_like(fields)
        for k, value in zip(range(-n, n + 1), kernel, strict=True):
            if value > 0 and abs(k) < size:
                to, since = slice(max(k, 0), size + min(k, 0)), slice(max(-k, 0), size - max(k, 0))
                index = (..., to) if axis == -1 else (..., to, slice(None))
                source = (..., since) if axis == -1 else (..., since, slice(None))
                total[index] += value * fields[source]
        fields = total
    return fields
