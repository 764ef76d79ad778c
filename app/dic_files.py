"""Displacement fields between plain image files, written as a table (CSV) or as one HDF5 file."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol, TextIO

import cv2
import numpy as np
from numpy.typing import NDArray

from analysis.dic import DirectTracker, Grid, Status, compile_kernels
from app.errors import UserError
from app.session.fields import FieldsWriter

SUFFIXES = (".h5", ".csv")
COLUMNS = "frame,x_px,y_px,ux_px,uy_px,status,zncc"


@dataclass(frozen=True, slots=True)
class FilesSummary:
    """How a series of image files was correlated: images, points per field, and how many points had each status in all."""

    output: Path
    frames: int
    points: int
    statuses: dict[str, int]


def correlate_files(
    reference: Path,
    images: list[Path],
    output: Path,
    *,
    box: int = 20,
    step: int = 10,
    search: int = 16,
    threads: int = 2,
    overwrite: bool = False,
    on_progress: Callable[[str, float], None] | None = None,
) -> FilesSummary:
    """The displacement field of each image against the reference, in a file that appears only when it is complete.

    Parameters
    ----------
    output : Path
        ``.csv``: one line per point, `COLUMNS`, ``nan`` where a point is lost; ``.h5``: see `app.session.fields`.
    on_progress : callable
        Called with what is being done and the share done, 0 to 1.

    Raises
    ------
    UserError
        A file or an option can not be used; nothing was written.
    """
    tell = on_progress or (lambda _text, _share: None)
    _check_names(reference, images, output, overwrite)
    first = read_image(reference)
    try:
        Grid.cover((first.shape[0], first.shape[1]), box, step)
        tell("preparing the correlation", 0.0)
        compile_kernels()
        tracker = DirectTracker(first, box, step, search=search, threads=threads)
    except ValueError as error:
        raise UserError(f"{reference}: {error}") from None
    settings = {"box": box, "step": step, "search": search}
    counts = np.zeros(len(Status), np.int64)
    with closing(tracker), _appearing(output, overwrite) as unfinished:
        names = [str(path) for path in images]
        with _writer(output.suffix, unfinished, str(reference), names, tracker.grid, settings) as writer:
            for n, path in enumerate(images):
                tell(path.name, n / len(images))
                field = tracker.track(_like(read_image(path), first, path, reference))
                counts += np.bincount(field.status.ravel(), minlength=len(Status))
                writer.append(field.ux_px, field.uy_px, field.zncc, field.status)
    tell("done", 1.0)
    statuses = {status.label: int(counts[status]) for status in Status}
    return FilesSummary(output, len(images), tracker.grid.shape[0] * tracker.grid.shape[1], statuses)


def read_image(path: Path) -> NDArray[Any]:
    """The grey levels of an image file, shape (rows, columns), as they were stored: 8 or 16 bit or 32-bit floats.

    A file with three equal channels (a grey palette, a grey picture saved as RGB) counts as grey.

    Raises
    ------
    UserError
        Not there, not an image, more than one image, or in colour.
    """
    try:
        data = np.fromfile(path, np.uint8)  # OpenCV itself opens only some paths on Windows
    except OSError as error:
        raise UserError(f"{path}: the file can not be read ({error.strerror or error}); check the name") from None
    found, pages = _decoded(data)
    if not found or not pages:
        raise UserError(f"{path}: not an image that can be read; give a PNG or TIFF file")
    if len(pages) > 1:
        raise UserError(f"{path}: {len(pages)} images found in one file; save each as a file of its own")
    image: NDArray[Any] = np.asarray(pages[0])
    if image.ndim == 3 and image.shape[2] == 3 and (image == image[..., :1]).all():
        image = image[..., 0]
    if image.ndim != 2:
        raise UserError(f"{path}: a colour image ({image.shape[2]} channels); convert it to grey levels")
    return np.ascontiguousarray(image)


def _decoded(data: NDArray[np.uint8]) -> tuple[bool, tuple[NDArray[Any], ...]]:
    """The images in an encoded file; OpenCV's own words about a damaged one are kept off the terminal."""
    level = cv2.utils.logging.getLogLevel()
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    try:
        found, pages = cv2.imdecodemulti(data, cv2.IMREAD_UNCHANGED)
        return found, tuple(pages)
    except cv2.error:
        return False, ()
    finally:
        cv2.utils.logging.setLogLevel(level)


def _like(image: NDArray[Any], first: NDArray[Any], path: Path, reference: Path) -> NDArray[Any]:
    if (image.shape, image.dtype) != (first.shape, first.dtype):
        found, expected = (f"{a.shape[1]} x {a.shape[0]} {a.dtype}" for a in (image, first))
        raise UserError(f"{path}: {found} found, the reference {reference} is {expected}; use images of one size and depth")
    if not np.isfinite(image).all():
        raise UserError(f"{path}: grey levels that are not finite found; replace them by numbers")
    return image


def _check_names(reference: Path, images: list[Path], output: Path, overwrite: bool) -> None:
    if not images:
        raise UserError(f"{reference}: no images to correlate with it; name at least one after the reference")
    if output.suffix not in SUFFIXES:
        raise UserError(f"{output}: the ending '{output.suffix}' is not known; use one of {', '.join(SUFFIXES)}")
    if output.is_dir() or not output.parent.is_dir():
        raise UserError(f"{output}: not a file name in an existing folder; choose another place")
    if output.exists() and not overwrite:
        raise UserError(f"{output}: a file of that name exists; choose another name or ask to overwrite it")
    for path in (reference, *images):
        if not path.is_file():
            raise UserError(f"{path}: there is no such file; check the name")


@contextmanager
def _appearing(output: Path, overwrite: bool) -> Iterator[Path]:
    """A name beside `output` to write to; it becomes `output` at the end, or disappears if anything fails."""
    unfinished = output.with_name(f"{output.name}.{os.getpid()}.part")
    try:
        yield unfinished
        if output.exists() and not overwrite:
            raise UserError(f"{output}: a file of that name has appeared meanwhile; choose another name or ask to overwrite it")
        unfinished.replace(output)
    except OSError as error:
        raise UserError(f"{output}: can not be written ({error.strerror or error}); choose another place") from None
    finally:
        unfinished.unlink(missing_ok=True)


class _Writer(Protocol):
    def append(self, ux_px: Any, uy_px: Any, zncc: Any, status: Any) -> None: ...


@contextmanager
def _writer(suffix: str, path: Path, reference: str, images: list[str], grid: Grid, settings: dict[str, int]) -> Iterator[_Writer]:
    if suffix == ".csv":
        with path.open("x", encoding="utf-8", newline="\n") as file:
            yield _Table(file, grid)
    else:
        labels = [status.label for status in Status]
        with FieldsWriter(path, reference, images, grid.x_px, grid.y_px, labels, settings) as writer:
            yield writer


class _Table:
    """One line per point of each field."""

    def __init__(self, file: TextIO, grid: Grid) -> None:
        self._file, self._frame = file, 0
        self._places = [f"{x:.1f},{y:.1f}" for y in grid.y_px for x in grid.x_px]
        self._labels = [status.label for status in Status]
        file.write(COLUMNS + "\n")

    def append(self, ux_px: Any, uy_px: Any, zncc: Any, status: Any) -> None:
        """Write the field of the next image."""
        self._frame += 1
        rows = zip(self._places, ux_px.flat, uy_px.flat, status.flat, zncc.flat, strict=True)
        self._file.writelines(f"{self._frame},{place},{ux:.6f},{uy:.6f},{self._labels[s]},{c:.6f}\n" for place, ux, uy, s, c in rows)
