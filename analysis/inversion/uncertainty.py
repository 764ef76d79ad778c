"""Uncertainty of any inversion by repetition: noise like the measured one on the fitted field,
inverted again.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from analysis.inversion.problem import InversionProblem
from analysis.inversion.result import Inversion

F64 = NDArray[np.float64]


def bootstrap(
    invert: Callable[[F64], Inversion],
    problem: InversionProblem,
    found: Inversion,
    sd: float | F64,
    *,
    repeats: int = 20,
    seed: int = 0,
) -> Inversion:
    """The same inversion with the standard uncertainty of sigma, D and Q from repetitions with
    fresh noise.

    Parameters
    ----------
    invert : callable
        From a field of u_x, shape (ny, nx), to its inversion: the method with its settings.
    problem, found
        What was inverted, and its result.
    sd : float or ndarray, shape (ny, nx)
        Standard uncertainty of a point, metres; boxes that overlap share noise.
    repeats : int
        Two or more; 20 give the uncertainty within 16 percent.
    seed : int
        Of the noise.

    Notes
    -----
    The spread only: what the method smooths away, or lags by, is the same in each repetition.

    References
    ----------
    Efron and Tibshirani, An Introduction to the Bootstrap, chapter 6 (parametric).
    """
    if repeats < 2:
        raise ValueError(f"bootstrap: {repeats} repetitions were asked; use two or more")
    rng = np.random.default_rng(seed)
    # NaN where nothing was measured
    fitted = found.D - problem.green.apply(found.sigma) + 0 * found.residual
    side = max(round(problem.box / problem.pitch), 1)
    again = [
        invert(
            fitted
            + sd * side * ndimage.uniform_filter(rng.normal(size=fitted.shape), side, mode="wrap")
        )
        for _ in range(repeats)
    ]
    D_sd, Q_sd = (
        float(np.std([getattr(one, name) for one in again], ddof=1)) for name in ("D", "Q")
    )
    return replace(
        found, sigma_sd=np.std([one.sigma for one in again], axis=0, ddof=1), D_sd=D_sd, Q_sd=Q_sd
    )
