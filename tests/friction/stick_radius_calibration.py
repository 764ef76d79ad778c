"""An estimate of the stick radius c corrected to a definition of c.

The stress from measured displacements is rounded by the correlation boxes and by the inversion's
regularisation, which moves its maximum; the fit of `analysis.friction.stick` supposes Cattaneo and
Mindlin's law. Both biases are those of the same estimate on a model's displacements.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator

from analysis.arrays import F64
from analysis.friction.stick import seen_in_rings
from analysis.mechanics.loading import LoadingState

MIN_STATES = 5  # of the model
RELIABLE = 0.7  # share of the samples of a state in which its estimate must exist


def displacement_in_rings(
    state: LoadingState, r: ArrayLike, box: float = 0.0, width: float = 0.0
) -> F64:
    """Mean of u_x over rings in a state of the loading solution, metres, as measured with boxes and
    rings of a given size; shape of `r`.
    """
    return np.asarray(state.D - seen_in_rings(lambda at: state.displacement(at)[0], r, box, width))


@dataclass(frozen=True, slots=True)
class Calibration:
    """What an estimate of c is worth in terms of a definition of c: arrays of shape (m,), metres,
    both increasing.

    Attributes
    ----------
    estimate, truth : ndarray
        Mean of the estimate in states of the model, and c in these states.
    scatter : ndarray
        Standard deviation of the estimate; NaN where the model was without noise.
    between : float
        Standard error of interpolating between the states.
    """

    estimate: F64
    truth: F64
    scatter: F64
    between: float

    def corrected(self, value: float, sd: float = np.nan) -> tuple[float, float]:
        """The c that an estimate stands for, and its standard uncertainty; both NaN beyond what the
        model covers by more than that.

        `sd` is the estimate's own uncertainty; default: the model's scatter there.
        """
        least, most = self.estimate[0], self.estimate[-1]
        spread = float(np.interp(value, self.estimate, self.scatter)) if np.isnan(sd) else sd
        if not least - spread <= value <= most + spread:
            return np.nan, np.nan
        curve = PchipInterpolator(self.estimate, self.truth)
        # the slope over the uncertainty, not at a point
        low, high = np.clip([value - spread, value + spread], least, most)
        rise = (curve(high) - curve(low)) / (high - low) if high > low else curve(low, 1)
        c = float(curve(np.clip(value, least, most)))
        return c, float(np.hypot(rise * spread, self.between))


def calibrate(
    estimate: Callable[[F64], float],
    profiles: ArrayLike,
    truth: ArrayLike,
    noise: ArrayLike | None = None,
    *,
    resolution: float = 0.0,
) -> Calibration:
    """How an estimate of c relates to its truth in a model, by applying it to the model's
    displacements.

    Parameters
    ----------
    estimate : callable
        From u_x in rings, shape (n,), to c in metres: the very estimate that measurements go
        through, with box, inversion and regularisation. NaN where it fails.
    profiles : array_like, shape (m, n)
        Mean of u_x over each ring in m states of the model, without noise
        (`displacement_in_rings`).
    truth : array_like, shape (m,)
        c in each state by the definition wanted, metres: of Cattaneo and Mindlin, or
        `LoadingState.peak_radius`.
    noise : array_like, shape (k, n), optional
        Samples of the noise of ring means, metres, such as residuals of an inversion. With them the
        estimate's bias holds what noise adds, and its scatter is known: a regularisation that
        adapts to noise makes both depend on it.
    resolution : float
        Least step of c between states that are told apart, metres.

    Raises
    ------
    ValueError
        Fewer than five states give an estimate that grows with the truth.
    """
    c, u = np.asarray(truth, dtype=np.float64), np.asarray(profiles, dtype=np.float64)
    samples = np.zeros((1, u.shape[1])) if noise is None else np.asarray(noise, dtype=np.float64)
    samples = samples - samples.mean(axis=0)  # the mean of a few samples is no bias
    found = np.array([[estimate(row + sample) for sample in samples] for row in u])
    reliable = np.isfinite(found).mean(axis=1) > RELIABLE
    found, c = found[reliable], c[reliable]
    mean, scatter = np.nanmean(found, axis=1), np.full(len(c), np.nan)
    if len(samples) > 1:
        scatter = np.nanstd(found, axis=1, ddof=1)
    keep: list[int] = []
    # a state whose estimate does not exceed the one before is of no use
    for i in np.argsort(c, kind="stable"):
        if not keep or (mean[i] > mean[keep[-1]] and c[i] > c[keep[-1]] + resolution):
            keep.append(int(i))
    if len(keep) < MIN_STATES:
        raise ValueError(
            f"calibration of c: the estimate grows with c in {len(keep)} states of the model; give"
            f" {MIN_STATES} or more"
        )
    mean, c, scatter = mean[keep], c[keep], scatter[keep]
    # at twice the step the error is some twice as large
    miss = PchipInterpolator(mean[::2], c[::2])(mean[1:-1:2]) - c[1:-1:2]
    return Calibration(mean, c, scatter, float(np.sqrt(np.mean(miss**2))) / 2)
