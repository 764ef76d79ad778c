"""Where the displacement is measured: the square lattice of correlation boxes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.arrays import F64, I64, Array, Bool


@dataclass(frozen=True, slots=True)
class Grid:
    """The centres of the correlation boxes, in pixels; (0, 0) is the centre of the top-left pixel.

    Attributes
    ----------
    box_px, step_px : int
        Side of a box and distance between neighbouring centres.
    x_px : ndarray, shape (nx,), float64
        Centres along x. A box covers the pixels from ``x - (box - 1) / 2`` to
        ``x + (box - 1) / 2``, so that the centre of an even box lies between two pixels.
    y_px : ndarray, shape (ny,), float64
        Centres along y (down).
    """

    box_px: int
    step_px: int
    x_px: F64
    y_px: F64

    @classmethod
    def cover(cls, shape: tuple[int, ...], box: int, step: int) -> Grid:
        """The largest grid in an image of `shape` (rows, columns), centred in it.

        One pixel is left free all round, so that a point which has not moved has its eight
        neighbouring correlations.

        Raises
        ------
        ValueError
            The box or the step is not positive, or the image is too small for a single box.
        """
        if box < 2 or step < 1:
            raise ValueError(
                f"grid: a box of {box} px and a step of {step} px were requested; use a box of 2 px"
                " or more and a step of 1 px or more"
            )
        if min(shape) < box + 2:
            raise ValueError(
                f"grid: a box of {box} px and one pixel around it do not fit the {shape[1]} x"
                f" {shape[0]} image; use a smaller box"
            )
        y, x = (_centres(size, box, step) for size in shape)
        return cls(box, step, x, y)

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns of a field on this grid, (ny, nx)."""
        return len(self.y_px), len(self.x_px)

    @property
    def left(self) -> I64:
        """First pixel column of the boxes, shape (nx,)."""
        return np.rint(self.x_px - (self.box_px - 1) / 2).astype(np.int64)

    @property
    def top(self) -> I64:
        """First pixel row of the boxes, shape (ny,)."""
        return np.rint(self.y_px - (self.box_px - 1) / 2).astype(np.int64)

    def is_inside(self, u_px: F64, shape: tuple[int, ...]) -> Bool:
        """Whether each box, displaced by u of shape (2, ny, nx), lies wholly in an image of `shape`
        (rows, columns).
        """
        x, y = self.left + u_px[0], self.top[:, None] + u_px[1]
        fits_x = (x >= 0) & (x <= shape[1] - self.box_px)
        return np.asarray(fits_x & (y >= 0) & (y <= shape[0] - self.box_px))

    def box_sums(self, plane: Array) -> F64:
        """Sums of an image, shape (rows, columns), over the pixels of each box, shape (ny, nx)."""
        return self.sums_of(integral(plane))

    def sums_of(self, total: F64) -> F64:
        """As `box_sums`, of the `integral` of an image."""
        top, left, box = self.top[:, None], self.left, self.box_px
        below = total[top + box, left + box] - total[top, left + box]
        return below - total[top + box, left] + total[top, left]


def integral(plane: Array) -> F64:
    """Sums of an image over all pixels above and to the left, of one row and column more."""
    import cv2  # a bench lays out its grid without it

    return np.asarray(cv2.integral(plane, sdepth=cv2.CV_64F))


def _centres(size: int, box: int, step: int) -> F64:
    intervals, spare = divmod(size - 2 - box, step)
    first = 1 + spare // 2
    return first + (box - 1) / 2 + step * np.arange(intervals + 1, dtype=np.float64)
