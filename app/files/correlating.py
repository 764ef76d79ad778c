"""Displacement fields between plain image files, written as a table (CSV), as one HDF5 file, or as
NumPy arrays (npz).
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np

from analysis.arrays import Array
from analysis.dic import Field, Grid, Status, Tracker, open_tracker
from analysis.dic.updating import UpdatingTracker
from analysis.options import as_written, options
from analysis.saturation import END_OF_16_BIT, end_of_scale
from analysis.settings import Correlation
from app.evaluation.compiling import compile_correlation
from app.files.field_files import FieldTable
from app.files.grey_images import ImagePage, pictures_of, read_image, size_text
from app.session.field_series import fields_file
from app.system.errors import UserError
from app.system.outputs import check_output, new_file
from app.system.progress import HowFar, unheard

ENDINGS = (".h5", ".csv", ".npz")
PLANES = {  # column -> attribute of a field
    "ux_px": "ux_px",
    "uy_px": "uy_px",
    "ux_sd_px": "ux_std_px",
    "uy_sd_px": "uy_std_px",
    "zncc": "zncc",
    "status": "status",
    "iterations": "iterations",
}


@dataclass(frozen=True, slots=True)
class CorrelationSummary:
    """How a series of image files was correlated.

    Attributes
    ----------
    frames, points : int
        Number of images, and of points on the grid.
    statuses : dict
        Label of each `analysis.dic.Status` -> number of points of all images that have it.
    points_per_s : float
        Points that were to be measured, divided by the elapsed time of their correlation, without
        compilation, reading and writing.
    ux_std_px, uy_std_px, zncc : float
        Standard uncertainties and correlation: median over the images of the medians over the
        points of an image; NaN if no point was measured.
    updates : int
        How often the reference was replaced.
    drift_px : float
        Root mean square of the standard uncertainty that this added to u_x.
    full_scale : int
        Grey level at which pixels of the reference are cut off although its type goes on; else 0.
    saturated : float
        Share of its pixels that are.
    remarks : tuple of str
        Sentences about the reference that an operator should know.
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
    full_scale: int = 0
    saturated: float = 0.0
    remarks: tuple[str, ...] = ()


def correlate_files(
    reference: Path,
    images: Sequence[Path],
    output: Path,
    correlation: Correlation = Correlation(),  # noqa: B008 - frozen
    *,
    mask: Path | None = None,
    roi: tuple[int, int, int, int] | None = None,
    overwrite: bool = False,
    on_progress: HowFar = unheard,
) -> CorrelationSummary:
    """Write the displacement field of each image against the reference.

    Parameters
    ----------
    reference : Path
        An image; of a folder, or of a file of many pages, the first one, and the others come before
        the images.
    images : sequence of Path
        Files, some of which may hold many images, and folders.
    output : Path
        ``.csv``: one line per point, see `app.files.field_files.FieldTable`; ``.h5``: see
        `app.session.field_series`; ``.npz``: x_px, y_px, `PLANES`, each (frames, ny, nx), and the
        texts status_names, images and settings (name, value). The arrays of an npz are kept in
        memory until the end.
    mask : Path, optional
        An image of the reference's size; pixels of the reference may be used where it is not 0.
    roi : tuple of int, optional
        Left, top, right, bottom, px: only boxes with their centre in this region are measured.
    on_progress : callable
        Called with what is being done and the share done, 0 to 1.

    Raises
    ------
    UserError
        A file or an option cannot be used; nothing was written.
    """
    inputs = [reference, *images, *([mask] if mask else [])]
    check_output(output, overwrite, endings=ENDINGS, inputs={"image": inputs})
    for path in inputs:
        if not (path.is_file() or path.is_dir()):
            raise UserError(f"{path}: there is no such file; check the name")
    begin, *later = pictures_of([reference])
    pictures = [*later, *pictures_of(images)]
    if not pictures:
        raise UserError(f"{reference}: there are no images to correlate with it; name at least one")
    first = read_image(begin)
    usable = None if mask is None else _read_like(ImagePage(mask), first, begin, is_mask=True) != 0
    _check_region(roi, first, reference)
    on_progress("preparing the correlation", 0.0)
    try:
        tracker = open_tracker(correlation, first, usable=usable, roi=roi)
    except ValueError as error:
        raise UserError(f"{reference}: {error}") from None
    record = {
        "reference": str(begin),
        "mask": str(mask or ""),
        "roi": " ".join(map(str, roi or ())),
        **as_written(correlation),
    }
    names = [str(picture) for picture in pictures]
    end = correlation.full_scale
    if first.dtype in (np.uint8, np.uint16):
        end = int(end_of_scale(first, end or int(np.iinfo(first.dtype).max)))
    account = _Account()
    with closing(tracker), new_file(output, overwrite) as unfinished:
        compile_correlation(correlation, first.dtype)
        with _writer(unfinished, names, tracker.grid, record) as append:
            for n, picture in enumerate(pictures):
                on_progress(picture.name, n / len(pictures))
                append(account.timed(tracker, _read_like(picture, first, begin)))
    on_progress("done", 1.0)
    found = account.summary(output, len(pictures), tracker)
    if first.dtype == np.uint16 and end < (correlation.full_scale or END_OF_16_BIT):
        found = replace(found, full_scale=end, saturated=float((first >= end).mean()))
    return found


class _Account:
    """Counts the fates of the points of a series, and times their correlation."""

    def __init__(self) -> None:
        self._counts = np.zeros(len(Status), np.int64)
        self._medians: list[list[float]] = []
        self._seconds = 0.0

    def timed(self, tracker: Tracker, image: Array) -> Field:
        """The field of the next image."""
        began = time.perf_counter()
        field = tracker.track(image)
        self._seconds += time.perf_counter() - began
        self._counts += np.bincount(field.status.ravel(), minlength=len(Status))
        ok = field.status == Status.OK
        if ok.any():
            planes = (field.ux_std_px, field.uy_std_px, field.zncc)
            self._medians.append([float(np.median(plane[ok])) for plane in planes])
        return field

    def summary(self, output: Path, frames: int, tracker: Tracker) -> CorrelationSummary:
        """The account of the whole series."""
        ux_std, uy_std, zncc = (
            np.median(self._medians, axis=0).tolist() if self._medians else [math.nan] * 3
        )
        updating = tracker if isinstance(tracker, UpdatingTracker) else None
        return CorrelationSummary(
            output,
            frames,
            math.prod(tracker.grid.shape),
            {status.label: int(self._counts[status]) for status in Status},
            int(self._counts.sum() - self._counts[Status.MASKED]) / self._seconds,
            ux_std,
            uy_std,
            zncc,
            updating.updates if updating else 0,
            updating.drift_px if updating else 0.0,
            remarks=tracker.remarks,
        )


def _read_like(
    path: ImagePage, first: Array, reference: ImagePage, *, is_mask: bool = False
) -> Array:
    """The image in a file, if it has the size and, unless it is a mask, the pixels of the
    reference.
    """
    image = read_image(path)
    if image.shape != first.shape or (image.dtype != first.dtype and not is_mask):
        raise UserError(
            f"{path}: {size_text(image)} found, the reference {reference} is {size_text(first)};"
            f" use {'a mask of its size' if is_mask else 'images of one size and depth'}"
        )
    if not np.isfinite(image).all():
        raise UserError(f"{path}: some grey levels are not finite; replace them by numbers")
    return image


def _check_region(roi: tuple[int, int, int, int] | None, first: Array, reference: Path) -> None:
    rows, columns = first.shape
    left, top, right, bottom = roi or (0, 0, columns, rows)
    if not (0 <= left < right <= columns and 0 <= top < bottom <= rows):
        raise UserError(
            f"{reference}: the region from ({left}, {top}) to ({right}, {bottom}) px does not lie"
            f" in an image of {columns} x {rows} px; give left, top, right and bottom inside it"
        )


@contextmanager
def _writer(
    path: Path, images: list[str], grid: Grid, settings: dict[str, Any]
) -> Iterator[Callable[[Field], None]]:
    """A function that writes the field of the next image."""
    labels, ending = [status.label for status in Status], path.suffix.lower()
    if ending == ".csv":
        with path.open("x", encoding="utf-8", newline="\n") as file:
            table = FieldTable(file, grid.x_px, grid.y_px, ["iterations"])
            numbers = count(1)
            yield lambda field: table.append(next(numbers), field, field.iterations)
    elif ending == ".h5":
        units = {name: option.unit or "1" for name, option in options(Correlation).items()}
        made = fields_file(path, images, grid.x_px, grid.y_px, labels, settings, units)
        with made as append:
            yield append
    else:
        fields: list[Field] = []
        yield fields.append
        arrays: dict[str, Any] = {
            name: np.stack([getattr(field, attribute) for field in fields])
            for name, attribute in PLANES.items()
        }
        arrays |= {"x_px": grid.x_px, "y_px": grid.y_px, "status_names": labels, "images": images}
        arrays["settings"] = [(name, str(value)) for name, value in settings.items()]
        with path.open("xb") as file:
            np.savez(file, **arrays)
