"""Speckle by closed form: Gaussian grains integrated over the pixels as one product of matrices,
with no code of the program.
"""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

MARGIN = 30


class Speckle:
    """Grains at random places that can be imaged after any displacement; `grain` is their standard
    deviation in pixels (least, greatest), `density` their number per pixel.
    """

    def __init__(self, shape=(240, 320), seed=1, grain=(1.0, 1.6), density=0.05):
        rng = np.random.default_rng(seed)
        self.shape = shape
        n = int(density * (shape[0] + 2 * MARGIN) * (shape[1] + 2 * MARGIN))
        self.x = rng.uniform(-MARGIN, shape[1] + MARGIN, n)
        self.y = rng.uniform(-MARGIN, shape[0] + MARGIN, n)
        self.width = rng.uniform(*grain, n)
        self.height = rng.uniform(0.4, 1.0, n) * self.width**2
        self.spread = self._raw(0.0, 0.0).std()

    def _raw(self, ux, uy):
        def within(place, size):
            edges = np.arange(size + 1) - 0.5
            return np.diff(ndtr((edges - place[:, None]) / self.width[:, None]), axis=1)

        down, across = within(self.y + uy, self.shape[0]), within(self.x + ux, self.shape[1])
        return (self.height[:, None] * down).T @ across

    def grey(self, ux=0.0, uy=0.0, contrast=40.0, level=20.0):
        """Grey levels, not rounded, with every grain moved by (ux, uy) pixels."""
        return level + self._raw(ux, uy) * (contrast / self.spread)

    def image(self, ux=0.0, uy=0.0, noise=0.0, seed=0, contrast=40.0, level=20.0):
        """The same from an 8-bit camera with Gaussian noise (grey levels)."""
        grey = self.grey(ux, uy, contrast, level)
        grey += noise * np.random.default_rng(seed).normal(size=self.shape)
        return np.clip(np.rint(grey), 0, 255).astype(np.uint8)
