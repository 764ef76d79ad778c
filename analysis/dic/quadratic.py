"""A quadratic displacement within each box, from moments that boxes share.

As in `analysis.dic.shared`, products of the reference with the image deformed back are added up
once for each cell, here with their moments, so that the least squares of a box know all terms of a
quadratic displacement: those of IC-GN of second order for the price of passes over the image. What
the box sees of the prediction is fitted by a quadratic too, so that the result does not depend on
how the prediction was smoothed.

References
----------
Gao et al. (2015), Opt. Lasers Eng. 65, 73: second order. Savitzky and Golay (1964): the value at
the centre of a quadratic fitted to the prediction.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np

from analysis.arrays import F32, F64, Array, Bool, floats
from analysis.dic.icgn import COMPONENT, TERM, normal_equations
from analysis.dic.shared import FITTED, Criteria, GridBoxes, Guess, Layout, PassResult, write_row
from analysis.dic.smoothing import cubic
from analysis.dic.strips import MOMENT_SUMS, Middles
from analysis.dic.threads import Rows, Threads
from analysis.grid import Grid
from analysis.kernels import compiled

UNKNOWNS = 14  # offset, gain, six of each component


class QuadraticBoxes(NamedTuple):
    """What boxes need to solve for a quadratic displacement."""

    middles: Middles
    x: F64  # (nx,) middles of the boxes, in the units and from the origin of `middles`
    y: F64  # (ny,)
    mean: F64  # (ny, nx) grey level of the reference, subtracted from it
    # (ny, nx, UNKNOWNS, UNKNOWNS) inverse of the normal matrix of (1, reference, steepest
    # descents); NaN: singular
    inverse: F64


def prepare(planes: F32, grid: Grid, layout: Layout, threads: Threads) -> QuadraticBoxes:
    """The boxes of a reference.

    `planes`, shape (4, rows, columns), are usable pixels (1 or 0), grey levels and gradients.
    """
    half = grid.box_px / 2
    place = (np.arange(grid.box_px) - (grid.box_px - 1) / 2) / half
    y, x = (axis.ravel() for axis in np.meshgrid(place, place, indexing="ij"))
    places = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y])
    mean = np.empty(grid.shape)
    inverse = np.empty((*grid.shape, UNKNOWNS, UNKNOWNS))

    def fill(rows: Rows) -> None:
        some = slice(*rows)
        part = Grid(grid.box_px, grid.step_px, grid.x_px, grid.y_px[some])
        moments, inverse[some] = normal_equations(planes, part, places, UNKNOWNS - 2)
        mean[some] = moments[..., 1]

    threads.share(fill, threads.bands(grid.shape[0]))

    def middle(edges: Array) -> F64:
        return floats((edges[:-1] + edges[1:] - 1) / 2 / half)

    columns = layout.column_edges - layout.left[0]
    return QuadraticBoxes(
        Middles(middle(columns), middle(layout.row_edges), half),
        floats((layout.left - layout.left[0] + (grid.box_px - 1) / 2) / half),
        floats((layout.top + (grid.box_px - 1) / 2) / half),
        mean,
        inverse,
    )


class SeenByBox:
    """The value in the middle of each box of the quadratic that fits a prediction best there."""

    def __init__(self, grid: Grid, pad: int) -> None:
        box, self._pad = grid.box_px, pad
        offsets = np.arange(box) - (box - 1) / 2
        reach = math.ceil(box / 2 / grid.step_px) + 2
        points = np.arange(-reach, reach + 1)
        splines, _ = cubic(offsets / grid.step_px - points[:, None] + 2)
        squares = (offsets / (box / 2)) ** 2
        self._mean, self._second = splines.mean(axis=1), (splines * squares).mean(axis=1)
        # h = a + b (x^2 + y^2), of mean 1 and without second moments, gives the value in the middle
        two, four = squares.mean(), (squares**2).mean()
        self._a, self._b = np.linalg.solve([[1, 2 * two], [two, four + two**2]], [1, 0])

    def of(self, control: F32, out: F64) -> None:
        """Write the values, shape (ny, nx), of a prediction with those control points."""
        kernels = (
            (self._mean, self._a * self._mean + self._b * self._second),
            (self._second, self._b * self._mean),
        )
        total = sum(cv2.sepFilter2D(control, cv2.CV_64F, across, down) for across, down in kernels)
        out[:] = np.asarray(total)[self._pad : -self._pad, self._pad : -self._pad]


@compiled
def add_cells_down(cells: F64, boxes: QuadraticBoxes, layout: Layout, row: int, out: F64) -> None:
    """Moments over the cells of one row of boxes, shape (MOMENT_SUMS, nc), about its middle."""
    out[:] = 0.0
    for r in range(layout.first_row[row], layout.last_row[row]):
        dy = boxes.middles.y[r] - boxes.y[row]
        for cell in range(out.shape[1]):
            for k in (0, 1, 14, 15, 16):
                out[k, cell] += cells[k, r, cell]
            for k in (2, 8):
                one, y = cells[k, r, cell], cells[k + 2, r, cell]
                x = cells[k + 1, r, cell]
                out[k, cell] += one
                out[k + 1, cell] += x
                out[k + 2, cell] += y + dy * one
                out[k + 3, cell] += cells[k + 3, r, cell]
                out[k + 4, cell] += cells[k + 4, r, cell] + dy * x
                out[k + 5, cell] += cells[k + 5, r, cell] + dy * (2.0 * y + dy * one)


@compiled
def add_cells_across(
    rows: F64, boxes: QuadraticBoxes, layout: Layout, column: int, out: F64
) -> None:
    """Moments over one box, shape (MOMENT_SUMS,), about its middle, from those of its row."""
    out[:] = 0.0
    for cell in range(layout.first_column[column], layout.last_column[column]):
        dx = boxes.middles.x[cell] - boxes.x[column]
        for k in (0, 1, 14, 15, 16):
            out[k] += rows[k, cell]
        for k in (2, 8):
            one, x, y = rows[k, cell], rows[k + 1, cell], rows[k + 2, cell]
            out[k] += one
            out[k + 1] += x + dx * one
            out[k + 2] += y
            out[k + 3] += rows[k + 3, cell] + dx * (2.0 * x + dx * one)
            out[k + 4] += rows[k + 4, cell] + dx * y
            out[k + 5] += rows[k + 5, cell]


@compiled(error_model="numpy")
def solve_quadratics(
    cells: F64,
    boxes: GridBoxes,
    quadratics: QuadraticBoxes,
    guess: Guess,
    criteria: Criteria,
    shape: tuple[int, int],
    wanted: Bool,
    rows: Rows,
    result: PassResult,
) -> None:
    """As `analysis.dic.shared.solve_boxes`, from moments over the cells, shape (MOMENT_SUMS, nr,
    nc).
    """
    layout = boxes.layout
    row, m = np.zeros((MOMENT_SUMS, cells.shape[2])), np.zeros(MOMENT_SUMS)
    right, solved = np.zeros(UNKNOWNS), np.zeros(UNKNOWNS)
    fits = np.zeros((FITTED, layout.left.size))
    for i in range(rows[0], rows[1]):
        if not wanted[i].any():
            continue
        add_cells_down(cells, quadratics, layout, i, row)
        for j in range(layout.left.size):
            if not wanted[i, j]:
                continue
            add_cells_across(row, quadratics, layout, j, m)
            mean, inverse = quadratics.mean[i, j], quadratics.inverse[i, j]
            right[0], right[1] = m[0], m[1] - mean * m[0]
            for k in range(UNKNOWNS - 2):
                right[k + 2] = m[2 + 6 * COMPONENT[k] + TERM[k]]
            residual = m[14]
            for k in range(UNKNOWNS):
                total = 0.0
                for n in range(UNKNOWNS):
                    total += inverse[k, n] * right[n]
                solved[k] = total
                residual -= total * right[k]
            pixels, gain = boxes.inverse[i, j, 10], solved[1]
            deviations = m[14] - m[0] * m[0] / pixels
            fits[0, j], fits[1, j] = solved[0] - gain * mean, gain
            fits[2, j], fits[3, j] = solved[2], solved[3]
            fits[4, j] = max(0.0, residual)
            fits[5, j] = deviations if abs(gain) < math.inf else 0.0
            fits[6, j] = pixels
            fits[7, j], fits[8, j] = math.sqrt(inverse[2, 2]), math.sqrt(inverse[3, 3])
            fits[9, j], fits[10, j] = m[15], m[16]
        write_row(boxes, guess, criteria, shape, wanted, i, fits, float(UNKNOWNS), result)
