"""Large displacements in steps: the reference is replaced by a later image when the first one is no
longer recognised.
"""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np

from analysis.arrays import F32, Array, Bool
from analysis.dic.field import Field, Tracker
from analysis.dic.neighbours import filled
from analysis.dic.status import OK
from analysis.grid import Grid


class UpdatingTracker(Tracker):
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

    Attributes
    ----------
    updates : int
        How often the reference has been replaced.
    """

    def __init__(
        self, make: Callable[[Array], Tracker], reference: Array, every: int | None, below: float
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
    def remarks(self) -> tuple[str, ...]:
        """See `Tracker`; of the present reference."""
        return self._tracker.remarks

    @property
    def drift_px(self) -> float:
        """Root mean square of the standard uncertainty along x that the replacements have added so
        far.
        """
        if self._base is None:
            return 0.0
        return float(np.sqrt(np.nanmean(self._base.ux_std_px.astype(np.float64) ** 2)))

    def track(self, image: Array, points: Bool | None = None, most_passes: int = 0) -> Field:
        """See `Tracker`: the displacement since the first reference."""
        field = self._tracker.track(image, points, most_passes)
        total = field if self._base is None else self._added(self._base, field)
        self._images += 1
        found = total.zncc[np.isfinite(total.zncc)]
        if self._every:
            is_due = self._images % self._every == 0
        else:
            is_due = found.size > 0 and float(np.median(found)) < self._below
        if is_due and found.size:
            new = self._make(image)
            new.start_from(np.zeros(self.grid.shape), np.zeros(self.grid.shape))
            self._tracker.close()
            self._tracker, self._base = new, total
            self.updates += 1
        return total

    def start_from(self, ux_px: Array, uy_px: Array) -> None:
        """See `Tracker`; the field is the displacement since the first reference."""
        if self._base is not None:
            ux_px = np.asarray(ux_px) - self._base.ux_px
            uy_px = np.asarray(uy_px) - self._base.uy_px
        self._tracker.start_from(ux_px, uy_px)

    def reset(self) -> None:
        """See `Tracker`; the references that were replaced stay replaced."""
        self._tracker.reset()

    def close(self) -> None:
        """See `Tracker`."""
        self._tracker.close()

    def _added(self, base: Field, new: Field) -> Field:
        """The field `new`, read where `base` has brought the points, on top of `base`."""
        step = self.grid.step_px
        rows, columns = np.indices(self.grid.shape, np.float32)
        known = np.isfinite(base.ux_px)
        to_x = (columns + np.where(known, base.ux_px, 0) / step).astype(np.float32)
        to_y = (rows + np.where(known, base.uy_px, 0) / step).astype(np.float32)
        ok, edge = new.status == OK, {"borderMode": cv2.BORDER_REPLICATE}

        def read(plane: F32) -> F32:
            whole = filled(plane[None].astype(np.float64), ok)[0].astype(np.float32)
            return np.asarray(cv2.remap(whole, to_x, to_y, cv2.INTER_LINEAR, **edge))

        here = cv2.remap(new.status.astype(np.float32), to_x, to_y, cv2.INTER_NEAREST, **edge)
        status = np.where(base.status == OK, here.astype(np.uint8), base.status)
        u = np.array([base.ux_px + read(new.ux_px), base.uy_px + read(new.uy_px)])
        added = read(new.ux_std_px), read(new.uy_std_px)
        std = np.hypot([base.ux_std_px, base.uy_std_px], added)
        return Field.of(self.grid, u, read(new.zncc), std, status, new.iterations)
