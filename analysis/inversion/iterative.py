"""Shear stress by iteration, stopped at the noise: conjugate gradients inside a mask, warm from the
previous frame for live fields, and Van-Cittert's, as in the paper, with a step that is bounded by
the operator's norm.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy import ndimage

from analysis.arrays import F64, Bool
from analysis.inversion.problem import InversionProblem, MeasuredField
from analysis.inversion.result import EndOfInversion, Inversion

# relative fall of chi2 in an iteration below which it has stopped falling
MIN_CHI2_FALL, MIN_CHI2_FALL_VAN_CITTERT = 3e-4, 1e-3
MAX_FUTILE_ITERATIONS = 10  # of Van-Cittert's, without such a fall, after which it is over


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

    Examples
    --------
    >>> import numpy as np, analysis
    >>> x = np.linspace(-4e-3, 4e-3, 61)
    >>> block = {"E": 3.4e6, "nu": 0.5}
    >>> _, ux, _ = analysis.cattaneo_mindlin.field(x, x, Q=0.3, mu=0.9, P=0.5, a=2.4e-3, **block)
    >>> mask = np.hypot(*np.meshgrid(x, x)) < 2.7e-3
    >>> problem = analysis.InversionProblem(mask, x[1] - x[0], **block)
    >>> round(analysis.conjugate_gradient(problem, 20e-6 - ux, 2e-8).Q, 2)
    0.3
    """
    field = problem.measured(ux, sd)
    sigma = np.zeros(problem.mask.shape) if start is None else np.where(problem.mask, start, 0.0)
    shapes, known = problem.shapes
    apply = problem.green.apply
    found = descend(apply, problem.mask, shapes, known, field, sigma, iterations)
    D = float(found.amounts[0])
    return problem.result(found.sigma, D, field, found.residual, found.iterations, found.stopped)


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

    Examples
    --------
    >>> import numpy as np, analysis
    >>> x = np.linspace(-4e-3, 4e-3, 61)
    >>> block = {"E": 3.4e6, "nu": 0.5}
    >>> _, ux, _ = analysis.cattaneo_mindlin.field(x, x, Q=0.3, mu=0.9, P=0.5, a=2.4e-3, **block)
    >>> mask = np.hypot(*np.meshgrid(x, x)) < 2.7e-3
    >>> problem = analysis.InversionProblem(mask, x[1] - x[0], **block)
    >>> round(analysis.van_cittert(problem, 20e-6 - ux, 5e-8, D=20e-6).Q, 2)
    0.3
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
    # stress acts where nothing was measured, too: what the nearest point misses is added there
    nearest = tuple(
        ndimage.distance_transform_edt(trusted == 0, return_distances=False, return_indices=True)
    )
    gain = np.where(problem.mask, trusted[nearest] * step / problem.largest, 0.0)
    best, n, since = (np.inf, sigma, 0.0, image), 0, 0
    while True:
        far = field.mean(field.u + image) if D is None else D
        residual = field.u + image - far
        chi2 = field.chi2(residual)
        since = 0 if chi2 < (1 - MIN_CHI2_FALL_VAN_CITTERT) * best[0] else since + 1
        if chi2 < best[0]:
            best = (chi2, sigma, far, residual)
        if chi2 <= 1 or since >= MAX_FUTILE_ITERATIONS or n >= iterations:
            break
        sigma = sigma - gain * residual[nearest]
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


class Descent(NamedTuple):
    """Where a descent ended: the stress, the amounts of what is known, what is left of u."""

    sigma: F64
    amounts: F64
    residual: F64
    iterations: int
    stopped: EndOfInversion


def descend(
    apply: Callable[[F64], F64],
    mask: Bool,
    shapes: F64,
    known: F64,
    field: MeasuredField,
    sigma: F64,
    iterations: int,
) -> Descent:
    """Conjugate gradients from `sigma`, for one component or both.

    Parameters
    ----------
    apply : callable
        From stress to displacement, its own transpose.
    mask : ndarray of bool
        sigma is 0 outside.
    shapes : ndarray, shape (k, ...)
        Simple stresses.
    known : ndarray, shape (m + k, points)
        What D, of m components, and the simple stresses do to u.
    field : MeasuredField
        Of one component, or of both as one.
    sigma : ndarray
        Stress to start from.
    iterations : int
        Largest number of iterations.
    """
    u, weight, count = field.u, field.weight, field.count
    root = np.sqrt(weight).ravel()
    size, axes = np.linalg.eigh((known * weight.ravel()) @ known.T)
    independent = size > 1e-10 * size[-1]  # a small mask may have fewer shapes
    axes = axes[:, independent] / np.sqrt(size[independent])
    across = (known * root).T @ axes

    def unexplained(v: F64) -> F64:
        """What of a displacement neither D nor the simple shapes explain, times the root of the
        weights.
        """
        v = v.ravel() * root
        return np.asarray(v - across @ (v @ across))

    image = apply(sigma) if sigma.any() else np.zeros_like(sigma)
    residual = unexplained(u + image)
    chi2, stopped, n = float(residual @ residual) / count, EndOfInversion.ITERATIONS, 0
    direction, power = np.zeros_like(sigma), np.inf
    while chi2 > 1 and n < iterations:
        gradient = np.where(mask, apply((root * residual).reshape(sigma.shape)), 0.0)
        new = float(np.vdot(gradient, gradient))
        direction, power = gradient + new / power * direction, new
        image_step = apply(direction)
        change = unexplained(image_step)
        square = float(change @ change)
        if not square > 0:
            stopped = EndOfInversion.STAGNATION
            break
        length = power / square
        sigma, image = sigma - length * direction, image - length * image_step
        residual = residual - length * change
        n += 1
        previous, chi2 = chi2, float(residual @ residual) / count
        if chi2 > 1 and chi2 > (1 - MIN_CHI2_FALL) * previous:
            stopped = EndOfInversion.STAGNATION
            break
    if chi2 <= 1:
        stopped = EndOfInversion.DISCREPANCY
    amounts = axes @ (((u + image).ravel() * root) @ across)
    far = len(known) - len(shapes)
    sigma = sigma + np.tensordot(amounts[far:], shapes, 1)
    left = u + image - (amounts @ known).reshape(sigma.shape)
    return Descent(sigma, amounts, left, n, stopped)
