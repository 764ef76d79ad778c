"""What a tracker gives for each image, and what it may be given."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import cv2
import numpy as np
from numpy.typing import NDArray

from analysis.dic.grid import Grid

F32 = NDArray[np.float32]
F64 = NDArray[np.float64]
FURTHEST = 1e5  # px; no start is further away


@dataclass(frozen=True, slots=True)
class Field:
    """The displacement of every box of a grid between the reference and one image.

    Attributes
    ----------
    ux_px, uy_px : ndarray, shape (ny, nx), float32
        Displacement along x and y; NaN where `status` is not 0. The receiver owns all arrays.
    zncc : ndarray, shape (ny, nx), float32
        Zero-mean normalised cross-correlation of box and image there; NaN where `status` is not 0.
    status : ndarray, shape (ny, nx), uint8
        `Status` of each point.
    ux_std_px, uy_std_px : ndarray, shape (ny, nx), float32
        Standard uncertainty of the displacement, from the noise found in this image; NaN where
        `status` is not 0.
    iterations : ndarray, shape (ny, nx), uint8
        Steps that were taken to the place.
    """

    ux_px: F32
    uy_px: F32
    zncc: F32
    status: NDArray[np.uint8]
    ux_std_px: F32
    uy_std_px: F32
    iterations: NDArray[np.uint8]


class Tracker(Protocol):
    """Displacement fields of the images of a stream against one reference."""

    @property
    def grid(self) -> Grid:
        """The points at which the displacement is measured."""

    def track(self, image: NDArray[Any]) -> Field:
        """The displacement of every point between the reference and `image`.

        Raises
        ------
        ValueError
            The image differs from the reference in shape or type, or can not be used.
        """

    def start_from(self, ux_px: NDArray[Any], uy_px: NDArray[Any]) -> None:
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


def checked(image: NDArray[Any], name: str, like: NDArray[Any] | None = None) -> NDArray[Any]:
    """The image, if it can be correlated (with the image `like`).

    Raises
    ------
    ValueError
        Not one plane of uint8, uint16 or float32 grey levels, not finite, or of another shape than
        `like`.
    """
    if image.ndim != 2:
        raise ValueError(
            f"{name}: an array of shape {image.shape} found; use one grey level per pixel, shape"
            " (rows, columns)"
        )
    if image.dtype not in (np.uint8, np.uint16, np.float32):
        raise ValueError(
            f"{name}: grey levels of type {image.dtype} found; use uint8, uint16 or float32"
        )
    if image.dtype == np.float32 and not np.isfinite(image).all():
        raise ValueError(f"{name}: grey levels that are not finite found; replace them by numbers")
    if like is not None and image.shape != like.shape:
        (rows, columns), (height, width) = like.shape, image.shape
        raise ValueError(
            f"{name}: {width} x {height} px found, the reference has {columns} x {rows}; use one"
            " size"
        )
    return image


def filled(field: F64, valid: NDArray[np.bool_]) -> F64:
    """A field, shape (.., ny, nx), with the values around continued smoothly into the points that
    are not valid.

    Averages over 2 x 2 points, then over 2 x 2 of those and so on, until every hole has a value
    (Gortler et al. 1996, "pull-push"). All zero if no point is valid.
    """
    out = np.where(valid, field, 0.0)
    if valid.all() or valid.size == 1:
        return out
    size = tuple((n + 1) // 2 for n in valid.shape[::-1])
    weight = cv2.resize(valid.astype(np.float64), size, interpolation=cv2.INTER_AREA)
    known = weight > 0
    coarse = np.stack(
        [cv2.resize(plane, size, interpolation=cv2.INTER_AREA) for plane in out]
    ) / np.where(known, weight, 1.0)
    coarse = filled(coarse.reshape(len(out), *known.shape), known)
    fine = np.stack(
        [cv2.resize(plane, valid.shape[::-1], interpolation=cv2.INTER_LINEAR) for plane in coarse]
    )
    return np.where(valid, out, fine.reshape(out.shape))


def start_field(ux_px: NDArray[Any], uy_px: NDArray[Any], grid: Grid) -> F64:
    """Displacements to start from, shape (2, ny, nx), finite everywhere.

    Raises
    ------
    ValueError
        The field has another shape than the grid.
    """
    field = np.array([ux_px, uy_px], np.float64)
    if field.shape[1:] != grid.shape:
        raise ValueError(
            f"start field: shape {field.shape[1:]} found, the grid has {grid.shape}; use a field of"
            " this grid"
        )
    return filled(field, np.abs(field).max(axis=0) < FURTHEST)
