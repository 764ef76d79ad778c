"""Speckle pictures whose displacement is known exactly.

Nothing is interpolated: every blob of a random pattern is moved by the displacement at its own
centre, deformed by the gradient there, and integrated over the pixels. The error that remains comes
from the curvature of the displacement over one blob, and is below 1e-3 px where `ExactMotion` and
`Wave` are used here.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from analysis.arrays import F64, Array, Bool, floats
from analysis.grid import Grid, integral
from drivers.sim.speckle import SPECKLE_DIAMETER_PX, SPECKLE_PER_PX2, add_blobs

Pair = tuple[F64, F64]
Picture = Array

DEVIATION, LEVEL = 40.0, 20.0  # of the standard picture, and under its blobs: grey levels
HALO_PX = 40  # the pattern continues outside the picture, so that blobs can move in
RING_PX = 10  # the graded zone is scored with this much around it
STEEPEST = 0.02  # largest slope of a wave; `add_blobs` is exact up to 0.03


@dataclass(frozen=True, slots=True)
class ExactMotion:
    """Displacement along x, pixels: `inside` for r < `stick`, `outside` for r > `radius`, a
    smoothstep between; r from `centre` (x, y).
    """

    inside: float
    outside: float
    stick: float = 0.0
    radius: float = 1.0
    centre: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def uniform(cls, ux: float) -> ExactMotion:
        """The same displacement everywhere."""
        return cls(ux, ux)

    @classmethod
    def contact(
        cls, drive: float, size: tuple[int, int], radius: float = 320.0, full_slip: float = 4.0
    ) -> ExactMotion:
        """Partial slip up to a drive of `full_slip` px, full sliding beyond."""
        stick = radius * max(0.0, 1 - drive / full_slip)
        inside, centre = max(0.0, drive - full_slip), (size[1] / 2, size[0] / 2)
        return cls(inside, drive, stick, radius, centre)

    def __call__(self, x: Any, y: Any) -> Pair:
        """The exact (u_x, u_y) at points (x, y) of the reference."""
        t = np.clip((self._distance(x, y) - self.stick) / (self.radius - self.stick), 0, 1)
        return self.inside + (self.outside - self.inside) * t * t * (3 - 2 * t), np.zeros_like(t)

    def gradient(self, x: Any, y: Any) -> Pair:
        """The exact (du_x/dx, du_x/dy)."""
        r, width = self._distance(x, y), self.radius - self.stick
        t = np.clip((r - self.stick) / width, 0, 1)
        slope = (self.outside - self.inside) * 6 * t * (1 - t) / width / np.maximum(r, 1e-9)
        return slope * (x - self.centre[0]), slope * (y - self.centre[1])

    def ring(self, x: Any, y: Any) -> Bool:
        """Which points lie in the graded zone; none if the displacement is uniform."""
        r, is_graded = self._distance(x, y), self.inside != self.outside
        return (r > self.stick - RING_PX) & (r < self.radius + RING_PX) & is_graded

    def _distance(self, x: Any, y: Any) -> F64:
        return np.hypot(floats(x) - self.centre[0], floats(y) - self.centre[1])


@dataclass(frozen=True, slots=True)
class Wave:
    """A displacement u_x = A sin(2 pi s / period), s along x (axis 0) or y (axis 1); A is half a
    pixel, or less where that would be steeper than `STEEPEST`.
    """

    period: float
    axis: int = 0

    @property
    def amplitude(self) -> float:
        """A in pixels."""
        return min(0.5, STEEPEST * self.period / 2 / np.pi)

    def __call__(self, x: Any, y: Any) -> Pair:
        """The exact (u_x, u_y) at points (x, y) of the reference."""
        u = self.amplitude * np.sin(2 * np.pi / self.period * np.asarray((x, y)[self.axis]))
        return u, np.zeros_like(u)

    def gradient(self, x: Any, y: Any) -> Pair:
        """The exact (du_x/dx, du_x/dy)."""
        k = 2 * np.pi / self.period
        slope = self.amplitude * k * np.cos(k * np.asarray((x, y)[self.axis]))
        return (slope, 0 * slope) if self.axis == 0 else (0 * slope, slope)


Displacement = ExactMotion | Wave
AT_REST = ExactMotion.uniform(0.0)


@dataclass(frozen=True, slots=True)
class Grains:
    """Gaussian blobs at random places, of any number of kinds.

    Attributes
    ----------
    per_px2 : float
        Blobs per square pixel.
    sigma_px : ndarray, shape (kinds, 2)
        Standard deviations along x and y.
    share : ndarray, shape (kinds,)
        Of the blobs; they add to 1.
    sign : float
        1 for bright grains, -1 for dark ones.
    """

    per_px2: float
    sigma_px: F64
    share: F64
    sign: float = 1.0


class Pattern:
    """Gaussian blobs at random places, the same for the same seed: e^-2 diameters of 3-5 px and
    0.15 per square pixel, or those of `grains`; peaks of 0.4-1. The picture has the standard
    deviation `contrast` over `level` (of what is under the blobs, or, with `grains`, of its mean).
    """

    def __init__(
        self,
        size: tuple[int, int],
        seed: int = 1,
        grains: Grains | None = None,
        contrast: float = DEVIATION,
        level: float = LEVEL,
    ) -> None:
        rng = np.random.default_rng(seed)
        rows, columns = size
        density = SPECKLE_PER_PX2 if grains is None else grains.per_px2
        n = int(density * (rows + 2 * HALO_PX) * (columns + 2 * HALO_PX))
        self.size, self._contrast, self._level = size, contrast, level
        self.x = rng.uniform(-HALO_PX, columns + HALO_PX, n)
        self.y = rng.uniform(-HALO_PX, rows + HALO_PX, n)
        if grains is None:
            self.variance = np.tile((rng.uniform(*SPECKLE_DIAMETER_PX, n) / 4) ** 2, (2, 1))
        else:
            kinds = rng.choice(len(grains.share), n, p=grains.share)
            self.variance = grains.sigma_px[kinds].T ** 2
        self.peak = rng.uniform(0.4, 1.0, n) * (1.0 if grains is None else grains.sign)
        raw = self._raw(AT_REST, 0.0)
        self.peak /= raw.std()
        if grains is not None:
            self._level -= contrast * float(raw.mean() / raw.std())

    def grey(self, motion: Displacement, uy: float = 0.0) -> F64:
        """Exact grey levels after `motion`, without noise and rounding; `uy` moves everything along
        y as well.
        """
        return self._level + self._contrast * self._raw(motion, uy)

    def _raw(self, motion: Displacement, uy: float) -> F64:
        image = np.zeros(self.size)
        gx, gy = motion.gradient(self.x, self.y)
        vx, vy = self.variance
        # F = [[1 + gx, gy], [0, 1]] makes the covariance F diag(vx, vy) F^T
        xx, xy = vx * (1 + gx) ** 2 + vy * gy**2, vy * gy
        add_blobs(image, self.x + motion(self.x, self.y)[0], self.y + uy, xx, xy, vy, self.peak)
        return image

    def information(self, variance: F64 | float) -> list[F64]:
        """Integrals over the picture of what its pixels tell of u_x, of both, and of u_y.

        Both pictures have noise of this `variance` (grey levels squared, one number or one for each
        pixel), which includes that of the rounding, 1/12. The gradients are those of the exact
        picture (differences over 0.02 px of blobs moved exactly: good to 1e-4).
        """
        gx, gy = self._gradient
        weight = 1 / (2 * np.broadcast_to(floats(variance), gx.shape))
        return [integral(weight * a) for a in (gx * gx, gx * gy, gy * gy)]

    @cached_property
    def _gradient(self) -> Pair:
        h = 0.01
        gx = (self.grey(ExactMotion.uniform(-h)) - self.grey(ExactMotion.uniform(h))) / (2 * h)
        gy = (self.grey(AT_REST, -h) - self.grey(AT_REST, h)) / (2 * h)
        return gx, gy


def noise_bound(grid: Grid, information: list[F64]) -> F64:
    """Cramer-Rao bound of u_x in every box of `grid`, pixels, shape (ny, nx), from a pattern's
    `information`: no unbiased measurement scatters less.

    u_x and u_y are unknown. Its mean square over the points compares with that of a measurement.
    """
    xx, xy, yy = map(grid.sums_of, information)
    return np.sqrt(yy / (xx * yy - xy**2))
