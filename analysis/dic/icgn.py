"""Displacement and gradient of every correlation box by itself: inverse-compositional
Gauss-Newton of first order.

The box of the reference is compared with the image read at its deformed places. Level and contrast
of the image are free, so that a step is a linear regression of the grey levels read there on (1,
reference, steepest descents), whose normal matrix belongs to the reference alone. Internally,
places are measured from the centre of the box in units of its half-width, so that every parameter
is a displacement in pixels at the edge of the box.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from analysis.arrays import F64, I64, U8, Array, Bool
from analysis.dic import reading
from analysis.dic.interpolants import FAST
from analysis.dic.reading import CHUNK, IMAGE_MARGIN, BoxLayout, Taps, Target
from analysis.dic.status import MASKED, NOT_CONVERGED, OK, OUT_OF_IMAGE
from analysis.dic.threads import Rows
from analysis.grid import Grid
from analysis.kernels import compiled

KIND = np.float32  # arithmetic of the work on pixels; normal equations are in double precision
PARAMETERS = 6
# Parameter k multiplies, in displacement component COMPONENT[k], term TERM[k] of (1, x, y, x^2,
# x y, y^2): the first 6 are a shift and its gradient. POWER[k] is the degree of the term; INDEX
# finds a parameter by component and term.
COMPONENT = np.array([0, 1, 0, 0, 1, 1, 0, 0, 0, 1, 1, 1])
TERM = np.array([0, 0, 1, 2, 1, 2, 3, 4, 5, 3, 4, 5])
POWER = np.array([0, 0, 1, 1, 1, 1])
INDEX = np.array([[0, 2, 3], [1, 4, 5]])
STEEPEST = 0.5  # a displacement gradient beyond is taken for a runaway
MIN_EIGENVALUE = 1e-8  # least eigenvalue of a normal matrix with a unit diagonal
# variance of the image in the box, as a share of its mean square, that rounding may produce
MIN_VARIANCE_SHARE = 1e-6
LEAST_SHARE = 0.5  # least share of a box's pixels that must be usable


class Boxes(NamedTuple):
    """The reference and what its boxes need to solve for a displacement."""

    # (4, rows, columns) usable, grey level, gradient along x, gradient along y (0 in pixels that
    # are not usable)
    planes: Array
    top: I64  # (ny,) first row of the boxes
    left: I64  # (nx,)
    layout: BoxLayout
    moments: F64  # (ny, nx, 3) usable pixels, mean grey level, sum of squared deviations from it
    # (ny, nx, k + 2, k + 2) inverse of the normal matrix of (1, reference, k steepest descents);
    # NaN: singular
    inverse: F64


class StoppingRule(NamedTuple):
    """When to stop."""

    max_iterations: int
    tolerance: float  # px at the edge of the box
    furthest: float  # px from the start


class Solution(NamedTuple):
    """The displacement and its gradient of all boxes; the caller owns the arrays.

    Attributes
    ----------
    parameters : ndarray, shape (PARAMETERS, ny, nx)
        u_x, u_y (px); du_x/dx, du_x/dy, du_y/dx, du_y/dy.
    zncc : ndarray, shape (ny, nx)
        Zero-mean normalised cross-correlation with the deformed box, before the last step.
    iterations : ndarray, shape (ny, nx), uint8
    std : ndarray, shape (2, ny, nx)
        Standard uncertainty of u_x and u_y (px) from the residuals of the box itself, taken as
        independent.
    status : ndarray, shape (ny, nx), uint8
        `Status`; all numbers are NaN where it is not OK.
    """

    parameters: F64
    zncc: F64
    iterations: U8
    std: F64
    status: U8

    @classmethod
    def empty(cls, shape: tuple[int, int]) -> Solution:
        """Arrays of NaN, status MASKED, for a grid of `shape`."""
        parameters, zncc, std = (np.full((n, *shape), np.nan) for n in (PARAMETERS, 1, 2))
        status = np.full(shape, MASKED, np.uint8)
        return cls(parameters, zncc[0], np.zeros(shape, np.uint8), std, status)


class Scratch(NamedTuple):
    """Working memory of one thread."""

    planes: Array  # (4, box * pitch) of the box: those of the reference
    grey: Array  # (box * pitch,) the image at the places of the box
    warp: Array  # (2, 3) displacement in the three terms, without its whole pixels
    sums: F64  # (k + 3,) of grey x (1, reference, k steepest descents) and grey^2
    taps: Taps
    place: F64  # (2, 3) displacement in the three terms
    step: F64  # (2, 3)
    out: F64  # (3,) ZNCC, standard uncertainties of u_x and u_y


@compiled(fastmath=FAST)
def grey_sums(planes: Array, g: Array, first: int, last: int, out: F64) -> None:
    """Add products of grey levels, pixels `first` to `last` of a box, with (1, reference,
    gradients) and themselves.
    """
    v, w, f = g[first:last], planes[0, first:last], planes[1, first:last]
    fx, fy = planes[2, first:last], planes[3, first:last]
    s = sf = sx = sy = sg = v[0] - v[0]  # zero in the precision of the pixels
    for j in range(v.size):
        u = w[j] * v[j]
        s += u
        sf += f[j] * v[j]
        sx += fx[j] * v[j]
        sy += fy[j] * v[j]
        sg += u * v[j]
    out[0] += s
    out[1] += sf
    out[2] += sx
    out[3] += sy
    out[-1] += sg


@compiled(fastmath=FAST)
def slope_sums(
    planes: Array, g: Array, place: Array, first: int, last: int, out: F64, to_x: int, to_y: int
) -> None:
    """Add products of grey levels with both gradients times one of the terms."""
    v, fx, fy, a = g[first:last], planes[2, first:last], planes[3, first:last], place[first:last]
    sx = sy = v[0] - v[0]
    for j in range(v.size):
        p = v[j] * a[j]
        sx += fx[j] * p
        sy += fy[j] * p
    out[to_x] += sx
    out[to_y] += sy


@compiled
def add_up(memory: Scratch, places: Array) -> None:
    """Products of the grey levels with everything their regression needs; in double precision from
    chunk to chunk.
    """
    planes, grey, sums = memory.planes, memory.grey, memory.sums
    sums[:] = 0
    for first in range(0, grey.size, CHUNK):
        last = min(first + CHUNK, grey.size)
        grey_sums(planes, grey, first, last, sums)
        for term in range(1, 3):
            to_x, to_y = 2 + INDEX[0, term], 2 + INDEX[1, term]
            slope_sums(planes, grey, places[term], first, last, sums, to_x, to_y)


@compiled
def compose(p: F64, step: F64, half: float) -> None:
    """Displace the places that `p` describes back by a small displacement: u(x) <- u(x) - (1 + grad
    u) step(x).
    """
    for c in range(2):
        slopes = p[c, 1], p[c, 2]
        for k in range(3):
            p[c, k] -= step[c, k]
        for axis in range(2):
            for k in range(3):
                p[c, k] -= slopes[axis] * step[axis, k] / half


@compiled
def load_box(boxes: Boxes, memory: Scratch, i: int, j: int) -> None:
    """Lay out one box of the reference in working memory; the columns beyond it stay zero."""
    top, left, box, pitch = boxes.top[i], boxes.left[j], boxes.layout.box, boxes.layout.pitch
    for plane in range(4):
        for k in range(box):
            source = boxes.planes[plane, top + k, left : left + box]
            to = memory.planes[plane, k * pitch : k * pitch + box]
            for m in range(box):
                to[m] = source[m]


@compiled
def read_box(boxes: Boxes, target: Target, memory: Scratch, i: int, j: int, p: F64) -> bool:
    """Read the image at the places of box (i, j) displaced by `p`; False: it leaves the image."""
    x, y = math.floor(p[0, 0]), math.floor(p[1, 0])
    for k in range(3):
        memory.warp[0, k], memory.warp[1, k] = p[0, k], p[1, k]
    memory.warp[0, 0], memory.warp[1, 0] = p[0, 0] - x, p[1, 0] - y
    taps, layout, warp, grey = memory.taps, boxes.layout, memory.warp, memory.grey
    top, left = boxes.top[i] + y, boxes.left[j] + x
    return bool(reading.read_deformed(target, taps, layout, warp, top, left, grey))


@compiled(error_model="numpy")
def solve_box(
    boxes: Boxes, target: Target, memory: Scratch, stops: StoppingRule, i: int, j: int
) -> tuple[int, int]:
    """Status of one box and iterations done; the place in `memory` is improved, and its `out`
    receives ZNCC and the two stds.
    """
    moments, inverse, sums = boxes.moments[i, j], boxes.inverse[i, j], memory.sums
    p, step, out = memory.place, memory.step, memory.out
    pixels, mean, deviations = moments[0], moments[1], moments[2]
    half, n = boxes.layout.box / 2, boxes.inverse.shape[2]
    if pixels < LEAST_SHARE * boxes.layout.box**2:
        return MASKED, 0
    if not math.isfinite(inverse[0, 0]):
        return NOT_CONVERGED, 0
    load_box(boxes, memory, i, j)
    start_x, start_y = p[0, 0], p[1, 0]
    for iteration in range(1, stops.max_iterations + 1):
        if not read_box(boxes, target, memory, i, j, p):
            return OUT_OF_IMAGE, iteration
        add_up(memory, boxes.layout.places)
        found = sums[n] - sums[0] * sums[0] / pixels
        if found <= MIN_VARIANCE_SHARE * sums[n]:
            return NOT_CONVERGED, iteration
        sums[1] -= mean * sums[0]
        gain = math.sqrt(found / deviations)
        explained, length = 0.0, 0.0
        for a in range(n):
            coefficient = 0.0
            for b in range(n):
                coefficient += inverse[a, b] * sums[b]
            explained += coefficient * sums[a]
            if a >= 2:
                step[COMPONENT[a - 2], TERM[a - 2]] = coefficient / gain
                length += (coefficient / gain) ** 2
        compose(p, step, half)
        bend = 0.0
        for k in range(2, n - 2):
            bend = max(bend, abs(p[COMPONENT[k], TERM[k]]))
        distance = max(abs(p[0, 0] - start_x), abs(p[1, 0] - start_y))
        if not (distance <= stops.furthest and bend <= STEEPEST * half):
            return NOT_CONVERGED, iteration
        if length < stops.tolerance**2:
            variance = max(0.0, sums[n] - explained) / (pixels - n)
            out[0] = sums[1] / (deviations * gain)
            gain *= max(abs(out[0]), 1e-9)  # of a regression: noise of the reference lessens it
            out[1] = math.sqrt(variance * inverse[2, 2]) / gain
            out[2] = math.sqrt(variance * inverse[3, 3]) / gain
            return OK, iteration
    return NOT_CONVERGED, stops.max_iterations


@compiled
def solve_rows(
    boxes: Boxes, target: Target, stops: StoppingRule, rows: Rows, start: F64, result: Solution
) -> None:
    """Solve the boxes in some rows of the grid; see `IcgnSolver.solve`."""
    half, n = boxes.layout.box / 2, result.parameters.shape[0]
    size, kind = boxes.layout.box * boxes.layout.pitch, boxes.planes.dtype
    planes, grey, warp = np.zeros((4, size), kind), np.zeros(size, kind), np.zeros((2, 3), kind)
    taps = reading.room(target)
    p, step, out = np.zeros((2, 3)), np.zeros((2, 3)), np.zeros(3)
    memory = Scratch(planes, grey, warp, np.zeros(n + 3), taps, p, step, out)
    for i in range(rows[0], rows[1]):
        for j in range(boxes.left.size):
            is_wanted = True
            for k in range(n):
                p[COMPONENT[k], TERM[k]] = start[k, i, j] * half ** POWER[k]
                is_wanted &= math.isfinite(start[k, i, j])
            if not is_wanted:
                continue
            status, iterations = solve_box(boxes, target, memory, stops, i, j)
            for k in range(n):
                value = p[COMPONENT[k], TERM[k]] / half ** POWER[k]
                result.parameters[k, i, j] = value if status == OK else math.nan
            result.zncc[i, j] = out[0] if status == OK else math.nan
            for axis in range(2):
                result.std[axis, i, j] = out[1 + axis] if status == OK else math.nan
            result.status[i, j], result.iterations[i, j] = status, iterations


class IcgnSolver:
    """The displacement and its gradient of each box of a grid between one reference and any number
    of images.

    Parameters
    ----------
    reference : ndarray, shape (rows, columns)
        Grey levels at t = 0.
    slopes : pair of ndarray, shape (rows, columns)
        Their derivatives along x and y, per px.
    grid : Grid
        Boxes of 4 to 512 px; all of them lie in the reference.
    weights : ndarray, shape (TAPS, COEFFICIENTS)
        How the image is read between its pixels: `analysis.dic.spectrum.interpolation`.
    usable : ndarray of bool, shape (rows, columns), or None
        Pixels of the reference that may be used; None: all.
    max_iterations : int
        At most 255. A point that has not converged after so many is NOT_CONVERGED.
    tolerance_px : float
        A point has converged if its last step moved the edge of the box by less.
    furthest_px : float
        A point that runs further from its start is NOT_CONVERGED.

    Attributes
    ----------
    contrast : ndarray, shape (ny, nx), float64
        Standard deviation of the reference in each box, over its usable pixels.
    pixels : ndarray, shape (ny, nx), float64
        Number of usable pixels in each box.

    References
    ----------
    Pan, Li and Tong (2013), inverse-compositional Gauss-Newton on the zero-normalised criterion.
    """

    def __init__(
        self,
        reference: F64,
        slopes: tuple[F64, F64],
        grid: Grid,
        weights: F64,
        *,
        usable: Bool | None = None,
        max_iterations: int = 20,
        tolerance_px: float = 1e-3,
        furthest_px: float = 5.0,
    ) -> None:
        if usable is None:
            usable = np.ones(reference.shape, np.bool_)
        self._level = float(reference[usable].mean())
        planes = np.stack([usable, reference - self._level, *slopes])
        planes = np.where(usable, planes, 0).astype(KIND)
        self._target = reading.target_for(reference.shape, weights, KIND)
        layout = reading.lay_out(grid.box_px)
        places = layout.places.reshape(3, layout.box, -1)[:, :, : layout.box].reshape(3, -1)
        moments, inverse = normal_equations(planes, grid, places, PARAMETERS)
        layout = layout._replace(places=layout.places.astype(KIND))
        self._boxes = Boxes(planes, grid.top, grid.left, layout, moments, inverse)
        self._stops = StoppingRule(int(max_iterations), float(tolerance_px), float(furthest_px))
        self.pixels = moments[:, :, 0]
        self.contrast = np.sqrt(moments[:, :, 2] / np.maximum(self.pixels, 1))

    def load(self, image: Array) -> None:
        """Make `image`, of the reference's shape, the one in which the boxes are looked for."""
        kind = self._target.image.dtype.type
        read = image.astype(kind) - kind(self._level)
        margins = IMAGE_MARGIN, IMAGE_MARGIN, IMAGE_MARGIN, IMAGE_MARGIN
        self._target.image[...] = cv2.copyMakeBorder(read, *margins, cv2.BORDER_REFLECT_101)

    def solve(self, rows: Rows, start: F64, result: Solution) -> None:
        """Solve the boxes in the rows from rows[0] to before rows[1] of the grid; several threads
        may, each its own rows.

        Parameters
        ----------
        start : ndarray, shape (PARAMETERS, ny, nx), float64
            Where each point begins, laid out like `Solution.parameters`; a point that is NaN in any
            is left as it is in `result`.
        result : Solution
            Receives the answers.
        """
        solve_rows(self._boxes, self._target, self._stops, rows, start, result)


def normal_equations(planes: Array, grid: Grid, places: F64, k: int) -> tuple[F64, F64]:
    """Moments (ny, nx, 3) and inverse normal matrices (ny, nx, k + 2, k + 2) of all boxes, of their
    first k parameters; NaN where singular.
    """
    n, box, (ny, nx) = k + 2, grid.box_px, grid.shape
    moments, inverse = np.zeros((ny * nx, 3)), np.full((ny * nx, n, n), np.nan)
    boxes = sliding_window_view(planes, (box, box), axis=(1, 2))
    # some at a time, so that what is worked on stays in the cache
    for some in np.array_split(np.arange(ny * nx), math.ceil(ny * nx * box**2 / 2**17)):
        part = boxes[:, grid.top[some // nx], grid.left[some % nx]]
        w, f, *slopes = part.reshape(4, some.size, -1).astype(np.float64)
        pixels = w.sum(axis=1)
        mean = f.sum(axis=1) / np.maximum(pixels, 1)
        f -= w * mean[:, None]
        moments[some] = np.stack([pixels, mean, (f * f).sum(axis=1)], axis=1)
        descents = [slopes[COMPONENT[k]] * places[TERM[k]] for k in range(n - 2)]
        regressors = np.stack([w, f, *descents], axis=1)
        normal = regressors @ regressors.transpose(0, 2, 1)
        size = np.sqrt(np.maximum(np.diagonal(normal, axis1=1, axis2=2), 1e-30))
        square = size[:, :, None] * size[:, None, :]
        normal /= square
        regular = (pixels > n) & (np.linalg.eigvalsh(normal)[:, 0] > MIN_EIGENVALUE)
        inverse[some[regular]] = np.linalg.inv(normal[regular]) / square[regular]
    return moments.reshape(ny, nx, 3), inverse.reshape(ny, nx, n, n)
