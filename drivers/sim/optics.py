"""The distortion of the simulated camera's lens, radial about the middle of the picture.

A pixel at p from the middle shows what an ideal lens would show at ``q = p (1 + k |p|^2/R^2)``,
where R is half of the picture's diagonal: k is the share by which the ideal place is further out,
at the corners.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from analysis.arrays import F64

TURNS = 12  # iterations of the inverse; each gains two digits at 1 %


class Lens(NamedTuple):
    """A lens: its k, the middle of the picture (x, y) in pixels, and 1/R^2."""

    k: float = 0.0
    x: float = 0.0
    y: float = 0.0
    inverse_square: float = 1.0

    @classmethod
    def of(cls, k: float, shape: tuple[int, int]) -> Lens:
        """The lens of a picture of (rows, columns)."""
        x, y = (shape[1] - 1) / 2, (shape[0] - 1) / 2
        return cls(k, x, y, 1 / (math.hypot(x, y) ** 2))

    def ideal(self, x: F64, y: F64) -> tuple[F64, F64]:
        """Where an ideal lens shows what this one shows at (x, y); pixels."""
        dx, dy = x - self.x, y - self.y
        far = 1 + self.k * self.inverse_square * (dx * dx + dy * dy)
        return self.x + dx * far, self.y + dy * far

    def seen(self, x: F64, y: F64) -> tuple[F64, F64]:
        """Where this lens shows what an ideal one shows at (x, y); pixels."""
        qx, qy = x - self.x, y - self.y
        px, py = qx, qy
        for _ in range(TURNS):
            far = 1 + self.k * self.inverse_square * (px * px + py * py)
            px, py = qx / far, qy / far
        return self.x + px, self.y + py

    def seen_blobs(self, places: F64) -> F64:
        """Blobs (x, y, xx, xy, yy), shape (5, n), as this lens shows them: moved and deformed."""
        x, y, xx, xy, yy = places
        seen = np.stack(self.seen(x, y))
        off, k = seen - np.array([[self.x], [self.y]]), self.k * self.inverse_square
        square = (off * off).sum(axis=0)
        far = 1 + k * square
        # dp/dq, the inverse of far I + 2 k p p, which is symmetric
        back = (np.eye(2)[:, :, None] - 2 * k / (far + 2 * k * square) * off * off[:, None]) / far
        spread = np.einsum("ijn,jkn,kln->iln", back, np.array([[xx, xy], [xy, yy]]), back)
        return np.stack([*seen, spread[0, 0], spread[0, 1], spread[1, 1]])


IDEAL = Lens()
