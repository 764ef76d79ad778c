"""Sums over correlation boxes of an image that is deformed back by a predicted displacement field,
once for all boxes.

The prediction is a bicubic B-spline through control points on the grid of the boxes. The image is
read where the prediction says each pixel of the reference has gone to: in x exactly, in y exactly
for the middle row of a strip of at most ROWS rows, and to first order in the distance from that row
for the others. Interpolation costs the same whatever the overlap of the boxes, because a pixel is
read once; so do the products with the reference, because they are added up in cells, the pieces
that the edges of all boxes cut the image into, and a box is a block of cells.

Working arrays have one dimension and rows of a fixed length: the compiler knows every distance and
vectorises.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
Rows = tuple[int, int]  # the first, and one past the last
TAPS = 8  # of the interpolation along each axis; fewer are filled up with zeros
COEFFICIENTS = 8  # of the polynomials for their weights
BLOCK = 128  # columns worked on at a time: what they need stays in the fastest memory
MARGIN = 6  # further columns of the prediction on both sides of a block
PITCH = BLOCK + 2 * MARGIN + 4
ROWS = 16  # rows of a strip at most; even
# of the reference: grey level, gradient along x, gradient along y; a pixel with the lowest possible
# grey level is not usable
PLANES = 3
# of the prediction: displacement along x and y, their change per row, gain, offset and widest
# difference of grey levels
FIELDS = 7
# Sums of image x (usable, grey level, gradients), of image^2, of pixels not believed, of the
# others' differences from expectation.
SUMS = 7
HIGHEST_STEP = 1.5  # px; one linear step is trusted no further

U = np.uint64  # unsigned indices need no check for negative ones
P1, P2, P3, P4, P5, P6, P7, P8 = (U(k * PITCH) for k in range(1, 9))
U1, U2, U3, U4, U5, U6, U7 = (U(k) for k in range(1, 8))
B1, B2, B3, B4, B5 = (U(k * BLOCK) for k in range(1, 6))


class Layout(NamedTuple):
    """Boxes, cells and strips, in pixels of the reference."""

    left: I64  # (nx,) first column of the boxes
    top: I64  # (ny,)
    box: int
    column_edges: I64  # (nc + 1,) the cells' edges along x
    row_edges: I64  # (nr + 1,)
    first_column: I64  # (nx,) first cell of each box along x, and one past the last
    last_column: I64
    first_row: I64  # (ny,)
    last_row: I64
    # (nr + 1,) the strips of cell row r are strip_cell[r] ... strip_cell[r + 1] - 1
    strip_cell: I64
    strip_top: I64  # (ns,) first row of each strip
    strip_rows: I64  # (ns,)


class Reference(NamedTuple):
    """The reference, cut into strips and blocks, and what its boxes need to solve for a
    displacement.
    """

    planes: NDArray[Any]  # (ns, blocks, rows * PLANES * BLOCK), int8 or int16, in units of
    units: F32  # (PLANES,)
    unusable: float  # the grey level of pixels that are not usable; their gradients are 0
    weights_x: F32  # (TAPS, COEFFICIENTS) interpolation along x
    weights_y: F32
    beyond: float  # how far outside 0 to 1 the fraction of a pixel may lie
    # (ny, nx, 13) inverse of the normal matrix of (usable, grey level, gradient x, gradient y),
    # upper triangle;
    inverse: F64
    # usable pixels; standard uncertainty of the displacement x, y for residuals of standard
    # deviation 1
    rounding: float  # variance of the rounding of both images, which no residual is below
    level: float  # subtracted from every grey level
    scale: float  # ... and then multiplied by


class Splines(NamedTuple):
    """How the prediction is read from its control points."""

    # (4 * step,) the cubic B-spline of a control point, from the first column it reaches
    basis: F32
    begin: int  # first column reached by the first control point, from `left[0]`
    row: I64  # (ns,) the first of the four control rows for the middle row of every strip
    # (2, 4, ns) their weights for the value, and for its derivative along y, per px
    row_weights: F32


class Guess(NamedTuple):
    """What is known before a pass."""

    # (5, ny + ..., nx + ...) control points of displacement x, y (px), gain, offset, widest
    # difference
    control: F32
    # (3, ny, nx) expected gain and offset, and widest believable difference, in the middle of every
    # box
    grey: F32
    before: F64  # (2, ny, nx) the displacement from which the prediction was made
    centre: F64  # (2, ny, nx) the prediction in the middle of every box


class Limits(NamedTuple):
    """When a pass is believed and when it is the last."""

    alike: float  # correlation above which a point resembles the reference
    # share of a box's pixels that may be unbelievable before the expectation is wrong
    most_odd: float
    believable: float  # mean differences within which a grey level is believed ...
    least_believable: float  # ... given this much more, of the contrast
    unlimited: float  # the widest difference of a point of which nothing is expected
    tolerance: float  # px; a larger change asks for another pass, unless noise explains it


class Result(NamedTuple):
    """What a pass finds, (ny, nx) each; where the normal equations have no solution the prediction,
    and NaN.
    """

    u: F64  # (2, ny, nx) displacement, px
    step: F64  # distance from the prediction, px
    zncc: F64
    # (2, ny, nx) standard uncertainty of u, px, for residuals independent from pixel to pixel
    std: F64
    odd: F64  # share of the pixels that were not believed
    expected: F32  # (3, ny, nx) gain, offset and widest believable difference for the next pass
    wrong: I64  # (ny,) points in each row where the pass found another light than expected
    restless: I64  # (ny,) points in each row that resemble the reference but have changed much


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract", "nsz"})
def tap_weights(fraction: F32, polynomials: F32, out: F32, n: int) -> None:
    """Interpolation weights, TAPS rows of `out`, for n fractions of a pixel."""
    for k in range(TAPS):
        row = out[k * PITCH : (k + 1) * PITCH]
        a0, a1, a2, a3 = polynomials[k, 0], polynomials[k, 1], polynomials[k, 2], polynomials[k, 3]
        a4, a5, a6, a7 = polynomials[k, 4], polynomials[k, 5], polynomials[k, 6], polynomials[k, 7]
        for j in range(U(n)):
            t = fraction[j]
            row[j] = a0 + t * (a1 + t * (a2 + t * (a3 + t * (a4 + t * (a5 + t * (a6 + t * a7))))))


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract", "nsz"})
def interpolate_two_rows(image: F32, w: F32, out: F32, n: int) -> None:
    """Two rows of the image between its rows: nine rows of `image` to two of `out`."""
    for j in range(U(n)):
        w0, w1, w2, w3, w4, w5, w6, w7 = (
            w[j],
            w[j + P1],
            w[j + P2],
            w[j + P3],
            w[j + P4],
            w[j + P5],
            w[j + P6],
            w[j + P7],
        )
        r1, r2, r3, r4 = image[j + P1], image[j + P2], image[j + P3], image[j + P4]
        r5, r6, r7 = image[j + P5], image[j + P6], image[j + P7]
        out[j] = w0 * image[j] + w1 * r1 + w2 * r2 + w3 * r3 + w4 * r4 + w5 * r5 + w6 * r6 + w7 * r7
        out[j + P1] = (
            w0 * r1 + w1 * r2 + w2 * r3 + w3 * r4 + w4 * r5 + w5 * r6 + w6 * r7 + w7 * image[j + P8]
        )


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract", "nsz"})
def add_two_rows(
    v: F32,
    w: F32,
    planes: NDArray[Any],
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
    z = y + np.float32(1.0)
    for j in range(U(n)):
        w0, w1, w2, w3, w4, w5, w6, w7 = (
            w[j],
            w[j + P1],
            w[j + P2],
            w[j + P3],
            w[j + P4],
            w[j + P5],
            w[j + P6],
            w[j + P7],
        )
        g = (
            w0 * v[j]
            + w1 * v[j + U1]
            + w2 * v[j + U2]
            + w3 * v[j + U3]
            + w4 * v[j + U4]
            + w5 * v[j + U5]
            + w6 * v[j + U6]
            + w7 * v[j + U7]
        )
        k = j + P1
        h = (
            w0 * v[k]
            + w1 * v[k + U1]
            + w2 * v[k + U2]
            + w3 * v[k + U3]
            + w4 * v[k + U4]
            + w5 * v[k + U5]
            + w6 * v[k + U6]
            + w7 * v[k + U7]
        )
        f_g, x_g, y_g = (
            np.float32(planes[j]),
            np.float32(planes[j + B1]),
            np.float32(planes[j + B2]),
        )
        f_h, x_h, y_h = (
            np.float32(planes[j + B3]),
            np.float32(planes[j + B4]),
            np.float32(planes[j + B5]),
        )
        slope_x, slope_y, gain, offset, most = (
            columns[j],
            columns[j + P1],
            columns[j + P2],
            columns[j + P3],
            columns[j + P4],
        )
        g += y * (slope_x * x_g + slope_y * y_g)
        h += z * (slope_x * x_h + slope_y * y_h)
        expected_g, expected_h = gain * f_g + offset, gain * f_h + offset
        away_g, away_h = g - expected_g, h - expected_h
        apart_g, apart_h = abs(away_g), abs(away_h)
        odd_g = np.float32(1.0) if apart_g > most else np.float32(0.0)
        odd_h = np.float32(1.0) if apart_h > most else np.float32(0.0)
        apart_g, apart_h = (
            min(apart_g, max(most + most - apart_g, np.float32(0.0))),
            min(apart_h, max(most + most - apart_h, np.float32(0.0))),
        )
        g, h = (
            expected_g + math.copysign(apart_g, away_g),
            expected_h + math.copysign(apart_h, away_h),
        )
        if f_g == unusable:
            g = apart_g = odd_g = np.float32(0.0)
        if f_h == unusable:
            h = apart_h = odd_h = np.float32(0.0)
        sums[j] += g + h
        sums[j + P1] += f_g * g + f_h * h
        sums[j + P2] += x_g * g + x_h * h
        sums[j + P3] += y_g * g + y_h * h
        sums[j + P4] += g * g + h * h
        sums[j + P5] += odd_g + odd_h
        sums[j + P6] += apart_g + apart_h


@njit(cache=True, nogil=True)
def load_rows(
    image: NDArray[Any],
    top: int,
    left: int,
    rows: int,
    n: int,
    level: np.float32,
    scale: np.float32,
    out: F32,
) -> None:
    """Copy a rectangle of the image as scaled floats; outside the image its nearest pixel stands."""
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


@njit(cache=True, nogil=True)
def predict_row(splines: Splines, guess: Guess, units: F32, strip: int, out: F32) -> None:
    """Control points, shape (n, FIELDS), of the prediction along the middle row of a strip."""
    first = splines.row[strip]
    value, slope = splines.row_weights[0, :, strip], splines.row_weights[1, :, strip]
    for k in range(guess.control.shape[0]):
        p0, p1, p2, p3 = (
            guess.control[k, first],
            guess.control[k, first + 1],
            guess.control[k, first + 2],
            guess.control[k, first + 3],
        )
        for j in range(out.shape[0]):
            out[j, k if k < 2 else k + 2] = (
                value[0] * p0[j] + value[1] * p1[j] + value[2] * p2[j] + value[3] * p3[j]
            )
            if k < 2:
                out[j, k + 2] = (
                    slope[0] * p0[j] + slope[1] * p1[j] + slope[2] * p2[j] + slope[3] * p3[j]
                )
    for j in range(out.shape[0]):  # the image's gradient is the reference's, times the gain
        out[j, 2] *= out[j, 4] * units[1]
        out[j, 3] *= out[j, 4] * units[2]
        out[j, 4] *= units[0]


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract", "nsz"})
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


@njit(cache=True, nogil=True)
def predict_block(control: F32, splines: Splines, step: int, first: int, fields: F32) -> None:
    """The prediction for the columns of a block and MARGIN more on both sides, FIELDS rows of
    `fields`.
    """
    fields[:] = 0.0
    low, high = first - MARGIN, first + BLOCK + MARGIN
    for k in range(max(0, (low - splines.begin) // step - 3), control.shape[0]):
        begin = splines.begin + k * step
        a, b = max(begin, low), min(begin + 4 * step, high)
        if a >= high:
            break
        if a < b:
            add_spline(control[k], splines.basis[a - begin :], fields[a - low :], b - a)


@njit(cache=True, nogil=True, fastmath={"reassoc", "contract", "nsz"})
def source_fractions(dx: F32, dy: F32, nx: int, ny: int, beyond: np.float32, out: F32) -> None:
    """Fractions of the displacement along y where the columns of the image come from; dy begins and
    ends one column further out.
    """
    x, y = np.float32(nx), np.float32(ny)
    for j in range(out.size):
        there = dy[j + 1] - np.float32(0.5) * (dx[j] - x) * (dy[j + 2] - dy[j]) - y
        out[j] = min(max(there, -beyond), np.float32(1.0) + beyond)


@njit(cache=True, nogil=True)
def run_end(dx: F32, dy: F32, begin: int, last: int, nx: int, ny: int, beyond: np.float32) -> int:
    """One past the last of the columns from `begin` on that lie within reach of the whole-pixel
    displacement (nx, ny).
    """
    low, high = -beyond, np.float32(1.0) + beyond
    end = begin
    while end < last and low <= dx[end] - nx <= high and low <= dy[end] - ny <= high:
        end += 1
    return end


@njit(cache=True, nogil=True)
def sum_cells(
    image: NDArray[Any],
    layout: Layout,
    reference: Reference,
    splines: Splines,
    guess: Guess,
    rows: tuple[int, int],
    cells: F64,
) -> None:
    """Sums over each cell, `cells` of shape (SUMS, nr, nc), for some rows of cells."""
    level, scale, blocks, step = (
        np.float32(reference.level),
        np.float32(reference.scale),
        reference.planes.shape[1],
        splines.basis.size // 4,
    )
    lines, v = np.zeros((ROWS + TAPS + 1) * PITCH, np.float32), np.zeros(ROWS * PITCH, np.float32)
    across, down = np.zeros(TAPS * PITCH, np.float32), np.zeros(TAPS * PITCH, np.float32)
    unusable, beyond = np.float32(reference.unusable), np.float32(reference.beyond)
    fields, sums = (
        np.zeros(FIELDS * PITCH, np.float32),
        np.zeros((blocks, SUMS * PITCH), np.float32),
    )
    dx, dy, fraction = (
        fields[MARGIN:PITCH],
        fields[PITCH + MARGIN : 2 * PITCH],
        np.zeros(PITCH, np.float32),
    )
    control = np.zeros((guess.control.shape[2], FIELDS), np.float32)
    for row in range(rows[0], rows[1]):
        sums[:] = 0.0
        for strip in range(layout.strip_cell[row], layout.strip_cell[row + 1]):
            predict_row(splines, guess, reference.units, strip, control)
            pairs, middle = (
                (layout.strip_rows[strip] + 1) // 2,
                np.float32((layout.strip_rows[strip] - 1) / 2),
            )
            for block in range(blocks):
                predict_block(control, splines, step, block * BLOCK, fields)
                begin, width = (
                    0,
                    min(BLOCK, layout.column_edges[-1] - layout.left[0] - block * BLOCK),
                )
                while begin < width:  # as many columns as have the same whole-pixel displacement
                    nx, ny = math.floor(dx[begin]), math.floor(dy[begin])
                    end = run_end(dx, dy, begin, width, nx, ny, beyond)
                    if end == begin:  # not a number
                        break
                    n, m = end - begin, end - begin + TAPS - 1
                    source = MARGIN + begin - TAPS // 2 + 1
                    source_fractions(
                        fields[source:], fields[PITCH + source - 1 :], nx, ny, beyond, fraction[:m]
                    )
                    tap_weights(fraction, reference.weights_y, down, m)
                    for j in range(n):
                        fraction[j] = dx[begin + j] - nx
                    tap_weights(fraction, reference.weights_x, across, n)
                    left, top = (
                        layout.left[0] + block * BLOCK + begin + nx - TAPS // 2 + 1,
                        layout.strip_top[strip] + ny - TAPS // 2 + 1,
                    )
                    load_rows(image, top, left, 2 * pairs + TAPS - 1, m, level, scale, lines)
                    for pair in range(pairs):
                        interpolate_two_rows(
                            lines[2 * pair * PITCH :], down, v[2 * pair * PITCH :], m
                        )
                    for pair in range(pairs):
                        planes = reference.planes[strip, block, 2 * pair * PLANES * BLOCK + begin :]
                        y = np.float32(2 * pair) - middle
                        add_two_rows(
                            v[2 * pair * PITCH :],
                            across,
                            planes,
                            fields[2 * PITCH + MARGIN + begin :],
                            y,
                            unusable,
                            sums[block, begin:],
                            n,
                        )
                    begin = end
        add_columns(sums, layout, reference.units, row, cells)


@njit(cache=True, nogil=True)
def add_columns(sums: F32, layout: Layout, units: F32, row: int, cells: F64) -> None:
    """Add up the columns of each cell of one row."""
    for cell in range(layout.column_edges.size - 1):
        x, last = (
            layout.column_edges[cell] - layout.left[0],
            layout.column_edges[cell + 1] - layout.left[0],
        )
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
        cells[0, row, cell], cells[1, row, cell], cells[2, row, cell] = (
            t0,
            t1 * units[0],
            t2 * units[1],
        )
        cells[3, row, cell], cells[4, row, cell], cells[5, row, cell], cells[6, row, cell] = (
            t3 * units[2],
            t4,
            t5,
            t6,
        )


@njit(cache=True, nogil=True)
def add_boxes(cells: F64, layout: Layout, row: int, running: F64, out: F64) -> None:
    """Sums over the boxes of one row of the grid, shape (SUMS, nx); `running`, shape (nc + 1,), is
    working memory.
    """
    first, last = layout.first_row[row], layout.last_row[row]
    for k in range(SUMS):
        running[0] = 0.0
        for cell in range(running.size - 1):
            total = 0.0
            for r in range(first, last):
                total += cells[k, r, cell]
            running[cell + 1] = running[cell] + total
        for j in range(layout.left.size):
            out[k, j] = running[layout.last_column[j]] - running[layout.first_column[j]]


@njit(cache=True, nogil=True, error_model="numpy")
def solve_boxes(
    cells: F64,
    layout: Layout,
    reference: Reference,
    guess: Guess,
    limits: Limits,
    shape: tuple[int, int],
    rows: Rows,
    result: Result,
) -> None:
    """Displacement, correlation and uncertainty of the boxes in some rows of the grid, from the
    sums over the cells.

    Least squares for the image in a box: ``image = offset + gain * (reference - d . gradient)``, d
    being what is left of the displacement after the prediction.
    """
    sums, running = np.zeros((SUMS, layout.left.size)), np.zeros(cells.shape[2] + 1)
    for i in range(rows[0], rows[1]):
        add_boxes(cells, layout, i, running, sums)
        result.wrong[i] = result.restless[i] = 0
        for j in range(layout.left.size):
            s0, s1, s2, s3, squares = sums[0, j], sums[1, j], sums[2, j], sums[3, j], sums[4, j]
            q = reference.inverse[i, j]
            offset = q[0] * s0 + q[1] * s1 + q[2] * s2 + q[3] * s3
            gain = q[1] * s0 + q[4] * s1 + q[5] * s2 + q[6] * s3
            px = q[2] * s0 + q[5] * s1 + q[7] * s2 + q[8] * s3
            py = q[3] * s0 + q[6] * s1 + q[8] * s2 + q[9] * s3
            per_gain, per_pixel = 1.0 / gain, 1.0 / q[10]
            dx, dy = -px * per_gain, -py * per_gain
            step = math.sqrt(dx * dx + dy * dy)
            if not step < math.inf:
                dx = dy = 0.0
            elif step > HIGHEST_STEP:
                dx, dy = dx * HIGHEST_STEP / step, dy * HIGHEST_STEP / step
            residual = max(0.0, squares - offset * s0 - gain * s1 - px * s2 - py * s3)
            sigma = math.sqrt(max(residual / (q[10] - 4.0), reference.rounding))
            deviations = squares - s0 * s0 * per_pixel
            is_flat = deviations <= q[10] * (reference.rounding + 1e-6)
            zncc = (
                0.0
                if is_flat
                else math.copysign(math.sqrt(max(0.0, 1.0 - residual / deviations)), gain)
            )
            x, y = guess.centre[0, i, j] + dx, guess.centre[1, i, j] + dy
            std_x, std_y, odd = (
                sigma * abs(per_gain) * q[11],
                sigma * abs(per_gain) * q[12],
                sums[5, j] * per_pixel,
            )
            result.u[0, i, j], result.u[1, i, j], result.step[i, j], result.zncc[i, j] = (
                x,
                y,
                step,
                zncc,
            )
            result.std[0, i, j], result.std[1, i, j], result.odd[i, j] = std_x, std_y, odd
            is_alike = zncc > limits.alike
            is_wrong = odd > limits.most_odd or (
                guess.grey[2, i, j] < limits.unlimited and not is_alike
            )
            result.wrong[i] += is_wrong
            if is_alike and not is_wrong:
                most = limits.believable * sums[6, j] * per_pixel + limits.least_believable * abs(
                    gain
                )
                result.expected[0, i, j], result.expected[1, i, j], result.expected[2, i, j] = (
                    gain,
                    offset,
                    most,
                )
            else:
                result.expected[0, i, j], result.expected[1, i, j], result.expected[2, i, j] = (
                    1.0,
                    0.0,
                    limits.unlimited,
                )
            left, top = layout.left[j] + x, layout.top[i] + y
            is_inside = (
                left >= 0
                and top >= 0
                and left + layout.box <= shape[1]
                and top + layout.box <= shape[0]
            )
            change = max(abs(x - guess.before[0, i, j]), abs(y - guess.before[1, i, j]))
            result.restless[i] += (
                is_alike and is_inside and change > max(limits.tolerance, 5.0 * max(std_x, std_y))
            )
