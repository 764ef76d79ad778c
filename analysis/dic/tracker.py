"""The displacement field of each image of a stream against one reference, by any method."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Protocol

import numpy as np

from analysis.arrays import F64, U8, Array, Bool
from analysis.dic.field import Field, Tracker
from analysis.dic.neighbours import contradicted, filled, neighbour_median
from analysis.dic.status import DECORRELATED, OK
from analysis.dic.threads import Threads
from analysis.grid import Grid

BRIGHTEST = 1e12  # grey level, of which single precision holds sums of squares
SUPPORT = 3  # valid neighbours that make their median worth starting from
MAX_START_PX = 1e5  # no search starts further away


@dataclass(frozen=True, slots=True)
class ReferenceImage:
    """The image at t = 0 and how it is to be correlated.

    Attributes
    ----------
    image : ndarray, shape (rows, columns), uint8, uint16 or float32
    grid : Grid
    threads : Threads
        The results do not depend on their number, to the bit.
    usable : ndarray of bool, shape (rows, columns), or None
        Pixels that may be used; None: all.
    """

    image: Array
    grid: Grid
    threads: Threads
    usable: Bool | None = None


@dataclass(frozen=True, slots=True)
class Estimate:
    """What a method measures in one image; the numbers count only where `status` is OK.

    Attributes
    ----------
    u, std : ndarray, shape (2, ny, nx)
        Displacement (x, y), finite or NaN, and its standard uncertainty, px.
    zncc : ndarray, shape (ny, nx)
    status, iterations : ndarray, shape (ny, nx), uint8
    """

    u: Array
    zncc: Array
    std: Array
    status: U8
    iterations: U8

    @property
    def is_ok(self) -> Bool:
        """Which points are OK, shape (ny, nx)."""
        return np.asarray(self.status == OK)

    def replaced(self, other: Estimate, where: Bool) -> Estimate:
        """This estimate, with the points `where` taken from another one."""
        names = [field.name for field in fields(self)]
        return Estimate(*(np.where(where, getattr(other, n), getattr(self, n)) for n in names))

    def retried(
        self,
        shift: Array,
        most_px: Array | float,
        search: Callable[[Array, Bool], Estimate],
        *,
        with_lost: bool,
    ) -> Estimate:
        """This estimate after another `search` of the points whose `shift` is more than `most_px`
        from the median of their neighbours, and of lost ones if they are to be tried as well: from
        that median, shape (2, ny, nx); what is OK is replaced only where it correlates better.
        """
        median, known = neighbour_median(shift, self.is_ok, SUPPORT)
        differs = (np.abs(shift - median) > most_px).any(axis=0)
        odd = known & np.where(self.is_ok, differs, with_lost)
        return self.improved(search(median, odd), odd) if odd.any() else self

    def improved(self, other: Estimate, tried: Bool) -> Estimate:
        """This one, with those of the points tried again that were lost or now correlate better."""
        return self.replaced(other, tried & (~self.is_ok | (other.zncc > self.zncc)))

    def reject_lonely(self, grid: Grid, threads: Threads) -> None:
        """Mark points with which no neighbour agrees, to 2 px or 20 % of the step, DECORRELATED.

        Their peak is a chance resemblance.
        """
        u, most, lonely = self.u.astype(np.float32), agreement_px(grid), np.empty(grid.shape, bool)
        threads.share(
            lambda rows: contradicted(u, self.status, most, rows, lonely),
            threads.bands(grid.shape[0]),
        )
        self.status[lonely] = DECORRELATED


def agreement_px(grid: Grid) -> float:
    """Difference between the displacements of neighbours up to which they agree: a strain of 20 %,
    or 2 px if that is more.
    """
    return max(2.0, grid.step_px / 5)


class Method(Protocol):
    """A way to measure displacements, prepared for one reference."""

    remarks: tuple[str, ...]  # see `Tracker`

    def measure(self, image: Array, points: Bool | None, most_passes: int) -> Estimate:
        """The displacement of every wanted point in the next image; see `Tracker.track`."""

    def start_from(self, u_px: F64 | None) -> None:
        """Start the next search from this displacement, shape (2, ny, nx), or, given None, from
        nothing.
        """


class ReferenceTracker(Tracker):
    """A `Tracker` of one reference by one method; both share its threads."""

    def __init__(self, reference: ReferenceImage, method: Method) -> None:
        self._reference, self._method = reference, method

    @property
    def grid(self) -> Grid:
        """See `Tracker`."""
        return self._reference.grid

    @property
    def remarks(self) -> tuple[str, ...]:
        """See `Tracker`."""
        return self._method.remarks

    def track(self, image: Array, points: Bool | None = None, most_passes: int = 0) -> Field:
        """See `Tracker`."""
        image = np.ascontiguousarray(checked(image, "image", self._reference.image)).view()
        image.flags.writeable = False  # one type, so that kernels compile once
        found = self._method.measure(image, points, most_passes)
        return Field.of(self.grid, found.u, found.zncc, found.std, found.status, found.iterations)

    def start_from(self, ux_px: Array, uy_px: Array) -> None:
        """See `Tracker`."""
        u = np.array([ux_px, uy_px], np.float64)
        if u.shape[1:] != self.grid.shape:
            raise ValueError(
                f"start field: shape {u.shape[1:]} found, the grid has {self.grid.shape}; use a"
                " field of this grid"
            )
        self._method.start_from(filled(u, np.abs(u).max(axis=0) < MAX_START_PX))

    def reset(self) -> None:
        """See `Tracker`."""
        self._method.start_from(None)

    def close(self) -> None:
        """See `Tracker`."""
        self._reference.threads.close()


def checked(image: Array, name: str, like: Array | None = None) -> Array:
    """The image, if it can be correlated, and if so with the image `like`; one of float64 as
    float32.

    Raises
    ------
    ValueError
        It is not one plane of finite uint8, uint16 or float grey levels, has masked pixels, or
        differs from `like` in shape or type.
    """
    if not isinstance(image, np.ndarray) or image.ndim != 2:
        found = f"shape {image.shape}" if isinstance(image, np.ndarray) else type(image).__name__
        raise ValueError(
            f"{name}: a 2-D array of grey levels, shape (rows, columns), is needed, found {found};"
            " use one grey level per pixel"
        )
    if np.ma.is_masked(image):
        raise ValueError(
            f"{name}: masked pixels found; give each a grey level, and leave out those that may"
            " not be used by the mask of the reference (usable) or by the region"
        )
    image = np.asarray(image)
    if image.dtype == np.float64:
        image = image.astype(np.float32)
    if image.dtype not in (np.uint8, np.uint16, np.float32):
        raise ValueError(
            f"{name}: grey levels of type {image.dtype} found; use uint8, uint16,"
            " float32 or float64"
        )
    if image.dtype == np.float32 and not np.abs(image).max(initial=0.0) < BRIGHTEST:
        raise ValueError(
            f"{name}: grey levels that are not finite, or beyond {BRIGHTEST:g}, found; replace them"
        )
    if like is not None and image.shape != like.shape:
        (rows, columns), (height, width) = like.shape, image.shape
        raise ValueError(
            f"{name}: {width} x {height} px found, the reference has {columns} x {rows}; use one"
            " size"
        )
    if like is not None and image.dtype != like.dtype:
        raise ValueError(
            f"{name}: grey levels of type {image.dtype} found, the reference has {like.dtype}; use"
            " one type"
        )
    return image
