"""What a speckle picture is made of, as far as it decides how accurately it can be correlated: the
sizes of its grains, its contrast, its noise; and pictures of the same kind whose displacement is
exact.

A picture of a camera has no exact displaced twin, and an interpolated one would flatter the method
whose interpolant made it. So the power spectrum of the picture is fitted by that of randomly placed
Gaussian blobs (Campbell's theorem), their number follows from the skewness of the grey levels, and
blobs can be moved exactly. What this leaves out: places where the texture is not like its average
(scratches, dirt, dim corners), grains that are not placed at random, and noise that is correlated
from pixel to pixel.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import cv2
import numpy as np
from scipy.fft import rfft2
from scipy.optimize import nnls

from analysis.arrays import F32, F64
from analysis.dic.spectrum import middle_of, texture as spectrum_of, windowed
from app.tradeoff.exact_speckle import DEVIATION, LEVEL, Grains, Pattern, Picture

BINS = 24  # of the spectrum, from 0 to half a cycle per px, along x and along y
SLOWEST = 1 / 64  # cycles per px; what varies more slowly is light, not texture
SIZES_PX = np.geomspace(0.45, 8.0, 12)  # standard deviations of the blobs that are tried
ROUND = 3.0  # the longest blob over its width
LEAST_POWER = 0.05  # bins of the spectrum below this share of the greatest weigh no more
LEAST_SHARE = 1e-3  # kinds of blobs with a smaller share of the variance are left out
DENSITY = 0.01, 0.3  # blobs per px^2, least and greatest
CLASSES = 16  # classes of grey levels, over which the noise is a straight line
ROUNDING = 1 / 12  # variance of grey levels that are whole numbers
STANDARD_MEAN = 76.4  # grey level of the standard picture


@dataclass(frozen=True, slots=True)
class Texture:
    """A speckle texture and the camera that sees it.

    Attributes
    ----------
    grains : Grains or None
        None: the standard speckle.
    contrast, mean : float
        Standard deviation of the texture and mean, grey levels.
    read_variance, shot_variance : float
        Variance of the noise, grey levels squared, at 0, and its growth with each grey level; both
        without the rounding.
    neighbours : float
        Correlation of the noise of neighbouring pixels.
    end : int
        Highest grey level; 0: the picture holds fractions.
    dtype : str
    """

    grains: Grains | None = None
    contrast: float = DEVIATION
    mean: float = STANDARD_MEAN
    read_variance: float = 4.0
    shot_variance: float = 0.0
    neighbours: float = 0.0
    end: int = 255
    dtype: str = "uint8"

    @property
    def noise(self) -> float:
        """Standard deviation of the noise at the mean grey level, without the rounding."""
        return math.sqrt(self._variance(self.mean))

    def pattern(self, size: tuple[int, int], seed: int = 1) -> Pattern:
        """Blobs of this texture, which can be moved."""
        level = LEVEL if self.grains is None else self.mean
        return Pattern(size, seed, self.grains, self.contrast, level)

    def variance(self, grey: F64) -> F64:
        """Variance of the noise at these grey levels, with that of the rounding."""
        return self._variance(grey) + (ROUNDING if self.end else 0.0)

    def _variance(self, grey: F64 | float) -> F64:
        return self.read_variance + self.shot_variance * np.maximum(grey, 0.0)

    def picture(self, grey: F64, rng: np.random.Generator) -> Picture:
        """What the camera makes of exact grey levels: noise, then rounding and clipping."""
        seen = grey + np.sqrt(self._variance(grey)) * rng.normal(size=grey.shape)
        if self.end:
            seen = np.clip(np.rint(seen), 0, self.end)
        return seen.astype(self.dtype)

    def sentence(self) -> str:
        """The texture in words."""
        kind, size = "standard speckle", 4.0
        if self.grains is not None:
            by_power = self.grains.share * np.prod(self.grains.sigma_px, axis=1)
            size = 4 * float(
                np.average(np.sqrt(np.prod(self.grains.sigma_px, 1)), weights=by_power)
            )
            kind = "speckle fitted to the picture"
        return (
            f"{kind}: grains of {size:.1f} px, contrast {self.contrast:.3g}, noise"
            f" {self.noise:.3g} grey levels"
        )


def texture_of(reference: Picture, at_rest: Sequence[Picture] = (), full_scale: int = 0) -> Texture:
    """The texture of a picture, and its noise by pictures taken at rest.

    Parameters
    ----------
    reference : ndarray, shape (rows, columns), uint8, uint16 or float32
    at_rest : sequence of ndarray
        Further pictures of the same. Without one the noise is taken from the highest frequencies of
        the reference, as the same at all grey levels.
    full_scale : int
        End of the grey scale; 0: that of the type.

    Raises
    ------
    ValueError
        There is no texture in the picture.
    """
    dtype = reference.dtype.name
    end = 0 if dtype == "float32" else full_scale or int(np.iinfo(reference.dtype).max)
    rounding = ROUNDING if end else 0.0
    plane = _middle(reference)
    found = spectrum_of(plane)
    read, shot, neighbours = max(0.0, found.noise**2 - rounding), 0.0, 0.0
    if at_rest:
        noises = [_noise(plane, _middle(other), end) for other in at_rest]
        read, shot, neighbours = np.mean(noises, axis=0).tolist()
        read = max(0.0, read - rounding)
    mean = float(plane.mean(dtype=np.float64))
    white = read + shot * mean + rounding
    if found.contrast**2 <= max(0.05 * white, 1e-12):
        raise ValueError(
            "no speckle found in the picture: its grey levels vary by no more than their noise of"
            f" {math.sqrt(white):.3g}; use a picture in focus, with grains of 2 px or more"
        )
    wanted, weight = _spectrum(plane, white)
    kinds, share, variance = _blobs(wanted, weight)
    smooth = cv2.blur(plane, (65, 65))
    odd = float(np.mean((plane - smooth).astype(np.float64) ** 3)) / variance**1.5
    # the third moment over the second of one blob is 2 peak / 3; peaks are 0.4 to 1, evenly
    area = math.pi * np.prod(kinds, axis=1)
    peaks = np.linspace(0.4, 1.0, 61)
    second = float(share @ area) * float(np.mean(peaks**2))
    third = float(share @ area) * float(np.mean(peaks**3)) * 2 / 3
    density = (third / second**1.5 / max(abs(odd), 1e-3)) ** 2
    grains = Grains(float(np.clip(density, *DENSITY)), kinds, share, math.copysign(1.0, odd))
    return Texture(grains, math.sqrt(variance), mean, read, shot, neighbours, end, dtype)


def binned(picture: Picture) -> Picture:
    """The means of 2 x 2 pixels, as a camera that bins returns them: in the same type."""
    rows, columns = (size // 2 for size in picture.shape)
    whole = picture[: 2 * rows, : 2 * columns]
    return np.asarray(cv2.resize(whole, (columns, rows), interpolation=cv2.INTER_AREA))


def _middle(picture: Picture) -> F32:
    """Its middle as float32."""
    return middle_of(picture).astype(np.float32)


def _noise(first: F64 | Any, second: F64 | Any, end: int) -> tuple[float, float, float]:
    """Variance of the noise at grey level 0, its growth with the grey level, and the correlation of
    neighbours, from the difference of two pictures at rest.

    What gain, level and a small shift between them explain is no noise: it is fitted and removed.
    """
    mean = ((first + second) / 2).astype(np.float64)
    gy, gx = np.gradient(mean)
    usable = np.ones(mean.shape, np.bool_) if not end else (mean > 1) & (mean < end - 1)
    if not usable.any():
        return 0.0, 0.0, 0.0
    explained = np.stack([np.ones_like(mean), mean, gx, gy], -1)
    difference = (second - first).astype(np.float64)
    best = np.linalg.lstsq(explained[usable], difference[usable])[0]
    left = np.where(usable, difference - explained @ best, 0.0)
    total = float((left**2).sum())
    beside = float((left[:, 1:] * left[:, :-1]).sum()) / total if total else 0.0
    grey, squares = mean[usable], left[usable] ** 2 / 2
    edges = np.quantile(grey, np.linspace(0, 1, CLASSES + 1))
    place = np.clip(np.searchsorted(edges, grey, side="right") - 1, 0, CLASSES - 1)
    count = np.bincount(place, minlength=CLASSES).clip(1)
    level, variance = (np.bincount(place, a, CLASSES) / count for a in (grey, squares))
    used = count > 30
    scale = np.sqrt(count[used]) / max(float(variance.max()), 1e-12)
    model = np.stack([np.ones(used.sum()), level[used].clip(0)], 1)
    read, shot = nnls(model * scale[:, None], variance[used] * scale)[0]
    return float(read), float(shot), beside


def _spectrum(plane: F32, white: float) -> tuple[F64, F64]:
    """Mean power of the texture in (BINS, BINS) classes of |frequency| along y and x, and the
    weight of each.
    """
    rows, columns = plane.shape
    power = np.abs(rfft2(windowed(plane))) ** 2
    fy, fx = np.abs(np.fft.fftfreq(rows))[:, None], np.fft.rfftfreq(columns)[None, :]
    slow = np.hypot(fy, fx) < SLOWEST
    down, across = (np.minimum((2 * BINS * f).astype(int), BINS - 1) for f in (fy, fx))
    place = down * BINS + across
    count = np.bincount(place[~slow], minlength=BINS**2)
    found = np.bincount(place[~slow], power[~slow], BINS**2) / count.clip(1)
    spread = (
        found + LEAST_POWER * found.max()
    )  # a spectrum that ends sharply is no sum of Gaussians
    return found - white, np.sqrt(count) / spread


def _blobs(wanted: F64, weight: F64) -> tuple[F64, F64, float]:
    """Standard deviations (kinds, 2), shares and variance of the blobs with this power spectrum."""
    f = (np.arange(BINS) + 0.5) / (2 * BINS)
    one = np.zeros((SIZES_PX.size, BINS))
    for alias in (-1, 0, 1):  # of the pixels
        k = f + alias
        one += np.exp(-((2 * np.pi * np.multiply.outer(SIZES_PX, k)) ** 2)) * np.sinc(k) ** 2
    sizes = np.array([*product(SIZES_PX, repeat=2)])
    atoms = np.array([np.outer(down, across).ravel() for across, down in product(one, repeat=2)])
    plain = np.abs(np.log(sizes[:, 0] / sizes[:, 1])) <= math.log(ROUND)
    sizes, atoms = sizes[plain], atoms[plain]
    atoms *= 4 * np.pi * np.prod(sizes, axis=1)[:, None]  # of variance 1, but for the pixels' blur
    found = nnls(atoms.T * weight[:, None], wanted * weight)[0]
    f2 = np.add.outer(f**2, f**2).ravel()
    steep = float(f2 @ wanted), float(f2 @ (found @ atoms))
    kept = found > LEAST_SHARE * found.sum()
    if not kept.any() or min(steep) <= 0:
        raise ValueError(
            "no speckle found in the picture: its spectrum is not that of grains; use a picture in"
            " focus, with grains of 2 px or more"
        )
    # the gradients decide the scatter: their energy is that of the picture
    variances = found[kept] * steep[0] / steep[1]
    number = variances / np.prod(sizes[kept], axis=1)
    mean_power = atoms[kept].mean(axis=1)
    return sizes[kept], number / number.sum(), float(variances @ mean_power)
