"""Displacement fields by passes over the whole image, each deforming it back by a smoothed field
and measuring what is left.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import cv2
import numpy as np
from scipy.ndimage import distance_transform_edt

from analysis.arrays import F32, F64, I64, Array, Bool
from analysis.dic import quadratic, shared, strips
from analysis.dic.smoothing import cubic, smooth, widen
from analysis.dic.spectrum import BEYOND, TextureCorrelation, interpolation, slopes
from analysis.dic.status import NOT_CONVERGED, OK
from analysis.dic.strips import BLOCK, PLANES, PREDICTION_MARGIN, ROWS
from analysis.dic.threads import Rows
from analysis.dic.tracker import Estimate, ReferenceImage
from analysis.grid import Grid

# width of the moving average over the prediction, in boxes: for boxes that shift as a whole, which
# see the prediction averaged, and for quadratic ones, which follow it
PREDICTION_WIDTH, PREDICTION_WIDTH_QUADRATIC = 2.5, 1.0
# a grey level further from the expected one than so many times the mean difference is not used ...
BELIEVABLE = 3.5
# ... given this much more, of the contrast, for what the points have moved since
LEAST_BELIEVABLE = 0.15
MOST_ODD = 0.15  # share of a box's pixels; if more are not believed, the expectation is wrong
RETRY_SHRINKAGE = 0.75  # limits that shrink to less of what they were are tried again
UNLIMITED = 1e9  # the widest believable difference where nothing is expected
MAX_CHANGING_SHARE = 1e-3  # largest share of points that still change after the last pass
ALIKE = 0.5  # correlation below which a point's step says nothing
MIN_DETERMINANT = 1e-8  # least determinant of a normal matrix with a unit diagonal
SAME = 0.01  # px; a point whose prediction has changed by less is not measured again
MAX_LAST_STEP_PX = 0.5  # a point whose last step is longer has not converged


class _PassPart(NamedTuple):
    """The points that are measured, shape (ny, nx), the blocks that they need, and which of them is
    the nearest to each point of the grid, flat; None if all are measured.
    """

    points: Bool
    needed: Bool
    nearest: I64 | None = None


class SharedPasses:
    """The reference prepared for passes: everything that stays the same from image to image.

    Parameters
    ----------
    reference : Reference
    texture : TextureCorrelation
        Of the reference.
    tolerance_px : float
        No further pass once nearly all points have changed by less than this (or by less than five
        times their noise).
    max_passes : int
    is_quadratic : bool
        Whether the displacement within a box is a quadratic, rather than that of the prediction
        with a shift of the box as a whole.
    """

    is_shared = True

    def __init__(
        self,
        reference: ReferenceImage,
        texture: TextureCorrelation,
        *,
        tolerance_px: float = 0.06,
        max_passes: int = 5,
        is_quadratic: bool = False,
    ) -> None:
        self._threads, self._max_passes = reference.threads, max_passes
        self._grid = grid = reference.grid
        width = (
            (PREDICTION_WIDTH_QUADRATIC if is_quadratic else PREDICTION_WIDTH)
            * grid.box_px
            / grid.step_px
        )
        self._width = max(1, round((width - 1) / 2) * 2 + 1)
        self._quadratic: tuple[quadratic.QuadraticBoxes, quadratic.SeenByBox] | None = None
        self._prepared, self.pixels, self.contrast = self._prepare(reference, texture, is_quadratic)
        layout = self._prepared.boxes.layout
        cells = layout.row_edges.size - 1, layout.column_edges.size - 1
        left, rows = layout.left - layout.left[0], np.arange(cells[0])
        blocks = np.arange(self._prepared.planes.shape[1])
        self._reach = (  # boxes along y above a row of cells, and down to it ...
            np.searchsorted(layout.last_row, rows, "right"),
            np.searchsorted(layout.first_row, rows, "right"),
            np.searchsorted((left + layout.box - 1) // BLOCK, blocks),  # ... and so along x
            np.searchsorted(left // BLOCK, blocks, "right"),
        )
        self._cells = np.zeros((strips.MOMENT_SUMS if is_quadratic else shared.SUMS, *cells))
        (ny, nx), more = grid.shape, 2 * self._pad
        shapes = (ny + more, nx), (ny + more, nx + more)
        self._work = [tuple(map(np.empty, shapes)) for _ in range(2)]
        whole = np.ones(grid.shape, np.bool_), np.ones((rows.size, blocks.size), np.bool_)
        self._part = _PassPart(*whole)
        self._whole = self._part
        nothing = np.array([1.0, 0.0, UNLIMITED], np.float32)[:, None, None]
        self._grey = np.broadcast_to(nothing, (3, *grid.shape)).copy()
        self._criteria = shared.Criteria(
            ALIKE, MOST_ODD, BELIEVABLE, LEAST_BELIEVABLE, UNLIMITED, float(tolerance_px)
        )
        self._result = shared.PassResult.empty(*grid.shape)
        self._predicted = np.empty((2, *grid.shape))  # px, in the middle of every box

    def _prepare(
        self,
        reference: ReferenceImage,
        texture: TextureCorrelation,
        is_quadratic: bool,
    ) -> tuple[shared.Prepared, F64, F64]:
        """What the kernels need of the reference; usable pixels and contrast of each box."""
        image, usable, grid = reference.image, reference.usable, self._grid
        scale = 1 / max(texture.contrast, 1e-6)
        is_8_bit = image.dtype == np.uint8
        level = 128.0 if is_8_bit else float(image.mean(dtype=np.float64))
        f = (image.astype(np.float32) - np.float32(level)) * np.float32(scale)
        w = np.ones_like(f) if usable is None else usable.astype(np.float32)
        exact = np.stack([f, *slopes(f, texture)])
        exact *= w  # in place, as below: new memory for a picture takes longer than the product
        most, unit = (127, scale) if is_8_bit else (32000, None)
        planes, units = _quantised(exact, w > 0, most, unit)
        read = np.stack([w, *planes])
        read[1:] *= w
        read[1:] *= units[:, None, None]
        normal = self._normal_matrices(read)
        pixels = normal[:, :, 0, 0]
        mean, squares = (normal[:, :, k, 1] / pixels.clip(1) for k in range(2))
        contrast = np.sqrt((squares - mean**2).clip(0)) / scale
        inverse = np.full((*grid.shape, 13), np.nan)
        size = np.sqrt(np.einsum("...ii->...i", normal))
        with np.errstate(invalid="ignore", divide="ignore"):
            regular = (
                np.linalg.det(normal / (size[..., :, None] * size[..., None, :])) > MIN_DETERMINANT
            )
        inverse[regular, :10] = np.linalg.inv(normal[regular])[:, *np.triu_indices(4)]
        inverse[..., 10] = pixels
        inverse[..., 11:] = np.sqrt(inverse[..., [7, 9]]) * _amplification(grid, self._width)
        layout = _layout(grid)
        splines, self._pad = _splines(grid, layout)
        if is_quadratic:
            seen = quadratic.SeenByBox(grid, self._pad)
            self._quadratic = quadratic.prepare(read, grid, layout, self._threads), seen
        prepared = shared.Prepared(
            boxes=shared.GridBoxes(
                layout=layout,
                inverse=inverse,
                rounding=0.0 if image.dtype == np.float32 else scale**2 / 12,
            ),
            splines=splines,
            planes=_cut(planes, layout),
            units=units,
            unusable=float(np.iinfo(planes.dtype).min),
            weights_x=interpolation(texture.power_x).astype(np.float32),
            weights_y=interpolation(texture.power_y).astype(np.float32),
            beyond=BEYOND,
            level=level,
            scale=scale,
        )
        return prepared, pixels, contrast

    def forget(self, points: Bool) -> None:
        """See `Refiner`: nothing is kept from one image to the next."""

    def refine(
        self,
        image: Array,
        start: F64,
        wanted: Bool,
        points: Bool | None = None,
        most_passes: int = 0,
    ) -> Estimate:
        """See `Refiner`: passes until the displacement hardly changes."""
        self._use(points)
        u, grey, passes = self._continued(start), self._grey, np.zeros(self._grid.shape, np.uint8)
        if points is not None:
            self._result.forget(u)
        n, is_last, typical = 0, False, _typical(grey[2])
        wrong = None  # points whose light was not the expected one; None: all may be
        while not is_last:
            last, measured = self._pass(image, u, grey, wrong)
            n, few = n + 1, MAX_CHANGING_SHARE * last.step.size
            passes += measured
            u, grey = self._continued(last.u.copy()), self._continued(last.expected.copy())
            before, typical = typical, _typical(grey[2])
            wrong = last.wrong if typical > RETRY_SHRINKAGE * before else None
            is_settled = wrong is not None and wrong.sum() <= few
            is_last = is_settled and last.restless.sum() <= few
            is_last |= n == (most_passes or self._max_passes)
        self._grey = grey
        at_rest = (last.step <= MAX_LAST_STEP_PX) & (last.odd <= MOST_ODD)
        status = np.where(at_rest, OK, NOT_CONVERGED).astype(np.uint8)
        return Estimate(u, last.zncc.copy(), last.std.copy(), status, passes)

    def _use(self, points: Bool | None) -> None:
        """Measure those points, or all."""
        if points is None:
            self._part = self._whole
        elif points is not self._part.points:
            at = distance_transform_edt(~points, return_distances=False, return_indices=True)
            nearest = np.ravel_multi_index(tuple(at), points.shape).ravel()
            self._part = _PassPart(points, self._needed(points), nearest)

    def _continued(self, fields: Array) -> Array:
        """Fields, shape (k, ny, nx), in which all other points have the value of the nearest of
        those that are measured, as their predictions need.
        """
        nearest = self._part.nearest
        if nearest is None:
            return fields
        return fields.reshape(len(fields), -1).take(nearest, axis=1).reshape(fields.shape)

    def _needed(self, wanted: Bool) -> Bool:
        """The blocks, shape (rows of cells, blocks), that the boxes of these points reach."""
        before_row, upto_row, before_block, upto_block = self._reach
        n = np.zeros((wanted.shape[0] + 1, wanted.shape[1] + 1), np.int64)
        wanted.cumsum(axis=0).cumsum(axis=1, out=n[1:, 1:])
        within_rows = n[upto_row] - n[before_row]
        needed = within_rows[:, upto_block] > within_rows[:, before_block]
        return np.ascontiguousarray(needed)  # as at first, so that kernels compile once

    def _pass(
        self, image: Array, u: F64, grey: F32, wrong: Bool | None
    ) -> tuple[shared.PassResult, Bool]:
        """One pass: the field that is left after the image is deformed back by the smoothed field
        `u`, added to it; and the points, shape (ny, nx), that were measured: all, or the
        `wrong` ones and those whose prediction is not that of the pass before. The result of
        the others stays.

        Parameters
        ----------
        u : ndarray, shape (2, ny, nx), float64
            Predicted displacement, px; finite.
        grey : ndarray, shape (3, ny, nx), float32
            Expected gain and offset, and largest believable difference of a grey level.
        """
        prepared, cells = self._prepared, self._cells
        n, (ny, nx), shape = self._pad, self._grid.shape, (image.shape[0], image.shape[1])
        control, centre = np.empty((5, ny + 2 * n, nx + 2 * n), np.float32), np.empty((2, ny, nx))
        guess, before = shared.Guess(control, grey, u, centre), self._predicted

        def predict(fields: Rows) -> None:
            for k in range(*fields):
                if k < 2:
                    smooth(u[k], self._width, self._work[k], control[k], centre[k])
                    if self._quadratic:
                        self._quadratic[1].of(control[k], centre[k])
                else:
                    widen(grey[k - 2], n, control[k])

        def sum_cells(rows: Rows) -> None:
            middles = self._quadratic[0].middles if self._quadratic else None
            strips.sum_cells(image, prepared, guess, needed, rows, cells, middles)

        def solve(rows: Rows) -> None:
            rest = guess, self._criteria, shape, wanted, rows, self._result
            if self._quadratic:
                quadratic.solve_quadratics(cells, prepared.boxes, self._quadratic[0], *rest)
            else:
                shared.solve_boxes(cells, prepared.boxes, *rest)

        self._threads.share(predict, [(0, 1), (1, 2), (2, 5)])
        self._predicted, (wanted, needed, _) = centre, self._part
        if wrong is not None:
            differs = wrong | (np.abs(centre - before).max(axis=0) > SAME)
            wanted = wanted & (cv2.dilate(differs.view(np.uint8), np.ones((3, 3), np.uint8)) > 0)
            needed = self._needed(wanted)
            self._result.restless[~wanted] = False  # they would be measured the same again
        self._threads.share(sum_cells, self._threads.bands(cells.shape[1]))
        self._threads.share(solve, self._threads.bands(ny))
        return self._result, wanted

    def _normal_matrices(self, planes: F32) -> F64:
        """Sums over every box of the products of the planes, shape (ny, nx, 4, 4)."""
        out = np.empty((*self._grid.shape, 4, 4))
        for i in range(4):
            for k in range(i, 4):
                out[:, :, i, k] = out[:, :, k, i] = self._grid.box_sums(planes[i] * planes[k])
        return out


def _typical(values: F32) -> float:
    """The median of every fifth value along both axes."""
    some = values[::5, ::5].ravel()
    return float(np.partition(some, some.size // 2)[some.size // 2])


def _layout(grid: Grid) -> shared.Layout:
    def cut(first: I64) -> tuple[I64, I64, I64]:
        edges = np.unique([first, first + grid.box_px])
        return edges, np.searchsorted(edges, first), np.searchsorted(edges, first + grid.box_px)

    column_edges, first_column, last_column = cut(grid.left)
    row_edges, first_row, last_row = cut(grid.top)
    strip_rows: list[tuple[int, int]] = []  # first row of each strip, and how many
    begins = [0]
    for low, high in pairwise(row_edges.tolist()):
        if ((grid.top <= low) & (low < grid.top + grid.box_px)).any():  # not between the boxes
            n = math.ceil((high - low) / ROWS)
            at = [low + (high - low) * k // n for k in range(n + 1)]
            strip_rows += [(a, b - a) for a, b in pairwise(at)]
        begins.append(len(strip_rows))
    return shared.Layout(
        left=grid.left,
        top=grid.top,
        box=grid.box_px,
        column_edges=column_edges,
        row_edges=row_edges,
        first_column=first_column,
        last_column=last_column,
        first_row=first_row,
        last_row=last_row,
        strip_cell=np.array(begins, np.int64),
        strip_top=np.array([top for top, _ in strip_rows], np.int64),
        strip_rows=np.array([rows for _, rows in strip_rows], np.int64),
    )


def _quantised(planes: F32, usable: Bool, most: int, grey: float | None) -> tuple[Array, F32]:
    """The planes as whole numbers up to `most`, and their units; the unit of the grey levels may be
    given.

    Gradients are cut at six times their root mean square: there a gradient is a scratch, not
    texture.
    """
    highest = np.maximum(planes.max(axis=(1, 2)), -planes.min(axis=(1, 2)))
    usual = 6 * np.sqrt((planes**2).mean(axis=(1, 2)))
    units = np.array([grey or highest[0] / most, *(np.minimum(highest, usual)[1:] / most)])
    units = units.clip(1e-9).astype(np.float32)
    planes = planes / units[:, None, None]
    np.rint(planes, out=planes)
    planes.clip(-most, most, out=planes)
    whole: Array = planes.astype(np.int8 if most < 128 else np.int16)
    whole[0, ~usable] = np.iinfo(whole.dtype).min
    return whole, units


def _cut(planes: Array, layout: shared.Layout) -> Array:
    """The planes in the order in which they are read: strip, block, row, plane, column; what fills
    them up is not usable.
    """
    first, last = layout.column_edges[0], layout.column_edges[-1]
    blocks = math.ceil((last - first) / BLOCK)
    rows = (int(layout.strip_rows.max()) + 1) // 2 * 2
    out = np.zeros((layout.strip_top.size, blocks, rows, PLANES, BLOCK), planes.dtype)
    out[:, :, :, 0] = np.iinfo(planes.dtype).min
    for strip, (top, n) in enumerate(zip(layout.strip_top, layout.strip_rows, strict=True)):
        for block in range(blocks):
            left = first + block * BLOCK
            piece = planes[:, top : top + n, left : min(left + BLOCK, last)]
            out[strip, block, :n, :, : piece.shape[2]] = piece.transpose(1, 0, 2)
    return out.reshape(*out.shape[:2], -1)


def _splines(grid: Grid, layout: shared.Layout) -> tuple[shared.Splines, int]:
    """How to read the prediction at columns and strips, and by how many control points it extends
    beyond the grid.
    """
    step = grid.step_px
    pad = math.ceil((grid.box_px / 2 + PREDICTION_MARGIN + 1) / step) + 2
    reach = grid.x_px[0] - (pad + 2) * step  # the first control point's spline begins here
    begin = math.floor(reach) + 1
    basis, _ = cubic((np.arange(begin, begin + 4 * step) - reach) / step)
    place = (layout.strip_top + (layout.strip_rows - 1) / 2 - grid.y_px[0]) / step + pad
    whole = np.floor(place).astype(np.int64)
    weights = np.array([cubic(3 - k + place - whole) for k in range(4)])
    weights[:, 1] /= step
    # in one order whatever the number of strips, so that kernels compile once
    row_weights = weights.transpose(1, 0, 2).astype(np.float32, order="C")
    start = begin - int(layout.left[0])
    return shared.Splines(basis.astype(np.float32), start, whole - 1, row_weights), pad


def _amplification(grid: Grid, width: int) -> float:
    """How much passes without end amplify the noise of a single box.

    A pass gives u = S u' + e - K S u', with S the smoothing, K the average over a box and e the
    boxes' noise, whose correlation is their overlap; hence u = e / (1 - S + K S), here for every
    wavelength on the grid.
    """
    angle = 2 * np.pi * np.arange(48) / 48
    overlap, average, smoothing = (np.zeros(48) for _ in range(3))
    offsets = (np.arange(grid.box_px) - (grid.box_px - 1) / 2) / grid.step_px
    for m in range(-grid.box_px // grid.step_px - 3, grid.box_px // grid.step_px + 4):
        overlap += max(0.0, 1 - abs(m) * grid.step_px / grid.box_px) * np.cos(m * angle)
        average += cubic(offsets - m + 2)[0].mean() * np.cos(m * angle)
    for m in range(-(width // 2), width // 2 + 1):
        smoothing += np.cos(m * angle) / width
    s, ks = smoothing * (4 + 2 * np.cos(angle)) / 6, smoothing * average
    gain = 1 / (1 - np.outer(s, s) + np.outer(ks, ks))
    weight = np.outer(overlap, overlap)
    return float(np.sqrt((gain**2 * weight).sum() / weight.sum()))
