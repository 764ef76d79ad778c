"""Distortion of the camera's lens, and the direction of the drive, from free translations: a block
that touches nothing moves as a whole, so that whatever the field of its displacement shows beside
one vector is the lens.

References
----------
Brown 1971, Close-range camera calibration (radial distortion); Sutton, Orteu, Schreier 2009,
section 3.2 (calibration by translations).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import F64, all_floats
from analysis.robust import robust_sd
from analysis.undistorted import ideal_displacement

MIN_POINTS = 30
SETTLED = 1e-9
HUBER, SWEEPS = 3.0, 10  # standard deviations from which a point counts less, and repeats
LEAST_SHIFT_PX = 2.0
# of the displacement's scatter about the model, in that of its neighbours, from which it is none
LARGEST_MISFIT = 3.0


@dataclass(frozen=True, slots=True)
class Optics:
    """The distortion of the lens, measured with a free translation.

    Attributes
    ----------
    k, k_sd : float
        Distortion at the corners of the picture (`analysis.undistorted`), and its uncertainty.
    shift_px : (float, float)
        Displacement in the middle of the picture, (x, y); the longest where there are many.
    angle : float
        Its direction in radians, from +x towards +y: that of the drive.
    rms_px : float
        Of what is left, both components.
    shifts_px : ndarray, shape (n, 2)
        The displacement in each picture.
    share_per_k : float
        Share of itself by which the displacement grows with k.
    """

    k: float
    k_sd: float
    shift_px: tuple[float, float]
    angle: float
    rms_px: float
    shifts_px: F64
    share_per_k: float


def distortion_of_translation(
    x: ArrayLike,
    y: ArrayLike,
    ux: ArrayLike,
    uy: ArrayLike,
    shape: tuple[int, int],
    box: float = 0.0,
) -> Optics:
    """Distortion and direction from the fields of a block that moved as a whole.

    Parameters
    ----------
    x, y : array_like, shape (ny, nx)
        Places of the points, pixels.
    ux, uy : array_like, shape (ny, nx) or (n, ny, nx)
        Their displacements from one picture to one or n others, pixels; NaN where not measured. The
        more the block has moved, the better.
    shape : (rows, columns)
        Of the picture.
    box : float
        Side of the square, pixels, over which each displacement is the mean.

    Raises
    ------
    ValueError
        Too few points, too small a motion, or a field that is no translation.

    Notes
    -----
    The displacement that an ideal lens would show is linear in k: k and a plane through each
    component are a linear fit. The plane in the middle of the picture is the shift; its slopes are
    those of a camera that looks obliquely, or whose distortion has another centre. All pictures
    share the errors of the first, so that the uncertainty of k is made of the sums over the
    pictures at each point.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> x, y = np.meshgrid(np.arange(20.0, 400, 20), np.arange(20.0, 300, 20))
    >>> found = analysis.distortion_of_translation(x, y, 0 * x + 30, 0 * x, (320, 420))
    >>> round(found.shift_px[0], 3), abs(found.k) < 1e-9
    (30.0, True)
    """
    x, y, ux, uy = all_floats(x, y, ux, uy)
    is_whole = x.ndim == 2 and x.shape == y.shape == ux.shape[-2:] and ux.shape == uy.shape
    if not is_whole or not np.isfinite([x, y]).all():
        raise ValueError(
            f"distortion: fields of shapes {ux.shape} and {uy.shape} at places of shapes {x.shape}"
            f" and {y.shape}; give (n, ny, nx) at finite places (ny, nx)"
        )
    u = np.stack([ux.reshape(-1, *x.shape), uy.reshape(-1, *x.shape)])
    known = np.isfinite(u).all(axis=0)
    if (fewest := int(known.sum(axis=(1, 2)).min())) < MIN_POINTS:
        raise ValueError(
            f"distortion: {fewest} points were measured; {MIN_POINTS} or more are needed"
        )
    rough = _roughness(u[0])
    u = np.where(known, u, 0.0)
    # what an ideal lens would show is u + k b, and its mean over a box
    b = np.stack(ideal_displacement(x, y, u[0], u[1], 1.0, shape)) - u
    middle = (shape[1] - 1) / 2, (shape[0] - 1) / 2
    b += u * (box**2 / 3 / (middle[0] ** 2 + middle[1] ** 2))
    plane = np.stack([np.ones_like(x), (x - middle[0]) / middle[0], (y - middle[1]) / middle[0]])
    weight, k = known * np.ones_like(u), 0.0
    for _ in range(SWEEPS):
        in_u, in_b = (_fitted(plane, v, weight) for v in (u, b))
        off_u, off_b = (v - np.tensordot(at, plane, 1) for v, at in ((u, in_u), (b, in_b)))
        square = max(float((weight * off_b**2).sum()), 1e-12)
        before, k = k, -float((weight * off_u * off_b).sum()) / square
        left = np.where(known, off_u + k * off_b, 0.0)
        scale = max(robust_sd(left[:, known]), 1e-6)
        if abs(k - before) < SETTLED:
            break
        weight = known / np.maximum(np.abs(left) / (HUBER * scale), 1.0)
    shifts, per_k = (v[..., 0].T for v in (in_u + k * in_b, in_b))
    longest = shifts[np.argmax(np.hypot(*shifts.T))]
    if (way := math.hypot(*longest)) < LEAST_SHIFT_PX:
        raise ValueError(
            f"distortion: the block has moved by {way:.2g} px; {LEAST_SHIFT_PX:g} px or more are"
            " needed"
        )
    if scale > LARGEST_MISFIT * max(rough, 1e-3):
        raise ValueError(
            f"distortion: what is left of the field scatters by {scale:.2g} px, its neighbours by"
            f" {rough:.2g} px: it is no plain translation; let the block touch nothing"
        )
    at_points = (weight * left * off_b).sum(axis=1)
    tx, ty = map(float, longest)
    return Optics(
        k=k,
        # boxes that overlap share their errors: twice
        k_sd=2 * math.sqrt((at_points**2).sum()) / square,
        shift_px=(tx, ty),
        angle=math.atan2(ty, tx),
        rms_px=float(np.sqrt(np.mean(left[:, known] ** 2))),
        shifts_px=shifts,
        share_per_k=float((per_k * shifts).sum() / (shifts**2).sum()),
    )


def _fitted(columns: F64, values: F64, weight: F64) -> F64:
    """Coefficients of the columns, (c, ny, nx), in each field, (2, n, ny, nx), by weighted least
    squares; shape (2, n, c).
    """
    gram = np.einsum("abij,cij,dij->abcd", weight, columns, columns, optimize=True)
    right = np.einsum("abij,cij->abc", weight * values, columns)
    return np.asarray((np.linalg.pinv(gram, hermitian=True) @ right[..., None])[..., 0])


def _roughness(u: F64) -> float:
    """Standard deviation of fields from point to point, by second differences."""
    bent = (u[..., :-2] - 2 * u[..., 1:-1] + u[..., 2:]) / math.sqrt(6)
    known = bent[np.isfinite(bent)]
    return robust_sd(known) if known.size else 0.0
