"""Both components of the shear traction, sigma_xz and sigma_yz, from both components of the surface
displacement, for a drive in any direction and a friction that is not parallel to it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import F64
from analysis.inversion.conjugate import descend
from analysis.inversion.problem import (
    LARGEST_CHI2,
    InversionProblem,
    MeasuredField,
    above_noise,
)
from analysis.inversion.result import NOT_COVERED, NOT_SEEN, EndOfInversion
from analysis.mechanics.half_space import SurfaceGreen

Pair = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class CoupledInversion:
    """Both components of the shear stress under both displacement fields, ``u = D - G*sigma``.

    Attributes
    ----------
    sigma : ndarray, shape (2, ny, nx)
        Shear stress along x and y at the grid's points, pascals; 0 outside the mask.
    D : (float, float)
        Displacement of the block far away, metres.
    Q : (float, float)
        Integral of `sigma`, newtons.
    residual : ndarray, shape (2, ny, nx)
        Measured less fitted displacement, metres; NaN where nothing was measured.
    chi2, iterations, stopped, is_covered, is_converged, notes
        As of `analysis.inversion.result.Inversion`.
    """

    sigma: F64
    D: Pair
    Q: Pair
    residual: F64
    chi2: float
    iterations: int
    stopped: EndOfInversion
    is_covered: bool
    is_converged: bool
    notes: tuple[str, ...] = ()


class CoupledProblem:
    """Inverts both displacement fields of one grid. Set up once for a geometry, then `solve`.

    Parameters and errors are those of `InversionProblem`.

    Notes
    -----
    Conjugate gradients on the normal equations, stopped at the noise, as `conjugate_gradient`. With
    Poisson's ratio 0 the components are independent; else G_xy passes some of each on to the other,
    and an inversion of u_x alone takes that for a traction along x.

    References
    ----------
    Johnson, Contact Mechanics, section 3.6 (Green's tensor); Prevost et al. 2013, section 4.
    """

    def __init__(
        self,
        mask: ArrayLike,
        pitch: float,
        E: float,
        nu: float,
        *,
        box: float = 0.0,
        thickness: float = math.inf,
    ) -> None:
        self._one = InversionProblem(mask, pitch, E, nu, box=box, thickness=thickness)
        self._green = SurfaceGreen(
            self._one.mask.shape, pitch, E, nu, thickness=thickness, box=box, coupled=True
        )

    def solve(
        self,
        u: tuple[ArrayLike, ArrayLike],
        sd: tuple[ArrayLike | None, ArrayLike | None] = (None, None),
        *,
        iterations: int = 50,
    ) -> CoupledInversion:
        """Both components of the stress.

        Parameters
        ----------
        u : (ux, uy), each of shape (ny, nx)
            Displacements, metres; NaN where not measured.
        sd : pair of float or array_like, optional
            Standard uncertainties; default: measured in the fields.
        iterations : int
            Largest number of iterations.

        Raises
        ------
        ValueError
            See `InversionProblem.measured`.
        """
        one = self._one
        parts = [one.measured(part, of) for part, of in zip(u, sd, strict=True)]
        measured = np.stack([part.u for part in parts])
        weight = np.stack([part.weight for part in parts])
        count = sum(part.count for part in parts)
        shapes, known = self._known()
        found = descend(
            self._green.apply,
            one.mask,
            shapes,
            known,
            measured,
            weight,
            count,
            np.zeros_like(measured),
            iterations,
        )
        sigma, amounts, left, n, stopped = found
        return self._result(sigma, amounts, parts, left, count, n, stopped)

    def _known(self) -> tuple[F64, F64]:
        """Simple stresses along x and along y, shape (2 k, 2, ny, nx), and what both D and they do
        to u, shape (2 + 2 k, 2 ny nx).
        """
        simple, _ = self._one.shapes
        nothing = np.zeros_like(simple)
        shapes = np.concatenate(
            [np.stack([simple, nothing], axis=1), np.stack([nothing, simple], axis=1)]
        )
        moved = np.stack([-self._green.apply(shape) for shape in shapes])
        far = np.zeros((2, 2, *self._one.mask.shape))
        far[0, 0], far[1, 1] = 1.0, 1.0
        return shapes, np.concatenate([far, moved]).reshape(2 + len(shapes), -1)

    def _result(
        self,
        sigma: F64,
        amounts: F64,
        parts: list[MeasuredField],
        left: F64,
        count: float,
        iterations: int,
        stopped: EndOfInversion,
    ) -> CoupledInversion:
        one = self._one
        weight = np.stack([part.weight for part in parts])
        chi2 = float(np.vdot(weight * left, left)) / count
        covers = [one.covers(part) for part in parts]
        notes = [] if all(covers) else [NOT_COVERED]
        if chi2 <= LARGEST_CHI2 and all(one.is_silent(part) for part in parts):
            stopped = EndOfInversion.SILENT
            notes.append(NOT_SEEN)
        if chi2 > LARGEST_CHI2:
            notes.append(above_noise(stopped, iterations, chi2))
        Qx, Qy = (float(part.sum()) * one.pitch**2 for part in sigma)
        return CoupledInversion(
            sigma=sigma,
            D=(float(amounts[0]), float(amounts[1])),
            Q=(Qx, Qy),
            residual=np.where(weight > 0, left, np.nan),
            chi2=chi2,
            iterations=iterations,
            stopped=stopped,
            is_covered=all(covers),
            is_converged=chi2 <= LARGEST_CHI2 and stopped is not EndOfInversion.SILENT,
            notes=tuple(notes),
        )
