"""What a speckle image is made of: its noise, the size of its grains, and the filters that read it
best between the pixels.

The power spectrum of the reference determines how its grey levels are correlated at any distance,
whole pixels or not. From that correlation follow, by linear least squares, the weights that predict
the grey level (or its gradient) at any place from the pixels around it: of all filters of that
length the ones with the smallest error for this very texture.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.fft import irfft2, rfft2

from analysis.arrays import F32, F64, Array
from analysis.dic.interpolants import COEFFICIENTS, TAPS

DEGREE = 6  # degree of the polynomials for the weights of a tap
BEYOND = 0.3  # how far outside 0 to 1 the fraction of a pixel may lie
# cycles per px; texture that a camera can resolve has no power where both frequencies are above
CORNER = 0.42
LARGEST = 1024  # px; this much of an image is enough
# of the texture's: keeps the normal equations solvable for textures smoother than any noise
LEAST_POWER = 1e-7


@dataclass(frozen=True, slots=True)
class TextureCorrelation:
    """The correlations of the grey levels of one image.

    Attributes
    ----------
    noise : float
        Standard deviation of the white part (camera noise and rounding), in grey levels.
    contrast : float
        Standard deviation of the rest, in grey levels.
    grain_px2 : float
        Correlation area: the sum over all lags of the squared correlation coefficient. A box of N
        pixels holds about N / grain_px2 independent grains.
    power_x, power_y : ndarray, shape (columns // 2 + 1,), (rows // 2 + 1,)
        Share of the texture's variance at each spatial frequency along x and y, from 0 to half a
        cycle per px.
    """

    noise: float
    contrast: float
    grain_px2: float
    power_x: F64
    power_y: F64

    @property
    def power(self) -> F64:
        """The mean of both spectra, at the frequencies of `power_x`."""
        place = np.linspace(0.0, 1.0, self.power_x.size), np.linspace(0.0, 1.0, self.power_y.size)
        other = np.interp(*place, self.power_y)
        return np.asarray((self.power_x + other / other.sum()) / 2)

    @property
    def noise_share(self) -> float:
        """Power of the noise in units of the texture's; 1 for an image without texture."""
        return (self.noise / self.contrast) ** 2 if self.contrast else 1.0


def middle_of(image: Array) -> Array:
    """Its middle of `LARGEST` pixels at most, even numbers, each way."""
    rows, columns = (min(size // 2 * 2, LARGEST) for size in image.shape)
    top, left = (image.shape[0] - rows) // 2, (image.shape[1] - columns) // 2
    return image[top : top + rows, left : left + columns]


def windowed(image: Array) -> F64:
    """What an image varies about its mean, under a Hann window of unit power."""
    rows, columns = image.shape
    window = np.multiply.outer(np.hanning(rows + 2)[1:-1], np.hanning(columns + 2)[1:-1])
    window /= math.sqrt(float((window**2).sum()))
    return np.asarray((image - image.mean(dtype=np.float64)) * window)


def texture(image: F32, *, is_noisy: bool = True) -> TextureCorrelation:
    """Noise, contrast and spectra of an image, shape (rows, columns), from the periodogram of its
    middle under a Hann window.

    The power in the corner of the spectrum, where no optics resolves anything, is taken for the
    noise's; with `is_noisy` false for that of a texture as fine as the pixels.
    """
    image = middle_of(image)
    rows, columns = image.shape
    spectrum = rfft2(windowed(image).astype(np.float32))
    power = spectrum.real.astype(np.float64) ** 2 + spectrum.imag.astype(np.float64) ** 2
    corner = power[np.ix_(np.abs(np.fft.fftfreq(rows)) > CORNER, np.fft.rfftfreq(columns) > CORNER)]
    noise = 0.0
    if is_noisy and corner.size:  # a periodogram's ordinates are exponentially distributed
        noise = float(np.median(corner)) / math.log(2)
    signal = np.maximum(power - noise, 0.0)
    if not signal.any():
        signal += 1.0
    # single precision holds squares of the power of no bright picture
    signal = np.ldexp(signal, -np.frexp(signal.max())[1])
    # what stands for a negative frequency too
    both = np.where((np.arange(columns // 2 + 1) % (columns // 2)) == 0, 1.0, 2.0)
    variance = float((power @ both).sum()) / (rows * columns)
    along_x, along_y, half = signal.sum(axis=0) * both, signal @ both, rows // 2
    folded = along_y[1:half] + along_y[:half:-1]
    along_y = np.concatenate([along_y[:1], folded, along_y[half : half + 1]])
    return TextureCorrelation(
        noise=math.sqrt(noise),
        contrast=math.sqrt(max(0.0, variance - noise)),
        grain_px2=_grain(signal),
        power_x=along_x / along_x.sum(),
        power_y=along_y / along_y.sum(),
    )


def interpolation(power: F64) -> F64:
    """The least-squares interpolation of a texture of this spectrum along one axis, for fractions
    from -BEYOND to 1 + BEYOND: the weight of each tap as a polynomial, shape (TAPS, COEFFICIENTS).

    A constant grey level is kept to rounding.
    """
    taps = np.arange(TAPS) - (TAPS // 2 - 1)
    t = np.linspace(-BEYOND, 1 + BEYOND, 65)
    normal = np.ones((TAPS + 1, TAPS + 1))  # bordered by the condition that the weights add to 1
    between = _correlation(power, taps[:, None] - taps[None, :])
    normal[:TAPS, :TAPS] = between + LEAST_POWER * np.eye(TAPS)
    normal[TAPS, TAPS] = 0.0
    right = np.vstack([_correlation(power, taps[:, None] - t[None, :]), np.ones(t.size)])
    exact = np.linalg.solve(normal, right)[:TAPS]
    weights = np.zeros((TAPS, COEFFICIENTS))
    weights[:, : DEGREE + 1] = np.polynomial.polynomial.polyfit(t, exact.T, DEGREE).T
    return weights


def gradient(power: F64, noise_share: float) -> F64:
    """Antisymmetric weights, shape (9,), of the least-squares estimate of the gradient (per px) at
    the middle pixel.

    The noise is part of the statistics: its power relative to the texture's is `noise_share`. For
    such an estimate sum(estimate x truth) = sum(estimate^2) on average, hence Gauss-Newton steps
    built on it have the right length.
    """
    taps = np.arange(-4, 5)
    omega = np.linspace(0.0, math.pi, power.size)
    slope = (power[:, None] * omega[:, None] * np.sin(omega[:, None] * taps)).sum(axis=0)
    white = (noise_share + LEAST_POWER) * np.eye(taps.size)
    weights = np.linalg.solve(_correlation(power, taps[:, None] - taps[None, :]) + white, slope)
    return np.asarray((weights - weights[::-1]) / 2)


def slopes(image: Array, texture: TextureCorrelation) -> tuple[Array, Array]:
    """Gradients of an image of this texture along x and y, per px, of its shape and type."""
    along_x = gradient(texture.power_x, texture.noise_share)[None, :]
    along_y = gradient(texture.power_y, texture.noise_share)[:, None]
    return cv2.filter2D(image, -1, along_x), cv2.filter2D(image, -1, along_y)


def _correlation(power: F64, lag: Array) -> F64:
    """Correlation coefficients, in the shape of `lag` (px), of a texture with this spectrum."""
    omega = np.linspace(0.0, math.pi, power.size)
    return np.asarray(np.tensordot(power, np.cos(np.multiply.outer(omega, lag)), 1))


def _grain(signal: F64) -> float:
    """Sum of the squared correlation coefficients over the lags near zero, px^2, less what chance
    correlations contribute, as they are further out.
    """
    squares = np.fft.fftshift(irfft2(signal.astype(np.float32))) ** 2
    row, column = (size // 2 for size in squares.shape)
    reach = min(48, max(1, min(squares.shape) // 8))

    def total(reach: int) -> tuple[float, int]:
        near = squares[row - reach : row + reach + 1, column - reach : column + reach + 1]
        return float(near.sum()), near.size

    (inner, lags), (outer, more) = total(reach), total(2 * reach)
    chance = (outer - inner) / (more - lags)
    return max(1.0, (inner - lags * chance) / float(squares[row, column]))
