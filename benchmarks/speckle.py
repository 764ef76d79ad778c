"""Speckle pictures whose displacement is known exactly, for the benchmarks of the image
correlation.

Nothing is interpolated: every blob of a random pattern is moved by the displacement at its own
centre, deformed by the gradient there, and integrated over the pixels. The error that remains comes
from the curvature of the displacement over one blob, and is below 1e-3 px at the sharpest front
here. A set is rendered once and kept in the system's folder for temporary files.

Sets, each after a reference that does not move:

translation  u_x = 0, 0.05 ... 1 px: the bias at every fraction of a pixel
long         u_x = 0.14 ... 14 px in steps of 0.495 px: the calibration of Prevost et al. (2013),
             section 2.3.2
contact      a stick disc that shrinks while the drive grows to 4 px, then full sliding to 10 px;
             the largest slope is 1.9 %
"""

from __future__ import annotations

import hashlib
import os
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.grid import Grid
from drivers.sim.speckle import SPECKLE_DIAMETER_PX, SPECKLE_PER_PX2, add_blobs

Array = NDArray[np.float64]

SIZE = (1200, 1600)
DEVIATION, LEVEL = 40.0, 20.0  # of the picture, and under the blobs: grey levels
HALO_PX = 40  # the pattern continues outside the picture, so that blobs can move in
CONTACT_RADIUS_PX, FULL_SLIP_PX = 320.0, 4.0
RING_PX = 10  # the graded zone is scored with this much around it
RECIPE = 2  # part of the key of the kept pictures; other pictures from the same sets need another


@dataclass(frozen=True, slots=True)
class Motion:
    """Displacement along x, pixels: `inside` for r < `stick`, `outside` for r > `radius`, a
    smoothstep between; r from `centre` (x, y).
    """

    inside: float
    outside: float
    stick: float = 0.0
    radius: float = 1.0
    centre: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def uniform(cls, ux: float) -> Motion:
        """The same displacement everywhere."""
        return cls(ux, ux)

    @classmethod
    def contact(cls, drive: float, size: tuple[int, int]) -> Motion:
        """Partial slip up to a drive of 4 px, full sliding beyond."""
        stick = CONTACT_RADIUS_PX * max(0.0, 1 - drive / FULL_SLIP_PX)
        inside, centre = max(0.0, drive - FULL_SLIP_PX), (size[1] / 2, size[0] / 2)
        return cls(inside, drive, stick, CONTACT_RADIUS_PX, centre)

    def __call__(self, x: Any, y: Any) -> tuple[Array, Array]:
        """The exact (u_x, u_y) at points (x, y) of the reference."""
        t = np.clip((self._distance(x, y) - self.stick) / (self.radius - self.stick), 0, 1)
        return self.inside + (self.outside - self.inside) * t * t * (3 - 2 * t), np.zeros_like(t)

    def gradient(self, x: Any, y: Any) -> tuple[Array, Array]:
        """The exact (du_x/dx, du_x/dy)."""
        r, width = self._distance(x, y), self.radius - self.stick
        t = np.clip((r - self.stick) / width, 0, 1)
        slope = (self.outside - self.inside) * 6 * t * (1 - t) / width / np.maximum(r, 1e-9)
        return slope * (x - self.centre[0]), slope * (y - self.centre[1])

    def ring(self, x: Any, y: Any) -> NDArray[np.bool_]:
        """Which points lie in the graded zone; none if the displacement is uniform."""
        r, is_graded = self._distance(x, y), self.inside != self.outside
        return (r > self.stick - RING_PX) & (r < self.radius + RING_PX) & is_graded

    def _distance(self, x: Any, y: Any) -> Array:
        return np.hypot(
            np.asarray(x, float) - self.centre[0], np.asarray(y, float) - self.centre[1]
        )


@dataclass(frozen=True, slots=True)
class Frame:
    """One 8-bit picture, shape (rows, columns), and its displacement from the reference."""

    image: NDArray[np.uint8]
    truth: Motion


class Pattern:
    """Gaussian blobs at random places, the same for the same seed: e^-2 diameters of 3-5 px, peaks
    of 0.4-1, 0.15 per square pixel.
    """

    def __init__(self, size: tuple[int, int] = SIZE, seed: int = 1) -> None:
        rng = np.random.default_rng(seed)
        rows, columns = size
        n = int(SPECKLE_PER_PX2 * (rows + 2 * HALO_PX) * (columns + 2 * HALO_PX))
        self.size = size
        self.x = rng.uniform(-HALO_PX, columns + HALO_PX, n)
        self.y = rng.uniform(-HALO_PX, rows + HALO_PX, n)
        self.variance = (rng.uniform(*SPECKLE_DIAMETER_PX, n) / 4) ** 2
        self.peak = rng.uniform(0.4, 1.0, n)
        self.peak /= self._raw(Motion.uniform(0), 0.0).std()

    def grey(self, motion: Motion, uy: float = 0.0) -> Array:
        """Exact grey levels after `motion`, without noise and rounding; `uy` moves everything along
        y as well.
        """
        return LEVEL + DEVIATION * self._raw(motion, uy)

    def _raw(self, motion: Motion, uy: float) -> Array:
        image = np.zeros(self.size)
        gx, gy = motion.gradient(self.x, self.y)
        # F = [[1 + gx, gy], [0, 1]] makes the covariance s^2 F F^T
        xx, xy, yy = self.variance * ((1 + gx) ** 2 + gy**2), self.variance * gy, self.variance
        add_blobs(image, self.x + motion(self.x, self.y)[0], self.y + uy, xx, xy, yy, self.peak)
        return image


@lru_cache(maxsize=2)
def pattern(size: tuple[int, int] = SIZE) -> Pattern:
    """The pattern of the sets, made once."""
    return Pattern(size)


def camera(grey: Array, noise: float, rng: np.random.Generator) -> NDArray[np.uint8]:
    """The picture of an 8-bit camera: Gaussian noise (grey levels), then rounding."""
    return np.clip(np.rint(grey + noise * rng.normal(size=grey.shape)), 0, 255).astype(np.uint8)


def motions(name: str) -> list[Motion]:
    """The displacements of a set: translation, long or contact."""
    return {
        "translation": [Motion.uniform(0.05 * k) for k in range(21)],
        "long": [Motion.uniform(0.14 + 0.495 * k) for k in range(29)],
        "contact": [Motion.contact(0.5 * k, SIZE) for k in range(1, 21)],
    }[name]


def images(name: str, noise: float) -> Iterator[Frame]:
    """The reference, then every picture of a set; each, the reference too, has its own camera
    noise.
    """
    moved = [Motion.uniform(0), *motions(name)]
    recipe = repr((RECIPE, float(noise), moved)).encode()
    key = hashlib.sha256(recipe).hexdigest()[:16]
    file = Path(tempfile.gettempdir(), "slipscope-speckle", f"{name}-{key}.npy")
    if not file.exists():
        stack = np.empty((len(moved), *SIZE), np.uint8)
        for k, motion in enumerate(moved):
            rng = np.random.default_rng([1, k, round(1000 * noise)])
            stack[k] = camera(pattern().grey(motion), noise, rng)
        file.parent.mkdir(exist_ok=True)
        unfinished = file.with_name(f"{file.name}.{os.getpid()}")
        with unfinished.open("wb") as stream:
            np.save(stream, stack)
        unfinished.replace(file)
    for image, motion in zip(np.load(file, mmap_mode="r"), moved, strict=True):
        yield Frame(np.array(image), motion)


def noise_floor(grid: Grid, noise: float) -> Array:
    """Cramer-Rao bound of u_x in every box of `grid`, pixels, shape (ny, nx): no unbiased
    measurement scatters less.

    Both pictures are noisy, u_x and u_y unknown; rounding adds 1/12 to the variance of the noise.
    Its mean square over the points compares with that of a measurement. The gradients are those of
    the exact picture (differences over 0.02 px of blobs moved exactly: good to 1e-4).
    """
    h, exact, rest = 0.01, pattern(), Motion.uniform(0)
    gx = (exact.grey(Motion.uniform(-h)) - exact.grey(Motion.uniform(h))) / (2 * h)
    gy = (exact.grey(rest, -h) - exact.grey(rest, h)) / (2 * h)

    def total(a: Array) -> Array:
        sums: Array = np.pad(a, ((1, 0), (1, 0))).cumsum(0).cumsum(1)
        bands = sums[grid.top + grid.box_px] - sums[grid.top]
        return np.asarray(bands[:, grid.left + grid.box_px] - bands[:, grid.left])

    xx, xy, yy = total(gx * gx), total(gx * gy), total(gy * gy)
    return np.asarray(np.sqrt(2 * (noise**2 + 1 / 12) * yy / (xx * yy - xy**2)))
