"""A folder of grey images as a camera: image n is the image of trigger n."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Iterable
from pathlib import Path
from typing import cast

import numpy as np

from drivers.cameras.image_files import decoded
from drivers.clock import SampleClock
from drivers.errors import DeviceFault, DeviceNotFound, DeviceTimeout, OutOfLimits
from drivers.protocols import Found, Frame, Image, LostFrame, TriggerTrain
from drivers.settings import CameraSettings

SUFFIXES = (".png", ".tif", ".tiff")
_SLICE_S = 0.05


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
    """The paths in the order in which people number them: a2 before a10."""

    def parts(path: Path) -> list[int | str]:
        return [int(part) if part.isdecimal() else part for part in re.split(r"(\d+)", str(path))]

    return sorted(paths, key=parts)


class FolderCamera:
    """A camera that plays a folder of PNG or TIFF images, 8 or 16 bit grey; see
    `drivers.protocols.Camera`.

    A file that can not be used, and every trigger after the last file, is a lost frame with its
    reason; the run continues.
    """

    name = "folder camera"

    def __init__(self, settings: CameraSettings, clock: SampleClock) -> None:
        self.shape, self.dtype = settings.shape, settings.dtype
        self.exposure_samples = settings.exposure_samples(clock.sample_rate_hz)
        self._folder = Path(settings.folder)
        self._clock = clock
        self._files: list[Path] = []
        self._train: TriggerTrain | None = None
        self._next = 0

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

    def describe(self) -> str:
        """Number and size of the images."""
        if not self._files:
            return f"{self.name}, not open"
        return (
            f"{len(self._files)} images of '{self._folder}': {self.shape[1]} x {self.shape[0]},"
            f" {self.dtype}; one for each trigger"
        )

    def start(self, train: TriggerTrain) -> None:
        """Wait for triggers; the first one shows the first image."""
        if not self._files:
            raise DeviceFault(
                f"{self.name}: it can not wait for triggers before it is open; open it first"
            )
        self._train, self._next = train, 0

    def read(self, timeout_s: float) -> Frame | LostFrame:
        """The image of the next trigger, once the clock has passed its exposure; see
        `drivers.protocols.Camera.read`.
        """
        train, clock, index = self._train, self._clock, self._next
        if train is None:
            raise DeviceFault(
                f"{self.name}: it has no frames before it waits for triggers; start it first"
            )
        sample = train.sample(index)
        end = sample + self.exposure_samples
        give_up = time.monotonic() + timeout_s
        while not clock.wait_for(
            lambda: clock.now >= end or clock.phase == "stopped", min(_SLICE_S, timeout_s)
        ):
            if self._train is None or time.monotonic() >= give_up:
                break
        if clock.now < end or self._train is None:
            raise DeviceTimeout(
                f"{self.name}: trigger {index} had no answer within {timeout_s:g} s (sample"
                f" {clock.now} of {end}); wait longer, or end here"
            )
        self._next = index + 1
        if index >= len(self._files):
            return LostFrame(index, sample, f"the folder has only {len(self._files)} images")
        image = self._load(self._files[index])
        if isinstance(image, str):
            return LostFrame(index, sample, image)
        return Frame(index, sample, image)

    def stop(self) -> None:
        """Stop waiting for triggers; a waiting `read` ends with `DeviceTimeout`."""
        self._train = None

    def close(self) -> None:
        """Stop, and let go of the folder."""
        self.stop()
        self._files = []

    def _load(self, path: Path) -> Image | str:
        """The image in a file, or why it can not be used."""
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
        image.setflags(write=False)
        return cast(Image, image)
