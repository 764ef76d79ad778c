"""A box of an image read between its pixels, deformed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from analysis.arrays import F64, I32, Array
from analysis.dic.interpolants import FAST, tap_weights
from analysis.kernels import compiled

CHUNK = 512  # pixels worked on at a time, so that what they need stays in the fastest memory
LANES = 32  # neighbouring pixels read together if they are displaced by the same whole pixels
# pixels around the image, its reflection about the outermost ones: no place lies there, but taps do
IMAGE_MARGIN = LANES + 8
SLACK = 2  # pixels that the places of a box may lie outside the image
U = np.uint64  # unsigned indices need no check for negative ones
U1, U2, U3, C1, C2, C3 = U(1), U(2), U(3), U(CHUNK), U(2 * CHUNK), U(3 * CHUNK)


class Target(NamedTuple):
    """The image that is read between its pixels."""

    image: Array  # grey levels, IMAGE_MARGIN more on each side
    polynomials: Array  # (TAPS, COEFFICIENTS) weights of the taps


class BoxLayout(NamedTuple):
    """How a box lies in working memory.

    Its rows fill whole vectors; columns beyond the box stand for its last.
    """

    box: int
    pitch: int  # distance between the rows
    pixels: I32  # (2, box * pitch) column and row of each pixel
    # (3, box * pitch) 1, x, y from the centre of the box, in units of its half-width
    places: Array


class Taps(NamedTuple):
    """Working memory of one thread."""

    weights: Array  # (2 * taps * CHUNK,) for x and then for y
    fraction: Array  # (2, CHUNK) of a pixel, along x and y
    whole: I32  # (2, CHUNK) pixels, along x and y
    lanes: Array  # (LANES,)


def target_for(shape: tuple[int, ...], weights: F64, kind: type) -> Target:
    """Room for an image of `shape` (rows, columns), to be read with these weights of the taps."""
    image: Array = np.zeros((shape[0] + 2 * IMAGE_MARGIN, shape[1] + 2 * IMAGE_MARGIN), kind)
    return Target(image, weights.astype(kind))


def lay_out(box: int) -> BoxLayout:
    """The layout of boxes of a side."""
    pitch = -(-box // 8) * 8
    row, column = np.divmod(np.arange(box * pitch, dtype=np.int32), np.int32(pitch))
    pixels = np.stack([np.minimum(column, box - 1), row])
    x, y = (pixels - (box - 1) / 2) / (box / 2)
    return BoxLayout(box, pitch, pixels, np.stack([np.ones_like(x), x, y]))


@compiled
def room(target: Target) -> Taps:
    """Working memory for one thread."""
    kind, taps = target.image.dtype, target.polynomials.shape[0]
    weights, fraction = np.zeros(2 * taps * CHUNK, kind), np.zeros((2, CHUNK), kind)
    return Taps(weights, fraction, np.zeros((2, CHUNK), np.int32), np.zeros(LANES, kind))


@compiled(fastmath=FAST)
def add_sixteen(
    image: Array,
    at: np.uint64,
    stride: np.uint64,
    w: Array,
    x: np.uint64,
    y: np.uint64,
    out: Array,
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


@compiled(fastmath=FAST)
def displace(places: Array, warp: Array, first: int, out: Array) -> None:
    """Displacement component at `places`, (3, n), from the place `first`, by three terms."""
    last = first + out.size
    a0, a1, a2, x, y = warp[0], warp[1], warp[2], places[1, first:last], places[2, first:last]
    for j in range(out.size):
        out[j] = a0 + a1 * x[j] + a2 * y[j]


@compiled(fastmath=FAST)
def split(t: Array, whole: I32) -> None:
    """Take the whole pixels out of `t`, so that a fraction from 0 to 1 is left."""
    for j in range(t.size):
        w = np.floor(t[j])
        whole[j] = np.int32(w)
        t[j] -= w


@compiled
def is_inside(
    whole: I32, pixels: I32, first: int, n: int, low: tuple[int, int], high: tuple[int, int]
) -> bool:
    """Whether n displaced pixels of a box, from `first`, stay between two corners (x, y) given
    relative to the box.
    """
    x_low = y_low = np.int32(1 << 30)
    x_high = y_high = np.int32(-(1 << 30))
    x, y, u, v = pixels[0, first:], pixels[1, first:], whole[0, :n], whole[1, :n]
    for j in range(n):
        a, b = np.int32(x[j] + u[j]), np.int32(y[j] + v[j])
        x_low, x_high, y_low, y_high = min(x_low, a), max(x_high, a), min(y_low, b), max(y_high, b)
    return bool(x_low >= low[0] and y_low >= low[1] and x_high <= high[0] and y_high <= high[1])


@compiled
def read_deformed(
    target: Target, memory: Taps, layout: BoxLayout, warp: Array, top: int, left: int, out: Array
) -> bool:
    """Read the image at the places of a deformed box, each with its own fraction of a pixel; False:
    it leaves the image.
    """
    rows, columns = target.image.shape
    box, pitch = layout.box, layout.pitch
    x, y = left + IMAGE_MARGIN, top + IMAGE_MARGIN
    image, taps = target.image.reshape(-1), target.polynomials.shape[0]
    before = taps // 2 - 1
    per_chunk = max(1, CHUNK // pitch)
    fraction, whole, weights = memory.fraction, memory.whole, memory.weights
    lanes = memory.lanes[:pitch]
    first, last = IMAGE_MARGIN - SLACK, IMAGE_MARGIN - SLACK + 1
    low, high = (first - x, first - y), (columns - last - x, rows - last - y)
    for start in range(0, box, per_chunk):
        height = min(per_chunk, box - start)
        n = height * pitch
        for axis in range(2):
            displace(layout.places, warp[axis], start * pitch, fraction[axis, :n])
            split(fraction[axis, :n], whole[axis])
        if not is_inside(whole, layout.pixels, start * pitch, n, low, high):
            return False
        for axis in range(2):
            half = weights[axis * (weights.size // 2) :]
            tap_weights(fraction[axis], target.polynomials, half, CHUNK, n)
        for i in range(height):
            origin, to = (y - before + start + i) * columns + x - before, (start + i) * pitch
            for block in range(0, pitch, lanes.size):
                j = min(block, pitch - lanes.size)
                source, at, there = origin + j, i * pitch + j, out[to + j :]
                read_lanes(image, columns, taps, weights, whole, source, at, lanes, there)
    return True


@compiled
def read_lanes(
    image: Array,
    columns: int,
    taps: int,
    weights: Array,
    whole: I32,
    origin: int,
    first: int,
    lanes: Array,
    out: Array,
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
                out[k] = lanes[k]
            return
        following = n
        for k in range(n - 1, -1, -1):
            if whole[0, first + k] == x and whole[1, first + k] == y:
                out[k] = lanes[k]
            elif k > lane:
                following = k
        lane = following
