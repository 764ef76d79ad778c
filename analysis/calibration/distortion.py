"""Distortion of the camera's lens, and the direction of the drive, from a free translation: a block
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
from scipy.optimize import least_squares

from analysis.arrays import F64
from analysis.robust import robust_sd
from analysis.undistorted import ideal_displacement

MIN_POINTS = 30
LEAST_SHIFT_PX = 2.0
# of the displacement's scatter about the model, in that of its neighbours, from which it is none
LARGEST_MISFIT = 3.0


@dataclass(frozen=True, slots=True)
class Optics:
    """What a free translation tells.

    Attributes
    ----------
    k, k_sd : float
        Distortion at the corners of the picture (`analysis.undistorted`), and its uncertainty.
    shift_px : (float, float)
        Displacement in the middle of the picture, (x, y).
    angle : float
        Its direction in radians, from +x towards +y: that of the drive.
    rms_px : float
        Of what is left, both components.
    """

    k: float
    k_sd: float
    shift_px: tuple[float, float]
    angle: float
    rms_px: float


def distortion_of_translation(
    x: ArrayLike, y: ArrayLike, ux: ArrayLike, uy: ArrayLike, shape: tuple[int, int]
) -> Optics:
    """Distortion and direction from the field of a block that moved as a whole.

    Parameters
    ----------
    x, y : array_like, shape (ny, nx)
        Places of the points, pixels.
    ux, uy : array_like, shape (ny, nx)
        Their displacements, pixels; NaN where not measured. The more the block has moved, the
        better.
    shape : (rows, columns)
        Of the picture.

    Raises
    ------
    ValueError
        Too few points, too small a motion, or a field that is no translation.

    Examples
    --------
    >>> import numpy as np, analysis
    >>> x, y = np.meshgrid(np.arange(20.0, 400, 20), np.arange(20.0, 300, 20))
    >>> found = analysis.distortion_of_translation(x, y, 0 * x + 30, 0 * x, (320, 420))
    >>> round(found.shift_px[0], 3), abs(found.k) < 1e-9
    (30.0, True)
    """
    places = [np.asarray(v, dtype=np.float64) for v in (x, y, ux, uy)]
    known = np.isfinite(places[2]) & np.isfinite(places[3])
    if known.sum() < MIN_POINTS:
        raise ValueError(
            f"distortion: {known.sum()} points were measured; {MIN_POINTS} or more are needed"
        )
    px, py, u, v = (one[known] for one in places)
    start = np.median(u), np.median(v)
    if math.hypot(*start) < LEAST_SHIFT_PX:
        raise ValueError(
            f"distortion: the block has moved by {math.hypot(*start):.2g} px; {LEAST_SHIFT_PX:g} px"
            " or more are needed"
        )

    def off(values: F64) -> F64:
        tx, ty, k = values
        moved = ideal_displacement(px, py, u, v, k, shape)
        return np.concatenate([moved[0] - tx, moved[1] - ty])

    scale = max(robust_sd(off(np.array([*start, 0.0]))), 1e-6)
    found = least_squares(off, [*start, 0.0], loss="huber", f_scale=3 * scale, x_scale=[1, 1, 1e-3])
    if not found.success:
        raise ValueError(
            f"distortion: no solution after {found.nfev} trials; take a field of a translation"
        )
    left = off(found.x)
    rough = _roughness(places[2])
    if robust_sd(left) > LARGEST_MISFIT * max(rough, 1e-3):
        raise ValueError(
            f"distortion: what is left of the field scatters by {robust_sd(left):.2g} px, its"
            f" neighbours by {rough:.2g} px: it is no plain translation; let the block touch"
            " nothing"
        )
    # boxes that overlap share their errors: twice
    covariance = np.linalg.inv(found.jac.T @ found.jac) * float(np.mean(left**2))
    tx, ty, k = (float(value) for value in found.x)
    return Optics(
        k=k,
        k_sd=2 * math.sqrt(float(covariance[2, 2])),
        shift_px=(tx, ty),
        angle=math.atan2(ty, tx),
        rms_px=float(np.sqrt(np.mean(left**2))),
    )


def _roughness(u: F64) -> float:
    """Standard deviation of a field from point to point, by second differences."""
    bent = (u[:, :-2] - 2 * u[:, 1:-1] + u[:, 2:]) / math.sqrt(6)
    known = bent[np.isfinite(bent)]
    return robust_sd(known) if known.size else 0.0
