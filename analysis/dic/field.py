"""What a tracker returns for each image, and what may be asked of it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np

from analysis.arrays import F32, F64, U8, Array, Bool
from analysis.dic.status import OK
from analysis.grid import Grid as Grid  # noqa: PLC0414 (the package exports it)


@dataclass(frozen=True, slots=True)
class Field:
    """The displacement of every box of a grid between the reference and one image.

    Attributes
    ----------
    ux_px, uy_px : ndarray, shape (ny, nx), float32
        Displacement along x and y; NaN where `status` is not 0. The receiver owns all arrays.
    zncc : ndarray, shape (ny, nx), float32
        Zero-mean normalised cross-correlation of the box with the image at its displaced place; NaN
        where `status` is not 0.
    status : ndarray, shape (ny, nx), uint8
        `Status` of each point.
    ux_std_px, uy_std_px : ndarray, shape (ny, nx), float32
        Standard uncertainty of the displacement, from the noise of this image; NaN where `status`
        is not 0.
    iterations : ndarray, shape (ny, nx), uint8
        Iterations that led to the result.
    x_px, y_px : ndarray, shape (nx,) and (ny,), float64
        Centres of the boxes in the reference, those of the tracker's `Grid`.
    um_per_px : float
        Size of a pixel, um: `x_um`, `y_um`, `ux_um` and `uy_um` are the same in um; NaN where the
        scale was not given.

    Examples
    --------
    >>> import numpy as np, scipy, analysis
    >>> random = np.random.default_rng(0).uniform(0, 255, (40, 50))
    >>> grey = scipy.ndimage.gaussian_filter(random, 1.5, mode="wrap")
    >>> field = analysis.correlate(grey, np.roll(grey, 1, axis=1), box=12, step=6)
    >>> field.ux_px.shape == (len(field.y_px), len(field.x_px)) == (5, 7)
    True
    """

    ux_px: F32
    uy_px: F32
    zncc: F32
    status: U8
    ux_std_px: F32
    uy_std_px: F32
    iterations: U8
    x_px: F64
    y_px: F64
    um_per_px: float = math.nan

    @property
    def x_um(self) -> F64:
        """Centres of the boxes along x, shape (nx,), um."""
        return self.x_px * self.um_per_px

    @property
    def y_um(self) -> F64:
        """Centres of the boxes along y, shape (ny,), um."""
        return self.y_px * self.um_per_px

    @property
    def ux_um(self) -> F64:
        """Displacement along x, shape (ny, nx), um."""
        return self.ux_px * np.float64(self.um_per_px)

    @property
    def uy_um(self) -> F64:
        """Displacement along y, shape (ny, nx), um."""
        return self.uy_px * np.float64(self.um_per_px)

    @classmethod
    def of(cls, grid: Grid, u: Array, zncc: Array, std: Array, status: U8, iterations: U8) -> Field:
        """From displacement and uncertainty (x, y), shape (2, ny, nx), whose numbers count only
        where `status` is OK.
        """
        planes = np.array([*u, zncc, *std], np.float32)
        planes[:, status != OK] = np.nan
        ux, uy, zncc, ux_std, uy_std = planes
        return cls(ux, uy, zncc, status, ux_std, uy_std, iterations, grid.x_px, grid.y_px)


class Tracker(Protocol):
    """Displacement fields of the images of a stream against one reference, in pixels.

    In a ``with`` statement its threads end with it.

    Examples
    --------
    >>> import numpy as np, scipy, analysis
    >>> random = np.random.default_rng(0).uniform(0, 255, (40, 50))
    >>> grey = scipy.ndimage.gaussian_filter(random, 1.5, mode="wrap")
    >>> with analysis.open_tracker(analysis.Correlation(box=12, step=6), grey) as tracker:
    ...     fields = [tracker.track(np.roll(grey, n, axis=1)) for n in (1, 2)]
    >>> [round(float(np.nanmedian(field.ux_px)), 2) for field in fields]
    [1.0, 2.0]
    """

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def grid(self) -> Grid:
        """The points at which the displacement is measured."""

    @property
    def remarks(self) -> tuple[str, ...]:
        """Sentences about the reference that an operator should know."""
        return ()

    def track(self, image: Array, points: Bool | None = None, most_passes: int = 0) -> Field:
        """The displacement of every point between the reference and `image`.

        Parameters
        ----------
        points : ndarray of bool, shape (ny, nx), or None
            Those that are wanted, the others are MASKED; None: all.
        most_passes : int
            Of the method ``shared``; 0: as many as it needs.

        Raises
        ------
        ValueError
            The image differs from the reference in shape or type, or cannot be used.
        """

    def start_from(self, ux_px: Array, uy_px: Array) -> None:
        """Start the next search from this field, shape (ny, nx); where it is NaN or absurd, from
        the points around.

        Raises
        ------
        ValueError
            The field has another shape than the grid.
        """

    def reset(self) -> None:
        """Forget the last field: the next search is a cold start around zero displacement."""

    def close(self) -> None:
        """End the threads. May be called twice."""
