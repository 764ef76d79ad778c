"""Which images there are to import, which frame each is, and which frames have none."""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.dic_files import read_image
from app.errors import UserError
from app.exchange.analysing import Taken
from app.exchange.tables import Table

SUFFIXES = (".png", ".tif", ".tiff")
# times as many frames as there are images: more, and their numbers count something else
MOST_LOST = 10


@dataclass(frozen=True, slots=True, kw_only=True)
class Sources:
    """What is to be imported, see ``slipscope import --help``; None: not given.

    `images` are files or one folder; in a folder metadata.csv, forces.csv and settings.toml are
    used if they are there and no others are given.
    """

    images: Sequence[Path]
    metadata: Path | None = None
    forces: Path | None = None
    settings: Path | None = None
    pixel_um: float | None = None
    rate_hz: int | None = None
    divisor: int | None = None
    background: int | None = None
    reference: int | None = None
    drive: int | None = None
    overrides: Sequence[str] = ()


@dataclass(slots=True)
class Frame:
    """A trigger: its file, or why there is none; sample -1 until it is known."""

    index: int
    sample: int = -1
    path: Path | None = None
    reason: str = ""
    phase: str = ""
    phase_sample: int = -1


def found_files(sources: Sources, remarks: list[str]) -> tuple[Sources, list[Path]]:
    """The sources with those that lie in the folder, and the image files in the order of their
    numbers.
    """
    folder = sources.images[0] if len(sources.images) == 1 and sources.images[0].is_dir() else None
    files = list(sources.images)
    if folder is not None:
        files = [path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES]
        for name in ("metadata", "forces", "settings"):
            path = folder / (f"{name}.toml" if name == "settings" else f"{name}.csv")
            if getattr(sources, name) is None and path.is_file():
                sources = replace(sources, **{name: path})  # type: ignore[arg-type]
                remarks.append(f"{path} is used")
    for path in files:
        if not path.is_file():
            raise UserError(
                f"{path}: there is no such file; give image files, or one folder of them"
            )
    if not files:
        raise UserError(
            f"{folder}: no image ({', '.join(SUFFIXES)}) in this folder; check the name"
        )
    return sources, sorted(
        files,
        key=lambda path: [
            int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", str(path))
        ],
    )


def numbered(files: list[Path], remarks: list[str]) -> list[Frame]:
    """A frame for each file; the numbers at the end of the names tell which are missing, if they
    count images.
    """
    found = [re.search(r"(\d+)\D*$", path.stem) for path in files]
    steps = [int(b[1]) - int(a[1]) for a, b in pairwise(found) if a and b]
    step = Counter(steps).most_common(1)[0][0] if steps and all(found) else 1
    counts = (
        len(steps) == len(files) - 1 and step > 0 and all(s > 0 and s % step == 0 for s in steps)
    )
    if counts and sum(steps) // step < (MOST_LOST + 1) * len(files):
        numbers = [int(name[1]) for name in found if name]
        return [
            Frame((number - numbers[0]) // step, path=path)
            for number, path in zip(numbers, files, strict=True)
        ]
    if len(files) > 1:
        remarks.append(
            "the names of the images do not count them: each is taken to follow the one before"
            " without a loss"
        )
    return [Frame(index, path=path) for index, path in enumerate(files)]


def listed(table: Table, files: list[Path], remarks: list[str]) -> list[Frame]:
    """A frame for each row of the metadata."""
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
    if numbers[-1] > (MOST_LOST + 1) * (table.rows + 100):
        raise UserError(
            f"{table.path}: frames up to {numbers[-1]:.0f} in {table.rows} rows; number the frames"
            " by the camera's triggers"
        )
    frames = [Frame(int(number)) for number in numbers]
    names = table.texts.get("file")
    if names is None and len(files) != table.rows:
        raise UserError(
            f"{table.path}: {table.rows} rows for {len(files)} images; add a column file, empty"
            " where an image was lost"
        )
    by_name = {path.name: path for path in files}
    for i, frame in enumerate(frames):
        name = files[i].name if names is None else names[i]
        path = by_name.pop(name, table.path.parent / name)
        frame.reason = table.texts["reason"][i] if "reason" in table.texts else ""
        if name and os.path.isfile(path):  # False also of a name that no disk can hold
            frame.path = path
        else:
            frame.reason = frame.reason or (
                f"'{name}' is not there" if name else f"no file is named in {table.path.name}"
            )
        frame.phase = table.texts["phase"][i] if "phase" in table.texts else ""
        began = table.numbers["phase_sample"][i] if table.has("phase_sample") else np.nan
        frame.phase_sample = int(began) if np.isfinite(began) else -1
    if by_name:
        remarks.append(
            f"{len(by_name)} images that {table.path} does not name are left out, the first:"
            f" {next(iter(by_name))}"
        )
    return frames


def first_image(frames: list[Frame]) -> NDArray[Any]:
    """The first image that there is: the others must be like it.

    Raises
    ------
    UserError
        There is none, or not of 8 or 16 bit.
    """
    path = next((frame.path for frame in frames if frame.path), None)
    if path is None:
        raise UserError(
            "import: not one of the images named in the metadata is there; run it where they are"
        )
    image = read_image(path)
    if image.dtype not in (np.uint8, np.uint16):
        raise UserError(
            f"{path}: pixels of type {image.dtype} found; a session holds 8 or 16 bit, convert the"
            " images"
        )
    return image


def with_lost(frames: list[Frame]) -> list[Frame]:
    """The frames, and between them those of which there is neither an image nor a row."""
    whole: list[Frame] = []
    for frame in frames:
        before = whole[-1] if whole else None
        for index in range(before.index + 1 if before else frame.index, frame.index):
            assert before is not None
            share = (index - before.index) / (frame.index - before.index)
            whole.append(
                Frame(
                    index,
                    before.sample + round(share * (frame.sample - before.sample)),
                    reason="no image of it was given",
                )
            )
        whole.append(frame)
    return whole


def taken(frames: list[Frame], shape: tuple[int, ...], dtype: np.dtype[Any]) -> Iterator[Taken]:
    """Each frame's image when it is its turn, or why there is none."""
    for frame in frames:
        image: NDArray[Any] | str = frame.reason
        if frame.path is not None:
            try:
                image = read_image(frame.path)
            except UserError as error:
                image = str(error)
            else:
                if image.shape != shape or image.dtype != dtype:
                    sizes = [
                        f"{s[1]} x {s[0]} {t}"
                        for s, t in ((image.shape, image.dtype), (shape, dtype))
                    ]
                    image = f"'{frame.path.name}' is {sizes[0]}, the first image {sizes[1]}"
        yield frame.index, frame.sample, image
