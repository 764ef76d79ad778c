"""Speckle images whose displacement is known exactly: Gaussian blobs integrated over the pixels,
moved without interpolation.
"""

from __future__ import annotations

import math
from functools import cached_property, lru_cache

import numpy as np
from numba import njit
from numpy.typing import NDArray

MARGIN = 40


@njit(cache=True)
def _add(image, x, y, width, height):
    rows, columns = image.shape
    along_x, along_y = np.empty(64), np.empty(64)
    for n in range(x.size):
        scale = 1 / (width[n] * math.sqrt(2))
        reach = int(6 * width[n]) + 2
        j0, i0 = round(x[n]) - reach, round(y[n]) - reach
        size = 2 * reach + 1
        last_x = math.erf((j0 - 0.5 - x[n]) * scale)
        last_y = math.erf((i0 - 0.5 - y[n]) * scale)
        for k in range(size):
            next_x = math.erf((j0 + k + 0.5 - x[n]) * scale)
            next_y = math.erf((i0 + k + 0.5 - y[n]) * scale)
            along_x[k], along_y[k] = height[n] * (next_x - last_x), next_y - last_y
            last_x, last_y = next_x, next_y
        first, end = max(0, -j0), min(size, columns - j0)
        for k in range(max(0, -i0), min(size, rows - i0)):
            for m in range(first, end):
                image[i0 + k, j0 + m] += along_x[m] * along_y[k]


@lru_cache(maxsize=64)
def _drawn(shape, seed, grain, density, ux, uy):
    """The pattern of a `Speckle`, of any contrast, after a displacement that is the same
    everywhere: many tests look at the same.
    """
    image = np.zeros(shape)
    x, y, width, height = _blobs(shape, seed, grain, density)
    _add(image, x + ux, y + uy, width, height)
    image.flags.writeable = False
    return image


@lru_cache(maxsize=64)
def _blobs(shape, seed, grain, density):
    rng = np.random.default_rng(seed)
    n = int(density * (shape[0] + 2 * MARGIN) * (shape[1] + 2 * MARGIN))
    x = rng.uniform(-MARGIN, shape[1] + MARGIN, n)
    y = rng.uniform(-MARGIN, shape[0] + MARGIN, n)
    width = rng.uniform(*grain, n)
    return x, y, width, rng.uniform(0.4, 1.0, n) * width**2


class Speckle:
    """A random pattern of blobs that can be imaged after any displacement.

    `grain` is the standard deviation of a blob in pixels (least, greatest); `density` the blobs per
    pixel.
    """

    def __init__(
        self,
        shape: tuple[int, int] = (240, 320),
        seed: int = 1,
        grain=(0.75, 1.25),
        density: float = 0.15,
    ):
        self.shape = shape
        self._recipe = tuple(shape), seed, tuple(grain), density
        self.x, self.y, self.width, self.height = _blobs(*self._recipe)

    @cached_property
    def spread(self) -> float:
        return self._raw(0, 0).std()

    def _raw(self, ux: float, uy: float) -> NDArray[np.float64]:
        if np.ndim(ux) == 0 == np.ndim(uy):
            return _drawn(*self._recipe, float(ux), float(uy))
        image = np.zeros(self.shape)
        _add(image, self.x + ux, self.y + uy, self.width, self.height)
        return image

    def grey(
        self, ux: float = 0, uy: float = 0, contrast: float = 40, level: float = 20
    ) -> NDArray[np.float64]:
        """Grey levels, not rounded, with every blob moved by (ux, uy) pixels."""
        return level + self._raw(ux, uy) * (contrast / self.spread)

    def image(
        self,
        ux: float = 0,
        uy: float = 0,
        noise: float = 0,
        seed: int = 0,
        contrast: float = 40,
        level: float = 20,
    ):
        """The same from an 8-bit camera with Gaussian noise (grey levels)."""
        grey = self.grey(ux, uy, contrast, level) + noise * np.random.default_rng(seed).normal(
            size=self.shape
        )
        return np.clip(np.rint(grey), 0, 255).astype(np.uint8)


def way(method: str) -> dict[str, str | int]:
    """The settings of a method; "quadratic" is that of passes over the whole image with a quadratic
    displacement within each box.
    """
    return {"method": "shared", "order": 2} if method == "quadratic" else {"method": method}
