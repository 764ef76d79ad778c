"""The paper's correlation of one box with an image, computed directly, for a row of boxes at a
time.

Every correlation is one dot product over contiguous memory. The box, less its mean, is laid out
with a row pitch a little wider than itself and zeros in between; the part of the image around it is
laid out with the same pitch. A displacement of the box is then an offset into the second array. The
order of summation does not depend on that offset, so that a correlation has the same bits whatever
path the search took to it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from analysis.arrays import F32, F64, I32, I64, U8
from analysis.dic.interpolants import FAST
from analysis.dic.status import DECORRELATED, LOW_CONTRAST, NOT_CONVERGED, OK, OUT_OF_IMAGE
from analysis.dic.threads import Rows
from analysis.kernels import compiled

REACH = 2  # the search looks this far around its present place: 5 x 5 displacements
WIDTH = np.int64(2 * REACH + 1)
OUTSIDE = -2.0  # stands for the correlation of a box that leaves the image
FLAT = -1.5  # ... and of a box without contrast
LEAST_CORRELATION = 0.02  # values below are raised to this before the logarithm is taken
NOWHERE = math.nan, math.nan, math.nan


class Templates(NamedTuple):
    """The boxes of the reference: what never changes during a run."""

    image: F32
    top: I64  # (ny,) first row of the boxes
    left: I64  # (nx,) first column
    mean: F64  # (ny, nx)
    deviations: F64  # (ny, nx) sum of squared deviations from the mean
    box: int
    least_deviations: float  # a box with fewer has no contrast


class SearchImage(NamedTuple):
    """The image in which the boxes are searched for, and its `summed_area`."""

    image: F32
    sums: F64


class Workspace(NamedTuple):
    """Working memory of one thread; the zeros between rows of `template` are never overwritten."""

    pitch: int
    template: F32
    window: F32
    scores: F64  # (2 * radius + 1, 5)
    deviations: F64


class ThreadTask(NamedTuple):
    """What a thread works on."""

    boxes: Templates
    target: SearchImage
    memory: Workspace


@compiled
def summed_area(image: F32, out: F64) -> None:
    """Sums of the grey levels and of their squares over all pixels above and to the left of each
    pixel, shape (rows + 1, columns + 1, 2).

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


@compiled
def box_moments(sums: F64, top: int, left: int, box: int) -> tuple[float, float]:
    """Mean grey level of a box and the sum of its squared deviations from it."""
    b, r = top + box, left + box
    total = (sums[b, r, 0] - sums[b, left, 0]) - (sums[top, r, 0] - sums[top, left, 0])
    squares = (sums[b, r, 1] - sums[b, left, 1]) - (sums[top, r, 1] - sums[top, left, 1])
    mean = total / (box * box)
    return mean, max(0.0, squares - total * mean)


@compiled
def grid_moments(sums: F64, top: I64, left: I64, box: int) -> tuple[F64, F64]:
    """`box_moments` of every box of a grid, shape (ny, nx) each."""
    mean, deviations = np.empty((top.size, left.size)), np.empty((top.size, left.size))
    for i in range(top.size):
        for j in range(left.size):
            mean[i, j], deviations[i, j] = box_moments(sums, top[i], left[j], box)
    return mean, deviations


# Re-ordering within a sum lets the compiler use the vector unit; the order is fixed once compiled.
@compiled(fastmath=FAST)
def five_products(template: F32, window: F32, at: int, out: F64) -> None:
    """Sum of template x window for five neighbouring offsets into the window, from `at` on."""
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


@compiled(error_model="numpy")
def normalise(scores: F64, deviations: F64, reference: float, least: float) -> None:
    """Turn sums of products into correlations, given the squared deviations of the image at each
    place, negative for places outside it, and those of the box.
    """
    for k in range(scores.size):
        found = deviations[k]
        value = scores[k] / math.sqrt(reference * max(found, 1e-9))
        scores[k] = value if found > least else (FLAT if found >= 0.0 else OUTSIDE)


@compiled
def workspace(box: int, radius: int) -> Workspace:
    """Working memory for boxes of side `box` and searches of half-width `radius`."""
    pitch = (box + 2 * REACH + 7) // 8 * 8
    rows = 2 * max(radius, REACH) + 1
    template, window = np.zeros(box * pitch, np.float32), (rows + box - 1) * pitch + WIDTH
    scores, deviations = np.empty((rows, WIDTH)), np.empty((rows, WIDTH))
    return Workspace(pitch, template, np.zeros(window, np.float32), scores, deviations)


@compiled
def load(
    image: F32, top: int, left: int, rows: int, columns: int, mean: float, pitch: int, out: F32
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


@compiled
def correlate(task: ThreadTask, i: int, j: int, top: int, left: int, rows: int) -> F64:
    """Zero-mean normalised cross-correlations of box (i, j) with `rows` x 5 places of the image,
    the first of them at (top, left); OUTSIDE or FLAT where there is none.

    The result, shape (rows, 5), is a view of the working memory.
    """
    boxes, target, memory = task
    box, scores, deviations = boxes.box, memory.scores[:rows], memory.deviations[:rows]
    sums, template, window, pitch = target.sums, memory.template, memory.window, memory.pitch
    image_rows, image_columns = target.image.shape
    for k in range(rows):
        y = top + k
        for m in range(WIDTH):
            x = left + m
            is_inside = y >= 0 and x >= 0 and y + box <= image_rows and x + box <= image_columns
            deviations[k, m] = box_moments(sums, y, x, box)[1] if is_inside else -1.0
    least = boxes.least_deviations
    if deviations.max() > least:  # nothing is multiplied where nothing is seen
        size, mean = (rows + box - 1, box + WIDTH - 1), boxes.mean[i, j]
        load(target.image, top, left, *size, mean, pitch, window)
        for k in range(rows):
            five_products(template, window, k * pitch, scores[k])
    normalise(scores.reshape(-1), deviations.reshape(-1), boxes.deviations[i, j], least)
    return scores


@compiled
def highest(scores: F64) -> tuple[int, int]:
    """Row and column of the greatest value, the first one of equals."""
    best_i, best_j = 0, 0
    for i in range(scores.shape[0]):
        for j in range(scores.shape[1]):
            if scores[i, j] > scores[best_i, best_j]:
                best_i, best_j = i, j
    return best_i, best_j


@compiled
def gaussian_peak(c: F64) -> tuple[float, float, bool]:
    """Offset (x, y) from the middle of nine correlations, shape (3, 3), to the top of their 2D
    Gaussian, and whether there is one.

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


@compiled
def scan(task: ThreadTask, i: int, j: int, x: int, y: int, radius: int) -> tuple[int, int]:
    """The displacement (x, y) of highest correlation among all those within `radius` of the given
    one.
    """
    best, best_x, best_y = OUTSIDE, x, y
    top, left, rows = task.boxes.top[i] + y - radius, task.boxes.left[j], 2 * radius + 1
    for first in range(x - radius, x + radius + 1, WIDTH):
        scores = correlate(task, i, j, top, left + first, rows)
        k, m = highest(scores)
        if scores[k, m] > best:
            best, best_x, best_y = scores[k, m], first + m, y - radius + k
    return best_x, best_y


@compiled
def climb(
    task: ThreadTask, i: int, j: int, x: int, y: int, furthest: int
) -> tuple[tuple[float, float, float], int]:
    """Displacement (x, y) and correlation of the peak reached uphill from the displacement (x, y),
    and the status of the point.
    """
    start_x, start_y = x, y
    while abs(x - start_x) <= furthest and abs(y - start_y) <= furthest:
        top, left = task.boxes.top[i] + y - REACH, task.boxes.left[j] + x - REACH
        scores = correlate(task, i, j, top, left, WIDTH)
        k, m = highest(scores)
        if scores[k, m] == OUTSIDE:
            return NOWHERE, OUT_OF_IMAGE
        if scores[k, m] == FLAT:
            return NOWHERE, LOW_CONTRAST
        x += m - REACH
        y += k - REACH
        if 0 < k < WIDTH - 1 and 0 < m < WIDTH - 1:
            nine = scores[k - 1 : k + 2, m - 1 : m + 2]
            for n in range(9):
                if nine[n // 3, n % 3] == OUTSIDE:
                    return NOWHERE, OUT_OF_IMAGE
            dx, dy, is_peak = gaussian_peak(nine)
            return (x + dx, y + dy, scores[k, m]), OK if is_peak else NOT_CONVERGED
    return NOWHERE, NOT_CONVERGED


@compiled
def match_rows(
    boxes: Templates,
    target: SearchImage,
    start: I32,
    radius: I32,
    furthest: int,
    least_correlation: float,
    rows: Rows,
    field: F32,
    status: U8,
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
    widest = np.int64(0)
    for i in range(rows[0], rows[1]):
        for j in range(boxes.left.size):
            widest = max(widest, radius[i, j])
    memory = workspace(boxes.box, widest)
    task, box, pitch = ThreadTask(boxes, target, memory), boxes.box, memory.pitch
    for i in range(rows[0], rows[1]):
        for j in range(boxes.left.size):
            if radius[i, j] < 0:
                continue
            found, state, mean = NOWHERE, LOW_CONTRAST, boxes.mean[i, j]
            if boxes.deviations[i, j] > boxes.least_deviations:
                top, left = boxes.top[i], boxes.left[j]
                load(boxes.image, top, left, box, box, mean, pitch, memory.template)
                x, y = start[0, i, j], start[1, i, j]
                if radius[i, j] > 0:
                    x, y = scan(task, i, j, x, y, radius[i, j])
                found, state = climb(task, i, j, x, y, furthest)
                if state == OK and found[2] < least_correlation:
                    state = DECORRELATED
            status[i, j] = state
            for k in range(3):
                field[k, i, j] = found[k] if state == OK else math.nan
