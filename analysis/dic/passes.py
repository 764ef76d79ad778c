"""Displacement fields by passes over the whole image, each deforming it back by a smoothed field
and measuring what is left.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from analysis.dic import shared
from analysis.dic.grid import Grid
from analysis.dic.interpolation import Interpolant
from analysis.dic.refining import Estimate, Share
from analysis.dic.shared import BLOCK, COEFFICIENTS, MARGIN, PLANES, ROWS, TAPS
from analysis.dic.smoothing import smooth, widen
from analysis.dic.spectrum import BEYOND, Texture, gradient, interpolation

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
I64 = NDArray[np.int64]
SMOOTHING = 2.5  # width of the moving average over the prediction, in boxes
# a grey level further from the expected one than so many times the mean difference is not used ...
BELIEVABLE = 3.5
# ... given this much more, of the contrast, for what the points have moved since
LEAST_BELIEVABLE = 0.15
MOST_ODD = 0.15  # share of a box's pixels; if more are not believed, the expectation is wrong
SETTLED = 0.75  # limits that shrink to less of what they were are tried again
UNLIMITED = 1e9  # the widest believable difference where nothing is expected
RESTLESS = 1e-3  # share of the points that may still change
ALIKE = 0.5  # correlation below which a point's step says nothing
SINGULAR = 1e-8  # determinant of the normal matrix with units on its diagonal
AT_REST = 0.5  # px; a point whose last step is longer has no place


class SharedPasses:
    """The reference prepared for passes: everything that stays the same from image to image.

    Parameters
    ----------
    image : ndarray, shape (rows, columns), float32
        The reference.
    usable : ndarray of bool, shape (rows, columns), or None
        Pixels that may be used; None: all.
    share : callable
        ``share(work, bands)`` calls ``work(band)`` for every band, on as many threads as there are.
    bands : int
        Into how many bands a field is cut.
    interpolant : Interpolant or None
        How the images are read between their pixels; None: the least-squares interpolation of the
        reference's texture.
    tolerance_px : float
        No further pass once nearly all points have changed by less than this (or by less than five
        times their noise).
    max_passes : int
    """

    is_shared = True

    def __init__(
        self,
        image: NDArray[Any],
        texture: Texture,
        grid: Grid,
        usable: NDArray[np.bool_] | None,
        share: Share,
        bands: int,
        *,
        interpolant: Interpolant | None = None,
        tolerance_px: float = 0.06,
        max_passes: int = 5,
    ) -> None:
        self._grid, self._share, self._max_passes = grid, share, max_passes
        scale = 1 / max(texture.contrast, 1e-6)
        is_8_bit = image.dtype == np.uint8
        level = 128.0 if is_8_bit else float(image.mean(dtype=np.float64))
        f = (image.astype(np.float32) - np.float32(level)) * np.float32(scale)
        slope_x = cv2.filter2D(f, -1, gradient(texture.power_x, texture.noise_share)[None, :])
        slope_y = cv2.filter2D(f, -1, gradient(texture.power_y, texture.noise_share)[:, None])
        w = np.ones_like(f) if usable is None else usable.astype(np.float32)
        planes = w * np.stack([f, slope_x, slope_y])
        planes, units = _quantised(
            planes, w > 0, 127 if is_8_bit else 32000, scale if is_8_bit else None
        )
        self.layout = _layout(grid)
        self.splines, self._pad = _splines(grid, self.layout)
        self._interpolant = interpolant or interpolation(texture.power_x)
        weights = (
            _eight_taps(self._interpolant),
            _eight_taps(interpolant or interpolation(texture.power_y)),
        )
        normal = self._normal_matrices(np.stack([w, *(w * planes * units[:, None, None])]))
        self.pixels = normal[:, :, 0, 0]
        variance = (
            normal[:, :, 1, 1] / self.pixels.clip(1)
            - (normal[:, :, 0, 1] / self.pixels.clip(1)) ** 2
        )
        self.contrast = np.sqrt(variance.clip(0)) / scale
        inverse = np.full((*grid.shape, 13), np.nan)
        size = np.sqrt(np.einsum("...ii->...i", normal))
        with np.errstate(invalid="ignore", divide="ignore"):
            regular = np.linalg.det(normal / (size[..., :, None] * size[..., None, :])) > SINGULAR
        inverse[regular, :10] = np.linalg.inv(normal[regular])[:, *np.triu_indices(4)]
        inverse[..., 10] = self.pixels
        self._width = max(1, round((SMOOTHING * grid.box_px / grid.step_px - 1) / 2) * 2 + 1)
        inverse[..., 11:] = np.sqrt(inverse[..., [7, 9]]) * _amplification(grid, self._width)
        rounding = 0.0 if image.dtype == np.float32 else scale**2 / 12
        self.reference = shared.Reference(
            _cut(planes, self.layout),
            units,
            float(np.iinfo(planes.dtype).min),
            *weights,
            0.0 if interpolant else BEYOND,
            inverse,
            rounding,
            level,
            scale,
        )
        self._cells = np.zeros(
            (shared.SUMS, self.layout.row_edges.size - 1, self.layout.column_edges.size - 1)
        )
        ny, nx = grid.shape
        self._grey = np.stack(
            [np.full(grid.shape, value, np.float32) for value in (1.0, 0.0, UNLIMITED)]
        )
        self._limits = shared.Limits(
            ALIKE, MOST_ODD, BELIEVABLE, LEAST_BELIEVABLE, UNLIMITED, float(tolerance_px)
        )
        self._result = shared.Result(
            u=np.empty((2, ny, nx)),
            step=np.empty((ny, nx)),
            zncc=np.empty((ny, nx)),
            std=np.empty((2, ny, nx)),
            odd=np.empty((ny, nx)),
            expected=np.empty((3, ny, nx), np.float32),
            wrong=np.empty(ny, np.int64),
            restless=np.empty(ny, np.int64),
        )
        self._cell_bands, self._box_bands = (
            _bands(n, bands) for n in (self._cells.shape[1], grid.shape[0])
        )

    def refine(self, image: NDArray[Any], start: F64, wanted: NDArray[np.bool_]) -> Estimate:
        """The displacement of every point, wanted or not, from a guess, shape (2, ny, nx), px:
        passes until it hardly changes.
        """
        u, grey = start, self._grey
        if self._interpolant.spline:
            image = self._interpolant.prepare(image.astype(np.float32))
        n, is_last = 0, False
        while not is_last:
            last = self._pass(image, u, grey)
            n, few = n + 1, RESTLESS * last.step.size
            is_settled = last.wrong.sum() <= few and _typical(
                last.expected[2]
            ) > SETTLED * _typical(grey[2])
            is_last = n == self._max_passes or (is_settled and last.restless.sum() <= few)
            u, grey = last.u.copy(), last.expected.copy()
        self._grey = grey
        at_rest = (last.step <= AT_REST) & (last.odd <= MOST_ODD)
        return Estimate(
            u, last.zncc.copy(), last.std.copy(), at_rest, np.full(self._grid.shape, n, np.uint8)
        )

    def _pass(self, image: NDArray[Any], u: F64, grey: F32) -> shared.Result:
        """One pass: the field that is left after the image is deformed back by the smoothed field
        `u`, added to it.

        Parameters
        ----------
        u : ndarray, shape (2, ny, nx), float64
            Predicted displacement, px; finite.
        grey : ndarray, shape (3, ny, nx), float32
            Expected gain and offset, and largest believable difference of a grey level.
        """
        layout, reference, splines, cells, result = (
            self.layout,
            self.reference,
            self.splines,
            self._cells,
            self._result,
        )
        n, (ny, nx), shape = self._pad, self._grid.shape, (image.shape[0], image.shape[1])
        control, centre = np.empty((5, ny + 2 * n, nx + 2 * n), np.float32), np.empty((2, ny, nx))
        guess = shared.Guess(control, grey, u, centre)

        def predict(fields: tuple[int, int]) -> None:
            for k in range(*fields):
                if k < 2:
                    smooth(u[k], self._width, n, control[k], centre[k])
                else:
                    widen(grey[k - 2], n, control[k])

        self._share(predict, [(0, 1), (1, 2), (2, 5)])
        self._share(
            lambda rows: shared.sum_cells(image, layout, reference, splines, guess, rows, cells),
            self._cell_bands,
        )
        self._share(
            lambda rows: shared.solve_boxes(
                cells, layout, reference, guess, self._limits, shape, rows, result
            ),
            self._box_bands,
        )
        return result

    def _normal_matrices(self, planes: F32) -> F64:
        """Sums over every box of the products of the planes, shape (ny, nx, 4, 4)."""
        out = np.empty((*self._grid.shape, 4, 4))
        for i in range(4):
            for k in range(i, 4):
                sums = cv2.integral((planes[i] * planes[k]), sdepth=cv2.CV_64F)
                low_x, low_y = self._grid.left, self._grid.top
                high_x, high_y = low_x + self._grid.box_px, low_y + self._grid.box_px
                box = (
                    sums[np.ix_(high_y, high_x)]
                    - sums[np.ix_(low_y, high_x)]
                    - sums[np.ix_(high_y, low_x)]
                    + sums[np.ix_(low_y, low_x)]
                )
                out[:, :, i, k] = out[:, :, k, i] = box
        return out


def _typical(values: F32) -> float:
    """The median of every fifth value along both axes."""
    return float(np.median(values[::5, ::5]))


def _layout(grid: Grid) -> shared.Layout:
    def cut(first: I64) -> tuple[I64, I64, I64]:
        edges = np.unique([first, first + grid.box_px])
        return edges, np.searchsorted(edges, first), np.searchsorted(edges, first + grid.box_px)

    column_edges, first_column, last_column = cut(grid.left)
    row_edges, first_row, last_row = cut(grid.top)
    strips: list[tuple[int, int]] = []
    begins = [0]
    for low, high in pairwise(row_edges.tolist()):
        # else it lies between the boxes
        if ((grid.top <= low) & (low < grid.top + grid.box_px)).any():
            n = math.ceil((high - low) / ROWS)
            at = [low + (high - low) * k // n for k in range(n + 1)]
            strips += [(a, b - a) for a, b in pairwise(at)]
        begins.append(len(strips))
    tops, rows = (np.array(column, np.int64) for column in zip(*strips, strict=True))
    return shared.Layout(
        grid.left,
        grid.top,
        grid.box_px,
        column_edges,
        row_edges,
        first_column,
        last_column,
        first_row,
        last_row,
        np.array(begins, np.int64),
        tops,
        rows,
    )


def _quantised(
    planes: F32, usable: NDArray[np.bool_], most: int, grey: float | None
) -> tuple[NDArray[Any], F32]:
    """The planes as whole numbers up to `most`, and their units; the unit of the grey levels may be
    given.

    Gradients are cut at six times their root mean square: there a gradient is a scratch, not
    texture.
    """
    highest = np.abs(planes).max(axis=(1, 2))
    usual = 6 * np.sqrt((planes**2).mean(axis=(1, 2)))
    units = (
        np.array([grey or highest[0] / most, *(np.minimum(highest, usual)[1:] / most)])
        .clip(1e-9)
        .astype(np.float32)
    )
    whole = (
        np.rint(planes / units[:, None, None])
        .clip(-most, most)
        .astype(np.int8 if most < 128 else np.int16)
    )
    whole[0, ~usable] = np.iinfo(whole.dtype).min
    return whole, units


def _cut(planes: NDArray[Any], layout: shared.Layout) -> NDArray[Any]:
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
    pad = math.ceil((grid.box_px / 2 + MARGIN + 1) / step) + 2
    reach = grid.x_px[0] - (pad + 2) * step  # the first control point's spline begins here
    begin = math.floor(reach) + 1
    basis, _ = _cubic((np.arange(begin, begin + 4 * step) - reach) / step)
    place = (layout.strip_top + (layout.strip_rows - 1) / 2 - grid.y_px[0]) / step + pad
    whole = np.floor(place).astype(np.int64)
    weights = np.array([_cubic(3 - k + place - whole) for k in range(4)])
    weights[:, 1] /= step
    return shared.Splines(
        basis.astype(np.float32),
        begin - int(layout.left[0]),
        whole - 1,
        weights.transpose(1, 0, 2).astype(np.float32),
    ), pad


def _cubic(t: F64) -> tuple[F64, F64]:
    """The cubic B-spline on 0 to 4, 0 elsewhere, and its derivative."""
    s = np.abs(t - 2)
    near = s < 1
    value = np.where(near, 4 - 6 * s**2 + 3 * s**3, np.clip(2 - s, 0, None) ** 3) / 6
    slope = np.where(near, 1.5 * s**2 - 2 * s, -0.5 * np.clip(2 - s, 0, None) ** 2) * np.sign(t - 2)
    return value, slope


def _amplification(grid: Grid, width: int) -> float:
    """How much passes without end amplify the noise that one box has.

    A pass gives u = S u' + e - K S u', with S the smoothing, K the average over a box and e the
    boxes' noise, whose correlation is their overlap; hence u = e / (1 - S + K S), here for every
    wavelength on the grid.
    """
    angle = 2 * np.pi * np.arange(48) / 48
    overlap, average, smoothing = (np.zeros(48) for _ in range(3))
    offsets = (np.arange(grid.box_px) - (grid.box_px - 1) / 2) / grid.step_px
    for m in range(-grid.box_px // grid.step_px - 3, grid.box_px // grid.step_px + 4):
        overlap += max(0.0, 1 - abs(m) * grid.step_px / grid.box_px) * np.cos(m * angle)
        average += _cubic(offsets - m + 2)[0].mean() * np.cos(m * angle)
    for m in range(-(width // 2), width // 2 + 1):
        smoothing += np.cos(m * angle) / width
    s, ks = smoothing * (4 + 2 * np.cos(angle)) / 6, smoothing * average
    gain = 1 / (1 - np.outer(s, s) + np.outer(ks, ks))
    weight = np.outer(overlap, overlap)
    return float(np.sqrt((gain**2 * weight).sum() / weight.sum()))


def _eight_taps(interpolant: Interpolant) -> F32:
    taps, coefficients = interpolant.weights.shape
    out = np.zeros((TAPS, COEFFICIENTS), np.float32)
    out[(TAPS - taps) // 2 : (TAPS + taps) // 2, :coefficients] = interpolant.weights
    return out


def _bands(n: int, bands: int) -> list[tuple[int, int]]:
    edges = [n * k // bands for k in range(bands + 1)]
    return [(a, b) for a, b in pairwise(edges) if b > a]
