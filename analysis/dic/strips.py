"""Products of the reference with an image that is deformed back by a predicted displacement field,
summed over cells.

The prediction is a bicubic B-spline through control points on the grid of the boxes. The image is
read where the prediction says each pixel of the reference has gone to: in x exactly, in y exactly
for the middle row of a strip of at most ROWS rows, and to first order in the distance from that row
for the others. Interpolation costs the same whatever the overlap of the boxes, because a pixel is
read once; so do the products with the reference, because they are added up in cells, the pieces
that the edges of all boxes cut the image into.

Working arrays have one dimension and rows of a fixed length, so that the compiler knows every
distance and vectorises.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit

from analysis.arrays import F32, F64, Array, Bool
from analysis.dic.interpolants import FAST, TAPS, tap_weights
from analysis.dic.shared import SUMS, Guess, Layout, Prepared, Splines
from analysis.dic.threads import Rows
from analysis.kernels import compiled

BLOCK = 128  # columns worked on at a time: what they need stays in the fastest memory
PREDICTION_MARGIN = 6  # further columns of the prediction on both sides of a block
PITCH = BLOCK + 2 * PREDICTION_MARGIN + 4
ROWS = 16  # rows of a strip at most; even
# of the reference: grey level, gradient along x, gradient along y; a pixel with the lowest possible
# grey level is not usable
PLANES = 3
# of the prediction: displacement along x and y, their change per row, gain, offset and widest
# difference of grey levels
FIELDS = 7

U = np.uint64  # unsigned indices need no check for negative ones
P1, P2, P3, P4, P5, P6, P7, P8, P9, P10 = (U(k * PITCH) for k in range(1, 11))
U1, U2, U3, U4, U5, U6, U7 = (U(k) for k in range(1, 8))
B1, B2, B3, B4, B5 = (U(k * BLOCK) for k in range(1, 6))
# The compiler orders long sums by the order in which their terms are loaded: with other statements
# the kernels round otherwise, and an old session would no longer replay to the bit.
ZERO, ONE, HALF = np.float32(0.0), np.float32(1.0), np.float32(0.5)
MOMENT_SUMS, COLUMN_SUMS = 17, 11  # over cells and columns, see `add_two_rows_of_moments`


class Middles(NamedTuple):
    """From where moments are counted: the middles of the cells, in units of half a box."""

    x: F64  # (nc,) of the cells, from the first column of the first box
    y: F64  # (nr,) from the first row of the image
    half: float  # of a box, px


@njit(inline="always")
def _eight_rows(a: F32, j: np.uint64) -> tuple[np.float32, ...]:
    """The eight values of a column."""
    return a[j], a[j + P1], a[j + P2], a[j + P3], a[j + P4], a[j + P5], a[j + P6], a[j + P7]


@njit(inline="always")
def _between_columns(v: F32, k: np.uint64, w: tuple[np.float32, ...]) -> Any:
    """The grey level read from eight pixels in a row with their weights."""
    w0, w1, w2, w3, w4, w5, w6, w7 = w
    g = w0 * v[k] + w1 * v[k + U1] + w2 * v[k + U2] + w3 * v[k + U3]
    g = g + w4 * v[k + U4] + w5 * v[k + U5] + w6 * v[k + U6] + w7 * v[k + U7]
    return g


@njit(inline="always")
def _two_pixels(
    v: F32,
    w: F32,
    planes: Array,
    columns: F32,
    y: np.float32,
    z: np.float32,
    unusable: np.float32,
    j: np.uint64,
) -> tuple[np.float32, ...]:
    """Of column j in two rows: reference, its gradients and the grey level read, as far as it is
    believed, of both; pixels not believed, and the others' differences from expectation.
    """
    weights = _eight_rows(w, j)
    g, h = _between_columns(v, j, weights), _between_columns(v, j + P1, weights)
    f_g, f_h = np.float32(planes[j]), np.float32(planes[j + B3])
    x_g, x_h = np.float32(planes[j + B1]), np.float32(planes[j + B4])
    y_g, y_h = np.float32(planes[j + B2]), np.float32(planes[j + B5])
    slope_x, slope_y, gain = columns[j], columns[j + P1], columns[j + P2]
    offset, most = columns[j + P3], columns[j + P4]
    g += y * (slope_x * x_g + slope_y * y_g)
    h += z * (slope_x * x_h + slope_y * y_h)
    expected_g, expected_h = gain * f_g + offset, gain * f_h + offset
    away_g, away_h = g - expected_g, h - expected_h
    apart_g, apart_h = abs(away_g), abs(away_h)
    odd_g, odd_h = ONE if apart_g > most else ZERO, ONE if apart_h > most else ZERO
    apart_g = min(apart_g, max(most + most - apart_g, ZERO))
    apart_h = min(apart_h, max(most + most - apart_h, ZERO))
    g = expected_g + math.copysign(apart_g, away_g)
    h = expected_h + math.copysign(apart_h, away_h)
    if f_g == unusable:
        g = apart_g = odd_g = ZERO
    if f_h == unusable:
        h = apart_h = odd_h = ZERO
    return f_g, f_h, x_g, x_h, y_g, y_h, g, h, odd_g + odd_h, apart_g + apart_h


@compiled(fastmath=FAST)
def interpolate_two_rows(image: F32, w: F32, out: F32, n: int) -> None:
    """Two rows of the image between its rows: nine rows of `image` to two of `out`."""
    for j in range(U(n)):
        w0, w1, w2, w3, w4, w5, w6, w7 = _eight_rows(w, j)
        r1, r2, r3, r4 = image[j + P1], image[j + P2], image[j + P3], image[j + P4]
        r5, r6, r7 = image[j + P5], image[j + P6], image[j + P7]
        out[j] = w0 * image[j] + w1 * r1 + w2 * r2 + w3 * r3 + w4 * r4 + w5 * r5 + w6 * r6 + w7 * r7
        first_seven = w0 * r1 + w1 * r2 + w2 * r3 + w3 * r4 + w4 * r5 + w5 * r6 + w6 * r7
        out[j + P1] = first_seven + w7 * image[j + P8]


@compiled(fastmath=FAST)
def add_two_rows(
    v: F32,
    w: F32,
    planes: Array,
    columns: F32,
    y: np.float32,
    unusable: np.float32,
    sums: F32,
    n: int,
) -> None:
    """Read two rows between their columns and add their products with the reference to `sums`,
    column by column.

    `columns` holds, for each column, the change of the displacement per row (x, y; times the gain),
    the expected gain and offset of the grey levels and the largest believable difference from them:
    a larger one counts less and less, and one twice as large not at all (Hampel et al. 1986). y is
    the first row's distance from the middle.
    """
    z = y + ONE
    for j in range(U(n)):
        pixels = _two_pixels(v, w, planes, columns, y, z, unusable, j)
        f_g, f_h, x_g, x_h, y_g, y_h, g, h, odd, apart = pixels
        sums[j] += g + h
        sums[j + P1] += f_g * g + f_h * h
        sums[j + P2] += x_g * g + x_h * h
        sums[j + P3] += y_g * g + y_h * h
        sums[j + P4] += g * g + h * h
        sums[j + P5] += odd
        sums[j + P6] += apart


@compiled(fastmath=FAST)
def add_two_rows_of_moments(
    v: F32,
    w: F32,
    planes: Array,
    columns: F32,
    y: np.float32,
    place: np.float32,
    per_px: np.float32,
    unusable: np.float32,
    sums: F32,
    n: int,
) -> None:
    """As `add_two_rows`, with the moments along y of the products with the gradients: `sums` are
    those of g, reference g, gradient x g (1, Y, Y^2), gradient y g (1, Y, Y^2), g^2, of pixels not
    believed, and of the others' differences.

    Y is `place` in the first row, and `per_px` more in the next one.
    """
    z, next_place = y + ONE, place + per_px
    for j in range(U(n)):
        pixels = _two_pixels(v, w, planes, columns, y, z, unusable, j)
        f_g, f_h, x_g, x_h, y_g, y_h, g, h, odd, apart = pixels
        x_g, x_h, y_g, y_h = x_g * g, x_h * h, y_g * g, y_h * h
        sums[j] += g + h
        sums[j + P1] += f_g * g + f_h * h
        sums[j + P2] += x_g + x_h
        sums[j + P5] += y_g + y_h
        x_g, x_h, y_g, y_h = place * x_g, next_place * x_h, place * y_g, next_place * y_h
        sums[j + P3] += x_g + x_h
        sums[j + P6] += y_g + y_h
        sums[j + P4] += place * x_g + next_place * x_h
        sums[j + P7] += place * y_g + next_place * y_h
        sums[j + P8] += g * g + h * h
        sums[j + P9] += odd
        sums[j + P10] += apart


@compiled
def load_rows(
    image: Array, prepared: Prepared, top: int, left: int, rows: int, n: int, out: F32
) -> None:
    """Copy a rectangle of the image as scaled floats; outside, its nearest pixel is repeated."""
    level, scale = np.float32(prepared.level), np.float32(prepared.scale)
    height, width = image.shape
    for r in range(rows):
        row = image[min(max(top + r, 0), height - 1)]
        to = out[r * PITCH : r * PITCH + n]
        if left >= 0 and left + n <= width:
            source = row[left : left + n]
            for j in range(n):
                to[j] = (np.float32(source[j]) - level) * scale
        else:
            for j in range(n):
                to[j] = (np.float32(row[min(max(left + j, 0), width - 1)]) - level) * scale


@compiled
def predict_row(splines: Splines, units: F32, control: F32, strip: int, out: F32) -> None:
    """Control points, shape (n, FIELDS), of the prediction along the middle row of a strip."""
    first = splines.row[strip]
    value, slope = splines.row_weights[0, :, strip], splines.row_weights[1, :, strip]
    for k in range(control.shape[0]):
        p0, p1 = control[k, first], control[k, first + 1]
        p2, p3 = control[k, first + 2], control[k, first + 3]
        for j in range(out.shape[0]):
            at = value[0] * p0[j] + value[1] * p1[j] + value[2] * p2[j] + value[3] * p3[j]
            out[j, k if k < 2 else k + 2] = at
            if k < 2:
                change = slope[0] * p0[j] + slope[1] * p1[j] + slope[2] * p2[j] + slope[3] * p3[j]
                out[j, k + 2] = change
    for j in range(out.shape[0]):  # the image's gradient is the reference's, times the gain
        out[j, 2] *= out[j, 4] * units[1]
        out[j, 3] *= out[j, 4] * units[2]
        out[j, 4] *= units[0]


@compiled(fastmath=FAST)
def add_spline(p: F32, basis: F32, fields: F32, n: int) -> None:
    """Add one control point's share to n columns of all fields."""
    p0, p1, p2, p3, p4, p5, p6 = p[0], p[1], p[2], p[3], p[4], p[5], p[6]
    for j in range(U(n)):
        w = basis[j]
        fields[j] += w * p0
        fields[j + P1] += w * p1
        fields[j + P2] += w * p2
        fields[j + P3] += w * p3
        fields[j + P4] += w * p4
        fields[j + P5] += w * p5
        fields[j + P6] += w * p6


@compiled
def predict_block(control: F32, splines: Splines, step: int, first: int, fields: F32) -> None:
    """The prediction for the columns of a block and PREDICTION_MARGIN more on both sides, FIELDS
    rows of `fields`.
    """
    fields[:] = 0.0
    low, high = first - PREDICTION_MARGIN, first + BLOCK + PREDICTION_MARGIN
    for k in range(max(0, (low - splines.begin) // step - 3), control.shape[0]):
        begin = splines.begin + k * step
        a, b = max(begin, low), min(begin + 4 * step, high)
        if a >= high:
            break
        if a < b:
            add_spline(control[k], splines.basis[a - begin :], fields[a - low :], b - a)


@compiled(fastmath=FAST)
def source_fractions(dx: F32, dy: F32, nx: int, ny: int, beyond: np.float32, out: F32) -> None:
    """Fractions of the displacement along y where the columns of the image come from; dy begins and
    ends one column further out.
    """
    x, y = np.float32(nx), np.float32(ny)
    for j in range(out.size):
        there = dy[j + 1] - HALF * (dx[j] - x) * (dy[j + 2] - dy[j]) - y
        out[j] = min(max(there, -beyond), ONE + beyond)


@compiled
def run_end(dx: F32, dy: F32, begin: int, last: int, nx: int, ny: int, beyond: np.float32) -> int:
    """One past the last of the columns from `begin` on that lie within reach of the whole-pixel
    displacement (nx, ny).
    """
    low, high = -beyond, ONE + beyond
    end = begin
    while end < last and low <= dx[end] - nx <= high and low <= dy[end] - ny <= high:
        end += 1
    return end


@compiled
def sum_cells(
    image: Array,
    prepared: Prepared,
    guess: Guess,
    needed: Bool,
    rows: Rows,
    cells: F64,
    middles: Middles | None,
) -> None:
    """Sums over each cell, `cells` of shape (SUMS, nr, nc), for some rows of cells; right where a
    cell lies in blocks that are `needed`, shape (nr, blocks). With `middles`, moments, `cells` of
    shape (MOMENT_SUMS, nr, nc).
    """
    layout, splines = prepared.boxes.layout, prepared.splines
    unusable, beyond = np.float32(prepared.unusable), np.float32(prepared.beyond)
    blocks, step = prepared.planes.shape[1], splines.basis.size // 4
    lines, v = np.zeros((ROWS + TAPS + 1) * PITCH, np.float32), np.zeros(ROWS * PITCH, np.float32)
    across, down = np.zeros(TAPS * PITCH, np.float32), np.zeros(TAPS * PITCH, np.float32)
    fields, fraction = np.zeros(FIELDS * PITCH, np.float32), np.zeros(PITCH, np.float32)
    dx, dy = fields[PREDICTION_MARGIN:PITCH], fields[PITCH + PREDICTION_MARGIN : 2 * PITCH]
    if middles is None:  # decided when this is compiled
        sums = np.zeros((blocks, SUMS * PITCH), np.float32)
    else:
        sums = np.zeros((blocks, COLUMN_SUMS * PITCH), np.float32)
        per_px = np.float32(1 / middles.half)
    control = np.zeros((guess.control.shape[2], FIELDS), np.float32)
    for row in range(rows[0], rows[1]):
        if not needed[row].any():
            continue
        sums[:] = 0.0
        for strip in range(layout.strip_cell[row], layout.strip_cell[row + 1]):
            predict_row(splines, prepared.units, guess.control, strip, control)
            pairs = (layout.strip_rows[strip] + 1) // 2
            middle = np.float32((layout.strip_rows[strip] - 1) / 2)
            for block in range(blocks):
                if not needed[row, block]:
                    continue
                at = layout.left[0] + block * BLOCK
                predict_block(control, splines, step, block * BLOCK, fields)
                begin, width = 0, min(BLOCK, layout.column_edges[-1] - at)
                while begin < width:  # as many columns as have the same whole-pixel displacement
                    nx, ny = math.floor(dx[begin]), math.floor(dy[begin])
                    end = run_end(dx, dy, begin, width, nx, ny, beyond)
                    if end == begin:  # not a number
                        break
                    n, m = end - begin, end - begin + TAPS - 1
                    source = PREDICTION_MARGIN + begin - TAPS // 2 + 1
                    there_x, there_y = fields[source:], fields[PITCH + source - 1 :]
                    source_fractions(there_x, there_y, nx, ny, beyond, fraction[:m])
                    tap_weights(fraction, prepared.weights_y, down, PITCH, m)
                    for j in range(n):
                        fraction[j] = dx[begin + j] - nx
                    tap_weights(fraction, prepared.weights_x, across, PITCH, n)
                    left = at + begin + nx - TAPS // 2 + 1
                    top = layout.strip_top[strip] + ny - TAPS // 2 + 1
                    load_rows(image, prepared, top, left, 2 * pairs + TAPS - 1, m, lines)
                    for pair in range(pairs):
                        first = 2 * pair * PITCH
                        interpolate_two_rows(lines[first:], down, v[first:], m)
                    for pair in range(pairs):
                        planes = prepared.planes[strip, block, 2 * pair * PLANES * BLOCK + begin :]
                        columns = fields[2 * PITCH + PREDICTION_MARGIN + begin :]
                        y, to = np.float32(2 * pair) - middle, sums[block, begin:]
                        two_rows = v[2 * pair * PITCH :]
                        if middles is None:
                            add_two_rows(two_rows, across, planes, columns, y, unusable, to, n)
                        else:
                            first_row = layout.strip_top[strip] + 2 * pair
                            place = np.float32(first_row / middles.half - middles.y[row])
                            more = columns, y, place, per_px, unusable, to, n
                            add_two_rows_of_moments(two_rows, across, planes, *more)
                    begin = end
        if middles is None:
            add_columns(sums, layout, prepared.units, row, cells)
        else:
            add_columns_of_moments(sums, layout, prepared.units, row, middles, cells)


@compiled
def add_columns(sums: F32, layout: Layout, units: F32, row: int, cells: F64) -> None:
    """Add up the columns of each cell of one row."""
    for cell in range(layout.column_edges.size - 1):
        x = layout.column_edges[cell] - layout.left[0]
        last = layout.column_edges[cell + 1] - layout.left[0]
        t0 = t1 = t2 = t3 = t4 = t5 = t6 = 0.0
        while x < last:
            block = x // BLOCK
            for k in range(x - block * BLOCK, min(last - block * BLOCK, BLOCK)):
                t0 += sums[block, k]
                t1 += sums[block, k + PITCH]
                t2 += sums[block, k + 2 * PITCH]
                t3 += sums[block, k + 3 * PITCH]
                t4 += sums[block, k + 4 * PITCH]
                t5 += sums[block, k + 5 * PITCH]
                t6 += sums[block, k + 6 * PITCH]
            x = (block + 1) * BLOCK
        totals = (t0, t1 * units[0], t2 * units[1], t3 * units[2], t4, t5, t6)
        for k in range(SUMS):
            cells[k, row, cell] = totals[k]


@compiled
def add_columns_of_moments(
    sums: F32, layout: Layout, units: F32, row: int, middles: Middles, cells: F64
) -> None:
    """As `add_columns`: sums of g, reference g, the moments (1, X, Y, X^2, X Y, Y^2) about the
    middle of the cell of gradient x g and of gradient y g, g^2, pixels not believed, differences.
    """
    for cell in range(layout.column_edges.size - 1):
        x = layout.column_edges[cell] - layout.left[0]
        last = layout.column_edges[cell + 1] - layout.left[0]
        cells[:, row, cell] = 0.0
        while x < last:
            block = x // BLOCK
            for k in range(x - block * BLOCK, min(last - block * BLOCK, BLOCK)):
                place = (block * BLOCK + k) / middles.half - middles.x[cell]
                cells[0, row, cell] += sums[block, k]
                cells[1, row, cell] += sums[block, k + PITCH] * units[0]
                for axis in range(2):
                    first, to = k + (2 + 3 * axis) * PITCH, 2 + 6 * axis
                    unit = units[1 + axis]
                    m0 = sums[block, first] * unit
                    m1 = sums[block, first + PITCH] * unit
                    m2 = sums[block, first + 2 * PITCH] * unit
                    cells[to, row, cell] += m0
                    cells[to + 1, row, cell] += place * m0
                    cells[to + 2, row, cell] += m1
                    cells[to + 3, row, cell] += place * place * m0
                    cells[to + 4, row, cell] += place * m1
                    cells[to + 5, row, cell] += m2
                for other in range(3):
                    cells[14 + other, row, cell] += sums[block, k + (8 + other) * PITCH]
            x = (block + 1) * BLOCK
