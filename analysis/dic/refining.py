"""Displacements refined from a first guess: the last field, or a search in reduced images where
that is too far off.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Protocol

import cv2
import numpy as np
from scipy.special import betaincinv

from analysis.arrays import F64, I64, U8, Array, Bool
from analysis.dic.clipping import clipped_scatter
from analysis.dic.coarse import CoarseSearch
from analysis.dic.neighbours import filled
from analysis.dic.periodicity import repetition
from analysis.dic.repeating import remarks_of
from analysis.dic.spectrum import TextureCorrelation, texture
from analysis.dic.status import (
    DECORRELATED,
    LOW_CONTRAST,
    MASKED,
    NOT_CONVERGED,
    OK,
    OUT_OF_IMAGE,
    SATURATED,
)
from analysis.dic.tracker import Estimate, ReferenceImage
from analysis.kernels import compiled
from analysis.region import measured
from analysis.saturation import end_of_scale
from analysis.settings import Correlation

# of the points that were followed so far; if more are lost at once, they are searched for in
# the whole image
MAX_NEWLY_LOST_SHARE = 0.02
CHANCE = 1e-4  # probability that a box which is not in the image is taken for recognised
ALMOST_SURE = 0.95  # a correlation that is enough however small the box
# power of the noise in units of the texture's, above which the texture may be finer than it looks
MOSTLY_NOISE = 0.3
LEAST_USABLE = 0.5  # share of the pixels of a box
PROBE = 6  # every so many points along both axes are tried first where points are refined singly
ODD_PX, ODD_SDS = 0.5, 5.0  # from the neighbours, in px and in standard uncertainties
REPAIRS = 3  # rounds at most in which lost points start from their neighbours
FULL_SCALE = {"uint8": 255.0, "uint16": 65535.0}


class Refiner(Protocol):
    """A way to refine displacements, prepared for one reference and its texture."""

    pixels: F64  # (ny, nx) usable pixels of each box
    contrast: F64  # (ny, nx) standard deviation of the reference's grey levels in each box
    is_shared: bool  # points depend on each other, so that all are refined even if few are wanted

    def refine(
        self,
        image: Array,
        start: F64,
        wanted: Bool,
        points: Bool | None = None,
        most_passes: int = 0,
    ) -> Estimate:
        """The displacement of at least the wanted points from a guess, shape (2, ny, nx), finite.

        The status is OK, or NOT_CONVERGED where the last step was long. If points depend on each
        other, all of `points` are refined (None: of the grid), in `most_passes` (0: as it needs).
        """

    def forget(self, points: Bool) -> None:
        """Start these points next without what was found there last, but for their start."""


MakeRefiner = Callable[[ReferenceImage, TextureCorrelation], Refiner]


class Refinement:
    """A method that refines a first guess, judges the result, and repairs or searches for what is
    lost.

    Every image starts from the field before and its change since the one before that. Lost points
    start again from the points around them, and so do points that are refined singly and differ
    from these; if many of the points that were followed are lost at once, all are searched for in
    reduced images. Lost points are tried again in every image. A
    point is OK only if its correlation is higher than chance explains (at a level of 1e-4, given
    the number of grains of the texture in a box) and a neighbour agrees with it.

    Parameters
    ----------
    reference : Reference
    settings : Correlation
        `search`, `min_correlation`, `min_contrast`, `max_saturated`, `full_scale` and `region` are
        used; points outside the region are MASKED as with `roi`.
    make : callable
        Makes the refiner.
    roi : tuple of int, or None
        Left, top, right, bottom, in pixels: points outside are MASKED. What is measured inside does
        not depend on it, to the bit, except for points that were repaired from points outside.

    Raises
    ------
    ValueError
        No box lies in the region and has enough usable pixels.
    """

    def __init__(
        self,
        reference: ReferenceImage,
        settings: Correlation,
        make: MakeRefiner,
        roi: tuple[int, int, int, int] | None,
    ) -> None:
        self._image, self._grid, self._threads = reference.image, reference.grid, reference.threads
        self._settings, self._make = settings, partial(make, reference)
        self._scatter = partial(clipped_scatter, reference)
        self._refiner: Refiner
        self._may_be_fine: bool
        self._points: Bool | None = None  # of the present image
        self._most_passes = 0
        self._full_scale = settings.full_scale or FULL_SCALE.get(str(self._image.dtype), math.inf)
        grain = texture(self._image.astype(np.float32))
        self._use(grain)
        self._repetition = repetition(reference, grain, settings.min_contrast)
        self.remarks = remarks_of(self._repetition)
        self._coarse = CoarseSearch(reference, settings.search)
        self._fixed = self._judge_reference()
        x, y = np.meshgrid(self._grid.x_px, self._grid.y_px)
        left, top, right, bottom = roi or (0, 0, self._image.shape[1], self._image.shape[0])
        self._outside = (x < left) | (x > right) | (y < top) | (y > bottom)
        self._outside |= ~measured(settings.polygons, x, y)
        if (self._outside | (self._fixed == MASKED)).all():
            raise ValueError(
                f"tracker: no box of {self._grid.box_px} px lies in the region and mask asked for;"
                " widen them"
            )
        if not self._refiner.is_shared:
            self._fixed[self._outside] = MASKED
        self._last: F64 | None = None
        self._motion: F64 | float = 0.0  # from one image to the next
        self._followed = np.zeros(self._grid.shape, np.bool_)

    def measure(self, image: Array, points: Bool | None = None, most_passes: int = 0) -> Estimate:
        """See `Method`."""
        self._points, self._most_passes = points, most_passes
        usable = self._usable
        if self._last is None:
            before = np.zeros((2, *self._grid.shape))
            found = self._refined(image, self._searched(image, before), usable)
        else:
            before = start = self._last + self._motion
            if not self._refiner.is_shared and self._is_off(image, start, usable):
                start = self._searched(image, before)
            found = self._refined(image, start, usable)
            if self._are_too_many_lost(found):
                lost = usable & ~found.is_ok
                start = np.where(lost, self._searched(image, before), found.u)
                found = found.replaced(self._refined(image, start, lost), lost)
        if self._may_be_fine and self._are_few(found):
            found = self._with_fine_texture(image, found, before)
        found = self._repaired(image, found)
        if not self._refiner.is_shared:
            found = self._with_odd_points(image, found)
        if self._repetition is not None:
            found = self._repetition.judged(found, before, partial(self._refined, image))
        found.reject_lonely(self._grid, self._threads)
        found.std[:] *= self._clipped
        self._follow(found)
        found.status[self._outside] = MASKED
        return found

    def start_from(self, u_px: F64 | None) -> None:
        """See `Method`."""
        self._last, self._motion = u_px, 0.0
        self._followed = self._fixed == OK

    def _use(self, grain: TextureCorrelation) -> None:
        """Make the refiner for a texture, and determine what correlation chance does not reach."""
        self._refiner = self._make(grain)
        grains = np.maximum(self._refiner.pixels / grain.grain_px2 - 4, 1.0)
        chance = np.sqrt(betaincinv(1.5, grains / 2, 1 - CHANCE))
        by_chance = np.minimum(chance, ALMOST_SURE)
        self._min_correlation = np.maximum(self._settings.min_correlation, by_chance)
        self._may_be_fine = grain.noise_share > MOSTLY_NOISE
        self._clipped = self._scatter(grain)

    def _refined(self, image: Array, start: F64, wanted: Bool) -> Estimate:
        """What the refiner makes of a start, with the status of each of the wanted points."""
        limits = self._points, self._most_passes
        found = self._refiner.refine(image, start, wanted, *limits)
        status = found.status
        status[~(found.zncc >= self._min_correlation)] = DECORRELATED
        status[~self._grid.is_inside(found.u, image.shape)] = OUT_OF_IMAGE
        np.copyto(status, self._fixed, where=self._fixed != OK)
        if self._points is not None:
            status[~self._points] = MASKED
        lost = wanted & ((status == NOT_CONVERGED) | (status == DECORRELATED))
        if lost.any():
            why = np.where(lost, OK, MASKED).astype(np.uint8)
            self._explain(image, found.u, why)
            np.copyto(status, why, where=lost & (why != OK))
        return found

    def _repaired(self, image: Array, found: Estimate) -> Estimate:
        """The estimate after lost points have started again from the points around them."""
        for _ in range(REPAIRS):
            ok = found.is_ok
            lost = (found.status == DECORRELATED) | (found.status == NOT_CONVERGED)
            if not lost.any() or not ok.any():
                break
            found = found.replaced(self._refined(image, filled(found.u, ok), lost), lost)
            if found.is_ok.sum() <= ok.sum():
                break
        return found

    def _with_odd_points(self, image: Array, found: Estimate) -> Estimate:
        """The estimate after another try of points that disagree with their neighbours."""
        return found.retried(
            np.where(found.is_ok, found.u, 0.0),
            np.maximum(ODD_PX, ODD_SDS * found.std),
            partial(self._refined_anew, image),
            with_lost=False,
        )

    def _refined_anew(self, image: Array, start: F64, wanted: Bool) -> Estimate:
        self._refiner.forget(wanted)
        return self._refined(image, start, wanted)

    def _searched(self, image: Array, before: F64) -> F64:
        """A first guess for the image from a search in reduced images; where the pattern repeats
        itself, as `Repetition.expected` says.
        """
        if self._repetition is None:
            return self._coarse.find(image)
        sure = self._usable & ~self._repetition.points
        found = self._coarse.find(image) if sure.any() else before
        return self._repetition.expected(found, sure, before)

    def _with_fine_texture(self, image: Array, found: Estimate, before: F64) -> Estimate:
        """A second try with what looked like noise taken for texture, for good if that recognises
        most points.
        """
        kept = self._refiner, self._min_correlation, self._clipped
        self._use(texture(self._image.astype(np.float32), is_noisy=False))
        other = self._refined(image, self._searched(image, before), self._usable)
        if not self._are_few(other):
            return other
        (self._refiner, self._min_correlation, self._clipped), self._may_be_fine = kept, True
        return found

    def _are_few(self, found: Estimate) -> bool:
        """Whether most of the points that can be recognised are lost."""
        return int(found.is_ok.sum()) < int(self._usable.sum()) // 2

    @property
    def _usable(self) -> Bool:
        """The points of the present image that can be recognised."""
        usable = self._fixed == OK
        return np.asarray(usable if self._points is None else usable & self._points)

    def _is_off(self, image: Array, start: F64, usable: Bool) -> bool:
        """Whether most of a few points cannot be refined from there, so that it is not worth
        trying with all of them.
        """
        few = np.zeros_like(usable)
        few[::PROBE, ::PROBE] = usable[::PROBE, ::PROBE]
        ok = self._refined(image, start, few).is_ok & few
        return int(ok.sum()) < int(few.sum()) // 2

    def _are_too_many_lost(self, found: Estimate) -> bool:
        followed = self._followed & self._usable
        newly = int((followed & ~found.is_ok).sum())
        return newly > max(4, MAX_NEWLY_LOST_SHARE * int(followed.sum())) or self._are_few(found)

    def _judge_reference(self) -> U8:
        """The status of the points that can never be recognised; OK elsewhere."""
        status = np.full(self._grid.shape, OK, np.uint8)
        self._explain(self._image, np.zeros((2, *self._grid.shape)), status)
        status[~(self._refiner.contrast > self._settings.min_contrast)] = LOW_CONTRAST
        status[self._refiner.pixels < LEAST_USABLE * self._grid.box_px**2] = MASKED
        return status

    def _explain(self, image: Array, u: F64, status: U8) -> None:
        """Give OK points the status LOW_CONTRAST or SATURATED if their displaced boxes are."""
        left = np.rint(self._grid.left + u[0]).astype(np.int64)
        top = np.rint(self._grid.top[:, None] + u[1]).astype(np.int64)
        box = self._grid.box_px
        limits = self._settings.min_contrast, float(end_of_scale(image, self._full_scale))
        most = self._settings.max_saturated * box * box
        explain(image, left, top, box, *limits, most, status)

    def _follow(self, found: Estimate) -> None:
        """Make this field, and its change since the last one, the start of the next search."""
        ok = found.is_ok
        if ok.any():
            # what was not measured has been continued from what was, if points share a prediction
            beside = (
                ~self._points if self._points is not None and self._refiner.is_shared else False
            )
            last = filled(found.u, ok | beside)
            both = (ok & self._followed) | beside
            self._motion = 0.0 if self._last is None else self._foreseen(last - self._last, both)
            self._last = last
        self._followed = ok

    def _foreseen(self, motion: F64, known: Bool) -> F64:
        """The motion to the next image: the last one.

        Where points share a prediction, only what five boxes share of it, not their noise.
        """
        if not self._refiner.is_shared:
            return np.where(known, motion, 0.0)
        width = 5 * self._grid.box_px // self._grid.step_px | 1
        edge = cv2.BORDER_REPLICATE
        smooth = filled(motion, known).astype(np.float32)
        return np.stack([cv2.blur(plane, (width, width), borderType=edge) for plane in smooth])


@compiled
def explain(
    image: Array,
    left: I64,
    top: I64,
    box: int,
    min_contrast: float,
    full_scale: float,
    max_saturated: float,
    status: U8,
) -> None:
    """Set OK points whose boxes lack contrast to LOW_CONTRAST, or are overexposed to SATURATED.

    The corners `left` and `top` of the boxes, and `status`, have shape (ny, nx). `min_contrast` is
    the least standard deviation of the grey levels, `max_saturated` the largest number of pixels
    at `full_scale` or above.
    """
    rows, columns = image.shape
    for i in range(status.shape[0]):
        for j in range(status.shape[1]):
            if status[i, j] != OK:
                continue
            y, x = min(max(top[i, j], 0), rows - box), min(max(left[i, j], 0), columns - box)
            total, squares, full = 0.0, 0.0, 0
            for r in range(y, y + box):
                for c in range(x, x + box):
                    # `float` of a kernel would keep single precision
                    g: float = np.float64(image[r, c])
                    total += g
                    squares += g * g
                    full += g >= full_scale
            n = box * box
            if math.sqrt(max(0.0, squares / n - (total / n) ** 2)) < min_contrast:
                status[i, j] = LOW_CONTRAST
            elif full > max_saturated:
                status[i, j] = SATURATED
