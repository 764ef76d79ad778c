"""Speckle whose displacement is known exactly: Gaussian blobs, drawn where they have moved to."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

MARGIN, REACH = 60, 6  # px
CONTRAST, LEVEL = 40.0, 110.0


class Speckle:
    """A random pattern of blobs in a picture of (rows, columns)."""

    def __init__(self, shape: tuple[int, int], seed: int = 1) -> None:
        rng = np.random.default_rng(seed)
        self.shape = shape
        n = int(0.15 * (shape[0] + 2 * MARGIN) * (shape[1] + 2 * MARGIN))
        self.x = rng.uniform(-MARGIN, shape[1] + MARGIN, n)
        self.y = rng.uniform(-MARGIN, shape[0] + MARGIN, n)
        self.width = rng.uniform(0.9, 1.3, n)

    @lru_cache(maxsize=64)  # noqa: B019 - as long as the tests
    def _raw(self, ux: float, uy: float) -> np.ndarray:
        x, y = self.x + ux, self.y + uy
        near = np.arange(-REACH, REACH + 1)
        columns, rows = (np.rint(v).astype(int)[:, None] + near for v in (x, y))
        along, across = (
            np.exp(-0.5 * ((at - v[:, None]) / self.width[:, None]) ** 2)
            for at, v in ((columns, x), (rows, y))
        )
        pad = 2 * (MARGIN + REACH)
        image = np.zeros((self.shape[0] + 2 * pad, self.shape[1] + 2 * pad))
        place = (rows[:, :, None] + pad) * image.shape[1] + columns[:, None, :] + pad
        light = across[:, :, None] * along[:, None, :]
        flat = np.bincount(place.ravel(), light.ravel(), minlength=image.size)
        picture = flat.reshape(image.shape)[pad:-pad, pad:-pad]
        return np.asarray((picture - picture.mean()) / picture.std())

    def grey(self, ux: float = 0.0, uy: float = 0.0) -> np.ndarray:
        """Grey levels, not rounded, after a displacement of up to 60 px."""
        return LEVEL + CONTRAST * self._raw(ux, uy)

    def image(
        self, ux: float = 0.0, uy: float = 0.0, *, noise: float = 0.0, seed: int = 0
    ) -> np.ndarray:
        """The same from an 8-bit camera with Gaussian noise."""
        rng = np.random.default_rng(seed)
        grey = self.grey(ux, uy) + noise * rng.normal(size=self.shape)
        return np.clip(np.rint(grey), 0, 255).astype(np.uint8)
