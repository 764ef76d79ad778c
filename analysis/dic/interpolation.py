"""Grey levels between the pixels: the classical separable interpolants, each as a table of
polynomials.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal, NamedTuple

import cv2
import numpy as np
from numba import njit
from numpy.polynomial import Polynomial
from numpy.typing import NDArray
from scipy.ndimage import spline_filter, spline_filter1d

F64 = NDArray[np.float64]
Real = NDArray[Any]  # float32 or float64, as the precision asks
CHUNK = 512  # pixels worked on at a time, so that what they need stays in the fastest memory
LANES = 32  # neighbouring pixels read together if they are displaced by the same whole pixels
# pixels around the image, its reflection about the outermost ones: no place lies there, but taps do
MARGIN = LANES + 8
COEFFICIENTS = 8  # of the weights' polynomials; lower degrees are filled up with zeros
U = np.uint64  # unsigned indices need no check for negative ones
U1, U2, U3, C1, C2, C3 = U(1), U(2), U(3), U(CHUNK), U(2 * CHUNK), U(3 * CHUNK)
FAST = {"reassoc", "contract", "nsz"}
SLACK = 2  # pixels that the places of a box may lie outside the image
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
        As it is asked for in settings.
    weights : ndarray, shape (taps, degree + 1), float64
        The weight of each tap as a polynomial in the fraction ``t`` of a pixel, ``w_k(t) = sum_p
        weights[k, p] t**p`` for t in [0, 1). Tap k sits at pixel ``floor(x) + k - taps // 2 + 1``;
        the number of taps is even.
    spline : 0, 3 or 5
        Degree of the B-spline whose coefficients take the place of the grey levels; 0: none.

    Raises
    ------
    ValueError
        The weights or the spline can not be used.
    """

    name: str
    weights: F64
    spline: Literal[0, 3, 5] = 0

    def __post_init__(self) -> None:
        taps, terms = self.weights.shape
        if taps % 2 or not 2 <= taps <= 8 or terms > COEFFICIENTS or self.spline not in (0, 3, 5):
            found = f"{taps} taps of degree {terms - 1} on a spline of degree {self.spline}"
            raise ValueError(
                f"interpolant {self.name}: {found} found; use 2, 4, 6 or 8 taps to degree"
                f" {COEFFICIENTS - 1} and spline 0, 3 or 5"
            )

    def at(self, fraction: float) -> F64:
        """The weights of the taps at one fraction of a pixel."""
        return np.asarray(np.polynomial.polynomial.polyval(fraction, self.weights.T))

    def prepare(self, image: NDArray[Any]) -> NDArray[Any]:
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
        response = spline_filter1d(
            np.eye(1, 4 * reach + 1, 2 * reach)[0], self.spline, mode="mirror"
        )[reach : 3 * reach + 1]
        return np.asarray(
            cv2.sepFilter2D(image, -1, response, response, borderType=cv2.BORDER_REFLECT_101)
        )


def _b_spline(degree: int) -> F64:
    """The pieces of the centred B-spline, by truncated powers (Unser 1999, equation 6)."""
    taps = degree + 1
    pieces = [
        sum(
            (
                (-1) ** i * math.comb(taps, i) * Polynomial([taps - 1 - k - i, 1]) ** degree
                for i in range(taps - k)
            ),
            Polynomial([0]),
        )
        for k in range(taps)
    ]
    return np.array([piece.coef for piece in pieces]) / math.factorial(degree)


def _fitted(kernel: Callable[[F64], F64], taps: int, degree: int) -> F64:
    """Polynomials through the values of a kernel at Chebyshev points, corrected so that the weights
    add up to 1 exactly.
    """
    t = (1 - np.cos(np.pi * (np.arange(degree + 1) + 0.5) / (degree + 1))) / 2
    values = kernel(t[:, None] - np.arange(taps) + taps // 2 - 1)
    weights = np.linalg.solve(
        np.vander(t, increasing=True), values / values.sum(axis=1, keepdims=True)
    ).T
    weights[taps // 2 - 1 : taps // 2 + 1] -= (weights.sum(axis=0) - np.eye(1, degree + 1)[0]) / 2
    return np.asarray(weights)


def _windowed_sinc(taps: int) -> F64:
    """A sinc under a Kaiser window, adjusted to add up to 1."""
    return _fitted(
        lambda x: np.sinc(x) * np.i0(BETA * np.sqrt(np.maximum(0, 1 - (2 * x / taps) ** 2))),
        taps,
        7,
    )


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


class Target(NamedTuple):
    """The image that is read between its pixels."""

    image: Real  # (rows + 2 MARGIN, columns + 2 MARGIN) grey levels or spline coefficients
    polynomials: Real  # (taps filled up to fours, COEFFICIENTS)
    taps: int  # that count: a place is inside if they are


class Taps(NamedTuple):
    """Working memory of one thread."""

    window: Real  # (pixels of a box and the taps around it,)
    across: Real  # (same,) interpolated along x
    weights: Real  # (2 * taps * CHUNK,) for x and then for y
    fraction: Real  # (2, CHUNK) of a pixel, along x and y
    whole: NDArray[np.int32]  # (2, CHUNK) pixels, along x and y
    lanes: Real  # (LANES,)


def target_for(shape: tuple[int, ...], interpolant: Interpolant, kind: type) -> Target:
    """Room for an image of `shape` (rows, columns) and the weights with which it will be read."""
    taps, degree = interpolant.weights.shape
    quads = -(-taps // 4) * 4
    polynomials = np.zeros((quads, COEFFICIENTS), kind)
    polynomials[(quads - taps) // 2 : (quads + taps) // 2, :degree] = interpolant.weights
    return Target(np.zeros((shape[0] + 2 * MARGIN, shape[1] + 2 * MARGIN), kind), polynomials, taps)


def lay_out(target: Target, box: int, order: int) -> tuple[int, NDArray[np.int32], F64]:
    """Distance between the rows of a box in working memory, and the pixels and places of
    `read_deformed`.

    Rows have room for the taps around the box (order 0), or fill whole vectors; columns beyond the
    box stand for its last. Places are the terms 1, x, y, x^2, x y, y^2, from the centre of the box
    in units of its half-width.
    """
    pitch = box + target.polynomials.shape[0] - 1 if order == 0 else -(-box // 8) * 8
    row, column = np.divmod(np.arange(box * pitch, dtype=np.int32), np.int32(pitch))
    pixels = np.stack([np.minimum(column, box - 1), row])
    x, y = (pixels - (box - 1) / 2) / (box / 2)
    return pitch, pixels, np.stack([np.ones_like(x), x, y, x * x, x * y, y * y])


@njit(cache=True, nogil=True)
def room(target: Target, box: int, pitch: int) -> Taps:
    """Working memory for one thread."""
    kind, taps = target.image.dtype, target.polynomials.shape[0]
    n = (box + taps) * pitch
    weights, lanes = np.zeros(2 * taps * CHUNK, kind), np.zeros(LANES, kind)
    return Taps(
        np.zeros(n, kind),
        np.zeros(n, kind),
        weights,
        np.zeros((2, CHUNK), kind),
        np.zeros((2, CHUNK), np.int32),
        lanes,
    )


@njit(cache=True, nogil=True, fastmath=FAST)
def tap_weights(fraction: Real, polynomials: Real, out: Real, n: int) -> None:
    """Interpolation weights for n fractions of a pixel; those of the next tap are CHUNK further in
    `out`.
    """
    for k in range(polynomials.shape[0]):
        row = out[k * CHUNK : k * CHUNK + n]
        a0, a1, a2, a3 = polynomials[k, 0], polynomials[k, 1], polynomials[k, 2], polynomials[k, 3]
        a4, a5, a6, a7 = polynomials[k, 4], polynomials[k, 5], polynomials[k, 6], polynomials[k, 7]
        if a4 == 0 and a5 == 0 and a6 == 0 and a7 == 0:
            for j in range(n):
                t = fraction[j]
                row[j] = a0 + t * (a1 + t * (a2 + t * a3))
        else:
            for j in range(n):
                t = fraction[j]
                row[j] = a0 + t * (
                    a1 + t * (a2 + t * (a3 + t * (a4 + t * (a5 + t * (a6 + t * a7)))))
                )


@njit(cache=True, nogil=True, fastmath=FAST)
def add_four(image: Real, distance: int, w0: Real, w1: Real, w2: Real, w3: Real, out: Real) -> None:
    """Add to `out` four pixels for each place, `distance` apart in memory, times their weights."""
    n = out.size
    a, b, c, d = (
        image[:n],
        image[distance : distance + n],
        image[2 * distance : 2 * distance + n],
        image[3 * distance : 3 * distance + n],
    )
    for j in range(n):
        out[j] += w0 * a[j] + w1 * b[j] + w2 * c[j] + w3 * d[j]


@njit(cache=True, nogil=True, fastmath=FAST)
def add_sixteen(
    image: Real,
    at: np.uint64,
    stride: np.uint64,
    w: Real,
    x: np.uint64,
    y: np.uint64,
    out: Real,
    n: int,
) -> None:
    """Add to `out` four by four taps for n neighbouring pixels, each with its own weights, from
    w[x] and w[y].
    """
    at1, at2, at3 = at + stride, at + U2 * stride, at + U3 * stride
    for j in range(U(n)):
        i, i1, i2, i3, p, q = at + j, at1 + j, at2 + j, at3 + j, x + j, y + j
        a, b, c, d = w[p], w[p + C1], w[p + C2], w[p + C3]
        r = a * image[i] + b * image[i + U1] + c * image[i + U2] + d * image[i + U3]
        r1 = a * image[i1] + b * image[i1 + U1] + c * image[i1 + U2] + d * image[i1 + U3]
        r2 = a * image[i2] + b * image[i2 + U1] + c * image[i2 + U2] + d * image[i2 + U3]
        r3 = a * image[i3] + b * image[i3 + U1] + c * image[i3 + U2] + d * image[i3 + U3]
        out[j] += w[q] * r + w[q + C1] * r1 + w[q + C2] * r2 + w[q + C3] * r3


@njit(cache=True, nogil=True)
def read_shifted(
    target: Target, memory: Taps, warp: Real, box: int, pitch: int, top: int, left: int, out: Real
) -> bool:
    """Read the image at the places of a box that is only shifted, by one fraction of a pixel;
    False: it leaves the image.

    `out` has rows of `pitch` pixels, of which the first `box` are meant.
    """
    rows, columns = target.image.shape
    y, x = top + MARGIN, left + MARGIN
    least = MARGIN - SLACK
    if y < least or x < least or y + box + least > rows or x + box + least > columns:
        return False
    taps, w = target.polynomials.shape[0], memory.weights
    lines, before = box + taps - 1, taps // 2 - 1
    for i in range(lines):
        source = target.image[y - before + i, x - before : x - before + pitch]
        to = memory.window[i * pitch : (i + 1) * pitch]
        for j in range(pitch):
            to[j] = source[j]
    across = memory.across[: lines * pitch]
    across[:] = 0
    out[:] = 0
    tap_weights(warp[0], target.polynomials, w, 1)
    for k in range(0, taps, 4):
        a, b, c, d = w[k * CHUNK], w[(k + 1) * CHUNK], w[(k + 2) * CHUNK], w[(k + 3) * CHUNK]
        add_four(memory.window[k:], 1, a, b, c, d, across)
    tap_weights(warp[1], target.polynomials, w, 1)
    for k in range(0, taps, 4):
        a, b, c, d = w[k * CHUNK], w[(k + 1) * CHUNK], w[(k + 2) * CHUNK], w[(k + 3) * CHUNK]
        add_four(memory.across[k * pitch :], pitch, a, b, c, d, out)
    return True


@njit(cache=True, nogil=True, fastmath=FAST)
def displace(places: Real, warp: Real, first: int, out: Real) -> None:
    """Displacement component at `places`, (6, n), from the place `first`: the sum of six terms."""
    n = out.size
    a0, a1, a2, a3, a4, a5 = warp[0], warp[1], warp[2], warp[3], warp[4], warp[5]
    x, y, xx = (
        places[1, first : first + n],
        places[2, first : first + n],
        places[3, first : first + n],
    )
    xy, yy = places[4, first : first + n], places[5, first : first + n]
    for j in range(n):
        out[j] = a0 + a1 * x[j] + a2 * y[j] + a3 * xx[j] + a4 * xy[j] + a5 * yy[j]


@njit(cache=True, nogil=True, fastmath=FAST)
def split(t: Real, whole: NDArray[np.int32]) -> None:
    """Take the whole pixels out of `t`, so that a fraction from 0 to 1 is left."""
    for j in range(t.size):
        w = np.floor(t[j])
        whole[j] = np.int32(w)
        t[j] -= w


@njit(cache=True, nogil=True)
def is_inside(
    whole: NDArray[np.int32],
    pixels: NDArray[np.int32],
    first: int,
    n: int,
    low: tuple[int, int],
    high: tuple[int, int],
) -> bool:
    """Whether n displaced pixels of a box, from `first`, stay between two corners (x, y) given
    relative to the box.
    """
    x_low = y_low = np.int32(1 << 30)
    x_high = y_high = np.int32(-(1 << 30))
    x, y, u, v = (
        pixels[0, first : first + n],
        pixels[1, first : first + n],
        whole[0, :n],
        whole[1, :n],
    )
    for j in range(n):
        a, b = np.int32(x[j] + u[j]), np.int32(y[j] + v[j])
        x_low, x_high, y_low, y_high = min(x_low, a), max(x_high, a), min(y_low, b), max(y_high, b)
    return bool(x_low >= low[0] and y_low >= low[1] and x_high <= high[0] and y_high <= high[1])


@njit(cache=True, nogil=True)
def read_deformed(
    target: Target,
    memory: Taps,
    warp: Real,
    places: Real,
    pixels: NDArray[np.int32],
    box: int,
    pitch: int,
    top: int,
    left: int,
    out: Real,
) -> bool:
    """Read the image at the places of a deformed box, each with its own fraction of a pixel; False:
    it leaves the image.
    """
    rows, columns = target.image.shape
    x, y = left + MARGIN, top + MARGIN
    image, taps = target.image.reshape(-1), target.polynomials.shape[0]
    before = taps // 2 - 1
    per_chunk = max(1, CHUNK // pitch)
    fraction, whole, weights, lanes = (
        memory.fraction,
        memory.whole,
        memory.weights,
        memory.lanes[:pitch],
    )
    first, last = MARGIN - SLACK, MARGIN - SLACK + 1
    low, high = (first - x, first - y), (columns - last - x, rows - last - y)
    for start in range(0, box, per_chunk):
        height = min(per_chunk, box - start)
        n = height * pitch
        for axis in range(2):
            displace(places, warp[axis], start * pitch, fraction[axis, :n])
            split(fraction[axis, :n], whole[axis])
        if not is_inside(whole, pixels, start * pitch, n, low, high):
            return False
        for axis in range(2):
            tap_weights(
                fraction[axis], target.polynomials, weights[axis * (weights.size // 2) :], n
            )
        for i in range(height):
            origin = (y - before + start + i) * columns + x - before
            for block in range(0, pitch, lanes.size):
                j = min(block, pitch - lanes.size)
                read_lanes(
                    image,
                    columns,
                    taps,
                    weights,
                    whole,
                    origin + j,
                    i * pitch + j,
                    lanes,
                    out,
                    (start + i) * pitch + j,
                )
    return True


@njit(cache=True, nogil=True)
def read_lanes(
    image: Real,
    columns: int,
    taps: int,
    weights: Real,
    whole: NDArray[np.int32],
    origin: int,
    first: int,
    lanes: Real,
    out: Real,
    to: int,
) -> None:
    """Read neighbouring pixels: together all those with the same whole-pixel displacement, then the
    others.
    """
    n, lane = lanes.size, 0
    while lane < n:
        x, y, alike = whole[0, first + lane], whole[1, first + lane], 0
        for k in range(n):
            alike += (whole[0, first + k] == x) & (whole[1, first + k] == y)
        for k in range(n):
            lanes[k] = 0
        at = origin + x + y * columns
        for ky in range(0, taps, 4):
            for kx in range(0, taps, 4):
                wx, wy = U(kx * CHUNK + first), U((taps + ky) * CHUNK + first)
                add_sixteen(image, U(at + ky * columns + kx), U(columns), weights, wx, wy, lanes, n)
        if alike == n:
            for k in range(U(n)):
                out[U(to) + k] = lanes[k]
            return
        following = n
        for k in range(n - 1, -1, -1):
            if whole[0, first + k] == x and whole[1, first + k] == y:
                out[to + k] = lanes[k]
            elif k > lane:
                following = k
        lane = following
