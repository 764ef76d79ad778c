"""Shear stress by conjugate gradients inside a mask, stopped at the noise; warm from the previous
frame for live fields.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import F64
from analysis.inversion.problem import InversionProblem
from analysis.inversion.result import Inversion, Stopped

STILL = 3e-4  # relative fall of chi2 in an iteration below which it has stopped falling


def conjugate_gradient(
    problem: InversionProblem,
    ux: ArrayLike,
    sd: ArrayLike | None = None,
    *,
    start: ArrayLike | None = None,
    iterations: int = 50,
) -> Inversion:
    """Shear stress that explains a displacement field down to its noise, the displacement far away
    fitted.

    Parameters
    ----------
    problem : InversionProblem
    ux : array_like, shape (ny, nx)
        Displacement along x, metres; NaN where not measured.
    sd : float or array_like, optional
        Standard uncertainty of each point, metres; default: measured in the field.
    start : array_like, shape (ny, nx), optional
        Stress to start from: the previous frame's. The result then keeps a part of it: where the
        noise of one frame hides the difference from the previous, nothing is undone, so that fine
        detail lags by a few frames while Q and D do not.
    iterations : int
        Largest number of iterations.

    Notes
    -----
    Conjugate gradients on the normal equations (CGLS); the number of iterations is the
    regularisation. D and the amounts of a few simple stresses are solved for exactly in each
    iteration: they converge last, D against Q above all.

    References
    ----------
    Hansen, Rank-Deficient and Discrete Ill-Posed Problems, section 6.3; Morozov's discrepancy
    principle.
    """
    field = problem.measured(ux, sd)
    sigma = np.zeros(problem.mask.shape) if start is None else np.where(problem.mask, start, 0.0)
    shapes, known = problem.shapes
    root = np.sqrt(field.weight).ravel()
    size, axes = np.linalg.eigh((known * field.weight.ravel()) @ known.T)
    independent = size > 1e-10 * size[-1]  # a small mask may have fewer shapes
    axes = axes[:, independent] / np.sqrt(size[independent])
    across = (known * root).T @ axes

    def unexplained(v: F64) -> F64:
        """What of a displacement neither D nor the simple shapes explain, times the root of the
        weights.
        """
        v = v.ravel() * root
        return np.asarray(v - across @ (v @ across))

    image = problem.green.apply(sigma) if sigma.any() else np.zeros_like(sigma)
    residual = unexplained(field.u + image)
    chi2, stopped, n = float(residual @ residual) / field.count, Stopped.ITERATIONS, 0
    direction, power = np.zeros_like(sigma), np.inf
    while chi2 > 1 and n < iterations:
        back = problem.green.apply((root * residual).reshape(sigma.shape))  # its own transpose
        gradient = np.where(problem.mask, back, 0.0)
        new = float(np.vdot(gradient, gradient))
        direction, power = gradient + new / power * direction, new
        image_step = problem.green.apply(direction)
        change = unexplained(image_step)
        square = float(change @ change)
        if not square > 0:
            stopped = Stopped.STAGNATION
            break
        length = power / square
        sigma, image = sigma - length * direction, image - length * image_step
        residual = residual - length * change
        n += 1
        previous, chi2 = chi2, float(residual @ residual) / field.count
        if chi2 > 1 and chi2 > (1 - STILL) * previous:
            stopped = Stopped.STAGNATION
            break
    if chi2 <= 1:
        stopped = Stopped.SILENT if problem.is_silent(field) else Stopped.DISCREPANCY
    amounts = axes @ (((field.u + image).ravel() * root) @ across)
    sigma = sigma + np.tensordot(amounts[1:], shapes, 1)
    left = field.u + image - (amounts @ known).reshape(sigma.shape)
    return problem.result(sigma, float(amounts[0]), field, left, n, stopped)
