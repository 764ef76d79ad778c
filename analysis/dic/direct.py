"""The paper's correlation of one box with an image, computed directly, for a row of boxes at a
time.

Every correlation is one dot product over contiguous memory. The box, less its mean, is laid out
with a row pitch a little wider than itself and zeros in between; the part of the image around it is
laid out with the same pitch. A displacement of the box is then an offset into the second array. The
order of summation is the same whatever the offset, hence a correlation has the same bits from
wherever the search came to it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from analysis.dic.status import Status

REACH = 2  # the search looks this far around its present place: 5 x 5 displacements
WIDTH = 2 * REACH + 1
OUTSIDE = -2.0  # stands for the correlation of a box that leaves the image
FLAT = -1.5  # ... and of a box without contrast
LEAST_CORRELATION = 0.02  # values below are raised to this before the logarithm is taken

OK, LOW_CONTRAST, OUT_OF_IMAGE = int(Status.OK), int(Status.LOW_CONTRAST), int(Status.OUT_OF_IMAGE)
DECORRELATED, NOT_CONVERGED, MASKED = (
    int(Status.DECORRELATED),
    int(Status.NOT_CONVERGED),
    int(Status.MASKED),
)


class Boxes(NamedTuple):
    """The boxes of the reference: what never changes during a run."""

    image: NDArray[np.float32]
    top: NDArray[np.int64]  # (ny,) first row of the boxes
    left: NDArray[np.int64]  # (nx,) first column
    mean: NDArray[np.float64]  # (ny, nx)
    deviations: NDArray[np.float64]  # (ny, nx) sum of squared deviations from the mean
    box: int
    least_deviations: float  # a box with fewer has no contrast


class Target(NamedTuple):
    """The image in which the boxes are looked for, and its `summed_area`."""

    image: NDArray[np.float32]
    sums: NDArray[np.float64]


class Scratch(NamedTuple):
    """Working memory of one thread; the zeros between the rows of `template` are never overwritten."""

    pitch: int
    template: NDArray[np.float32]
    window: NDArray[np.float32]
    scores: NDArray[np.float64]  # (2 * radius + 1, 5)
    deviations: NDArray[np.float64]


@njit(cache=True, nogil=True)
def summed_area(image: NDArray[np.float32], out: NDArray[np.float64]) -> None:
    """Sums of grey levels and of their squares over all pixels above and to the left, shape (rows +
    1, columns + 1, 2).

    Exact for integer grey levels as long as the sum of squares stays below 2**53 (8 bit: any image;
    16 bit: 2 million pixels of full brightness; beyond, rounded to 1e-16 of the whole).
    """
    rows, columns = image.shape
    out[0] = 0.0
    for i in range(rows):
        total = 0.0
        squares = 0.0
        out[i + 1, 0, 0] = 0.0
        out[i + 1, 0, 1] = 0.0
        for j in range(columns):
            g = np.float64(image[i, j])
            total += g
            squares += g * g
            out[i + 1, j + 1, 0] = out[i, j + 1, 0] + total
            out[i + 1, j + 1, 1] = out[i, j + 1, 1] + squares


@njit(cache=True, nogil=True)
def box_moments(sums: NDArray[np.float64], top: int, left: int, box: int) -> tuple[float, float]:
    """Mean grey level of a box and the sum of its squared deviations from it."""
    bottom, right = top + box, left + box
    total = (sums[bottom, right, 0] - sums[bottom, left, 0]) - (
        sums[top, right, 0] - sums[top, left, 0]
    )
    squares = (sums[bottom, right, 1] - sums[bottom, left, 1]) - (
        sums[top, right, 1] - sums[top, left, 1]
    )
    mean = total / (box * box)
    return mean, max(0.0, squares - total * mean)


# Re-ordering within a sum lets the compiler use the vector unit; the order is fixed once compiled.
@njit(cache=True, nogil=True, fastmath={"reassoc", "contract", "nsz"})
def five_products(
    template: NDArray[np.float32], window: NDArray[np.float32], at: int, out: NDArray[np.float64]
) -> None:
    """Sum of template x window for five neighbouring offsets into the window, the first one `at`."""
    n = template.size
    w0, w1, w2 = window[at : at + n], window[at + 1 : at + 1 + n], window[at + 2 : at + 2 + n]
    w3, w4 = window[at + 3 : at + 3 + n], window[at + 4 : at + 4 + n]
    s0 = s1 = s2 = s3 = s4 = np.float32(0.0)
    for k in range(n):
        t = template[k]
        s0 += t * w0[k]
        s1 += t * w1[k]
        s2 += t * w2[k]
        s3 += t * w3[k]
        s4 += t * w4[k]
    out[0], out[1], out[2], out[3], out[4] = s0, s1, s2, s3, s4


@njit(cache=True, nogil=True, error_model="numpy")
def normalise(
    scores: NDArray[np.float64], deviations: NDArray[np.float64], reference: float, least: float
) -> None:
    """Turn product sums into correlations, given the squared deviations of box and image; negative
    ones mean outside.
    """
    for k in range(scores.size):
        found = deviations[k]
        value = scores[k] / math.sqrt(reference * max(found, 1e-9))
        scores[k] = value if found > least else (FLAT if found >= 0.0 else OUTSIDE)


@njit(cache=True, nogil=True)
def scratch(box: int, radius: int) -> Scratch:
    """Working memory for boxes of side `box` and searches of half-width `radius`."""
    pitch = (box + 2 * REACH + 7) // 8 * 8
    rows = 2 * max(radius, REACH) + 1
    window = np.zeros((rows + box - 1) * pitch + WIDTH, np.float32)
    return Scratch(
        pitch,
        np.zeros(box * pitch, np.float32),
        window,
        np.empty((rows, WIDTH)),
        np.empty((rows, WIDTH)),
    )


@njit(cache=True, nogil=True)
def load(
    image: NDArray[np.float32],
    top: int,
    left: int,
    rows: int,
    columns: int,
    mean: float,
    pitch: int,
    out: NDArray[np.float32],
) -> None:
    """Copy a rectangle of the image, less `mean`, to rows of length `pitch`; `out` stays as it was
    where there is no image.
    """
    level = np.float32(mean)
    first, last = max(0, -left), min(columns, image.shape[1] - left)
    for i in range(max(0, -top), min(rows, image.shape[0] - top)):
        if first < last:
            source = image[top + i, left + first : left + last]
            row = out[i * pitch + first : i * pitch + last]
            for j in range(source.size):
                row[j] = source[j] - level


@njit(cache=True, nogil=True)
def correlate(
    boxes: Boxes, target: Target, memory: Scratch, i: int, j: int, top: int, left: int, rows: int
) -> NDArray[np.float64]:
    """Zero-mean normalised cross-correlations of box (i, j) at displaced places, OUTSIDE or FLAT
    where there is none.

    The first of the places is (top, left). The answer, shape (rows, 5), is a view of the working
    memory.
    """
    box, scores, deviations = boxes.box, memory.scores[:rows], memory.deviations[:rows]
    sums, template, window, pitch = target.sums, memory.template, memory.window, memory.pitch
    image_rows, image_columns = target.image.shape
    load(target.image, top, left, rows + box - 1, box + WIDTH - 1, boxes.mean[i, j], pitch, window)
    for k in range(rows):
        five_products(template, window, k * pitch, scores[k])
        y = top + k
        for m in range(WIDTH):
            x = left + m
            is_inside = y >= 0 and x >= 0 and y + box <= image_rows and x + box <= image_columns
            deviations[k, m] = box_moments(sums, y, x, box)[1] if is_inside else -1.0
    normalise(
        scores.reshape(-1), deviations.reshape(-1), boxes.deviations[i, j], boxes.least_deviations
    )
    return scores


@njit(cache=True, nogil=True)
def highest(scores: NDArray[np.float64]) -> tuple[int, int]:
    """Row and column of the greatest value, the first one of equals."""
    best_i, best_j = 0, 0
    for i in range(scores.shape[0]):
        for j in range(scores.shape[1]):
            if scores[i, j] > scores[best_i, best_j]:
                best_i, best_j = i, j
    return best_i, best_j


@njit(cache=True, nogil=True)
def gaussian_peak(c: NDArray[np.float64]) -> tuple[float, float, bool]:
    """Offset (x, y) from the middle of nine correlations, shape (3, 3), to the top of their 2D
    Gaussian; whether there is one.

    Least squares on the logarithm: ``ln C = a + b x + c y + d x^2 + e x y + f y^2``. Correlations
    below LEAST_CORRELATION are raised to it: they have no logarithm, and they lie far from the top.
    """
    bx, by, dxx, dxy, dyy = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(3):
        for j in range(3):
            x, y = j - 1, i - 1
            g = math.log(max(c[i, j], LEAST_CORRELATION))
            bx += x * g / 6
            by += y * g / 6
            dxy += x * y * g / 4
            dxx += (x * x / 2 - 1 / 3) * g
            dyy += (y * y / 2 - 1 / 3) * g
    det = 4 * dxx * dyy - dxy * dxy
    if dxx >= 0 or det <= 0:
        return 0.0, 0.0, False
    top_x, top_y = (dxy * by - 2 * dyy * bx) / det, (dxy * bx - 2 * dxx * by) / det
    return top_x, top_y, abs(top_x) <= 1 and abs(top_y) <= 1


@njit(cache=True, nogil=True)
def scan(
    boxes: Boxes, target: Target, memory: Scratch, i: int, j: int, x: int, y: int, radius: int
) -> tuple[int, int]:
    """The displacement (x, y) of highest correlation within `radius` of the given one: all of them
    are tried.
    """
    best, best_x, best_y = OUTSIDE, x, y
    for first in range(x - radius, x + radius + 1, WIDTH):
        scores = correlate(
            boxes,
            target,
            memory,
            i,
            j,
            boxes.top[i] + y - radius,
            boxes.left[j] + first,
            2 * radius + 1,
        )
        k, m = highest(scores)
        if scores[k, m] > best:
            best, best_x, best_y = scores[k, m], first + m, y - radius + k
    return best_x, best_y


@njit(cache=True, nogil=True)
def climb(
    boxes: Boxes, target: Target, memory: Scratch, i: int, j: int, x: int, y: int, furthest: int
) -> tuple[float, float, float, int]:
    """Displacement (x, y), correlation and status of the peak reached uphill from the displacement
    (x, y).
    """
    start_x, start_y = x, y
    while abs(x - start_x) <= furthest and abs(y - start_y) <= furthest:
        scores = correlate(
            boxes, target, memory, i, j, boxes.top[i] + y - REACH, boxes.left[j] + x - REACH, WIDTH
        )
        k, m = highest(scores)
        if scores[k, m] == OUTSIDE:
            return math.nan, math.nan, math.nan, OUT_OF_IMAGE
        if scores[k, m] == FLAT:
            return math.nan, math.nan, math.nan, LOW_CONTRAST
        x += m - REACH
        y += k - REACH
        if 0 < k < WIDTH - 1 and 0 < m < WIDTH - 1:
            nine = scores[k - 1 : k + 2, m - 1 : m + 2]
            if nine.min() == OUTSIDE:
                return math.nan, math.nan, math.nan, OUT_OF_IMAGE
            dx, dy, is_peak = gaussian_peak(nine)
            return x + dx, y + dy, scores[k, m], OK if is_peak else NOT_CONVERGED
    return math.nan, math.nan, math.nan, NOT_CONVERGED


@njit(cache=True, nogil=True)
def match_rows(
    boxes: Boxes,
    target: Target,
    start: NDArray[np.int32],
    radius: NDArray[np.int32],
    furthest: int,
    least_correlation: float,
    rows: tuple[int, int],
    field: NDArray[np.float32],
    status: NDArray[np.uint8],
) -> None:
    """Displacements and correlations of the boxes in some rows of the grid.

    Parameters
    ----------
    start : ndarray, shape (2, ny, nx)
        Displacement (x, y) at which the search of each point begins.
    radius : ndarray, shape (ny, nx)
        Negative: leave the point as it is; 0: climb from `start`; more: try every displacement
        within it first.
    furthest : int
        How far from its start a point may climb.
    field : ndarray, shape (3, ny, nx)
        Receives u_x, u_y, ZNCC; NaN where `status` is not OK.
    """
    memory = scratch(boxes.box, max(0, radius[rows[0] : rows[1]].max()))
    for i in range(rows[0], rows[1]):
        for j in range(boxes.left.size):
            if radius[i, j] < 0:
                continue
            x, y, ux, uy, zncc, state = (
                start[0, i, j],
                start[1, i, j],
                math.nan,
                math.nan,
                math.nan,
                LOW_CONTRAST,
            )
            if boxes.deviations[i, j] > boxes.least_deviations:
                load(
                    boxes.image,
                    boxes.top[i],
                    boxes.left[j],
                    boxes.box,
                    boxes.box,
                    boxes.mean[i, j],
                    memory.pitch,
                    memory.template,
                )
                if radius[i, j] > 0:
                    x, y = scan(boxes, target, memory, i, j, x, y, radius[i, j])
                ux, uy, zncc, state = climb(boxes, target, memory, i, j, x, y, furthest)
                if state == OK and zncc < least_correlation:
                    state = DECORRELATED
            status[i, j] = state
            field[0, i, j] = ux if state == OK else math.nan
            field[1, i, j] = uy if state == OK else math.nan
            field[2, i, j] = zncc if state == OK else math.nan


@njit(cache=True, nogil=True)
def grid_moments(
    sums: NDArray[np.float64], top: NDArray[np.int64], left: NDArray[np.int64], box: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Mean grey level of every box of a grid and sum of its squared deviations, shape (ny, nx)."""
    mean = np.empty((top.size, left.size))
    deviations = np.empty((top.size, left.size))
    for i in range(top.size):
        for j in range(left.size):
            mean[i, j], deviations[i, j] = box_moments(sums, top[i], left[j], box)
    return mean, deviations


@njit(cache=True, nogil=True)
def neighbour_median(
    shift: NDArray[np.int32], valid: NDArray[np.bool_], least: int
) -> tuple[NDArray[np.int32], NDArray[np.bool_]]:
    """Median displacement (2, ny, nx) of the valid among a point's 8 neighbours, and where at least
    `least` of them are valid.
    """
    _, ny, nx = shift.shape
    median = np.zeros_like(shift)
    found = np.zeros((ny, nx), np.bool_)
    near = np.empty(8, np.int32)
    for axis in range(2):
        for i in range(ny):
            for j in range(nx):
                n = 0
                for k in range(max(0, i - 1), min(ny, i + 2)):
                    for m in range(max(0, j - 1), min(nx, j + 2)):
                        if valid[k, m] and (k != i or m != j):
                            at = n  # insertion keeps `near` sorted
                            while at > 0 and near[at - 1] > shift[axis, k, m]:
                                near[at] = near[at - 1]
                                at -= 1
                            near[at] = shift[axis, k, m]
                            n += 1
                if n >= least:
                    median[axis, i, j] = near[n // 2]
                    found[i, j] = True
    return median, found


@njit(cache=True, nogil=True)
def contradicted(
    field: NDArray[np.float32], status: NDArray[np.uint8], tolerance: float
) -> NDArray[np.bool_]:
    """OK points, shape (ny, nx), with neighbours that have contrast, none of which is OK and within
    `tolerance` px of them.
    """
    _, ny, nx = field.shape
    out = np.zeros((ny, nx), np.bool_)
    for i in range(ny):
        for j in range(nx):
            if status[i, j] == OK:
                out[i, j] = is_contradicted(field, status, tolerance, i, j)
    return out


@njit(cache=True, nogil=True)
def is_contradicted(
    field: NDArray[np.float32], status: NDArray[np.uint8], tolerance: float, i: int, j: int
) -> bool:
    """Whether point (i, j) has neighbours that have contrast, none of which agrees with it."""
    alone = True
    for k in range(max(0, i - 1), min(field.shape[1], i + 2)):
        for m in range(max(0, j - 1), min(field.shape[2], j + 2)):
            if k == i and m == j:
                continue
            if (
                status[k, m] == OK
                and max(abs(field[0, k, m] - field[0, i, j]), abs(field[1, k, m] - field[1, i, j]))
                <= tolerance
            ):
                return False
            alone &= status[k, m] == LOW_CONTRAST or status[k, m] == MASKED
    return not alone
