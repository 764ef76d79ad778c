"""Where the points of the moved block appear in the image, and the image of the block resampled
there.

In pixels: the lab point x shows the material point X = x - rigid + g(x - centre), where g = (g0 +
g2 cos 2theta, g2 sin 2theta) is the elastic displacement of the contact, along and across the
direction of the drive, given by its radial functions g0 and g2.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from functools import lru_cache

import numpy as np
from numba import njit

from analysis.arrays import F32, F64, I16, floats
from analysis.kernels import compiled
from analysis.mechanics.greenwood_tripp import RoughContact
from analysis.mechanics.tabulated_pressure import TabulatedPressure
from drivers.sim.optics import IDEAL, Lens
from drivers.sim.truth import TrueState

Curves = tuple[F64, F64, float, tuple[float, float]]
"""g0 and g2 of a displacement, how often they are tabulated in a pixel, and the drive."""

CELL_PX = 4
"""Distance between the nodes of the inverse map, which is cubic in between."""
STEP_GREY, GREY_RANGE = 1 / 64, (-32768, 32767)  # of the coefficients, and in these steps
RUN_PX = 16
"""Pixels are resampled in runs of a multiple of this length, with one integer shift for each run.
"""
UNSEEN = 1e-5  # share of the peak pressure below which no micro-contact touches
_ITERATIONS = 8  # gradients are below 3 %, so that each iteration gains one and a half digits
CLOSE_PX = 1e-6  # of the last one


@dataclass(frozen=True, slots=True)
class BlockMotion:
    """The block's displacement in pixels: rigid (x, y), centre (x, y) of the contact, and g0, g2
    tabulated over the distance to it.

    `drive` is the unit vector of the direction of the drive, `radius` that within which
    micro-contacts touch, `lit` their share over that distance; None: that of a smooth face. All
    are those of an ideal lens; `lens` is the one that the camera has.
    """

    rigid: tuple[float, float]
    centre: tuple[float, float]
    radius: float
    g0: F64
    g2: F64
    per_px: float
    drive: tuple[float, float] = (1.0, 0.0)
    lit: F64 | None = None
    lens: Lens = IDEAL

    def equals(self, other: BlockMotion) -> bool:
        """Whether the other one is the same, so that it gives the same picture."""
        pairs = ((getattr(self, one.name), getattr(other, one.name)) for one in fields(self))
        return all(np.array_equal(a, b) for a, b in pairs)

    @property
    def curves(self) -> Curves:
        """The elastic displacement."""
        return self.g0, self.g2, self.per_px, self.drive

    @property
    def largest_elastic(self) -> float:
        """Upper bound of the elastic displacement of any point."""
        return float(np.max(np.abs(self.g0) + np.abs(self.g2)))


AT_REST = BlockMotion(
    rigid=(0.0, 0.0), centre=(0.0, 0.0), radius=0.0, g0=np.zeros(2), g2=np.zeros(2), per_px=1.0
)
"""The free block at its place of sample 0."""


def motion(
    state: TrueState,
    pixel_m: float,
    shape: tuple[int, int],
    margin_px: float,
    per_px: int = 4,
    distortion: float = 0.0,
) -> BlockMotion:
    """The state of the world in pixels, with its radial functions tabulated `per_px` times per
    pixel.

    The table ends `margin_px` beyond the farthest corner of the image. Linear interpolation in it
    is accurate to 1e-5 px at 4 entries per pixel.
    """
    centre = (state.lens_centre_m[0] / pixel_m, state.lens_centre_m[1] / pixel_m)
    far_x = max(abs(centre[0]), abs(shape[1] - centre[0])) + margin_px
    far_y = max(abs(centre[1]), abs(shape[0] - centre[1])) + margin_px
    distance = np.arange(math.ceil(math.hypot(far_x, far_y) * per_px) + 2) / per_px
    g0, g2 = state.radial(distance * pixel_m)
    seen, lit = state.apparent_radius_m, None
    if state.rough is not None:
        seen, lit = _touching(state.rough, distance.size, per_px, pixel_m)
    return BlockMotion(
        rigid=(state.rigid_m[0] / pixel_m, state.rigid_m[1] / pixel_m),
        centre=centre,
        radius=seen / pixel_m,
        g0=floats(g0) / pixel_m,
        g2=floats(g2) / pixel_m,
        per_px=float(per_px),
        drive=state.drive,
        lit=lit,
        lens=Lens.of(distortion, shape),
    )


@lru_cache(maxsize=2)  # the load is the same in all pictures of a drive
def _touching(
    rough: RoughContact | TabulatedPressure, entries: int, per_px: int, pixel_m: float
) -> tuple[float, F64]:
    """The radius in metres beyond which no micro-contact touches, and the share that does, as
    tabulated by `motion`; not to be written to.
    """
    lit = rough.pressure(np.arange(entries) / per_px * pixel_m) / rough.peak_pressure
    return rough.radius_at(UNSEEN), lit


@compiled
def _g(x, y, curves):  # type: ignore[no-untyped-def]
    """Elastic displacement at (x, y) from the contact's centre."""
    g0, g2, per_px, drive = curves
    square = x * x + y * y
    at = math.sqrt(square) * per_px
    k = min(int(at), g0.size - 2)
    t = min(at - k, 1.0)
    even = g0[k] + t * (g0[k + 1] - g0[k])
    if square == 0.0:
        return even * drive[0], even * drive[1]
    twice = (g2[k] + t * (g2[k + 1] - g2[k])) / square
    # of twice the angle in the image; the products with the drive subtract its angle once
    cos, sin = twice * (x * x - y * y), twice * 2.0 * x * y
    return drive[0] * (even + cos) + drive[1] * sin, drive[1] * (even - cos) + drive[0] * sin


@compiled
def _place(base, sigma, curves, out):  # type: ignore[no-untyped-def]
    h = 0.25
    for k in range(sigma.size):
        x, y = base[0, k], base[1, k]
        for _ in range(_ITERATIONS):
            was_x, was_y = x, y
            gx, gy = _g(x, y, curves)
            x, y = base[0, k] - gx, base[1, k] - gy
            if abs(x - was_x) + abs(y - was_y) < CLOSE_PX:
                break
        right, left = _g(x + h, y, curves), _g(x - h, y, curves)
        below, above = _g(x, y + h, curves), _g(x, y - h, curves)
        # dX/dx = 1 + grad g; the blob is deformed by its inverse F: covariance sigma^2 F F^T
        xx, yx = 1.0 + (right[0] - left[0]) / (2 * h), (right[1] - left[1]) / (2 * h)
        xy, yy = (below[0] - above[0]) / (2 * h), 1.0 + (below[1] - above[1]) / (2 * h)
        scale = (sigma[k] / (xx * yy - xy * yx)) ** 2
        out[0, k], out[1, k] = x, y
        out[2, k] = scale * (yy * yy + xy * xy)
        out[3, k] = -scale * (yy * yx + xy * xx)
        out[4, k] = scale * (yx * yx + xx * xx)


def as_if_rigid(x: F64, y: F64, move: BlockMotion, period: tuple[int, int], halo: int) -> F64:
    """Where points (x, y) of the block would appear if it had moved as a rigid whole, from the
    contact's centre; shape (2, n), pixels.

    The pattern is periodic with `period` (rows, columns); of each point, the copy within `halo` of
    the image is taken.
    """
    (rx, ry), (cx, cy) = move.rigid, move.centre
    return np.stack(
        [(x + rx + halo) % period[1] - halo - cx, (y + ry + halo) % period[0] - halo - cy]
    )


def place(base: F64, sigma: F64, move: BlockMotion) -> F64:
    """Where blobs of the block appear, and how the motion deforms them.

    Parameters
    ----------
    base : ndarray, shape (2, n)
        Places from `as_if_rigid`.
    sigma : ndarray, shape (n,)
        Standard deviations on the undeformed block, pixels.
    move : BlockMotion

    Returns
    -------
    ndarray, shape (5, n)
        x and y from the contact's centre, and the covariances xx, xy, yy; pixels.
    """
    out = np.empty((5, sigma.size))
    _place(base, sigma, move.curves, out)
    return out


def table(coefficients: F32) -> I16:
    """Cubic B-spline coefficients of a periodic pattern at every half pixel as `warp` reads them,
    in `STEP_GREY`; read-only.

    Shape (rows, 2, columns): each row has those at whole pixels, then those halfway to the next
    one, so that neighbours in a picture are neighbours there. Of both, the first columns follow on
    the last.
    """
    steps = coefficients * np.float32(1 / STEP_GREY)
    np.rint(steps, out=steps).clip(*GREY_RANGE, out=steps)
    halves = steps.astype(np.int16).reshape(len(steps), -1, 2).transpose(0, 2, 1)
    made = np.ascontiguousarray(np.pad(halves, ((0, 0), (0, 0), (0, 2)), mode="wrap"))
    made.setflags(write=False)
    return made


@compiled
def _nodes(rows, columns, fx, fy, cx, cy, curves, lens):  # type: ignore[no-untyped-def]
    """Twice X - x at the nodes of the map, from the one before the first pixel on; without the
    integer part of that of the rigid displacement.
    """
    out = np.empty((2, (rows - 1) // CELL_PX + 4, (columns - 1) // CELL_PX + 4), np.float32)
    for j in range(out.shape[1]):
        for i in range(out.shape[2]):
            # what an ideal lens would show there
            left, top = (i - 1) * CELL_PX, (j - 1) * CELL_PX
            x, y = left - lens[1], top - lens[2]
            far = lens[0] * lens[3] * (x * x + y * y)
            gx, gy = _g(left + far * x - cx, top + far * y - cy, curves)
            out[0, j, i] = fx + 2 * (gx + far * x)
            out[1, j, i] = fy + 2 * (gy + far * y)
    return out


@compiled(fastmath=True)
def _between(k, p, q, r, s, out):  # type: ignore[no-untyped-def]
    """Of four nodes in a row, pixel k from the second to the third: the cubic whose slope at a node
    is that between its neighbours (Catmull and Rom 1974).
    """
    f, t = np.float32, k / CELL_PX
    a, d = f(-0.5 * t * (1 - t) ** 2), f(-0.5 * (1 - t) * t**2)
    b, c = f(1 + (1.5 * t - 2.5) * t**2), f(0.5 * t + 2 * t**2 - 1.5 * t**3)
    for i in range(out.size):
        out[i] = a * p[i] + b * q[i] + c * r[i] + d * s[i]


@compiled
def _spread(nodes, out):  # type: ignore[no-untyped-def]
    """One row of nodes interpolated along x."""
    for k in range(CELL_PX):
        _between(k, nodes[:-3], nodes[1:-2], nodes[2:-1], nodes[3:], out[k::CELL_PX])


@compiled(fastmath=True)
def _weights(t):  # type: ignore[no-untyped-def]
    """Cubic B-spline weights, times 6, of the four nodes around a point, which lies a fraction t
    beyond the second.
    """
    f = np.float32
    s = f(1) - t
    t2, s2 = t * t, s * s
    return s * s2, f(4) + t2 * (f(3) * t - f(6)), f(4) + s2 * (f(3) * s - f(6)), t * t2


@njit(inline="always")  # type: ignore[untyped-decorator,unused-ignore]
def _four(a, taps, i):  # type: ignore[no-untyped-def]
    f, (p, q) = np.float32, taps
    return a[0] * f(p[i]) + a[1] * f(q[i]) + a[2] * f(p[i + 1]) + a[3] * f(q[i + 1])


@compiled(fastmath=True)
def _resample(p, q, r, s, tx, ty, kx, ky, out):  # type: ignore[no-untyped-def]
    """A run of pixels of one row from the taps of four rows, all with the same integer shift (kx,
    ky); contiguous, so that the loop vectorises.
    """
    unit = np.float32(STEP_GREY / 36)
    for i in range(out.size):
        a, b = _weights(tx[i] - kx), _weights(ty[i] - ky)
        upper = b[0] * _four(a, p, i) + b[1] * _four(a, q, i)
        out[i] = unit * (upper + b[2] * _four(a, r, i) + b[3] * _four(a, s, i))


@compiled
def _whole(t, i):  # type: ignore[no-untyped-def]
    """Integer shift of the run of pixels that begins at i, taken at its middle: slightly beyond the
    ends of a spline segment its polynomial is still accurate.
    """
    return math.floor(t[min(i + RUN_PX // 2, t.size - 1)])


@njit(inline="always")  # type: ignore[untyped-decorator,unused-ignore]
def _taps(c, row, first, n):  # type: ignore[no-untyped-def]
    """The coefficients of a row from half pixel `first` on, of which two rows take turns."""
    row, half, left = row % c.shape[0], first & 1, first >> 1
    then = left + half
    return c[row, half, left : left + n], c[row, 1 - half, then : then + n]


@compiled
def _warp_row(c, j, wx, wy, tx, ty, out):  # type: ignore[no-untyped-def]
    period = c.shape[2] - 2
    i0 = 0
    while i0 < out.size:
        kx, ky = _whole(tx, i0), _whole(ty, i0)
        first, top = (2 * i0 + wx + kx - 1) % (2 * period), 2 * j + wy + ky - 1
        end = min(out.size, i0 + period - (first >> 1))
        i1 = i0 + RUN_PX
        while i1 < end and _whole(tx, i1) == kx and _whole(ty, i1) == ky:
            i1 += RUN_PX
        i1 = min(i1, end)
        n = i1 - i0 + 1
        _resample(
            _taps(c, top, first, n),
            _taps(c, top + 1, first, n),
            _taps(c, top + 2, first, n),
            _taps(c, top + 3, first, n),
            tx[i0:i1],
            ty[i0:i1],
            np.float32(kx),
            np.float32(ky),
            out[i0:i1],
        )
        i0 = i1


@compiled
def _warp(c, wx, wy, nodes, out):  # type: ignore[no-untyped-def]
    # four rows of nodes in turn, for x and for y
    spread = np.empty((2, 4, (nodes.shape[2] - 3) * CELL_PX), np.float32)
    t = np.empty((2, spread.shape[2]), np.float32)
    for axis in range(2):
        for n in range(3):
            _spread(nodes[axis, n], spread[axis, n])
    for j in range(out.shape[0]):
        n, k = j // CELL_PX, j % CELL_PX
        for axis in range(2):
            turn = spread[axis]
            if k == 0:
                _spread(nodes[axis, n + 3], turn[(n + 3) % 4])
            p, q, r, s = turn[n % 4], turn[(n + 1) % 4], turn[(n + 2) % 4], turn[(n + 3) % 4]
            _between(k, p, q, r, s, t[axis])
        _warp_row(c, j, wx, wy, t[0], t[1], out[j])


def warp(coefficients: I16, move: BlockMotion, out: F32) -> None:
    """Write the pattern of the moved block to `out`, shape (rows, columns), float32.

    It is interpolated by the cubic B-spline of the undeformed, pixel-integrated pattern at every
    half pixel, which is a fast approximation of the exact sum of blobs.
    """
    x, y = (-2 * along for along in move.rigid)  # half pixels
    wx, wy = math.floor(x), math.floor(y)
    nodes = _nodes(*out.shape, x - wx, y - wy, *move.centre, move.curves, tuple(move.lens))
    _warp(coefficients, wx, wy, nodes, out)
