"""What every inversion returns: the shear stress, the block's displacement far away, the force, and
how far they can be trusted.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from analysis.arrays import F64


class EndOfInversion(StrEnum):
    """Why an inversion ended."""

    DISCREPANCY = "discrepancy"  #: the residual is down to the noise
    STAGNATION = "stagnation"  #: the residual no longer falls and is above the noise
    ITERATIONS = "iterations"  #: the allowed number of iterations was made
    SILENT = "silent"  #: the displacement far away alone explains the field: no stress is seen
    GCV = "gcv"  #: direct solution, its smoothing chosen by generalised cross-validation


@dataclass(frozen=True, slots=True, kw_only=True)
class Inversion:
    """Shear stress under a measured displacement field, ``u_x = D - G*sigma``.

    Attributes
    ----------
    sigma : ndarray, shape (ny, nx)
        Shear stress along x at the grid's points, pascals; 0 outside the mask. Of a radial profile:
        shape (n,).
    sigma_sd : ndarray
        Standard uncertainty of `sigma`, with an allowance for what smoothing takes away; NaN where
        the method has none.
    D, D_sd : float
        Displacement of the block far away, metres; the uncertainty is NaN where the method has
        none, 0 where D was given.
    Q, Q_sd : float
        Integral of `sigma`, newtons.
    residual : ndarray
        Measured less fitted displacement, metres; NaN where nothing was measured.
    chi2 : float
        Mean square of the residual in units of its uncertainty, outliers down-weighted, per degree
        of freedom where the method knows them.
    iterations : int
        Number of iterations; 0 for direct methods.
    stopped : EndOfInversion
    is_covered : bool
        The whole mask lies inside the measured part of the picture.
    is_converged : bool
        The residual is down to the noise, by a stress that stands out of it.
    notes : tuple of str
        What limits the result.
    """

    sigma: F64
    sigma_sd: F64
    D: float
    D_sd: float
    Q: float
    Q_sd: float
    residual: F64
    chi2: float
    iterations: int
    stopped: EndOfInversion
    is_covered: bool
    is_converged: bool
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class RadialInversion(Inversion):
    """The same as a function of the distance from the centre; arrays of shape (n,), one entry per
    ring.

    Attributes
    ----------
    radius : ndarray
        Of each ring, metres.
    coefficients : ndarray
        Of the basis: `AxisymmetricInversion.stress` turns them into the stress at any radius.
    covariance : ndarray, shape (n, n)
        Of `sigma`: smoothing makes neighbours share their errors.
    """

    radius: F64
    coefficients: F64
    covariance: F64


NOT_SEEN = (
    "inversion: the field is as even as its noise, so that no stress is seen; take a frame with"
    " more shear force, or check the uncertainty"
)
NOT_COVERED = (
    "inversion: the mask reaches beyond the measured points, and sigma, Q and D rest on a part of"
    " the contact; widen the field"
)
