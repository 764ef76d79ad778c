"""Displacement fields between plain image files, written as a table (CSV), as one HDF5 file or as
NumPy arrays (npz).
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TextIO

import cv2
import numpy as np
from numpy.typing import NDArray

from analysis.dic import Field, Grid, Status, Tracker, compile_kernels, open_tracker
from analysis.dic.updating import UpdatingTracker
from analysis.options import as_written, options
from analysis.settings import Correlation
from app.errors import UserError
from app.session.fields import FieldsWriter

SUFFIXES = (".h5", ".csv", ".npz")
COLUMNS = "frame,x_px,y_px,ux_px,uy_px,status,zncc,ux_std_px,uy_std_px,iterations"
PLANES = ("ux_px", "uy_px", "ux_std_px", "uy_std_px", "zncc", "status", "iterations")


@dataclass(frozen=True, slots=True)
class FilesSummary:
    """How a series of image files was correlated.

    Attributes
    ----------
    frames, points : int
        Images, and points of the grid.
    statuses : dict
        How many points had each status in all.
    points_per_s : float
        Points that were asked for, by the time on the clock that their correlation took: without
        compilation, reading and writing.
    ux_std_px, uy_std_px, zncc : float
        Medians over the points of an image (standard uncertainty, correlation), of the middle
        image; NaN if no point was found.
    updates : int
        How often the reference was replaced.
    drift_px : float
        Root mean square of the standard uncertainty of u_x that this has added.
    """

    output: Path
    frames: int
    points: int
    statuses: dict[str, int]
    points_per_s: float
    ux_std_px: float
    uy_std_px: float
    zncc: float
    updates: int
    drift_px: float


def correlate_files(
    reference: Path,
    images: list[Path],
    output: Path,
    correlation: Correlation = Correlation(),  # noqa: B008 - frozen
    *,
    mask: Path | None = None,
    roi: tuple[int, int, int, int] | None = None,
    overwrite: bool = False,
    on_progress: Callable[[str, float], None] | None = None,
) -> FilesSummary:
    """The displacement field of each image against the reference, in a file that appears only when
    it is complete.

    Parameters
    ----------
    output : Path
        ``.csv``: one line per point, `COLUMNS`, ``nan`` where a point is lost; ``.h5``: see
        `app.session.fields`; ``.npz``: x_px, y_px, `PLANES`, each (frames, ny, nx), and the texts
        status_names, images and settings (name, value). The arrays of an npz are kept in memory
        until the end.
    mask : Path, optional
        An image of the reference's size; its pixels that are not 0 may be used.
    roi : tuple of int, optional
        Left, top, right, bottom, px: only box centres in this region are asked for.
    on_progress : callable
        Called with what is being done and the share done, 0 to 1.

    Raises
    ------
    UserError
        A file or an option can not be used; nothing was written.
    """
    tell = on_progress or (lambda _text, _share: None)
    _check_names([reference, *images, *([mask] if mask else [])], len(images), output, overwrite)
    first = read_image(reference)
    usable = (
        None if mask is None else _like(read_image(mask), first, mask, reference, depth=False) != 0
    )
    _check_region(roi, first, reference)
    tell("preparing the correlation", 0.0)
    try:
        tracker = open_tracker(correlation, first, usable=usable, roi=roi)
    except ValueError as error:
        raise UserError(f"{reference}: {error}") from None
    texts = {"mask": str(mask or ""), "roi": " ".join(map(str, roi or ()))}
    record = {"reference": str(reference), **texts, **as_written(correlation)}
    account = _Account()
    with closing(tracker), _appearing(output, overwrite) as unfinished:
        compile_kernels(correlation, first.dtype)
        with _writer(
            output.suffix, unfinished, [str(path) for path in images], tracker.grid, record
        ) as writer:
            for n, path in enumerate(images):
                tell(path.name, n / len(images))
                writer.append(
                    account.timed(tracker, _like(read_image(path), first, path, reference))
                )
    tell("done", 1.0)
    return account.summary(output, len(images), tracker)


class _Account:
    """What becomes of the points of a series, and how long it takes."""

    def __init__(self) -> None:
        self._counts = np.zeros(len(Status), np.int64)
        self._medians: list[list[float]] = []
        self._seconds = 0.0

    def timed(self, tracker: Tracker, image: NDArray[Any]) -> Field:
        """The field of the next image."""
        began = time.perf_counter()
        field = tracker.track(image)
        self._seconds += time.perf_counter() - began
        self._counts += np.bincount(field.status.ravel(), minlength=len(Status))
        ok = field.status == Status.OK
        if ok.any():
            self._medians.append(
                [
                    float(np.median(plane[ok]))
                    for plane in (field.ux_std_px, field.uy_std_px, field.zncc)
                ]
            )
        return field

    def summary(self, output: Path, frames: int, tracker: Tracker) -> FilesSummary:
        """The account of the whole series."""
        asked = int(self._counts.sum() - self._counts[Status.MASKED])
        ux_std, uy_std, zncc = (
            np.median(self._medians, axis=0).tolist() if self._medians else [math.nan] * 3
        )
        return FilesSummary(
            output,
            frames,
            tracker.grid.shape[0] * tracker.grid.shape[1],
            {status.label: int(self._counts[status]) for status in Status},
            asked / self._seconds,
            ux_std,
            uy_std,
            zncc,
            tracker.updates if isinstance(tracker, UpdatingTracker) else 0,
            tracker.drift_px if isinstance(tracker, UpdatingTracker) else 0.0,
        )


def read_image(path: Path) -> NDArray[Any]:
    """The grey levels of an image file, shape (rows, columns), as they were stored: 8 or 16 bit or
    32-bit floats.

    A file with three equal channels (a grey palette, a grey picture saved as RGB) counts as grey.

    Raises
    ------
    UserError
        Not there, not an image, more than one image, or in colour.
    """
    try:
        data = np.fromfile(path, np.uint8)  # OpenCV itself opens only some paths on Windows
    except OSError as error:
        raise UserError(
            f"{path}: the file can not be read ({error.strerror or error}); check the name"
        ) from None
    found, pages = _decoded(data)
    if not found or not pages:
        raise UserError(f"{path}: not an image that can be read; give a PNG or TIFF file")
    if len(pages) > 1:
        raise UserError(
            f"{path}: {len(pages)} images found in one file; save each as a file of its own"
        )
    image: NDArray[Any] = np.asarray(pages[0])
    if image.ndim == 3 and image.shape[2] == 3 and (image == image[..., :1]).all():
        image = image[..., 0]
    if image.ndim != 2:
        raise UserError(
            f"{path}: a colour image ({image.shape[2]} channels); convert it to grey levels"
        )
    return np.ascontiguousarray(image)


def _decoded(data: NDArray[np.uint8]) -> tuple[bool, tuple[NDArray[Any], ...]]:
    """The images in an encoded file; OpenCV's own words about a damaged one are kept off the
    terminal.
    """
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        found, pages = cv2.imdecodemulti(data, cv2.IMREAD_UNCHANGED)
        return found, tuple(pages)
    except cv2.error:
        return False, ()
    finally:
        cv2.utils.logging.setLogLevel(level)


def _like(
    image: NDArray[Any], first: NDArray[Any], path: Path, reference: Path, *, depth: bool = True
) -> NDArray[Any]:
    if image.shape != first.shape or (depth and image.dtype != first.dtype):
        found, expected = (f"{a.shape[1]} x {a.shape[0]} {a.dtype}" for a in (image, first))
        what = "images of one size and depth" if depth else "a mask of its size"
        raise UserError(
            f"{path}: {found} found, the reference {reference} is {expected}; use {what}"
        )
    if not np.isfinite(image).all():
        raise UserError(f"{path}: grey levels that are not finite found; replace them by numbers")
    return image


def _check_region(
    roi: tuple[int, int, int, int] | None, first: NDArray[Any], reference: Path
) -> None:
    rows, columns = first.shape
    left, top, right, bottom = roi or (0, 0, columns, rows)
    if not (0 <= left < right <= columns and 0 <= top < bottom <= rows):
        raise UserError(
            f"{reference}: a region from ({left}, {top}) to ({right}, {bottom}) px asked of"
            f" {columns} x {rows} px;"
            " give left, top, right and bottom inside the image"
        )


def _check_names(paths: list[Path], images: int, output: Path, overwrite: bool) -> None:
    if not images:
        raise UserError(
            f"{paths[0]}: no images to correlate with it; name at least one after the reference"
        )
    if output.suffix not in SUFFIXES:
        raise UserError(
            f"{output}: the ending '{output.suffix}' is not known; use one of {', '.join(SUFFIXES)}"
        )
    if output.is_dir() or not output.parent.is_dir():
        raise UserError(f"{output}: not a file name in an existing folder; choose another place")
    if output.exists() and not overwrite:
        raise UserError(
            f"{output}: a file of that name exists; choose another name or ask to overwrite it"
        )
    for path in paths:
        if not path.is_file():
            raise UserError(f"{path}: there is no such file; check the name")


@contextmanager
def _appearing(output: Path, overwrite: bool) -> Iterator[Path]:
    """A name beside `output` to write to; it becomes `output` at the end, or disappears if anything
    fails.
    """
    unfinished = output.with_name(f"{output.name}.{os.getpid()}.part")
    try:
        yield unfinished
        if output.exists() and not overwrite:
            raise UserError(
                f"{output}: a file of that name has appeared meanwhile; choose another name or ask"
                " to overwrite it"
            )
        unfinished.replace(output)
    except OSError as error:
        raise UserError(
            f"{output}: can not be written ({error.strerror or error}); choose another place"
        ) from None
    finally:
        unfinished.unlink(missing_ok=True)


class _Writer(Protocol):
    def append(self, field: Field, /) -> None: ...


@contextmanager
def _writer(
    suffix: str, path: Path, images: list[str], grid: Grid, settings: dict[str, Any]
) -> Iterator[_Writer]:
    labels = [status.label for status in Status]
    if suffix == ".csv":
        with path.open("x", encoding="utf-8", newline="\n") as file:
            yield _Table(file, grid, labels)
    elif suffix == ".h5":
        units = {name: option.unit or "1" for name, option in options(Correlation).items()}
        with FieldsWriter(path, images, grid.x_px, grid.y_px, labels, settings, units) as writer:
            yield writer
    else:
        fields: list[Field] = []
        yield fields
        arrays: dict[str, Any] = {
            name: np.stack([getattr(field, name) for field in fields]) for name in PLANES
        }
        arrays |= {"x_px": grid.x_px, "y_px": grid.y_px, "status_names": labels, "images": images}
        arrays["settings"] = [(name, str(value)) for name, value in settings.items()]
        with path.open("xb") as file:
            np.savez(file, **arrays)


class _Table:
    """One line per point of each field."""

    def __init__(self, file: TextIO, grid: Grid, labels: list[str]) -> None:
        self._file, self._frame, self._labels = file, 0, labels
        self._places = [f"{x:.1f},{y:.1f}" for y in grid.y_px for x in grid.x_px]
        file.write(COLUMNS + "\n")

    def append(self, field: Field, /) -> None:
        """Write the field of the next image."""
        self._frame += 1
        for place, *values in zip(
            self._places, *(getattr(field, name).flat for name in PLANES), strict=True
        ):
            ux, uy, ux_std, uy_std, zncc, status, iterations = values
            found = f"{ux:.6f},{uy:.6f},{self._labels[status]},{zncc:.6f},{ux_std:.6f},{uy_std:.6f},{iterations}"
            self._file.write(f"{self._frame},{place},{found}\n")
