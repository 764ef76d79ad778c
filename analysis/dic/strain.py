"""Displacement gradient and strain of a field, by local least squares, with the uncertainty that
the displacement's own makes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from analysis.arrays import F64, Array, Bool
from analysis.grid import Grid

# ratio of the extreme eigenvalues of a fit's normal matrix; points on one line have 0, a quarter
# window 1e-5
UNDETERMINED = 1e-9


@dataclass(frozen=True, slots=True)
class Strain:
    """The displacement gradient at every point of a grid, and its standard uncertainty; strains are
    small strains.

    Attributes
    ----------
    dux_dx, dux_dy, duy_dx, duy_dy : ndarray, shape (ny, nx), float64
        Gradient, dimensionless; NaN where the displacement is, or where too few points around it
        have one. The receiver owns all arrays.
    dux_dx_std, dux_dy_std, duy_dx_std, duy_dy_std : ndarray, shape (ny, nx), float64
        Standard uncertainties from the noise of the displacement; what the polynomial can not
        follow is not in them.
    """

    dux_dx: F64
    dux_dy: F64
    duy_dx: F64
    duy_dy: F64
    dux_dx_std: F64
    dux_dy_std: F64
    duy_dx_std: F64
    duy_dy_std: F64

    @property
    def exx(self) -> F64:
        """Extension along x."""
        return self.dux_dx

    @property
    def eyy(self) -> F64:
        """Extension along y."""
        return self.duy_dy

    @property
    def exy(self) -> F64:
        """Shear strain, half the engineering shear."""
        return (self.dux_dy + self.duy_dx) / 2

    @property
    def exx_std(self) -> F64:
        """Standard uncertainty of `exx`."""
        return self.dux_dx_std

    @property
    def eyy_std(self) -> F64:
        """Standard uncertainty of `eyy`."""
        return self.duy_dy_std

    @property
    def exy_std(self) -> F64:
        """Standard uncertainty of `exy`; the errors of u_x and u_y are taken for independent."""
        return np.hypot(self.dux_dy_std, self.duy_dx_std) / 2


def strain(
    grid: Grid,
    ux_px: Array,
    uy_px: Array,
    *,
    window: int = 5,
    order: int = 1,
    ux_std_px: Array | None = None,
    uy_std_px: Array | None = None,
    correlation_px: float | None = None,
) -> Strain:
    """Gradient and strain of a field, from a plane or a quadratic fitted to the points of a window
    around each point.

    The errors of points whose boxes overlap are correlated, as they share pixels: by the shared
    part of the box, (1 - |dx| / box)+ (1 - |dy| / box)+. The uncertainty is propagated with it
    exactly, at borders and around lost points too. Without `ux_std_px` and `uy_std_px` the noise is
    that of the residuals of each fit, corrected for the same correlation.

    Parameters
    ----------
    ux_px, uy_px : ndarray, shape (ny, nx)
        Displacement on `grid`; points where either is NaN are left out.
    window : int
        Side of the window in points, odd; it ends at the border of the grid.
    order : int
        1 for a plane, 2 for a quadratic. In a full window both give the same slope; at borders and
        beside lost points the plane is biased where the strain changes, the quadratic up to four
        times as noisy.
    ux_std_px, uy_std_px : ndarray, shape (ny, nx), optional
        Standard uncertainties of the displacement, both or none; points where either is NaN are
        left out.
    correlation_px : float, optional
        Side of the squares over which noise is shared, 0 for independent points; default the grid's
        box.

    Raises
    ------
    ValueError
        A shape differs from the grid's, only one uncertainty is given, or the window, order or
        correlation can not be used.
    """
    reach = float(grid.box_px if correlation_px is None else correlation_px)
    if order not in (1, 2) or window % 2 == 0 or window < 1 + 2 * order or not 0 <= reach < np.inf:
        raise ValueError(
            f"strain: order {order}, a window of {window} points and a correlation of {reach:g} px"
            " were requested; use order 1 or 2, an odd window of 3 points or more (5 for order 2)"
            " and 0 px or more"
        )
    given = [field for field in (ux_px, uy_px, ux_std_px, uy_std_px) if field is not None]
    if len(given) == 3:
        raise ValueError(
            "strain: the uncertainty of only one component was given; give those of u_x and u_y,"
            " or none"
        )
    for field in given:
        if np.shape(field) != grid.shape:
            raise ValueError(
                f"strain: a field of shape {np.shape(field)} found, the grid has {grid.shape}; use"
                " fields of this grid"
            )
    half = window // 2
    margins = (0, 0), (half, half), (half, half)
    fields = np.pad(np.array(given, np.float64), margins, constant_values=np.nan)
    known = np.isfinite(fields).all(axis=0)
    fields[:, ~known] = 0
    near = sliding_window_view(fields, (window, window), (-2, -1))
    at = sliding_window_view(known, (window, window), (-2, -1))
    local = np.arange(-half, half + 1) / half
    powers = [(0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2)][: 3 * order]
    basis = np.array([np.outer(local**n, local**m).ravel() for m, n in powers])
    lag = grid.step_px * np.abs(np.subtract.outer(np.arange(window), np.arange(window)))
    shared = np.clip(1 - lag / reach, 0, None) if reach > 0 else np.eye(window)
    out = np.full((2, 2, 2, *grid.shape), np.nan)  # value or uncertainty, component, along x or y
    for row in range(grid.shape[0]):  # one row at a time bounds the memory
        n = at[row].sum((-2, -1))
        wanted = at[row, :, half, half] & (n >= 2 * len(basis))
        if wanted.any():
            inside = near[:, row, wanted].reshape(len(given), -1, window**2)
            out[..., row, wanted] = _fit(
                inside, at[row, wanted].reshape(-1, window**2), basis, shared
            )
    value, spread = out / (half * grid.step_px)
    return Strain(*value.reshape(4, *grid.shape), *spread.reshape(4, *grid.shape))


def _fit(fields: F64, known: Bool, basis: F64, shared: F64) -> F64:
    """Slopes and their uncertainties, shape (2, 2, 2, n), of n windows of m points: fields (2 or 4,
    n, m), known (n, m), basis (p, m).
    """
    p, side = len(basis), len(shared)
    normal = (known @ (basis[:, None] * basis).reshape(p * p, -1).T).reshape(-1, p, p)
    size, axes = np.linalg.eigh(normal)
    size[size[:, 0] < UNDETERMINED * size[:, -1]] = np.nan
    # displacements to coefficients
    estimator = (axes / size[:, None]) @ axes.transpose(0, 2, 1) @ basis * known[:, None]
    coefficients = np.einsum("npk,cnk->cnp", estimator, fields[:2])

    def averaged(a: F64) -> F64:
        return (shared @ a.reshape(*a.shape[:-1], side, side) @ shared).reshape(a.shape)

    if len(fields) == 4:
        weighted = estimator[:, 1:3] * fields[2:, :, None]
        variance = (weighted * averaged(weighted)).sum(-1)
    else:
        correlated = averaged(estimator)
        freedom = known.sum(-1) - (correlated * basis * known[:, None]).sum((1, 2))
        residual = (fields - coefficients @ basis) * known
        noise = (residual**2).sum(-1) / freedom
        variance = noise[..., None] * (estimator * correlated)[:, 1:3].sum(-1)
    return np.stack([coefficients[..., 1:3], np.sqrt(variance)]).transpose(0, 1, 3, 2)
