"""Pictures in which nothing moves, of sessions or of files: pairs of an exposure, and those that
are named for what they show.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from analysis.arrays import Array
from analysis.saturation import end_of_scale
from app.calibrations.given_files import is_session
from app.calibrations.session_readings import opened, times_of_frames
from app.files.grey_images import pictures_of, read_image
from app.system.errors import UserError

Picture = Array


@dataclass(frozen=True)
class ExposureSeries:
    """Pictures of a scene at rest, those that follow one another in pairs.

    Attributes
    ----------
    pictures : sequence of sequence of ndarray
        Of each exposure.
    exposures_s : sequence of float
        NaN where it is not known.
    top : float
        Grey level at and above which pixels are saturated.
    """

    pictures: Sequence[Sequence[Picture]]
    exposures_s: Sequence[float]
    top: float

    @property
    def pairs(self) -> list[tuple[Picture, Picture]]:
        """Two pictures each, one taken after the other."""
        return [pair for one in self.pictures for pair in zip(one[::2], one[1::2], strict=False)]


def end_of_pictures(images: Sequence[Picture], stated: float = 0.0) -> float:
    """The grey level at and above which pixels are saturated: the one that is stated (0: the end of
    the type), unless pictures of 16 bits are cut off at a lower one.
    """
    kind = images[0].dtype
    stated = stated or (float(np.iinfo(kind).max) if kind.kind == "u" else math.inf)
    return min(end_of_scale(image, stated) for image in images)


def exposure_series(sources: Sequence[Path], top: float, frames: int) -> ExposureSeries:
    """Up to so many pictures of each session, or the pairs of pictures in files.

    Raises
    ------
    UserError
        A file cannot be used, or `top` is 0 and pictures do not tell it.
    """
    stated = top
    series, exposures = [], []
    if is_session(sources[0]):
        for source in sources:
            with opened(source) as (reader, config):
                stated = stated or float(config.correlation.full_scale)
                series.append([reader.frame(n)[2] for n in times_of_frames(reader, frames)])
                exposures.append(config.camera.exposure)
    else:
        files = pictures_of(sources)
        if len(files) % 2:
            raise UserError(
                f"camera: {len(files)} pictures were given; pictures are taken in pairs, one after"
                " the other, of each brightness"
            )
        images = [read_image(one) for one in files]
        series = [images[n : n + 2] for n in range(0, len(images), 2)]
        exposures = [np.nan] * len(series)
    pictures = [one for images in series for one in images]
    end = top or end_of_pictures(pictures, stated)
    if not stated and end > 255 and end > max(one.max() for one in pictures):
        raise UserError(
            f"{sources[0]}: pictures of 16 bits do not say at which grey level their camera is"
            " saturated; give --top, 4095 for one of 12 bits"
        )
    return ExposureSeries(series, exposures, end)


def is_named(picture: Path, word: str) -> bool:
    """Whether the name of a picture, or that of its folder, begins with a word."""
    return any(name.lower().startswith(word) for name in (picture.name, picture.parent.name))


def pictures_named(sources: Sequence[Path], word: str) -> list[Picture]:
    """The pictures of those sources that are named so."""
    named = (one for one in sources if is_named(one, word))
    return [read_image(one) for one in pictures_of(named)]
