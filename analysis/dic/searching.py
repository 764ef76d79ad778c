"""The paper's direct correlation: an exhaustive search, then the top of a 2D Gaussian."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from numpy.polynomial.polynomial import polyval

from analysis.arrays import F32, F64, I32, Array, Bool
from analysis.dic import direct
from analysis.dic.clipping import clipped_scatter
from analysis.dic.neighbours import filled, neighbour_median
from analysis.dic.repeating import Repetition, remarks_of
from analysis.dic.spectrum import gradient, interpolation, texture
from analysis.dic.status import DECORRELATED, MASKED, NOT_CONVERGED
from analysis.dic.threads import Rows
from analysis.dic.tracker import SUPPORT, Estimate, ReferenceImage, agreement_px

NEAR = 4  # half-width of the search of a lost point whose neighbours are known
SHIFT = 0.25  # px; the displacement of the reference that shows its scatter


class DirectSearch:
    """Displacements by direct correlation, each search started from the field before.

    Correlations are zero-mean and normalised, so that a change of the light's level and contrast is
    no displacement. The sub-pixel part is the top of a 2D Gaussian through the highest correlation
    and its 8 neighbours. The start of a search decides which peak is reached, not what is measured
    there: a point that reaches the same peak has the same bits. Lost points are searched for again
    in every image, first near their neighbours.

    Parameters
    ----------
    reference : Reference
        With all pixels usable: a mask is not supported.
    search : int
        Half-width in pixels of the exhaustive search of points that have no start.
    min_correlation : float
        A point whose correlation stays below is lost (DECORRELATED).
    min_contrast : float
        Standard deviation in grey levels below which a box, in either image, is LOW_CONTRAST.
    first_guess : callable or None
        ``first_guess(image)`` gives the displacement, shape (2, ny, nx), from which to start when
        there is no field before or most points are lost; None: every displacement within `search`
        is tried.
    states_uncertainty : bool
        Whether the estimates hold one: the scatter that this reference has when it is displaced by
        a quarter of a pixel, and in quadrature the noise of both images. It takes as long as one
        more field, once.
    repetition : Repetition or None
        Which points are not recognised wherever they are.

    References
    ----------
    Prevost et al. (2013), section 2.3.2 and Fig. 4.
    """

    def __init__(
        self,
        reference: ReferenceImage,
        *,
        search: int = 16,
        min_correlation: float = 0.5,
        min_contrast: float = 2.0,
        first_guess: Callable[[Array], F64] | None = None,
        states_uncertainty: bool = True,
        repetition: Repetition | None = None,
    ) -> None:
        self._grid, self._threads = reference.grid, reference.threads
        self._search, self._min_correlation = search, min_correlation
        self._first_guess = first_guess
        self._repetition, self.remarks = repetition, remarks_of(repetition)
        self._start: I32 | None = None  # whole pixels (x, y), shape (2, ny, nx)
        image = np.array(reference.image, np.float32, order="C")
        sums = np.empty((image.shape[0] + 1, image.shape[1] + 1, 2))
        self._target = direct.SearchImage(np.empty_like(image), sums)
        direct.summed_area(image, sums)
        top, left, box = self._grid.top, self._grid.left, self._grid.box_px
        mean, deviations = direct.grid_moments(sums, top, left, box)
        least = max(box * box * float(min_contrast) ** 2, 1e-6)
        self._boxes = direct.Templates(image, top, left, mean, deviations, box, least)
        self._std = np.full((2, *self._grid.shape), np.nan, np.float32)
        if states_uncertainty:
            self._std = self._uncertainty(image, reference)

    def measure(self, image: Array, points: Bool | None = None, most_passes: int = 0) -> Estimate:
        """See `Method`: every point is searched for, whether it is wanted or not."""
        del most_passes
        self._load(image)
        start, guess = self._start, self._first_guess
        if start is None and guess is not None:
            start = _whole(guess(image))
        if start is None:
            start = np.zeros((2, *self._grid.shape), np.int32)
            found = self._matched(start, self._search)
        else:
            found = self._matched(start)
            if guess is not None and self._are_few(found):
                start = _whole(guess(image))
                found = self._matched(start)
            found = self._with_lost_points(found, start)
        found = self._with_odd_points(found)
        if self._repetition is not None:
            before = np.zeros_like(start) if self._start is None else self._start
            found = self._repetition.judged(
                found,
                before.astype(np.float64),
                lambda there, far: self._matched(_whole(there), np.where(far, 0, -1)),
            )
        found.reject_lonely(self._grid, self._threads)
        # a lost point keeps its last place, unless it may look like another one there
        ok, shift = found.is_ok, _shift(found)
        beside = self._repetition is not None and ok.any()
        self._start = np.where(
            ok, shift, _whole(filled(shift.astype(np.float64), ok)) if beside else start
        )
        if points is not None:
            found.status[~points] = MASKED
        return found

    def start_from(self, u_px: F64 | None) -> None:
        """See `Method`."""
        self._start = None if u_px is None else _whole(u_px)

    def _load(self, image: Array) -> None:
        self._target.image[...] = image
        direct.summed_area(self._target.image, self._target.sums)

    def _uncertainty(self, image: F32, reference: ReferenceImage) -> F32:
        """Standard uncertainty of u_x and u_y at each point, shape (2, ny, nx)."""
        grain, std = texture(image), np.empty((2, *self._grid.shape), np.float32)
        noise = 2 * (grain.noise * clipped_scatter(reference, grain)) ** 2
        noise = np.broadcast_to(noise, std.shape)
        for axis, power in enumerate((grain.power_x, grain.power_y)):
            along = (1, -1) if axis == 0 else (-1, 1)
            weights = polyval(SHIFT, interpolation(power).T).astype(np.float32).reshape(along)
            anchor = (3, 0) if axis == 0 else (0, 3)
            self._load(cv2.filter2D(image, -1, weights, anchor=anchor))
            found = self._matched(np.zeros((2, *self._grid.shape), np.int32))
            miss = found.u[axis][found.is_ok] + SHIFT
            scatter = float(np.sqrt(np.mean(miss.astype(np.float64) ** 2))) if miss.size else 0.0
            slope = gradient(power, grain.noise_share).astype(np.float32).reshape(along)
            slopes = self._grid.box_sums(cv2.filter2D(image, -1, slope) ** 2)
            std[axis] = np.sqrt(scatter**2 + noise[axis] / np.maximum(slopes, 1e-9))
        return std

    def _matched(self, start: I32, radius: I32 | int = 0) -> Estimate:
        """The points where `radius` is not negative, searched within it from `start`."""
        shape = self._grid.shape
        reach = np.full(shape, radius, np.int32)
        values = np.full((3, *shape), np.nan, np.float32)
        status = np.full(shape, NOT_CONVERGED, np.uint8)
        settings = start, reach, self._search, self._min_correlation

        def match(rows: Rows) -> None:
            direct.match_rows(self._boxes, self._target, *settings, rows, values, status)

        bands = self._threads.bands(shape[0], per_thread=8)
        self._threads.share(match, [rows for rows in bands if reach[slice(*rows)].max() >= 0])
        return Estimate(values[:2], values[2], self._std, status, np.ones(shape, np.uint8))

    def _are_few(self, found: Estimate) -> bool:
        """Whether most of the points that have contrast are lost."""
        contrasted = int((self._boxes.deviations > self._boxes.least_deviations).sum())
        return int(found.is_ok.sum()) < contrasted // 2

    def _with_lost_points(self, found: Estimate, start: I32) -> Estimate:
        """The estimate after an exhaustive search of the lost points: near their neighbours'
        median, or else around their start.
        """
        lost = (found.status == DECORRELATED) | (found.status == NOT_CONVERGED)
        if not lost.any():
            return found
        median, known = neighbour_median(_shift(found), found.is_ok, SUPPORT)
        radius = np.where(lost, np.where(known, NEAR, self._search), -1)
        return found.improved(self._matched(np.where(known, median, start), radius), lost)

    def _with_odd_points(self, found: Estimate) -> Estimate:
        """The estimate after another try of points that are lost or disagree with their neighbours,
        from the neighbours' median.
        """
        return found.retried(
            _shift(found),
            agreement_px(self._grid),
            lambda median, odd: self._matched(median, np.where(odd, 0, -1)),
            with_lost=True,
        )


def _whole(u_px: F64) -> I32:
    return np.rint(u_px).astype(np.int32)


def _shift(found: Estimate) -> I32:
    """Displacements in whole pixels, 0 where the point is not OK."""
    return np.rint(np.where(found.is_ok, found.u, 0)).astype(np.int32)
