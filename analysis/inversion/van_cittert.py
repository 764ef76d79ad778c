"""Shear stress by Van-Cittert's iteration, as in the paper, with a step that is bounded by the
operator's norm.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from analysis.inversion.problem import InversionProblem
from analysis.inversion.result import EndOfInversion, Inversion

# relative fall of chi2 that counts as one, and iterations without any after which it is over
MIN_CHI2_FALL, MAX_FUTILE_ITERATIONS = 1e-3, 10


def van_cittert(
    problem: InversionProblem,
    ux: ArrayLike,
    sd: ArrayLike | None = None,
    *,
    D: float | None = None,
    step: float = 1.0,
    iterations: int = 400,
) -> Inversion:
    """Shear stress from a displacement field: what the fit misses of it is added to the stress
    until the residual is down to the noise.

    Parameters
    ----------
    problem : InversionProblem
        The paper's way is a mask of the whole field with `D` given.
    ux, sd
        As for `conjugate_gradient`.
    D : float, optional
        Displacement of the block far away, metres; default: fitted in each iteration.
    step : float
        In units of the reciprocal of the operator's largest eigenvalue, above 0 and below 2, where
        the iteration would diverge. The paper's 5 percent is a small one: it takes twenty times the
        iterations for the same stress.
    iterations : int
        Largest number of iterations.

    Returns
    -------
    Inversion
        Of the iteration with the least residual. ``stopped`` is "stagnation" where the residual no
        longer falls: D or the mask is wrong, or the noise larger than `sd`.

    Raises
    ------
    ValueError
        A step that diverges, a `D` that is none; see also `InversionProblem.measured`.

    References
    ----------
    Van Cittert (1931); Prevost et al. 2013, section 4, and Chateauminois and Fretigny (2008).
    """
    if not 0 < step < 2:
        raise ValueError(
            f"Van-Cittert: a step of {step:g} over the largest eigenvalue was given; it converges"
            " between 0 and 2"
        )
    if D is not None and not math.isfinite(D):
        raise ValueError(f"Van-Cittert: a displacement of {D:g} m far away was given; use a number")
    field = problem.measured(ux, sd, needs_outside=D is None)
    sigma = image = np.zeros(problem.mask.shape)
    usual = np.median(field.weight[field.weight > 0])
    trusted = np.minimum(1.0, field.weight / usual)
    gain = np.where(problem.mask, trusted * step / problem.largest, 0.0)
    best, n, since = (np.inf, sigma, 0.0, image), 0, 0
    while True:
        far = field.mean(field.u + image) if D is None else D
        residual = field.u + image - far
        chi2 = field.chi2(residual)
        since = 0 if chi2 < (1 - MIN_CHI2_FALL) * best[0] else since + 1
        if chi2 < best[0]:
            best = (chi2, sigma, far, residual)
        if chi2 <= 1 or since >= MAX_FUTILE_ITERATIONS or n >= iterations:
            break
        sigma = sigma - gain * residual
        image = problem.green.apply(sigma)
        n += 1
    chi2, sigma, far, residual = best
    stopped = (
        EndOfInversion.STAGNATION if since >= MAX_FUTILE_ITERATIONS else EndOfInversion.ITERATIONS
    )
    if chi2 <= 1:
        stopped = EndOfInversion.DISCREPANCY
    D_sd = np.nan if D is None else 0.0
    return problem.result(sigma, far, field, residual, n, stopped, D_sd=D_sd)
