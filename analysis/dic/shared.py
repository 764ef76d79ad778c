"""Displacements of all boxes at once, from sums over the cells that their edges cut the image into.

The reference and the image deformed back by a predicted displacement field are multiplied and added
up once for each cell (`analysis.dic.strips`). A box is a block of cells, and the displacement that
is left follows from its sums by least squares.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from analysis.arrays import F32, F64, I64, Array, Bool
from analysis.dic.threads import Rows
from analysis.kernels import compiled

# Sums of image x (usable, grey level, gradients), of image^2, of pixels not believed, of the
# others' differences from expectation.
SUMS = 7
LONGEST_STEP = 1.5  # px; one linear step is trusted no further


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


class Splines(NamedTuple):
    """How the prediction is read from its control points."""

    # (4 * step,) the cubic B-spline of a control point, from the first column it reaches
    basis: F32
    begin: int  # first column reached by the first control point, from `left[0]`
    row: I64  # (ns,) the first of the four control rows for the middle row of every strip
    # (2, 4, ns) their weights for the value, and for its derivative along y, per px
    row_weights: F32


class GridBoxes(NamedTuple):
    """What boxes need to solve for a displacement, whatever the type of the grey levels."""

    layout: Layout
    # (ny, nx, 13) inverse of the normal matrix of (usable, grey level, gradient x, gradient y),
    # upper triangle; usable pixels; standard uncertainty of the displacement x, y for residuals of
    # standard deviation 1
    inverse: F64
    rounding: float  # variance of the rounding of both images, which no residual is below


class Prepared(NamedTuple):
    """The reference, cut into strips and blocks, and what its boxes need."""

    boxes: GridBoxes
    splines: Splines
    planes: Array  # (ns, blocks, rows * PLANES * BLOCK), int8 or int16, in units of
    units: F32  # (PLANES,)
    unusable: float  # the grey level of pixels that are not usable; their gradients are 0
    weights_x: F32  # (TAPS, COEFFICIENTS) interpolation along x
    weights_y: F32
    beyond: float  # how far outside 0 to 1 the fraction of a pixel may lie
    level: float  # subtracted from every grey level
    scale: float  # ... and then multiplied by


class Guess(NamedTuple):
    """What is expected before a pass."""

    # (5, ny + ..., nx + ...) control points of displacement x, y (px), gain, offset, widest
    # difference
    control: F32
    # (3, ny, nx) expected gain and offset, and widest believable difference, in the middle of every
    # box
    grey: F32
    before: F64  # (2, ny, nx) the displacement from which the prediction was made
    centre: F64  # (2, ny, nx) the prediction in the middle of every box


class Criteria(NamedTuple):
    """When a pass is believed and when it is the last."""

    alike: float  # correlation above which a point resembles the reference
    # share of a box's pixels that may be unbelievable before the expectation is wrong
    most_odd: float
    believable: float  # mean differences within which a grey level is believed ...
    least_believable: float  # ... given this much more, of the contrast
    unlimited: float  # the widest difference of a point of which nothing is expected
    tolerance: float  # px; a larger change calls for another pass, unless noise explains it


class PassResult(NamedTuple):
    """What a pass measures, (ny, nx) each; where the normal equations have no solution the
    prediction, and NaN.
    """

    u: F64  # (2, ny, nx) displacement, px
    step: F64  # distance from the prediction, px
    zncc: F64
    # (2, ny, nx) standard uncertainty of u, px, for residuals independent from pixel to pixel
    std: F64
    odd: F64  # share of the pixels that were not believed
    expected: F32  # (3, ny, nx) gain, offset and widest believable difference for the next pass
    wrong: Bool  # (ny, nx) whether the light was not the expected one
    restless: Bool  # (ny, nx) whether the point resembles the reference but has changed much

    def forget(self, u: F64) -> None:
        """Hold `u` and nothing else of all points, but what is expected of their light."""
        self.u[:], self.std[:], self.zncc[:] = u, np.nan, 0.0
        for values in (self.step, self.odd, self.wrong, self.restless):
            values[:] = 0

    @classmethod
    def empty(cls, ny: int, nx: int) -> PassResult:
        """Room for the result on a grid of ny x nx points."""
        u, std = np.empty((2, 2, ny, nx))
        step, zncc, odd = np.empty((3, ny, nx))
        expected = np.empty((3, ny, nx), np.float32)
        wrong, restless = np.zeros((2, ny, nx), np.bool_)
        return cls(u, step, zncc, std, odd, expected, wrong, restless)


# Of the least squares ``image = offset + gain reference + px gradient x + ...`` of a box: offset,
# gain, px, py, sum of squares of the residuals and of the deviations from the mean, usable pixels,
# standard uncertainty of x and y for residuals of standard deviation 1, pixels that were not
# believed, sum of the others' differences from expectation.
FITTED = 11


@compiled
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


@compiled(error_model="numpy")
def solve_boxes(
    cells: F64,
    boxes: GridBoxes,
    guess: Guess,
    criteria: Criteria,
    shape: tuple[int, int],
    wanted: Bool,
    rows: Rows,
    result: PassResult,
) -> None:
    """Displacement, correlation and uncertainty of the `wanted` boxes, shape (ny, nx), in some rows
    of the grid, from the sums over the cells, shape (SUMS, nr, nc); what the result holds of others
    stays.

    Least squares for the image in a box: ``image = offset + gain * (reference - d . gradient)``, d
    being what is left of the displacement after the prediction.
    """
    layout = boxes.layout
    sums, running = np.zeros((SUMS, layout.left.size)), np.zeros(cells.shape[2] + 1)
    fits = np.zeros((FITTED, layout.left.size))
    for i in range(rows[0], rows[1]):
        if not wanted[i].any():
            continue
        add_boxes(cells, layout, i, running, sums)
        for j in range(layout.left.size):
            if not wanted[i, j]:
                continue
            s0, s1, s2, s3, squares = sums[0, j], sums[1, j], sums[2, j], sums[3, j], sums[4, j]
            q = boxes.inverse[i, j]
            offset = q[0] * s0 + q[1] * s1 + q[2] * s2 + q[3] * s3
            gain = q[1] * s0 + q[4] * s1 + q[5] * s2 + q[6] * s3
            px = q[2] * s0 + q[5] * s1 + q[7] * s2 + q[8] * s3
            py = q[3] * s0 + q[6] * s1 + q[8] * s2 + q[9] * s3
            residual = max(0.0, squares - offset * s0 - gain * s1 - px * s2 - py * s3)
            fits[0, j], fits[1, j], fits[2, j], fits[3, j] = offset, gain, px, py
            fits[4, j], fits[5, j] = residual, squares - s0 * s0 * (1.0 / q[10])
            fits[6, j], fits[7, j], fits[8, j] = q[10], q[11], q[12]
            fits[9, j], fits[10, j] = sums[5, j], sums[6, j]
        write_row(boxes, guess, criteria, shape, wanted, i, fits, 4.0, result)


@compiled(error_model="numpy")
def write_row(
    boxes: GridBoxes,
    guess: Guess,
    criteria: Criteria,
    shape: tuple[int, int],
    wanted: Bool,
    i: int,
    fits: F64,
    unknowns: float,
    result: PassResult,
) -> None:
    """Write what the fits of a row's `wanted` boxes say, shape (FITTED, nx)."""
    layout, noise = boxes.layout, boxes.rounding
    for j in range(layout.left.size):
        if not wanted[i, j]:
            continue
        gain, residual, pixels = fits[1, j], fits[4, j], fits[6, j]
        per_gain, per_pixel = 1.0 / gain, 1.0 / pixels
        dx, dy = -fits[2, j] * per_gain, -fits[3, j] * per_gain
        step = math.sqrt(dx * dx + dy * dy)
        if not step < math.inf:
            dx = dy = 0.0
        elif step > LONGEST_STEP:
            dx, dy = dx * LONGEST_STEP / step, dy * LONGEST_STEP / step
        sigma = math.sqrt(max(residual / (pixels - unknowns), noise))
        zncc = 0.0
        if not fits[5, j] <= pixels * (noise + 1e-6):  # else the image is flat
            zncc = math.copysign(math.sqrt(max(0.0, 1.0 - residual / fits[5, j])), gain)
        x, y = guess.centre[0, i, j] + dx, guess.centre[1, i, j] + dy
        std_x, std_y = sigma * abs(per_gain) * fits[7, j], sigma * abs(per_gain) * fits[8, j]
        odd = fits[9, j] * per_pixel
        result.u[0, i, j], result.u[1, i, j] = x, y
        result.std[0, i, j], result.std[1, i, j] = std_x, std_y
        result.step[i, j], result.zncc[i, j], result.odd[i, j] = step, zncc, odd
        is_alike = zncc > criteria.alike
        had_expectation = guess.grey[2, i, j] < criteria.unlimited
        is_wrong = odd > criteria.most_odd or (had_expectation and not is_alike)
        result.wrong[i, j] = is_wrong
        expected = (1.0, 0.0, criteria.unlimited)
        if is_alike and not is_wrong:
            spread = criteria.believable * fits[10, j] * per_pixel
            expected = (gain, fits[0, j], spread + criteria.least_believable * abs(gain))
        for k in range(3):
            result.expected[k, i, j] = expected[k]
        left, top = layout.left[j] + x, layout.top[i] + y
        fits_x = left >= 0 and left + layout.box <= shape[1]
        is_inside = fits_x and top >= 0 and top + layout.box <= shape[0]
        change = max(abs(x - guess.before[0, i, j]), abs(y - guess.before[1, i, j]))
        is_large = change > max(criteria.tolerance, 5.0 * max(std_x, std_y))
        result.restless[i, j] = is_alike and is_inside and is_large
