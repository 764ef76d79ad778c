"""IC-GN as a method of a refining tracker: every box for itself."""

from __future__ import annotations

from itertools import pairwise
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from analysis.dic.grid import Grid
from analysis.dic.icgn import PARAMETERS, IcgnSolver, Result
from analysis.dic.interpolation import Interpolant
from analysis.dic.refining import Estimate, Share
from analysis.dic.spectrum import Texture, gradient, interpolation
from analysis.dic.status import Status

F64 = NDArray[np.float64]


class SeparatePoints:
    """The reference prepared for inverse-compositional Gauss-Newton of each box; see
    `analysis.dic.icgn.IcgnSolver`.

    Parameters
    ----------
    image, texture, grid, usable, share, bands
        See `analysis.dic.passes.SharedPasses`.
    order, precision, tolerance_px, max_iterations
        See `IcgnSolver`.
    interpolant : Interpolant or None
        None: the least-squares interpolation of the reference's texture, the same along x and y.
    """

    is_shared = False

    def __init__(
        self,
        image: NDArray[Any],
        texture: Texture,
        grid: Grid,
        usable: NDArray[np.bool_] | None,
        share: Share,
        bands: int,
        *,
        order: int = 1,
        interpolant: Interpolant | None = None,
        precision: Literal["single", "double"] = "single",
        tolerance_px: float = 1e-3,
        max_iterations: int = 20,
    ) -> None:
        f = image.astype(np.float64)
        slope_x = cv2.filter2D(f, -1, gradient(texture.power_x, texture.noise_share)[None, :])
        slope_y = cv2.filter2D(f, -1, gradient(texture.power_y, texture.noise_share)[:, None])
        self._solver = IcgnSolver(
            f,
            slope_x,
            slope_y,
            grid,
            order=order,
            interpolant=interpolant or interpolation(texture.power),
            weights=usable,
            precision=precision,
            tolerance_px=tolerance_px,
            max_iterations=max_iterations,
        )
        self.contrast, self.pixels = self._solver.contrast, self._solver.pixels
        self._grid, self._share, self._order = grid, share, order
        edges = [grid.shape[0] * k // bands for k in range(bands + 1)]
        self._bands = [(a, b) for a, b in pairwise(edges) if b > a]
        self._last = np.zeros((PARAMETERS[order], *grid.shape))

    def refine(self, image: NDArray[Any], start: F64, wanted: NDArray[np.bool_]) -> Estimate:
        """The displacement of the wanted points from a guess, shape (2, ny, nx), px, and the
        gradients found last.
        """
        parameters = self._last.copy()
        parameters[:2] = start
        parameters[:, ~wanted] = np.nan
        result = Result.empty(self._order, self._grid.shape)
        self._solver.load(image)
        self._share(lambda rows: self._solver.solve(rows, parameters, result), self._bands)
        ok = result.status == Status.OK
        self._last[:, wanted] = np.where(ok, result.parameters, 0.0)[:, wanted]
        return Estimate(
            np.where(ok, result.parameters[:2], start),
            result.zncc,
            result.std,
            ok,
            result.iterations,
        )
