"""Displacement and deformation of every correlation box by itself: inverse-compositional
Gauss-Newton of order 0, 1 and 2.

The box of the reference is compared with the image read at its deformed places. Level and contrast
of the image are free, so the step is a linear regression of the grey levels found there on (1,
reference, steepest descents), whose normal matrix belongs to the reference alone. Inside, places
are measured from the centre of the box in units of its half-width, so that every parameter is a
displacement in pixels at the edge of the box.
"""

from __future__ import annotations

import math
from typing import Any, Literal, NamedTuple

import cv2
import numpy as np
from numba import njit
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from analysis.dic import interpolation
from analysis.dic.grid import Grid
from analysis.dic.interpolation import CHUNK, FAST, MARGIN, Interpolant, Real, Taps, Target
from analysis.dic.status import Status

F64 = NDArray[np.float64]

PARAMETERS = (2, 6, 12)  # of the orders 0, 1, 2
# Parameter k is the derivative of order POWER[k] of displacement component COMPONENT[k]; it
# multiplies term TERM[k] of (1, x, y, x^2, x y, y^2) / FACTOR[k]; INDEX finds it by component and
# term.
COMPONENT = np.array([0, 1, 0, 0, 1, 1, 0, 0, 0, 1, 1, 1])
TERM = np.array([0, 0, 1, 2, 1, 2, 3, 4, 5, 3, 4, 5])
POWER = np.array([0, 0, 1, 1, 1, 1, 2, 2, 2, 2, 2, 2])
FACTOR = np.array([1, 1, 1, 1, 1, 1, 2, 1, 2, 2, 1, 2])
INDEX = np.array([[0, 2, 3, 6, 7, 8], [1, 4, 5, 9, 10, 11]])
STEEPEST = 0.5  # a displacement gradient beyond is taken for a runaway
SINGULAR = 1e-8  # smallest eigenvalue of a normal matrix with ones on its diagonal that counts
# variance of the image in the box, as a share of its mean square, that rounding may produce
FLAT = 1e-6
LEAST_BOX = 4  # px
LEAST_SHARE = 0.5  # of a box's pixels that must be usable

OK, OUT_OF_IMAGE, NOT_CONVERGED, MASKED = (
    int(Status.OK),
    int(Status.OUT_OF_IMAGE),
    int(Status.NOT_CONVERGED),
    int(Status.MASKED),
)


class Boxes(NamedTuple):
    """The reference and what its boxes need to solve for a displacement."""

    # (4, rows, columns) usable, grey level, gradient along x, gradient along y (0 in pixels that
    # are not usable)
    planes: Real
    top: NDArray[np.int64]  # (ny,) first row of the boxes
    left: NDArray[np.int64]  # (nx,)
    box: int
    order: int
    pitch: int  # distance of the rows of a box in working memory
    places: Real  # (6, box * pitch): 1, x, y, x^2, x y, y^2 of each pixel
    # (2, box * pitch) column and row of each pixel; columns beyond the box stand for its last
    pixels: NDArray[np.int32]
    moments: F64  # (ny, nx, 3) usable pixels, mean grey level, sum of squared deviations from it
    # (ny, nx, k + 2, k + 2) inverse of the normal matrix of (1, reference, k steepest descents);
    # NaN: singular
    inverse: F64


class Stops(NamedTuple):
    """When to stop."""

    max_iterations: int
    tolerance: float  # px at the edge of the box
    furthest: float  # px from the start
    clip: float  # standard deviations; 0: off


class Result(NamedTuple):
    """What is found, on the whole grid; the caller owns the arrays and chooses their float type.

    Attributes
    ----------
    parameters : ndarray, shape (n_parameters, ny, nx)
        u_x, u_y (px); du_x/dx, du_x/dy, du_y/dx, du_y/dy; the second derivatives xx, xy, yy of u_x
        and then of u_y (1/px).
    zncc : ndarray, shape (ny, nx)
        Zero-mean normalised cross-correlation with the deformed box, before the last step.
    iterations : ndarray, shape (ny, nx), uint8
    std : ndarray, shape (2, ny, nx)
        Standard uncertainty of u_x and u_y (px) from the residuals of the very box, taken as
        independent.
    status : ndarray, shape (ny, nx), uint8
        `Status`; all numbers are NaN where it is not OK.
    """

    parameters: Real
    zncc: Real
    iterations: NDArray[np.uint8]
    std: Real
    status: NDArray[np.uint8]

    @classmethod
    def empty(cls, order: int, shape: tuple[int, int]) -> Result:
        """Arrays of NaN, status MASKED, for a grid of `shape`."""
        parameters, zncc, std = (np.full((n, *shape), np.nan) for n in (PARAMETERS[order], 1, 2))
        return cls(
            parameters, zncc[0], np.zeros(shape, np.uint8), std, np.full(shape, MASKED, np.uint8)
        )


class Scratch(NamedTuple):
    """Working memory of one thread."""

    planes: Real  # (4, box * pitch) of the box: those of the reference
    grey: Real  # (box * pitch,) the image at the places of the box
    warp: Real  # (2, 6) displacement in the six terms, without its whole pixels
    expected: Real  # (3,) gain, offset and largest believable difference of the grey levels
    sums: F64  # (k + 3,) of grey x (1, reference, k steepest descents) and grey^2
    taps: Taps


@njit(cache=True, nogil=True, fastmath=FAST)
def grey_sums(planes: Real, g: Real, first: int, last: int, out: F64) -> None:
    """Add products of grey levels, pixels `first` to `last` of a box, with (1, reference,
    gradients) and themselves.
    """
    v, w, f, fx, fy = (
        g[first:last],
        planes[0, first:last],
        planes[1, first:last],
        planes[2, first:last],
        planes[3, first:last],
    )
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


@njit(cache=True, nogil=True, fastmath=FAST)
def slope_sums(
    planes: Real, g: Real, place: Real, first: int, last: int, out: F64, to_x: int, to_y: int
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


@njit(cache=True, nogil=True)
def add_up(memory: Scratch, places: Real, order: int) -> None:
    """Products of the grey levels read with everything their regression needs; in double precision
    from chunk to chunk.
    """
    sums, n = memory.sums, memory.grey.size
    sums[:] = 0
    for first in range(0, n, CHUNK):
        last = min(first + CHUNK, n)
        grey_sums(memory.planes, memory.grey, first, last, sums)
        for term in range(1, (order + 1) * (order + 2) // 2):
            slope_sums(
                memory.planes,
                memory.grey,
                places[term],
                first,
                last,
                sums,
                2 + INDEX[0, term],
                2 + INDEX[1, term],
            )


@njit(cache=True, nogil=True, fastmath=FAST)
def cut(planes: Real, grey: Real, expected: Real) -> None:
    """Bring grey levels that are too far from what the reference makes expect back to the largest
    believable distance.
    """
    f, a, b, limit = planes[1], expected[0], expected[1], expected[2]
    for j in range(grey.size):
        level = a * f[j] + b
        grey[j] = min(max(grey[j], level - limit), level + limit)


@njit(cache=True, nogil=True)
def compose(p: F64, step: F64, half: float) -> None:
    """Displace the places that `p` describes back by a small displacement: u(x) <- u(x) - (1 + grad
    u) step(x), to second order.
    """
    for c in range(2):
        # du/dx and du/dy, each linear in x and y
        slopes = (p[c, 1], 2 * p[c, 3], p[c, 4]), (p[c, 2], p[c, 4], 2 * p[c, 5])
        for k in range(6):
            p[c, k] -= step[c, k]
        for axis in range(2):
            (g, gx, gy), d = slopes[axis], step[axis]
            p[c, 0] -= g * d[0] / half
            p[c, 1] -= (g * d[1] + gx * d[0]) / half
            p[c, 2] -= (g * d[2] + gy * d[0]) / half
            p[c, 3] -= (g * d[3] + gx * d[1]) / half
            p[c, 4] -= (g * d[4] + gx * d[2] + gy * d[1]) / half
            p[c, 5] -= (g * d[5] + gy * d[2]) / half


@njit(cache=True, nogil=True)
def load_box(boxes: Boxes, memory: Scratch, i: int, j: int) -> None:
    """Lay out one box of the reference in working memory; the columns beyond it stay zero."""
    top, left, box = boxes.top[i], boxes.left[j], boxes.box
    for plane in range(4):
        for k in range(box):
            source = boxes.planes[plane, top + k, left : left + box]
            to = memory.planes[plane, k * boxes.pitch : k * boxes.pitch + box]
            for m in range(box):
                to[m] = source[m]


@njit(cache=True, nogil=True)
def read_box(boxes: Boxes, target: Target, memory: Scratch, i: int, j: int, p: F64) -> bool:
    """Read the image at the places of box (i, j) displaced by `p`; False: some pixel needed lies
    outside.
    """
    x, y = math.floor(p[0, 0]), math.floor(p[1, 0])
    for k in range(6):
        memory.warp[0, k], memory.warp[1, k] = p[0, k], p[1, k]
    memory.warp[0, 0], memory.warp[1, 0] = p[0, 0] - x, p[1, 0] - y
    top, left = boxes.top[i] + y, boxes.left[j] + x
    if boxes.order == 0:
        return bool(
            interpolation.read_shifted(
                target, memory.taps, memory.warp, boxes.box, boxes.pitch, top, left, memory.grey
            )
        )
    layout = boxes.places, boxes.pixels, boxes.box, boxes.pitch
    return bool(
        interpolation.read_deformed(
            target, memory.taps, memory.warp, *layout, top, left, memory.grey
        )
    )


@njit(cache=True, nogil=True, error_model="numpy")
def solve_box(
    boxes: Boxes,
    target: Target,
    memory: Scratch,
    stops: Stops,
    i: int,
    j: int,
    p: F64,
    step: F64,
    out: F64,
) -> tuple[int, int]:
    """Status of one box and iterations done; `p`, shape (2, 6), is improved in place and `out`
    receives ZNCC and the two stds.
    """
    pixels, mean, deviations = (
        boxes.moments[i, j, 0],
        boxes.moments[i, j, 1],
        boxes.moments[i, j, 2],
    )
    inverse, sums, half, n = boxes.inverse[i, j], memory.sums, boxes.box / 2, boxes.inverse.shape[2]
    if pixels < LEAST_SHARE * boxes.box**2:
        return MASKED, 0
    if not math.isfinite(inverse[0, 0]):
        return NOT_CONVERGED, 0
    load_box(boxes, memory, i, j)
    start_x, start_y = p[0, 0], p[1, 0]
    for iteration in range(1, stops.max_iterations + 1):
        if not read_box(boxes, target, memory, i, j, p):
            return OUT_OF_IMAGE, iteration
        if stops.clip > 0 and iteration > 1:
            cut(memory.planes, memory.grey, memory.expected)
        add_up(memory, boxes.places, boxes.order)
        found = sums[n] - sums[0] * sums[0] / pixels
        if found <= FLAT * sums[n]:
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
        variance = max(0.0, sums[n] - explained) / (pixels - n)
        memory.expected[0], memory.expected[1] = gain, sums[0] / pixels - gain * mean
        memory.expected[2] = stops.clip * math.sqrt(variance)
        bend = 0.0
        for k in range(2, n - 2):
            bend = max(bend, abs(p[COMPONENT[k], TERM[k]]))
        if not (
            max(abs(p[0, 0] - start_x), abs(p[1, 0] - start_y)) <= stops.furthest
            and bend <= STEEPEST * half
        ):
            return NOT_CONVERGED, iteration
        if length < stops.tolerance**2:
            out[0] = sums[1] / (deviations * gain)
            out[1], out[2] = (
                math.sqrt(variance * inverse[2, 2]) / gain,
                math.sqrt(variance * inverse[3, 3]) / gain,
            )
            return OK, iteration
    return NOT_CONVERGED, stops.max_iterations


@njit(cache=True, nogil=True)
def solve_rows(
    boxes: Boxes, target: Target, stops: Stops, rows: tuple[int, int], start: F64, result: Result
) -> None:
    """Solve the boxes in some rows of the grid; see `IcgnSolver.solve`."""
    half, n, size, kind = (
        boxes.box / 2,
        result.parameters.shape[0],
        boxes.box * boxes.pitch,
        boxes.planes.dtype,
    )
    planes, grey, warp, expected = (
        np.zeros((4, size), kind),
        np.zeros(size, kind),
        np.zeros((2, 6), kind),
        np.zeros(3, kind),
    )
    memory = Scratch(
        planes,
        grey,
        warp,
        expected,
        np.zeros(n + 3),
        interpolation.room(target, boxes.box, boxes.pitch),
    )
    p, step, out = np.zeros((2, 6)), np.zeros((2, 6)), np.zeros(3)
    for i in range(rows[0], rows[1]):
        for j in range(boxes.left.size):
            asked = True
            for k in range(n):
                p[COMPONENT[k], TERM[k]] = start[k, i, j] * half ** POWER[k] / FACTOR[k]
                asked &= math.isfinite(start[k, i, j])
            if not asked:
                continue
            status, iterations = solve_box(boxes, target, memory, stops, i, j, p, step, out)
            is_ok = status == OK
            for k in range(n):
                result.parameters[k, i, j] = (
                    p[COMPONENT[k], TERM[k]] * FACTOR[k] / half ** POWER[k] if is_ok else math.nan
                )
            result.zncc[i, j] = out[0] if is_ok else math.nan
            for axis in range(2):
                result.std[axis, i, j] = out[1 + axis] if is_ok else math.nan
            result.status[i, j], result.iterations[i, j] = status, iterations


class IcgnSolver:
    """The displacement and deformation of each box of a grid between one reference and any number
    of images.

    Parameters
    ----------
    reference, gradient_x, gradient_y : ndarray, shape (rows, columns)
        Grey levels at t = 0 and their derivatives per px.
    grid : Grid
        The boxes; all of them lie in the reference.
    order : int
        0: shift; 1: and displacement gradient; 2: and second derivatives.
    interpolant : Interpolant
        How the image is read between its pixels.
    weights : ndarray of bool, shape (rows, columns), or None
        Pixels of the reference that may be used; None: all.
    precision : "single" or "double"
        Arithmetic of the work on pixels; the normal equations are always solved in double
        precision.
    max_iterations : int
        At most 255. A point that has not come to rest after so many is NOT_CONVERGED.
    tolerance_px : float
        A point is at rest if its last step moved the edge of the box by less.
    furthest_px : float
        A point that runs further from its start is NOT_CONVERGED.
    clip : float
        Grey levels further than so many standard deviations of the box's residuals from the
        expected ones are brought back to that distance, from the second iteration on; 0: never.

    Attributes
    ----------
    contrast : ndarray, shape (ny, nx), float64
        Standard deviation of the reference in each box, over its usable pixels.
    pixels : ndarray, shape (ny, nx), float64
        How many they are.

    Raises
    ------
    ValueError
        Order, precision, box, iterations, or the shape of an array can not be used.

    References
    ----------
    Pan, Li and Tong (2013), inverse-compositional Gauss-Newton on the zero-normalised criterion;
    Gao et al. (2015), second order.
    """

    def __init__(
        self,
        reference: Real,
        gradient_x: Real,
        gradient_y: Real,
        grid: Grid,
        *,
        order: int,
        interpolant: Interpolant,
        weights: NDArray[np.bool_] | None = None,
        precision: Literal["single", "double"] = "single",
        max_iterations: int = 20,
        tolerance_px: float = 1e-3,
        furthest_px: float = 5.0,
        clip: float = 0.0,
    ) -> None:
        box = grid.box_px
        is_known = order in (0, 1, 2) and precision in ("single", "double")
        if not (is_known and LEAST_BOX <= box <= CHUNK and 1 <= max_iterations <= 255):
            asked = (
                f"order {order}, {precision} precision, a box of {box} px and {max_iterations}"
                " iterations asked"
            )
            raise ValueError(
                f"ic-gn: {asked}; use order 0 to 2, single or double, {LEAST_BOX} to {CHUNK} px and"
                " 1 to 255 iterations"
            )
        kind = np.float32 if precision == "single" else np.float64
        usable = np.ones(reference.shape, np.bool_) if weights is None else weights
        if not (reference.shape == gradient_x.shape == gradient_y.shape == usable.shape):
            found = f"{reference.shape}, {gradient_x.shape}, {gradient_y.shape} and {usable.shape}"
            raise ValueError(
                f"ic-gn: reference, gradients and weights of shapes {found} found; use one shape"
            )
        self._interpolant, self._level = (
            interpolant,
            float(reference[usable].mean(dtype=np.float64)),
        )
        planes = np.where(
            usable, np.stack([usable, reference - self._level, gradient_x, gradient_y]), 0
        ).astype(kind)
        self._target = interpolation.target_for(reference.shape, interpolant, kind)
        pitch, pixels, places = interpolation.lay_out(self._target, box, order)
        moments, inverse = _normal_equations(
            planes, grid, places.reshape(6, box, pitch)[:, :, :box].reshape(6, -1), order
        )
        self._boxes = Boxes(
            planes,
            grid.top,
            grid.left,
            box,
            order,
            pitch,
            places.astype(kind),
            pixels,
            moments,
            inverse,
        )
        self._stops = Stops(
            int(max_iterations), float(tolerance_px), float(furthest_px), float(clip)
        )
        self.pixels, self.contrast = (
            moments[:, :, 0],
            np.sqrt(moments[:, :, 2] / np.maximum(moments[:, :, 0], 1)),
        )

    def load(self, image: NDArray[Any]) -> None:
        """Make `image` the one in which the boxes are looked for.

        Raises
        ------
        ValueError
            The image differs from the reference in shape.
        """
        kind = self._target.image.dtype.type
        if image.shape != (shape := self._boxes.planes.shape[1:]):
            raise ValueError(
                f"ic-gn: an image of shape {image.shape} found, the reference has {shape}; use one"
                " shape"
            )
        read = self._interpolant.prepare(image.astype(kind) - kind(self._level))
        self._target.image[...] = cv2.copyMakeBorder(
            read, MARGIN, MARGIN, MARGIN, MARGIN, cv2.BORDER_REFLECT_101
        )

    def solve(self, rows: tuple[int, int], start: F64, result: Result) -> None:
        """Solve the boxes in the rows from rows[0] to before rows[1] of the grid; several threads
        may, each its own rows.

        Parameters
        ----------
        start : ndarray, shape (n_parameters, ny, nx), float64
            Where each point begins, laid out like `Result.parameters`; a point that is NaN in any
            is left as it is in `result`.
        result : Result
            Receives the answers.
        """
        solve_rows(self._boxes, self._target, self._stops, rows, start, result)


def _normal_equations(planes: Real, grid: Grid, places: F64, order: int) -> tuple[F64, F64]:
    """Moments (ny, nx, 3) and inverse normal matrices (ny, nx, k + 2, k + 2) of all boxes; NaN
    where singular.
    """
    n, box, (ny, nx) = PARAMETERS[order] + 2, grid.box_px, grid.shape
    moments, inverse = np.zeros((ny * nx, 3)), np.full((ny * nx, n, n), np.nan)
    boxes = sliding_window_view(planes, (box, box), axis=(1, 2))
    for some in np.array_split(np.arange(ny * nx), math.ceil(ny * nx * box**2 / 2**17)):
        w, f, *slopes = (
            boxes[:, grid.top[some // nx], grid.left[some % nx]]
            .reshape(4, some.size, -1)
            .astype(np.float64)
        )
        pixels = w.sum(axis=1)
        mean = f.sum(axis=1) / np.maximum(pixels, 1)
        f -= w * mean[:, None]
        moments[some] = np.stack([pixels, mean, (f * f).sum(axis=1)], axis=1)
        regressors = np.stack(
            [w, f] + [slopes[COMPONENT[k]] * places[TERM[k]] for k in range(n - 2)], axis=1
        )
        normal = regressors @ regressors.transpose(0, 2, 1)
        size = np.sqrt(np.maximum(np.diagonal(normal, axis1=1, axis2=2), 1e-30))
        normal /= size[:, :, None] * size[:, None, :]
        regular = (pixels > n) & (np.linalg.eigvalsh(normal)[:, 0] > SINGULAR)
        scale = size[regular]
        inverse[some[regular]] = np.linalg.inv(normal[regular]) / (
            scale[:, :, None] * scale[:, None, :]
        )
    return moments.reshape(ny, nx, 3), inverse.reshape(ny, nx, n, n)
