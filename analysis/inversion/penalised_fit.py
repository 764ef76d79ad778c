"""Penalised least squares, smoothed as the data call for, with noise that neighbours share."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from analysis.arrays import F64

# by which a degree of freedom counts more: plain cross-validation fits noise once in a while
CAUTION = 1.4
AS_GOOD = 1.3  # scores of cross-validation within this factor of the least do not differ
MEASURED = 1e-6  # share of the data, against the smoothing, in what counts as measured
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


class Smoothing:
    """Least ``|y - X b|^2 + lambda b penalty b`` with lambda from generalised cross-validation.

    What does not depend on y is computed once.

    Parameters
    ----------
    gram : ndarray, shape (k, k)
        X'X, in units of the uncertainty of each y.
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

    def __init__(self, gram: F64, shared: F64, penalty: F64, count: int) -> None:
        scale = 1 / np.sqrt(np.maximum(np.diag(gram), 1e-300))
        scale[np.diag(gram) == 0] = 0.0
        square = np.outer(scale, scale)
        gram, shared, penalty = gram * square, shared * square, penalty * square
        balanced = len(gram) / np.trace(penalty)  # the strength that weighs as much as the data
        together = gram + balanced * penalty + 1e-13 * np.eye(len(gram))
        g, V, failed = linalg.lapack.dsygvd(penalty, together)
        g = np.maximum(g, 0.0)
        data = np.maximum(1 - balanced * g, 0.0)  # V' gram V
        # what was not measured has no say in how strong a smoothing is tried
        ratio = g[data > MEASURED] / data[data > MEASURED]
        ratio = ratio[ratio > 1e-9 * ratio.max(initial=0.0)]
        if failed or not ratio.size:
            raise ValueError(
                "smooth fit: the measurements do not determine the unknowns; measure more points,"
                " or widen the field"
            )
        self._scale, self._square, self._gram, self._V, self._g = scale, square, gram, V, g
        self._noise = V.T @ shared @ V
        least = 1e-13 * balanced
        self._strength = least * (1e3 / (least * ratio.min())) ** TRIED
        self._passed = 1 / (data + np.outer(self._strength, g))
        self._explained = self._passed * (2 - self._passed * data)
        self._count, self._left = count, count - self._passed @ np.diag(self._noise)

    def fit(self, right: F64, power: float) -> SmoothFit:
        """The fit to one y, given as X'y (k,) and y'y in units of its uncertainty."""
        right = self._scale * right
        z = self._V.T @ right
        misfit = np.maximum(power - self._explained @ z**2, 0.0)
        taken = CAUTION * (self._count - self._left)
        score = np.where(taken < self._count, misfit / (self._count - taken) ** 2, np.inf)
        # of minima that are as good, that of the strongest smoothing
        least = (score <= np.append(np.inf, score[:-1])) & (score <= np.append(score[1:], np.inf))
        best = int(np.flatnonzero(least & (score <= AS_GOOD * score.min()))[-1])
        chosen = self._V * self._passed[best]
        b = chosen @ z
        freedom = max(float(self._left[best]), 1e-9)
        chi2 = max(power - 2 * b @ right + b @ self._gram @ b, 0.0) / freedom
        covariance = chosen @ (self._noise + np.diag(self._strength[best] * self._g)) @ chosen.T
        return SmoothFit(
            self._scale * b, max(chi2, 1.0) * covariance * self._square, float(chi2), freedom
        )


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
