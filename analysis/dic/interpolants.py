"""Grey levels between the pixels: separable interpolants, each as a table of polynomials."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import cv2
import numpy as np
from numpy.polynomial import Polynomial
from scipy.ndimage import spline_filter, spline_filter1d

from analysis.arrays import F64, Array
from analysis.kernels import compiled

COEFFICIENTS = 8  # of the weights' polynomials; lower degrees are filled up with zeros
FAST = {"reassoc", "contract", "nsz"}
# of the Kaiser window; least bias on speckle of 2 to 4 px: 0.0025 px with 6 taps, below 0.0005 px
# with 8
BETA = 4.0
# slowest decay of the inverse of a sampled B-spline, per pixel
POLE = {3: math.sqrt(3) - 2, 5: -0.43057534709997}


@dataclass(frozen=True, slots=True)
class Interpolant:
    """A separable interpolation: the weights of the pixels around a place, along one axis.

    Attributes
    ----------
    name : str
        Its name in settings.
    weights : ndarray, shape (taps, degree + 1), float64
        The weight of each tap as a polynomial in the fraction ``t`` of a pixel, ``w_k(t) = sum_p
        weights[k, p] t**p`` for t in [0, 1). Tap k sits at pixel ``floor(x) + k - taps // 2 + 1``;
        the number of taps is even.
    spline : 0, 3 or 5
        Degree of the B-spline whose coefficients take the place of the grey levels; 0: none.

    Raises
    ------
    ValueError
        The weights or the spline cannot be used.
    """

    name: str
    weights: F64
    spline: Literal[0, 3, 5] = 0

    def __post_init__(self) -> None:
        taps, terms = self.weights.shape
        if taps % 2 or not 2 <= taps <= 8 or terms > COEFFICIENTS or self.spline not in (0, 3, 5):
            raise ValueError(
                f"interpolant {self.name}: {taps} taps of degree {terms - 1} on a spline of degree"
                f" {self.spline} found; use 2, 4, 6 or 8 taps to degree {COEFFICIENTS - 1} and"
                " spline 0, 3 or 5"
            )

    def at(self, fraction: float) -> F64:
        """The weights of the taps at one fraction of a pixel."""
        return np.asarray(np.polynomial.polynomial.polyval(fraction, self.weights.T))

    def padded(self, taps: int, kind: type) -> Array:
        """The weights for `tap_weights`, shape (taps, COEFFICIENTS), with zeros for further taps on
        both sides and for higher powers.
        """
        own, terms = self.weights.shape
        out: Array = np.zeros((taps, COEFFICIENTS), kind)
        out[(taps - own) // 2 : (taps + own) // 2, :terms] = self.weights
        return out

    def prepare(self, image: Array) -> Array:
        """What the weights are applied to: the grey levels, or the coefficients of the spline
        through them.

        The image is continued by reflection about its outermost pixels. In single precision the
        recursive filter of the spline is applied as its impulse response, cut below the resolution
        of the arithmetic: three times faster than the recursion.

        Parameters
        ----------
        image : ndarray, shape (rows, columns), float32 or float64

        Returns
        -------
        ndarray, same shape and type
            The image itself if there is no spline.
        """
        if self.spline == 0:
            return image
        if image.dtype == np.float64:
            return np.asarray(spline_filter(image, self.spline, mode="mirror"))
        reach = math.ceil(math.log(np.finfo(image.dtype).eps) / math.log(-POLE[self.spline]))
        impulse = np.eye(1, 4 * reach + 1, 2 * reach)[0]
        response = spline_filter1d(impulse, self.spline, mode="mirror")[reach : 3 * reach + 1]
        edge = cv2.BORDER_REFLECT_101
        return np.asarray(cv2.sepFilter2D(image, -1, response, response, borderType=edge))


@compiled(fastmath=FAST)
def tap_weights(fraction: Array, polynomials: Array, out: Array, pitch: int, n: int) -> None:
    """Interpolation weights for n fractions of a pixel; those of the next tap are `pitch` further
    in `out`.
    """
    for k in range(polynomials.shape[0]):
        row = out[k * pitch : k * pitch + n]
        a0, a1, a2, a3 = polynomials[k, 0], polynomials[k, 1], polynomials[k, 2], polynomials[k, 3]
        a4, a5, a6, a7 = polynomials[k, 4], polynomials[k, 5], polynomials[k, 6], polynomials[k, 7]
        if a4 == 0 and a5 == 0 and a6 == 0 and a7 == 0:
            for j in range(n):
                t = fraction[j]
                row[j] = a0 + t * (a1 + t * (a2 + t * a3))
        else:
            for j in range(n):
                t = fraction[j]
                upper = a4 + t * (a5 + t * (a6 + t * a7))
                row[j] = a0 + t * (a1 + t * (a2 + t * (a3 + t * upper)))


def _b_spline(degree: int) -> F64:
    """The pieces of the centred B-spline, by truncated powers (Unser 1999, equation 6)."""
    taps = degree + 1
    pieces = [Polynomial([0.0]) for _ in range(taps)]
    for k in range(taps):
        for i in range(taps - k):
            power = Polynomial([taps - 1 - k - i, 1]) ** degree
            pieces[k] = pieces[k] + (-1) ** i * math.comb(taps, i) * power
    return np.array([piece.coef for piece in pieces]) / math.factorial(degree)


def _fitted(kernel: Callable[[F64], F64], taps: int, degree: int) -> F64:
    """Polynomials through the values of a kernel at Chebyshev points, corrected so that the weights
    add up to 1 exactly.
    """
    t = (1 - np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))) / 2
    values = kernel(t[:, None] - np.arange(taps) + taps // 2 - 1)
    values = values / values.sum(axis=1, keepdims=True)
    weights = np.linalg.solve(np.vander(t, increasing=True), values).T
    weights[taps // 2 - 1 : taps // 2 + 1] -= (weights.sum(axis=0) - np.eye(1, degree + 1)[0]) / 2
    return np.asarray(weights)


def _windowed_sinc(taps: int) -> F64:
    """A sinc under a Kaiser window, adjusted to add up to 1."""

    def kernel(x: F64) -> F64:
        window = np.i0(BETA * np.sqrt(np.maximum(0, 1 - (2 * x / taps) ** 2)))
        return np.asarray(np.sinc(x) * window)

    return _fitted(kernel, taps, 7)


KEYS = np.array([[0, -1, 2, -1], [2, 0, -5, 3], [0, 1, 4, -3], [0, 0, -1, 1]]) / 2

CLASSICAL = {
    interpolant.name: interpolant
    for interpolant in (
        Interpolant("bilinear", np.array([[1.0, -1.0], [0.0, 1.0]])),
        Interpolant("bicubic", KEYS),
        Interpolant("bspline3", _b_spline(3), spline=3),
        Interpolant("bspline5", _b_spline(5), spline=5),
        Interpolant("sinc6", _windowed_sinc(6)),
        Interpolant("sinc8", _windowed_sinc(8)),
    )
}
