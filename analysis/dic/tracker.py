"""The displacement field of each image of a stream against one reference: the paper's direct
correlation.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from analysis.dic import direct
from analysis.dic.field import Field, checked, start_field
from analysis.dic.grid import Grid
from analysis.dic.spectrum import gradient, interpolation, texture
from analysis.dic.status import Status

F32 = NDArray[np.float32]
Shift = NDArray[np.int32]  # whole pixels (x, y), shape (2, ny, nx)
SUPPORT = 3  # valid neighbours that make their median worth starting from
# a point further than this (px; a strain of 20 % if that is more) from its neighbours' median is
# asked again
ODD = 2
NEAR = 4  # half-width of the search of a lost point whose neighbours are known


class DirectTracker:
    """Displacement fields by direct correlation with a reference, each search started from the
    field before.

    Correlations are zero-mean and normalised, so that a change of the light's level and contrast is
    no displacement. The sub-pixel part is the top of a 2D Gaussian through the highest correlation
    and its 8 neighbours. The start of a search decides which peak is found, not what is measured
    there: a point that finds the same peak has the same bits. A lost point is looked for again in
    every image, first from its neighbours. A peak with which no neighbour agrees (to 2 px or 20 %
    of the step) is taken for a chance resemblance and the point for lost.

    Parameters
    ----------
    reference : ndarray, shape (rows, columns), uint8, uint16 or float32
        The image at t = 0.
    box, step : int
        Side of the correlation boxes and pitch of their grid, in pixels.
    search : int
        Half-width in pixels of the exhaustive search of points that have no start.
    min_correlation : float
        A point whose correlation stays below is lost (DECORRELATED).
    min_contrast : float
        Standard deviation in grey levels below which a box, in either image, is LOW_CONTRAST.
    threads : int
        Threads that share a field. The result does not depend on it, to the bit.
    first_guess : callable or None
        ``first_guess(image)`` says where to start, shape (2, ny, nx), when there is no field before
        or most points are lost; None: every displacement within `search` is tried.
    uncertainty : bool
        Whether to state one: the scatter that this reference has when it is displaced by a quarter
        of a pixel, and in quadrature the noise of both images. Costs one more field.

    Raises
    ------
    ValueError
        The image, the box or the step can not be used.

    References
    ----------
    Prevost et al. (2013), section 2.3.2 and Fig. 4.
    """

    def __init__(
        self,
        reference: NDArray[Any],
        box: int = 20,
        step: int = 10,
        *,
        search: int = 16,
        min_correlation: float = 0.5,
        min_contrast: float = 2.0,
        threads: int = 2,
        first_guess: Callable[[NDArray[Any]], NDArray[np.float64]] | None = None,
        uncertainty: bool = True,
    ) -> None:
        image = np.array(checked(reference, "reference"), np.float32, order="C")
        if search < 1 or threads < 1:
            raise ValueError(
                f"tracker: search of {search} px on {threads} threads asked; use 1 or more of both"
            )
        self.grid = Grid.cover((image.shape[0], image.shape[1]), box, step)
        top, left = self.grid.top, self.grid.left
        self._target = direct.Target(
            np.empty_like(image), np.empty((image.shape[0] + 1, image.shape[1] + 1, 2))
        )
        direct.summed_area(image, self._target.sums)
        mean, deviations = direct.grid_moments(self._target.sums, top, left, box)
        self._boxes = direct.Boxes(
            image, top, left, mean, deviations, box, max(box * box * float(min_contrast) ** 2, 1e-6)
        )
        self._search, self._min_correlation = search, min_correlation
        self._tolerance = max(ODD, step / 5)
        self._start: Shift | None = None
        bands = min(self.grid.shape[0], 1 if threads == 1 else 8 * threads)
        self._bands = list(
            pairwise(int(row) for row in np.linspace(0, self.grid.shape[0], bands + 1))
        )
        self._pool = ThreadPoolExecutor(threads, "dic") if threads > 1 else None
        self._first_guess = first_guess
        self._std = (
            self._uncertainty(image)
            if uncertainty
            else np.full((2, *self.grid.shape), np.nan, np.float32)
        )

    def track(self, image: NDArray[Any]) -> Field:
        """The displacement of every point between the reference and `image`.

        Raises
        ------
        ValueError
            The image differs from the reference in shape, or can not be used.
        """
        checked(image, "image", like=self._boxes.image)
        self._target.image[...] = image
        direct.summed_area(self._target.image, self._target.sums)
        if self._start is None and self._first_guess is not None:
            self._start = np.rint(self._first_guess(image)).astype(np.int32)
        if self._start is None:
            start = np.zeros((2, *self.grid.shape), np.int32)
            found = self._match(start, np.full(self.grid.shape, self._search, np.int32))
        else:
            start = self._start
            found = self._match(start, np.zeros(self.grid.shape, np.int32))
            if self._first_guess is not None and self._is_off(found):
                start = np.rint(self._first_guess(image)).astype(np.int32)
                found = self._match(start, np.zeros(self.grid.shape, np.int32))
            self._scan_lost(found, start)
        self._ask_neighbours(found)
        found.reject(direct.contradicted(found.values, found.status, self._tolerance))
        self._start = np.where(found.valid, found.shift, start)  # a lost point keeps its last place
        ux, uy, zncc = found.values
        ux_std, uy_std = np.where(found.valid, self._std, np.float32(np.nan))
        return Field(ux, uy, zncc, found.status, ux_std, uy_std, np.ones(self.grid.shape, np.uint8))

    def start_from(self, ux_px: NDArray[Any], uy_px: NDArray[Any]) -> None:
        """Start the next search from this field, shape (ny, nx); where it is NaN, from the nearest
        points that are not.

        Raises
        ------
        ValueError
            The field has another shape than the grid.
        """
        self._start = np.rint(start_field(ux_px, uy_px, self.grid)).astype(np.int32)

    def reset(self) -> None:
        """Forget the last field: the next search is a cold start around zero displacement."""
        self._start = None

    def close(self) -> None:
        """End the threads. May be called twice."""
        if self._pool is not None:
            self._pool.shutdown()

    def _uncertainty(self, image: F32) -> F32:
        """Standard uncertainty of u_x and u_y at each point, shape (2, ny, nx)."""
        grain, shift = texture(image), 0.25
        std = np.empty((2, *self.grid.shape), np.float32)
        for axis, power in enumerate((grain.power_x, grain.power_y)):
            weights = interpolation(power).at(shift).astype(np.float32)
            slope = gradient(power, grain.noise_share).astype(np.float32)
            shape = (1, -1) if axis == 0 else (-1, 1)
            self._target.image[...] = cv2.filter2D(
                image, -1, weights.reshape(shape), anchor=(3, 0) if axis == 0 else (0, 3)
            )
            direct.summed_area(self._target.image, self._target.sums)
            found = self._match(
                np.zeros((2, *self.grid.shape), np.int32), np.zeros(self.grid.shape, np.int32)
            )
            miss = found.values[axis][found.valid] + shift
            scatter = float(np.sqrt(np.mean(miss.astype(np.float64) ** 2))) if miss.size else 0.0
            squares = cv2.integral(
                cv2.filter2D(image, -1, slope.reshape(shape)) ** 2, sdepth=cv2.CV_64F
            )
            top, left, box = self.grid.top[:, None], self.grid.left, self.grid.box_px
            total = (
                squares[top + box, left + box]
                - squares[top, left + box]
                - squares[top + box, left]
                + squares[top, left]
            )
            std[axis] = np.sqrt(scatter**2 + 2 * grain.noise**2 / np.maximum(total, 1e-9))
        return std

    def _match(self, start: Shift, radius: NDArray[np.int32]) -> _Found:
        """Match the points of non-negative `radius`, in bands of rows shared by the threads."""
        found = _Found(
            np.full((3, *self.grid.shape), np.nan, np.float32),
            np.full(self.grid.shape, Status.NOT_CONVERGED, np.uint8),
        )

        def match(rows: tuple[int, int]) -> None:
            settings = self._search, self._min_correlation, rows
            direct.match_rows(
                self._boxes, self._target, start, radius, *settings, found.values, found.status
            )

        bands = [rows for rows in self._bands if radius[slice(*rows)].max() >= 0]
        for _ in map(match, bands) if self._pool is None else self._pool.map(match, bands):
            pass
        return found

    def _is_off(self, found: _Found) -> bool:
        """Whether most of the points that can be found are lost."""
        return (
            int(found.valid.sum())
            < int((self._boxes.deviations > self._boxes.least_deviations).sum()) // 2
        )

    def _ask_neighbours(self, found: _Found) -> None:
        """Try again from the neighbours' median where a point is lost or far from it; the higher
        correlation stays.
        """
        valid, shift = found.valid, found.shift
        median, known = direct.neighbour_median(shift, valid, SUPPORT)
        odd = known & (~valid | (np.abs(shift - median) > self._tolerance).any(axis=0))
        if odd.any():
            found.improve(self._match(median, np.where(odd, 0, -1).astype(np.int32)), odd)

    def _scan_lost(self, found: _Found, start: Shift) -> None:
        """Try every displacement where a point is lost: near its neighbours' median, or else around
        its start.
        """
        lost = (found.status == Status.DECORRELATED) | (found.status == Status.NOT_CONVERGED)
        if lost.any():
            median, known = direct.neighbour_median(found.shift, found.valid, SUPPORT)
            radius = np.where(lost, np.where(known, NEAR, self._search), -1).astype(np.int32)
            found.improve(self._match(np.where(known, median, start), radius), lost)


@dataclass(frozen=True, slots=True)
class _Found:
    """What is known so far of one image: `values` are u_x, u_y and ZNCC, shape (3, ny, nx)."""

    values: F32
    status: NDArray[np.uint8]

    @property
    def valid(self) -> NDArray[np.bool_]:
        return np.asarray(self.status == Status.OK)

    @property
    def shift(self) -> Shift:
        """Displacements in whole pixels, 0 where there is none."""
        return np.rint(np.where(self.valid, self.values[:2], 0)).astype(np.int32)

    def improve(self, other: _Found, asked: NDArray[np.bool_]) -> None:
        """Take over from `other`, where asked, what was lost here or has the higher correlation."""
        better = asked & (~self.valid | (other.values[2] > self.values[2]))
        self.values[:, better] = other.values[:, better]
        self.status[better] = other.status[better]

    def reject(self, false: NDArray[np.bool_]) -> None:
        """Give up points whose peak was a chance resemblance."""
        self.values[:, false] = np.nan
        self.status[false] = Status.DECORRELATED
