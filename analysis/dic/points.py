"""IC-GN as a way to refine displacements: every box by itself."""

from __future__ import annotations

import numpy as np

from analysis.arrays import F64, Array, Bool
from analysis.dic.icgn import IcgnSolver, Solution
from analysis.dic.spectrum import TextureCorrelation, interpolation, slopes
from analysis.dic.status import NOT_CONVERGED, OK
from analysis.dic.tracker import Estimate, ReferenceImage


class SeparatePoints:
    """The reference prepared for inverse-compositional Gauss-Newton iterations of each box.

    Parameters
    ----------
    reference, texture
        See `analysis.dic.passes.SharedPasses`; the interpolation is the same along x and y.
    tolerance_px : float
        See `analysis.dic.icgn.IcgnSolver`.
    """

    is_shared = False

    def __init__(
        self,
        reference: ReferenceImage,
        texture: TextureCorrelation,
        *,
        tolerance_px: float = 1e-3,
    ) -> None:
        f = reference.image.astype(np.float64)
        self._solver = IcgnSolver(
            f,
            slopes(f, texture),
            reference.grid,
            interpolation(texture.power),
            usable=reference.usable,
            tolerance_px=tolerance_px,
        )
        self.contrast, self.pixels = self._solver.contrast, self._solver.pixels
        self._shape, self._threads = reference.grid.shape, reference.threads
        self._last = np.zeros((6, *self._shape))

    def forget(self, points: Bool) -> None:
        """See `Refiner`: their gradients start from 0."""
        self._last[:, points] = 0.0

    def refine(
        self,
        image: Array,
        start: F64,
        wanted: Bool,
        points: Bool | None = None,
        most_passes: int = 0,
    ) -> Estimate:
        """See `Refiner`; the gradients start from those of the last solution."""
        del points, most_passes
        parameters = self._last.copy()
        parameters[:2] = start
        parameters[:, ~wanted] = np.nan
        found = Solution.empty(self._shape)
        self._solver.load(image)
        bands = self._threads.bands(self._shape[0])
        self._threads.share(lambda rows: self._solver.solve(rows, parameters, found), bands)
        ok = found.status == OK
        self._last[:, wanted] = np.where(ok, found.parameters, 0.0)[:, wanted]
        u = np.where(ok, found.parameters[:2], start)
        status = np.where(ok, OK, NOT_CONVERGED).astype(np.uint8)
        return Estimate(u, found.zncc, found.std, status, found.iterations)
