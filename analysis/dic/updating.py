"""Large displacements in steps: the reference is replaced by a later image when the first one is no
longer recognised.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from analysis.dic.field import Field, Tracker, filled
from analysis.dic.grid import Grid

F32 = NDArray[np.float32]


class UpdatingTracker:
    """Displacements from the first reference, added up over the references that replace it.

    The displacement of a point is what it had when the reference was replaced, plus what the place
    it had reached then has moved since, read linearly from the new field. The uncertainties add up
    in quadrature; that growth is the drift, and an upper bound: the noise of a reference that was
    replaced is in two of the terms, with opposite signs. A point that is lost at a replacement
    stays lost.

    Parameters
    ----------
    make : callable
        ``make(image)`` is a tracker against that image.
    reference : ndarray, shape (rows, columns)
    every : int or None
        Replace the reference after so many images; None: whenever the median correlation falls
        below `below`.
    below : float
    """

    def __init__(
        self,
        make: Callable[[NDArray[Any]], Tracker],
        reference: NDArray[Any],
        every: int | None,
        below: float,
    ) -> None:
        self._make, self._every, self._below = make, every, below
        self._tracker = make(reference)
        self._images = 0
        self.updates = 0
        self._base: Field | None = None  # of the present reference from the first

    @property
    def grid(self) -> Grid:
        """The points of the first reference at which the displacement is measured."""
        return self._tracker.grid

    @property
    def drift_px(self) -> float:
        """Root mean square of the standard uncertainty along x that the replacements have added so
        far.
        """
        return (
            0.0
            if self._base is None
            else float(np.sqrt(np.nanmean(self._base.ux_std_px.astype(np.float64) ** 2)))
        )

    def track(self, image: NDArray[Any]) -> Field:
        """See `Tracker`: the displacement since the first reference."""
        field = self._tracker.track(image)
        total = field if self._base is None else self._added(self._base, field)
        self._images += 1
        found = total.zncc[np.isfinite(total.zncc)]
        is_due = (
            self._images % self._every == 0
            if self._every
            else found.size > 0 and float(np.median(found)) < self._below
        )
        if is_due and found.size:
            new = self._make(image)
            new.start_from(np.zeros(self.grid.shape), np.zeros(self.grid.shape))
            self._tracker.close()
            self._tracker, self._base = new, total
            self.updates += 1
        return total

    def start_from(self, ux_px: NDArray[Any], uy_px: NDArray[Any]) -> None:
        """See `Tracker`; the field is the displacement since the first reference."""
        if self._base is None:
            self._tracker.start_from(ux_px, uy_px)
        else:
            self._tracker.start_from(
                np.asarray(ux_px) - self._base.ux_px, np.asarray(uy_px) - self._base.uy_px
            )

    def reset(self) -> None:
        """See `Tracker`; the references that were replaced stay replaced."""
        self._tracker.reset()

    def close(self) -> None:
        """End the threads. May be called twice."""
        self._tracker.close()

    def _added(self, base: Field, new: Field) -> Field:
        """The field `new`, read where `base` has brought the points, on top of `base`."""
        step = self.grid.step_px
        columns, rows = np.meshgrid(
            *(np.arange(n, dtype=np.float32) for n in self.grid.shape[::-1])
        )
        known = np.isfinite(base.ux_px)
        to_x, to_y = (
            (columns + np.where(known, base.ux_px, 0) / step).astype(np.float32),
            (rows + np.where(known, base.uy_px, 0) / step).astype(np.float32),
        )
        ok = new.status == 0

        def read(plane: F32) -> F32:
            whole = filled(plane[None].astype(np.float64), ok)[0].astype(np.float32)
            return np.asarray(
                cv2.remap(whole, to_x, to_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
            )

        here = cv2.remap(
            new.status.astype(np.float32),
            to_x,
            to_y,
            cv2.INTER_NEAREST,
            borderMode=cv2.BORDER_REPLICATE,
        ).astype(np.uint8)
        status = np.where(base.status == 0, here, base.status)
        lost = status != 0
        ux, uy, zncc = base.ux_px + read(new.ux_px), base.uy_px + read(new.uy_px), read(new.zncc)
        ux_std, uy_std = (
            np.hypot(base.ux_std_px, read(new.ux_std_px)),
            np.hypot(base.uy_std_px, read(new.uy_std_px)),
        )
        for plane in (ux, uy, zncc, ux_std, uy_std):
            plane[lost] = np.nan
        return replace(
            new, ux_px=ux, uy_px=uy, zncc=zncc, status=status, ux_std_px=ux_std, uy_std_px=uy_std
        )
