"""Both components of the shear traction, sigma_xz and sigma_yz, from both components of the surface
displacement, for a drive in any direction and a friction that is not parallel to it.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import F64
from analysis.inversion.iterative import descend
from analysis.inversion.problem import InversionProblem, MeasuredField
from analysis.inversion.result import Inversion
from analysis.mechanics.half_space import SurfaceGreen


class CoupledProblem(InversionProblem):
    """Inverts both displacement fields of one grid. Set up once for a geometry, then `solve`.

    Parameters
    ----------
    mask, pitch, E, nu, box, thickness
        As for `InversionProblem`: shape (ny, nx), lengths in metres, E in pascals.

    Notes
    -----
    Conjugate gradients on the normal equations, stopped at the noise, as `conjugate_gradient`. With
    Poisson's ratio 0 the components are independent; otherwise G_xy passes some of each on to the
    other, and an inversion of u_x alone takes that for a traction along x.

    References
    ----------
    Johnson, Contact Mechanics, section 3.6 (Green's tensor); Prevost et al. 2013, section 4.
    """

    @cached_property
    def _coupled_green(self) -> SurfaceGreen:
        return SurfaceGreen(self.mask.shape, coupled=True, **self._block)

    def solve(
        self,
        u: tuple[ArrayLike, ArrayLike],
        sd: tuple[ArrayLike | None, ArrayLike | None] = (None, None),
        *,
        iterations: int = 50,
    ) -> tuple[Inversion, Inversion]:
        """The stress along x and the stress along y. The flags of each are those of both.

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
        x, y = (self.measured(part, of) for part, of in zip(u, sd, strict=True))
        both = MeasuredField(
            np.stack([x.u, y.u]), np.stack([x.weight, y.weight]), x.count + y.count
        )
        shapes, known = self._coupled_shapes()
        apply, start = self._coupled_green.apply, np.zeros_like(both.u)
        found = descend(apply, self.mask, shapes, known, both, start, iterations)
        chi2 = both.chi2(found.residual)
        ended = found.iterations, found.stopped

        def component(k: int, field: MeasuredField, across: MeasuredField) -> Inversion:
            measured = float(found.amounts[k]), field, found.residual[k]
            return self.result(found.sigma[k], *measured, *ended, chi2=chi2, across=across)

        return component(0, x, y), component(1, y, x)

    def _coupled_shapes(self) -> tuple[F64, F64]:
        """Simple stresses along x and along y, shape (2 k, 2, ny, nx), and what both D and they do
        to u, shape (2 + 2 k, 2 ny nx).
        """
        simple, _ = self.shapes
        nothing = np.zeros_like(simple)
        shapes = np.concatenate(
            [np.stack([simple, nothing], axis=1), np.stack([nothing, simple], axis=1)]
        )
        moved = np.stack([-self._coupled_green.apply(shape) for shape in shapes])
        far = np.zeros((2, 2, *self.mask.shape))
        far[0, 0], far[1, 1] = 1.0, 1.0
        return shapes, np.concatenate([far, moved]).reshape(2 + len(shapes), -1)
