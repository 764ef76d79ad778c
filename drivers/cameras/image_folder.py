"""A folder of grey images as a camera: image n is the image of trigger n."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from itertools import zip_longest
from pathlib import Path
from typing import cast

import numpy as np

from drivers.cameras.image_files import decoded
from drivers.cameras.played_images import PlayedImages
from drivers.clock import SampleClock
from drivers.errors import DeviceNotFound, OutOfLimits
from drivers.protocols import Found, Image
from drivers.settings import CameraSettings

SUFFIXES = (".png", ".tif", ".tiff", ".bmp")
# the digits behind a point; not of a date or a version, which have more than one point
_BEHIND_POINT = re.compile(r"(?<![\d.,])\d+[.,](\d+)(?![.,]?\d)")


def find(folder: str = "") -> list[Found]:
    """The images of a folder as one device; none if there is no folder, or no image in it."""
    files = images_of(Path(folder)) if folder else []
    if not files:
        return []
    return [Found(folder, f"{len(files)} images, {files[0].name} to {files[-1].name}")]


def images_of(folder: Path) -> list[Path]:
    """The image files of a folder, in the order of their numbers; none if there is no such
    folder.
    """
    if not folder.is_dir():
        return []
    return in_order_of_numbers(path for path in folder.iterdir() if path.suffix.lower() in SUFFIXES)


def in_order_of_numbers(paths: Iterable[Path]) -> list[Path]:
    """The paths in the order in which people number them: a2 before a10, v1.9 before v1.10, and
    0.25 s before 0.5 s.
    """
    held = [*paths]
    # to how many decimal places each decimal number of the names is compared
    widths = [max(map(len, one)) if _are_decimals(one) else 0 for one in _places(held)]

    def parts(path: Path) -> list[int | str]:
        width = iter(widths)
        text = _BEHIND_POINT.sub(lambda one: one[0] + "0" * (next(width) - len(one[1])), str(path))
        return [int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", text)]

    return sorted(held, key=parts)


def has_known_order(paths: Iterable[Path]) -> bool:
    """Whether it is known how people number them: not of x1.5 and x1.10, which may be decimal
    numbers or counts.
    """
    return None not in map(_are_decimals, _places(paths))


def _places(paths: Iterable[Path]) -> list[set[str]]:
    """The digits behind the point in the first, second, ... decimal number of all names."""
    found = zip_longest(*(_BEHIND_POINT.findall(str(path)) for path in paths), fillvalue="")
    return [{*column} - {""} for column in found]


def _are_decimals(places: set[str]) -> bool | None:
    """Whether they are decimal places (0.25, 0.5) rather than counts (1.9, 1.10); None where it
    cannot be known, and matters.
    """
    counts, shortest = {*map(int, places)}, min(map(len, places))
    longer = [one for one in places if len(one) > shortest]
    if not longer or any(one[0] == "0" for one in longer):
        return True
    is_dense = 2 * len(counts) >= max(counts) - min(counts)  # as counts are
    # as few decimal numbers have
    has_tens = any(one[-1] == "0" for one in places if len(one) > 1)
    return not is_dense if is_dense == has_tens else None


class FolderCamera(PlayedImages):
    """A camera that plays a folder of PNG, TIFF or BMP images, 8 or 16 bit grey; see
    `drivers.protocols.Camera`.

    A file that cannot be used, and every trigger after the last file, is a lost frame with its
    reason; the run continues.
    """

    name = "folder camera"

    def __init__(self, settings: CameraSettings, clock: SampleClock) -> None:
        super().__init__(settings, clock)
        self._folder = Path(settings.folder)
        self._files: list[Path] = []

    def open(self) -> None:
        """List the images, and compare the first with the settings.

        Raises
        ------
        DeviceNotFound
            There is no image in the folder.
        OutOfLimits
            The first image has another size or depth than the settings say.
        """
        files = images_of(self._folder)
        if not files:
            raise DeviceNotFound(
                f"{self.name}: '{self._folder}' has no image ({', '.join(SUFFIXES)}); set"
                " camera.folder to a folder of images"
            )
        first = self._load(files[0])
        if isinstance(first, str):
            raise OutOfLimits(
                f"{self.name}: {first}; set camera.width, camera.height and camera.pixel_format to"
                " those of the images"
            )
        self._files = files
        super().open()

    def describe(self) -> str:
        """Number and size of the images."""
        if not self._files:
            return f"{self.name}, not open"
        return (
            f"{len(self._files)} images of '{self._folder}': {self.shape[1]} x {self.shape[0]},"
            f" {self.dtype}; one for each trigger"
        )

    def image(self, index: int) -> Image | str:
        """The image of a trigger, or why it has none."""
        if index >= len(self._files):
            return f"the folder has only {len(self._files)} images"
        return self._load(self._files[index])

    def close(self) -> None:
        """Stop, and let go of the folder."""
        super().close()
        self._files = []

    def _load(self, path: Path) -> Image | str:
        """The image in a file, or why it cannot be used."""
        most = 8 * math.prod(self.shape) * np.dtype(self.dtype).itemsize + (1 << 20)
        try:
            image = decoded(path, most)
        except (OSError, ValueError) as error:
            return f"'{path.name}': {error}"
        if image.shape != self.shape or image.dtype != self.dtype:
            size = " x ".join(str(n) for n in (image.shape[1], image.shape[0], *image.shape[2:]))
            return (
                f"'{path.name}' is {size} {image.dtype}, not {self.shape[1]} x {self.shape[0]}"
                f" {self.dtype}"
            )
        return cast(Image, image)
