"""Weights of the pixels around a place, from which the grey level there is interpolated."""

from __future__ import annotations

from analysis.arrays import Array
from analysis.kernels import compiled

TAPS = 8  # pixels along each axis; tap k sits at pixel floor(x) + k - TAPS // 2 + 1
COEFFICIENTS = 8  # of the weights' polynomials in the fraction of a pixel, from its power 0 on
FAST = {"reassoc", "contract", "nsz"}


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
