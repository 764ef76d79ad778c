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
from typing import TYPE_CHECKING

import numpy as np
from numba import njit
from scipy import ndimage

from analysis.arrays import F32, F64, floats
from analysis.kernels import compiled
from drivers.sim.optics import IDEAL, Lens

if TYPE_CHECKING:
    from analysis.mechanics.greenwood_tripp import RoughContact
    from analysis.mechanics.tabulated_pressure import TabulatedPressure
    from drivers.sim.truth import TrueState


CELL_PX = 4
"""Distance between the nodes of the inverse map, which is linear in between."""
RUN_PX = 16
"""Pixels are resampled in runs of a multiple of this length, with one integer shift for each run.
"""
UNSEEN = 1e-5  # share of the peak pressure below which no micro-contact touches
_ITERATIONS = 8  # gradients are below 3 %, so that each iteration gains one and a half digits


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
def _g(x, y, g0, g2, per_px, drive):  # type: ignore[no-untyped-def]
    """Elastic displacement at (x, y) from the contact's centre."""
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
def _place(base_x, base_y, sigma, g0, g2, per_px, drive, out):  # type: ignore[no-untyped-def]
    h = 0.25
    for k in range(sigma.size):
        x, y = base_x[k], base_y[k]
        for _ in range(_ITERATIONS):
            gx, gy = _g(x, y, g0, g2, per_px, drive)
            x, y = base_x[k] - gx, base_y[k] - gy
        right, left = _g(x + h, y, g0, g2, per_px, drive), _g(x - h, y, g0, g2, per_px, drive)
        below, above = _g(x, y + h, g0, g2, per_px, drive), _g(x, y - h, g0, g2, per_px, drive)
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
    _place(base[0], base[1], sigma, move.g0, move.g2, move.per_px, move.drive, out)
    return out


def spline_coefficients(pattern: F64, columns: int) -> F32:
    """Quintic B-spline coefficients of a periodic pattern, continued so that a row of `columns`
    pixels can start anywhere in a period; read-only.
    """
    coefficients = ndimage.spline_filter(pattern, order=5, output=np.float64, mode="grid-wrap")
    made = np.ascontiguousarray(
        np.pad(coefficients, ((0, 0), (2, columns + 4)), mode="wrap"), dtype=np.float32
    )
    made.setflags(write=False)
    return made


@compiled
def _nodes(rows, columns, fx, fy, cx, cy, g0, g2, per_px, drive, lens):  # type: ignore[no-untyped-def]
    """X - x at the nodes of the map, without the integer part of the rigid displacement."""
    out = np.empty((2, (rows - 1) // CELL_PX + 2, (columns - 1) // CELL_PX + 2), np.float32)
    for j in range(out.shape[1]):
        for i in range(out.shape[2]):
            # what an ideal lens would show there
            x, y = i * CELL_PX - lens[1], j * CELL_PX - lens[2]
            far = lens[0] * lens[3] * (x * x + y * y)
            at_x, at_y = i * CELL_PX + far * x, j * CELL_PX + far * y
            gx, gy = _g(at_x - cx, at_y - cy, g0, g2, per_px, drive)
            out[0, j, i] = fx + gx + far * x
            out[1, j, i] = fy + gy + far * y
    return out


@compiled(fastmath=True)
def _weights(t):  # type: ignore[no-untyped-def]
    """Quintic B-spline weights of the six nodes around a point, which lies a fraction t beyond the
    third.
    """
    f = np.float32
    a = f(1 / 120)
    s = f(1) - t
    t2 = t * t
    s2 = s * s
    return (
        a * s * s2 * s2,
        a * (f(26) + t * (f(-50) + t * (f(20) + t * (f(20) + t * (f(-20) + t * f(5)))))),
        a * (f(66) + t2 * (f(-60) + t2 * (f(30) - f(10) * t))),
        a * (f(66) + s2 * (f(-60) + s2 * (f(30) - f(10) * s))),
        a * (f(26) + s * (f(-50) + s * (f(20) + s * (f(20) + s * (f(-20) + s * f(5)))))),
        a * t * t2 * t2,
    )


@njit(inline="always")  # type: ignore[untyped-decorator,unused-ignore]
def _six(a, p, i):  # type: ignore[no-untyped-def]
    return (
        a[0] * p[i]
        + a[1] * p[i + 1]
        + a[2] * p[i + 2]
        + a[3] * p[i + 3]
        + a[4] * p[i + 4]
        + a[5] * p[i + 5]
    )


@compiled(fastmath=True)
def _resample(p, q, r, s, t, u, tx, ty, kx, ky, out):  # type: ignore[no-untyped-def]
    """A run of pixels of one row from six rows of coefficients, all with the same integer shift
    (kx, ky); contiguous, so that the loop vectorises.
    """
    for i in range(out.size):
        a, b = _weights(tx[i] - kx), _weights(ty[i] - ky)
        upper = b[0] * _six(a, p, i) + b[1] * _six(a, q, i) + b[2] * _six(a, r, i)
        out[i] = upper + b[3] * _six(a, s, i) + b[4] * _six(a, t, i) + b[5] * _six(a, u, i)


@compiled(fastmath=True)
def _spread(nodes, out):  # type: ignore[no-untyped-def]
    """One row of nodes interpolated along x."""
    step = np.float32(1 / CELL_PX)
    for m in range(nodes.size - 1):
        for k in range(CELL_PX):
            out[m * CELL_PX + k] = nodes[m] + np.float32(k) * step * (nodes[m + 1] - nodes[m])


@compiled(fastmath=True)
def _between(f, above, below, out):  # type: ignore[no-untyped-def]
    for i in range(out.size):
        out[i] = above[i] + f * (below[i] - above[i])


@compiled
def _whole(t, i):  # type: ignore[no-untyped-def]
    """Integer shift of the run of pixels that begins at i, taken at its middle.

    Slightly beyond the ends of a spline segment its polynomial is still accurate: at 3 % of RUN_PX
    / 2 beyond, the jump of the fifth derivative causes an error of 1e-4 of the contrast.
    """
    return math.floor(t[min(i + RUN_PX // 2, t.size - 1)])


@compiled
def _warp_row(c, j, period_x, wx, wy, tx, ty, out):  # type: ignore[no-untyped-def]
    period_y, columns = c.shape[0], out.size
    i0 = 0
    while i0 < columns:
        kx, ky = _whole(tx, i0), _whole(ty, i0)
        i1 = i0 + RUN_PX
        while i1 < columns and _whole(tx, i1) == kx and _whole(ty, i1) == ky:
            i1 += RUN_PX
        i1 = min(i1, columns)
        top = j + wy + ky - 2
        left = (i0 + wx + kx) % period_x
        right = left + i1 - i0 + 5
        _resample(
            c[top % period_y, left:right],
            c[(top + 1) % period_y, left:right],
            c[(top + 2) % period_y, left:right],
            c[(top + 3) % period_y, left:right],
            c[(top + 4) % period_y, left:right],
            c[(top + 5) % period_y, left:right],
            tx[i0:i1],
            ty[i0:i1],
            np.float32(kx),
            np.float32(ky),
            out[i0:i1],
        )
        i0 = i1


@compiled
def _warp(c, period_x, wx, wy, nodes, out):  # type: ignore[no-untyped-def]
    # the rows of nodes above and below, for x and for y
    spread = np.empty((2, 2, (nodes.shape[2] - 1) * CELL_PX), np.float32)
    tx, ty = np.empty_like(spread[0, 0]), np.empty_like(spread[0, 0])
    for axis in range(2):
        _spread(nodes[axis, 0], spread[axis, 1])
    for j in range(out.shape[0]):
        n, k = j // CELL_PX, j % CELL_PX
        if k == 0:
            for axis in range(2):
                for i in range(spread.shape[2]):
                    spread[axis, 0, i] = spread[axis, 1, i]
                _spread(nodes[axis, n + 1], spread[axis, 1])
        _between(np.float32(k / CELL_PX), spread[0, 0], spread[0, 1], tx)
        _between(np.float32(k / CELL_PX), spread[1, 0], spread[1, 1], ty)
        _warp_row(c, j, period_x, wx, wy, tx, ty, out[j])


def warp(
    coefficients: F32,
    period_columns: int,
    move: BlockMotion,
    out: F32,
) -> None:
    """Write the pattern of the moved block to `out`, shape (rows, columns), float32.

    It is interpolated by the quintic B-spline of the undeformed, pixel-integrated pattern, which is
    a fast approximation of the exact sum of blobs.
    """
    wx, wy = math.floor(-move.rigid[0]), math.floor(-move.rigid[1])
    nodes = _nodes(
        *out.shape,
        -move.rigid[0] - wx,
        -move.rigid[1] - wy,
        *move.centre,
        move.g0,
        move.g2,
        move.per_px,
        move.drive,
        tuple(move.lens),
    )
    _warp(coefficients, period_columns, wx, wy, nodes, out)
