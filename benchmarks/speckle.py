"""Speckle pictures whose displacement is known exactly, for the benchmarks of the image
correlation.

Blobs are moved and integrated over the pixels as `app.tradeoff.exact_speckle` does it; nothing is
interpolated. A set is rendered once and kept in the system's folder for temporary files.

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

import numpy as np
from numpy.typing import NDArray

from analysis.grid import Grid
from app.tradeoff.exact_speckle import ExactMotion, Pattern, noise_bound

__all__ = ["SIZE", "ExactMotion", "Frame", "Pattern", "camera", "images", "noise_floor", "pattern"]

Array = NDArray[np.float64]

SIZE = (1200, 1600)
RECIPE = 2  # part of the key of the kept pictures; other pictures from the same sets need another


@dataclass(frozen=True, slots=True)
class Frame:
    """One 8-bit picture, shape (rows, columns), and its displacement from the reference."""

    image: NDArray[np.uint8]
    truth: ExactMotion


@lru_cache(maxsize=2)
def pattern(size: tuple[int, int] = SIZE) -> Pattern:
    """The pattern of the sets, made once."""
    return Pattern(size)


def camera(grey: Array, noise: float, rng: np.random.Generator) -> NDArray[np.uint8]:
    """The picture of an 8-bit camera: Gaussian noise (grey levels), then rounding."""
    return np.clip(np.rint(grey + noise * rng.normal(size=grey.shape)), 0, 255).astype(np.uint8)


def motions(name: str) -> list[ExactMotion]:
    """The displacements of a set: translation, long or contact."""
    return {
        "translation": [ExactMotion.uniform(0.05 * k) for k in range(21)],
        "long": [ExactMotion.uniform(0.14 + 0.495 * k) for k in range(29)],
        "contact": [ExactMotion.contact(0.5 * k, SIZE) for k in range(1, 21)],
    }[name]


def images(name: str, noise: float) -> Iterator[Frame]:
    """The reference, then every picture of a set; each, the reference too, has its own camera
    noise.
    """
    moved = [ExactMotion.uniform(0), *motions(name)]
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

    Rounding adds 1/12 to the variance of the noise.
    """
    return noise_bound(grid, pattern().information(noise**2 + 1 / 12))
