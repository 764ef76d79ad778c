"""The most accurate field of shear stress: a round part from the ring means, plus what the
two-dimensional residual calls for.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from analysis.arrays import F64, as_grid
from analysis.contact.rings import ring_means
from analysis.inversion.axisymmetric import AxisymmetricInversion
from analysis.inversion.geometry_checks import grid_pitch
from analysis.inversion.penalised_fit import Smoothing, shared_noise
from analysis.inversion.problem import InversionProblem
from analysis.inversion.result import EndOfInversion, Inversion

BUMPS = 250  # about; at least `CLOSEST` pitches apart
CLOSEST = 3.0


class RegularisedInversion:
    """Inverts whole u_x fields, offline: about half a second each. Set up once for a geometry, then
    `solve`.

    Parameters
    ----------
    x, y, mask_radius, E, nu, edge, box, noise_box, thickness
        As for `AxisymmetricInversion`: shape (ny, nx), lengths in metres, E in pascals; the rings
        are one pitch wide.

    Notes
    -----
    The rest of u_x, without the round part, is fitted by cubic B-splines inside the mask, their
    second differences penalised. Both strengths come from generalised cross-validation with the
    known correlation of overlapping boxes: a round contact keeps its round stress. Q is the sum of
    the whole stress over the grid's points: what the points miss of the force of the round part is
    found in the rest.
    """

    def __init__(
        self,
        x: ArrayLike,
        y: ArrayLike,
        mask_radius: float,
        E: float,
        nu: float,
        *,
        edge: float | None = None,
        box: float = 0.0,
        noise_box: float | None = None,
        thickness: float = math.inf,
    ) -> None:
        x, y = as_grid(x, y)
        pitch = grid_pitch(x, y, "regularised inversion")
        self._noise_box = box if noise_box is None else noise_box
        self.radius, self.azimuth = np.hypot(x, y), np.arctan2(y, x)
        block: dict[str, Any] = {"box": box, "thickness": thickness}
        self.round = AxisymmetricInversion(
            x, y, pitch, mask_radius, E, nu, edge=edge, noise_box=self._noise_box, **block
        )
        self.problem = InversionProblem(self.radius < mask_radius, pitch, E, nu, **block)
        self._bumps, self._penalty = _bumps(x, y, mask_radius, pitch)
        moved = (-self.problem.green.apply(bump) for bump in self._bumps)
        self._design = np.stack([np.ones_like(x), *moved]).reshape(-1, x.size)

    def solve(self, ux: ArrayLike, sd: ArrayLike | None = None) -> Inversion:
        """Shear stress of one field, with its uncertainty at each point.

        `ux`, `sd` and what is raised: as for `conjugate_gradient` and
        `AxisymmetricInversion.solve`.
        """
        problem = self.problem
        field = problem.measured(ux, sd)
        trusted = np.where(field.weight > 0, field.u, np.nan)
        means = ring_means(self.radius, trusted, problem.pitch, theta=self.azimuth)
        rings = self.round.solve(means)
        round_stress = self.round.stress(self.radius, rings.coefficients)
        round_stress = np.where(problem.mask, round_stress, 0.0)
        rest = field.u - rings.D + problem.green.apply(round_stress)
        root = np.sqrt(field.weight).ravel()
        X, z = self._design * root, rest.ravel() * root
        noisy = shared_noise(X.reshape(-1, *rest.shape), problem.pitch, self._noise_box)
        shared, power, count = X @ noisy.reshape(X.shape).T, float(z @ z), round(field.count)
        fit = Smoothing(X @ X.T, shared, self._penalty, count).fit(X @ z, power)
        shift, *amounts = fit.coefficients
        residual = rest - (fit.coefficients @ self._design).reshape(rest.shape)
        sigma = round_stress + np.tensordot(amounts, self._bumps, 1)
        flat = self._bumps.reshape(len(self._bumps), -1)
        own_sd = fit.sd(np.pad(flat.T, ((0, 0), (1, 0)))).reshape(rest.shape)
        round_sd = np.interp(self.radius, rings.radius, rings.sigma_sd)
        force = np.concatenate([[0.0], flat.sum(axis=1)]) * problem.pitch**2
        D_sd, Q_sd = fit.sd(np.stack([np.eye(len(force))[0], force]))
        result = problem.result(
            sigma, rings.D + float(shift), field, residual, 0, EndOfInversion.GCV
        )
        return replace(
            result,
            sigma_sd=np.hypot(own_sd, np.where(problem.mask, round_sd, 0.0)),
            D_sd=math.hypot(rings.D_sd, D_sd),
            Q_sd=math.hypot(rings.Q_sd, Q_sd),
        )


def _bumps(x: F64, y: F64, mask_radius: float, pitch: float) -> tuple[F64, F64]:
    """Cubic B-splines on a square lattice over the mask, cut off at its rim, shape (k, ny, nx);
    penalty of their second differences.
    """
    spacing = max(CLOSEST * pitch, mask_radius * math.sqrt(math.pi / BUMPS))
    n = math.ceil(mask_radius / spacing) + 1
    at = np.arange(-n, n + 1) * spacing
    spline = scipy.interpolate.BSpline.basis_element(np.arange(-2, 3) * spacing, extrapolate=False)
    along, across = (np.nan_to_num(spline(v - at[:, None])) for v in (x[0], y[:, 0]))
    j, i = np.nonzero(np.hypot(at[None, :], at[:, None]) < mask_radius)
    bumps = across[j][:, :, None] * along[i][:, None, :] * (np.hypot(x, y) < mask_radius)
    seen = bumps.any(axis=(1, 2))
    bumps, j, i = bumps[seen], j[seen], i[seen]
    # differences reach beyond the mask, where coefficients are 0: no field but zero is free
    lattice = np.zeros((len(j), 2 * n + 5, 2 * n + 5))
    lattice[np.arange(len(j)), j + 2, i + 2] = 1
    twist = math.sqrt(2) * np.diff(np.diff(lattice, axis=1), axis=2)
    bends = [np.diff(lattice, 2, axis=1), np.diff(lattice, 2, axis=2), twist]
    bend = np.concatenate([b.reshape(len(j), -1) for b in bends], axis=1)
    penalty = np.zeros((len(j) + 1,) * 2)
    penalty[1:, 1:] = bend @ bend.T
    return bumps, penalty
