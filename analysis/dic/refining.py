"""Trackers that refine a first guess: the last field, or a search in reduced images where that does
not lead to the boxes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv

from analysis.dic import direct
from analysis.dic.coarse import CoarseSearch
from analysis.dic.field import Field, checked, filled, start_field
from analysis.dic.grid import Grid
from analysis.dic.spectrum import Texture, texture
from analysis.dic.status import Status, explain

F64 = NDArray[np.float64]
Bool = NDArray[np.bool_]
# share of the points that were followed so far; if more are lost at once, they are searched for in
# the whole image
LOST = 0.02
CHANCE = 1e-4  # probability that a box which is not there is taken for found
ALMOST_SURE = 0.95  # a correlation that is enough however small the box
# power of the noise in units of the texture's, above which the texture may be finer than thought
MOSTLY_NOISE = 0.3
LEAST_USABLE = 0.5  # share of the pixels of a box
# every so many points along both axes are tried first where points are refined one by one
PROBE = 6
REPAIRS = 3  # rounds at most in which lost points start from their neighbours
FULL_SCALE = {"uint8": 255.0, "uint16": 65535.0}


@dataclass(frozen=True, slots=True)
class Estimate:
    """What a method finds, (ny, nx) each and before it is judged; NaN where it found nothing."""

    u: F64  # (2, ny, nx), finite
    zncc: F64
    std: F64  # (2, ny, nx)
    at_rest: Bool  # the last step was short
    iterations: NDArray[np.uint8]


class Method(Protocol):
    """A way to refine displacements, prepared for one reference."""

    pixels: F64  # (ny, nx) usable pixels of each box
    contrast: F64  # (ny, nx) standard deviation of the reference's grey levels in each box
    is_shared: bool  # points depend on each other, so that all are found even if few are asked for

    def refine(self, image: NDArray[Any], start: F64, wanted: Bool) -> Estimate:
        """The displacement of at least the wanted points from a guess, shape (2, ny, nx), finite."""


Share = Callable[[Callable[[tuple[int, int]], None], Sequence[tuple[int, int]]], None]
MakeMethod = Callable[..., Method]  # (image, texture, grid, usable, share, bands)


class RefiningTracker:
    """Displacement fields by refinement of a first guess, with judgement, repair and search of lost
    points.

    Every image starts from the field before and its change since the one before that. Points that
    are lost start again from the points around; if many of the points that were followed are lost
    at once, all are searched for in reduced images. A point that was lost is asked again in every
    image. A point counts as found only if its correlation is higher than chance explains (at a
    level of 1e-4, given the number of grains of the texture in a box) and a neighbour agrees with
    it.

    Parameters
    ----------
    reference : ndarray, shape (rows, columns), uint8, uint16 or float32
        The image at t = 0.
    box, step : int
        Side of the correlation boxes and pitch of their grid, in pixels.
    make : callable
        Makes the method; see `analysis.dic.trackers`.
    search : int
        Largest jump in pixels from one image to the next that must be found.
    min_correlation, min_contrast : float
        See `DirectTracker`.
    max_saturated : float
        Share of the pixels of a box that may be at the upper end of the grey scale.
    full_scale : int or None
        That end; None: 255 or 65535, as the type of the images says. Cameras of 12 bit give 4095.
    usable : ndarray of bool, shape (rows, columns), or None
        Pixels that may be used; None: all. Boxes with too few of them are MASKED.
    roi : tuple of int, or None
        Left, top, right, bottom, in pixels: points outside are MASKED. What is found inside does
        not depend on it, to the bit, except for points that were repaired from points outside.
    threads : int
        The result does not depend on it, to the bit.

    Raises
    ------
    ValueError
        The image, the mask, the box or the step can not be used.
    """

    def __init__(
        self,
        reference: NDArray[Any],
        box: int,
        step: int,
        make: MakeMethod,
        *,
        search: int = 64,
        min_correlation: float = 0.5,
        min_contrast: float = 2.0,
        max_saturated: float = 0.2,
        full_scale: int | None = None,
        usable: Bool | None = None,
        roi: tuple[int, int, int, int] | None = None,
        threads: int = 2,
    ) -> None:
        image = np.array(checked(reference, "reference"), order="C")
        if search < 1 or threads < 1:
            raise ValueError(
                f"tracker: search of {search} px on {threads} threads asked; use 1 or more of both"
            )
        if usable is not None and usable.shape != image.shape:
            raise ValueError(
                f"mask: shape {usable.shape} found, the reference has {image.shape}; use a mask of"
                " its size"
            )
        self.grid = Grid.cover((image.shape[0], image.shape[1]), box, step)
        self._image = image
        self._pool = ThreadPoolExecutor(threads - 1, "dic") if threads > 1 else None
        self._make = partial(
            make, image, grid=self.grid, usable=usable, share=self._share, bands=threads
        )
        self._use(texture(image.astype(np.float32)), min_correlation)
        self._coarse = CoarseSearch(image, self.grid, search, threads)
        self._min_contrast, self._tolerance = min_contrast, max(2.0, step / 5)
        self._full = full_scale or FULL_SCALE.get(str(image.dtype), math.inf)
        self._max_saturated = max_saturated * box * box
        self._fixed = self._judge_reference()
        x, y = np.meshgrid(self.grid.x_px, self.grid.y_px)
        left, top, right, bottom = roi or (0, 0, image.shape[1], image.shape[0])
        self._outside = (x < left) | (x > right) | (y < top) | (y > bottom)
        if (self._outside | (self._fixed == Status.MASKED)).all():
            raise ValueError(
                f"tracker: no box of {box} px lies in the region and mask asked for; widen them"
            )
        if not self._method.is_shared:
            self._fixed[self._outside] = Status.MASKED
        self._last: F64 | None = None
        self._motion: F64 | float = 0.0  # from one image to the next
        self._followed = np.zeros(self.grid.shape, np.bool_)

    def track(self, image: NDArray[Any]) -> Field:
        """The displacement of every point between the reference and `image`.

        Raises
        ------
        ValueError
            The image differs from the reference in shape or type, or can not be used.
        """
        checked(image, "image", like=self._image)
        if image.dtype != self._image.dtype:
            raise ValueError(
                f"image: grey levels of type {image.dtype} found, the reference has"
                f" {self._image.dtype}; use one type"
            )
        image = np.ascontiguousarray(image).view()
        image.flags.writeable = False  # one type, so that kernels compile once
        usable = self._fixed == Status.OK
        start = self._coarse.find(image) if self._last is None else self._last + self._motion
        if (
            self._last is not None
            and not self._method.is_shared
            and self._is_off(image, start, usable)
        ):
            start = self._coarse.find(image)
        found = self._method.refine(image, start, usable)
        status = self._judge(image, found)
        if self._last is not None and self._too_many_lost(status):
            lost = usable & (status != Status.OK)
            found, status = self._again(
                image, found, np.where(lost, self._coarse.find(image), found.u), lost
            )
        if self._may_be_fine and self._are_few(status):
            found, status = self._with_fine_texture(image, found, status)
        for _ in range(REPAIRS):
            ok, lost = (
                status == Status.OK,
                (status == Status.DECORRELATED) | (status == Status.NOT_CONVERGED),
            )
            if not lost.any() or not ok.any():
                break
            found, status = self._again(image, found, filled(found.u, ok), lost)
            if (status == Status.OK).sum() <= ok.sum():
                break
        return self._finish(found, status)

    def start_from(self, ux_px: NDArray[Any], uy_px: NDArray[Any]) -> None:
        """Start the next search from this field, shape (ny, nx); where it is NaN, from the points
        around.

        Raises
        ------
        ValueError
            The field has another shape than the grid.
        """
        self._last, self._motion = start_field(ux_px, uy_px, self.grid), 0.0
        self._followed = self._fixed == Status.OK

    def reset(self) -> None:
        """Forget the last field: the next search is a cold start around zero displacement."""
        self._last, self._motion = None, 0.0

    def close(self) -> None:
        """End the threads. May be called twice."""
        self._coarse.close()
        if self._pool is not None:
            self._pool.shutdown()

    def _share(
        self, work: Callable[[tuple[int, int]], None], bands: Sequence[tuple[int, int]]
    ) -> None:
        """Do the first band here while the other threads do the rest."""
        others = [] if self._pool is None else [self._pool.submit(work, band) for band in bands[1:]]
        for band in bands[: len(bands) - len(others)]:
            work(band)
        for other in others:
            other.result()

    def _again(
        self, image: NDArray[Any], found: Estimate, start: F64, lost: Bool
    ) -> tuple[Estimate, NDArray[np.uint8]]:
        """Refine the lost points from another start; the others keep what was found."""
        new = self._method.refine(image, start, lost)
        names = ("u", "zncc", "std", "at_rest", "iterations")
        both = Estimate(
            *(np.where(lost, getattr(new, name), getattr(found, name)) for name in names)
        )
        return both, self._judge(image, both)

    def _use(self, grain: Texture, min_correlation: float) -> None:
        """Make the method for a texture, and say what correlation it does not reach by chance."""
        self._method = self._make(grain)
        grains = np.maximum(self._method.pixels / grain.grain_px2 - 4, 1.0)
        chance = np.sqrt(betaincinv(1.5, grains / 2, 1 - CHANCE))
        self._least, self._min_correlation = (
            min_correlation,
            np.maximum(min_correlation, np.minimum(chance, ALMOST_SURE)),
        )
        self._may_be_fine = grain.noise_share > MOSTLY_NOISE

    def _with_fine_texture(
        self, image: NDArray[Any], found: Estimate, status: NDArray[np.uint8]
    ) -> tuple[Estimate, NDArray[np.uint8]]:
        """A second try with what looked like noise taken for texture, for good if it finds most
        points.
        """
        before = self._method, self._min_correlation
        self._use(texture(self._image.astype(np.float32), is_noisy=False), self._least)
        other = self._method.refine(image, self._coarse.find(image), self._fixed == Status.OK)
        new = self._judge(image, other)
        if not self._are_few(new):
            return other, new
        (self._method, self._min_correlation), self._may_be_fine = before, True
        return found, status

    def _are_few(self, status: NDArray[np.uint8]) -> bool:
        """Whether most of the points that can be found are lost."""
        return int((status == Status.OK).sum()) < int((self._fixed == Status.OK).sum()) // 2

    def _is_off(self, image: NDArray[Any], start: F64, usable: Bool) -> bool:
        """Whether most of a few points can not be refined from there, so that it is not worth
        trying with all of them.
        """
        few = np.zeros_like(usable)
        few[::PROBE, ::PROBE] = usable[::PROBE, ::PROBE]
        ok = self._judge(image, self._method.refine(image, start, few)) == Status.OK
        return int((ok & few).sum()) < int(few.sum()) // 2

    def _too_many_lost(self, status: NDArray[np.uint8]) -> bool:
        newly = int((self._followed & (status != Status.OK)).sum())
        return newly > max(4, LOST * int(self._followed.sum())) or self._are_few(status)

    def _judge_reference(self) -> NDArray[np.uint8]:
        """The status of the points that can never be found; OK elsewhere."""
        status = np.full(self.grid.shape, Status.OK, np.uint8)
        self._explain(self._image, np.zeros((2, *self.grid.shape)), status)
        status[~(self._method.contrast > self._min_contrast)] = Status.LOW_CONTRAST
        status[self._method.pixels < LEAST_USABLE * self.grid.box_px**2] = Status.MASKED
        return status

    def _judge(self, image: NDArray[Any], found: Estimate) -> NDArray[np.uint8]:
        """What became of each point."""
        status = np.full(self.grid.shape, Status.OK, np.uint8)
        status[~found.at_rest] = Status.NOT_CONVERGED
        status[~(found.zncc >= self._min_correlation)] = Status.DECORRELATED
        status[~self.grid.is_inside(found.u, image.shape)] = Status.OUT_OF_IMAGE
        np.copyto(status, self._fixed, where=self._fixed != Status.OK)
        lost = (status == Status.NOT_CONVERGED) | (status == Status.DECORRELATED)
        if lost.any():
            why = np.where(lost, Status.OK, Status.MASKED).astype(np.uint8)
            self._explain(image, found.u, why)
            np.copyto(status, why, where=lost & (why != Status.OK))
        return status

    def _explain(self, image: NDArray[Any], u: F64, status: NDArray[np.uint8]) -> None:
        """Set the status of points that are OK to LOW_CONTRAST or SATURATED if the displaced boxes
        are.
        """
        left, top = (
            np.rint(place).astype(np.int64)
            for place in (self.grid.left + u[0], self.grid.top[:, None] + u[1])
        )
        explain(
            image,
            left,
            top,
            self.grid.box_px,
            self._min_contrast,
            self._full,
            self._max_saturated,
            status,
        )

    def _foreseen(self, motion: F64, known: Bool) -> F64:
        """The motion to the next image: the last one.

        Where points share a prediction only what five boxes share, not their noise.
        """
        if not self._method.is_shared:
            return np.where(known, motion, 0.0)
        width = 5 * self.grid.box_px // self.grid.step_px | 1
        smooth = filled(motion, known).astype(np.float32)
        return np.stack(
            [cv2.blur(plane, (width, width), borderType=cv2.BORDER_REPLICATE) for plane in smooth]
        )

    def _finish(self, found: Estimate, status: NDArray[np.uint8]) -> Field:
        """Take lonely points for lost, keep the rest for the next start and hand it out."""
        values = np.array([*found.u, found.zncc, *found.std], np.float32)
        status[direct.contradicted(values[:2], status, self._tolerance)] = Status.DECORRELATED
        ok = status == Status.OK
        if ok.any():
            last = filled(found.u, ok)
            both = ok & self._followed
            self._motion = 0.0 if self._last is None else self._foreseen(last - self._last, both)
            self._last = last
        self._followed = ok
        status[self._outside] = Status.MASKED
        values[:, status != Status.OK] = np.nan
        ux, uy, zncc, ux_std, uy_std = values
        return Field(ux, uy, zncc, status, ux_std, uy_std, found.iterations)
