"""Which images there are to import, which frame each is, and which frames have none."""

from __future__ import annotations

import math
import os
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from analysis.arrays import Array
from app.files.forms import TableForm
from app.files.grey_images import ImagePage, pictures_of, read_image, size_text
from app.files.text_tables import ANY_FORM, TextTable
from app.records.quantities import counted
from app.system.errors import UserError
from drivers.cameras.image_folder import has_known_order, in_order_of_numbers

# times as many frames as there are images: more, and their numbers count something else
MOST_LOST = 10
LIKE_THE_FIRST = 8  # times the bytes of the first image that another can take


@dataclass(frozen=True, slots=True, kw_only=True)
class Sources:
    """What is to be imported, see ``slipscope import --help``; None: not given.

    `images` are files, some of which may hold many images, or one folder; metadata.csv, forces.csv
    and settings.toml in a folder are used unless others are given.

    Attributes
    ----------
    frame_rate : float
        Images per second.
    offset_s : float
        What is to be added to the times of the forces to have those of the images.
    form : TableForm
        How the tables are written.
    """

    images: Sequence[Path]
    metadata: Path | None = None
    forces: Path | None = None
    settings: Path | None = None
    pixel_um: float | None = None
    rate_hz: int | None = None
    divisor: int | None = None
    frame_rate: float | None = None
    offset_s: float | None = None
    form: TableForm = ANY_FORM
    background: int | None = None
    reference: int | None = None
    drive: int | None = None
    overrides: Sequence[str] = ()


@dataclass(slots=True)
class ImportedTrigger:
    """A trigger of the camera: its image in a file, or the reason why there is none.

    `sample`, `phase_sample` and `step_sample` are -1 until they are known, `stamp_s`, the camera's
    own time of it, is NaN; `first` and `last`, the triggers that it can be, are -1 where it is
    certain.
    """

    index: int
    sample: int = -1
    path: ImagePage | None = None
    reason: str = ""
    phase: str = ""
    phase_sample: int = -1
    step: int = 0
    step_sample: int = -1
    stamp_s: float = math.nan
    first: int = -1
    last: int = -1


def files_of(sources: Sources, remarks: list[str]) -> tuple[Sources, list[ImagePage]]:
    """The sources with those that lie in the folder, and the images in the order of the numbers in
    the names of their files.
    """
    files = in_order_of_numbers(sources.images)
    if len(files) == 1 and files[0].is_dir():
        folder = files[0]
        beside = {"metadata": "metadata.csv", "forces": "forces.csv", "settings": "settings.toml"}
        for name, file in beside.items():
            if getattr(sources, name) is None and (folder / file).is_file():
                _check_inside(folder / file, folder)
                sources = replace(sources, **{name: folder / file})  # type: ignore[arg-type]
                remarks.append(f"{folder / file} is used")
        pictures = pictures_of([folder])
        for picture in pictures:
            _check_inside(picture.path, folder)
        return sources, pictures
    for path in files:
        if not path.is_file():
            raise UserError(
                f"{path}: there is no such file; give image files, or one folder of them"
            )
    return sources, pictures_of(files)


def _check_inside(path: Path, folder: Path) -> None:
    """Refuse a file that a link brings into a folder of somebody else, or a name leads out of
    it.
    """
    if not path.resolve().is_relative_to(folder.resolve()):
        raise UserError(f"{path}: it is not in the folder {folder}; copy it into that folder")


def numbered(files: list[ImagePage], remarks: list[str]) -> list[ImportedTrigger]:
    """A trigger for each image, by the last number in the name of its file if these numbers count
    the images; the pages of a file follow each other.
    """
    if any(picture.page is not None for picture in files):
        if len({picture.path for picture in files}) > 1:
            remarks.append("the images of each file are taken to follow those of the one before")
        return [ImportedTrigger(index, path=picture) for index, picture in enumerate(files)]
    if not has_known_order(picture.path for picture in files):
        raise UserError(
            f"{files[0]} to {files[-1].name}: the numbers behind the points may be decimal places,"
            " which give another order, or counts; write them all with as many digits, or give a"
            " table --metadata with a column file"
        )
    found = [re.search(r"(\d+)\D*$", picture.path.stem) for picture in files]
    steps = [int(b[1]) - int(a[1]) for a, b in pairwise(found) if a and b]
    step = Counter(steps).most_common(1)[0][0] if steps else 1
    counts = all(found) and step > 0 and all(s > 0 and s % step == 0 for s in steps)
    if counts and sum(steps) // step < (MOST_LOST + 1) * len(files):
        numbers = [int(name[1]) for name in found if name]
        return [
            ImportedTrigger((number - numbers[0]) // step, path=path)
            for number, path in zip(numbers, files, strict=True)
        ]
    if len(files) > 1:
        remarks.append(
            "the names of the images do not count them: each is taken to follow the one before"
            " without a loss"
        )
    return [ImportedTrigger(index, path=path) for index, path in enumerate(files)]


def listed(table: TextTable, files: list[ImagePage], remarks: list[str]) -> list[ImportedTrigger]:
    """A trigger for each row of the metadata."""
    numbers = table.numbers.get("frame", np.arange(table.rows, dtype=np.float64))
    if not (
        np.isfinite(numbers).all()
        and (numbers == np.rint(numbers)).all()
        and (np.diff(numbers, prepend=-1) > 0).all()
    ):
        raise UserError(
            f"{table.path}: the numbers in column frame must be whole, from 0 on, each larger than"
            " the one before"
        )
    most = (MOST_LOST + 1) * (table.rows + 100)
    if numbers[-1] > most:
        raise UserError(
            f"{table.path}: frames up to {numbers[-1]:.0f} in {table.rows} rows; number the frames"
            " by the camera's triggers"
        )
    names = table.texts.get("file") or [picture.name for picture in files]
    if len(names) != table.rows:
        raise UserError(
            f"{table.path}: {table.rows} rows for {len(files)} images; add a column file, empty"
            " where an image was lost"
        )
    nothing = [""] * table.rows
    reasons, phases = (table.texts.get(name, nothing) for name in ("reason", "phase"))
    begins, steps, step_begins = (
        np.nan_to_num(table.numbers.get(name, np.full(table.rows, -1.0)), nan=-1.0).tolist()
        for name in ("phase_sample", "step", "step_sample")
    )
    stamps = table.numbers.get("camera", np.full(table.rows, np.nan)).tolist()
    spans = [numbers, numbers]
    if table.has("first", "last"):
        given = (table.numbers[name] for name in ("first", "last"))
        first, last = spans = [np.where(np.isnan(held), numbers, held) for held in given]
        is_none = ~((first >= 0) & (first <= numbers) & (numbers <= last) & (last <= most))
        if (is_none | (np.rint(spans) != spans).any(axis=0)).any():
            raise UserError(
                f"{table.path}: columns first and last must be the triggers, from the first to the"
                " last, that each frame can be; correct them, or leave both columns out"
            )
    by_name = {picture.name: picture for picture in files}
    frame_of: dict[str, int] = {}
    triggers = []
    for number, name, reason, phase, stamp_s, first, last, *begun in zip(
        numbers, names, reasons, phases, stamps, *spans, begins, steps, step_begins, strict=True
    ):
        path = by_name.get(name) or _named_beside(table.path, name)
        began, step, step_began = map(int, begun)
        trigger = ImportedTrigger(
            int(number), -1, None, reason, phase, began, max(0, step), step_began, stamp_s
        )
        trigger.first, trigger.last = int(first), int(last)
        if path is not None and frame_of.setdefault(name, trigger.index) < trigger.index:
            trigger.reason = f"'{name}' is the image of frame {frame_of[name]}"
        elif path is not None:
            trigger.path = path
        elif not reason:
            trigger.reason = (
                f"'{name}' is not there" if name else f"no file is named in {table.path.name}"
            )
        triggers.append(trigger)
    if left := [name for name in by_name if name not in frame_of]:
        remarks.append(
            f"left out: {counted(len(left), 'image')} that {table.path} does not name, the"
            f" first: {left[0]}"
        )
    return triggers


def _named_beside(table: Path, name: str) -> ImagePage | None:
    """The file that a table names, in its own folder or below; None if it is not there."""
    path = table.parent / name
    if Path(name).anchor or ".." in Path(name).parts:
        raise UserError(
            f"{table}: '{name[:200]}' is named as an image; name only files in {table.parent}"
        )
    if not name or not os.path.isfile(path):  # False also for a name that no disk can hold
        return None
    _check_inside(path, table.parent)
    return ImagePage(path)


def with_lost(triggers: list[ImportedTrigger]) -> list[ImportedTrigger]:
    """The triggers, and between them those that have neither an image nor a row."""
    whole = triggers[:1]
    for trigger in triggers[1:]:
        before = whole[-1]
        for index in range(before.index + 1, trigger.index):
            share = (index - before.index) / (trigger.index - before.index)
            sample = before.sample + round(share * (trigger.sample - before.sample))
            whole.append(ImportedTrigger(index, sample, reason="no image of it was given"))
        whole.append(trigger)
    return whole


def first_image(triggers: list[ImportedTrigger]) -> Array:
    """The first image that there is: the others must be like it.

    Raises
    ------
    UserError
        There is none, or not of 8 or 16 bit.
    """
    path = next((trigger.path for trigger in triggers if trigger.path), None)
    if path is None:
        raise UserError(
            "import: not one of the images named in the metadata is there"
            f" ({triggers[0].reason[:200]});"
            " run it where they are, and name them as their files are"
        )
    image = read_image(path)
    if image.dtype not in (np.uint8, np.uint16):
        raise UserError(
            f"{path}: its pixels are of type {image.dtype}; a session holds 8 or 16 bit, convert"
            " the images"
        )
    return image


def image_or_reason(trigger: ImportedTrigger, first: Array) -> Array | str:
    """The image of a trigger, or why there is none that is like the first."""
    if trigger.path is None:
        return trigger.reason
    try:
        image = read_image(trigger.path, LIKE_THE_FIRST * first.nbytes + (1 << 20))
    except UserError as error:
        return str(error)
    if image.shape != first.shape or image.dtype != first.dtype:
        return f"'{trigger.path.name}' is {size_text(image)}, the first image {size_text(first)}"
    return image
