"""What pictures show of a motion: of a block that touches nothing, or of marks."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from analysis.arrays import F64, Array, Bool
from analysis.calibration.stage_motion import encoder_step
from analysis.contact.orientation import Direction, drive_direction
from analysis.dic import Status, correlate, open_tracker
from analysis.dic.field import Field
from analysis.region import measured
from analysis.robust import robust_sd
from analysis.settings import Correlation
from app.calibrations.calibration import Data
from app.calibrations.session_readings import opened, times_of_frames, travel_of
from app.evaluation.setup import pixel_correction
from app.files.grey_images import read_image
from app.session.reader import SessionReader
from app.settings.config import settings_of
from app.settings.sections import Config
from app.system.errors import UserError

BOX_PX, STEP_PX = 40, 20  # of the displacements whose median is the motion
BORDER_PX = 4  # along the border of a region, which are not looked at
# of the displacements of one picture: by noise, and the share of its motion that a lens adds
SPREAD_PX, SPREAD = 0.1, 0.03
LEAST_PX = 0.02  # of motion, whose direction is known to some degrees: a cosine of 1 to 0.3 %
MOST_FRAMES = 80  # whose whole fields are kept
MOST_POINTS = 1500  # of a field that are kept
LEAST_GAIN = 0.005  # spread of gains that is taken to be there
MARKED = 3.0  # times the spread of the other gains: that of a region whose marks are in the map


@dataclass(frozen=True)
class SeenMotion:
    """Times of the middle of each exposure (s, from the first sample), and the displacement since
    the first of these pictures, pixels; all of shape (frames,).
    """

    time_s: F64
    ux_px: F64
    uy_px: F64


def flat_fielded_pictures(reader: SessionReader, frames: Iterable[int]) -> Iterator[Array]:
    """The pictures of frames, flat-fielded by the map of the pixels that the session holds, if it
    holds one.
    """
    even = pixel_correction(reader.pattern())
    return (even(reader.frame(frame)[2]) for frame in frames)


def _fields(
    reader: SessionReader, frames: Iterable[int], dic: Correlation, usable: Bool | None = None
) -> Iterator[Field]:
    """Displacements in the pictures of frames since the first of them."""
    pictures = flat_fielded_pictures(reader, frames)
    first = next(pictures)
    with open_tracker(dic, first, usable=usable) as tracker:
        yield tracker.track(first)
        for picture in pictures:
            yield tracker.track(picture)


def _looked_at(
    reader: SessionReader, region: tuple[str, ...], is_within: bool = True
) -> tuple[Correlation, Bool | None]:
    """How pictures are correlated, and which of their pixels: those within `region`, or outside of
    it; None: all, as where there is no region.
    """
    asked = settings_of(reader).dic
    dic = replace(asked, box=BOX_PX, step=STEP_PX, update="never", region=())
    if not region:
        return dic, None
    rows, columns = reader.header.frame_shape
    polygons = replace(asked, region=region).polygons
    within = measured(polygons, np.arange(1.0 * columns), np.arange(1.0 * rows)[:, None])
    # across a border grey levels are interpolated from pixels that move otherwise
    around = np.ones((2 * BORDER_PX + 1,) * 2, np.uint8)
    usable = cv2.erode((within == is_within).astype(np.uint8), around).astype(np.bool_)
    return replace(dic, method="icgn", order=1), usable


def region_of_marks(config: Config, given: tuple[str, ...]) -> tuple[str, ...]:
    """The region of the picture that shows marks on the lens: that given, or that of the settings;
    UserError where neither is.
    """
    region = given or config.dic.region
    if not region:
        raise UserError(
            "calibrate compliance: the region of the lens in the image is unknown, and the motion"
            " of the block does not show that of the lens; put marks on the lens beside the contact"
            " and give their --region, or the table of a gauge"
        )
    return region


def has_map(reader: SessionReader, region: tuple[str, ...]) -> bool:
    """Whether a session holds a map of the pixels; ValueError where that shows the marks in
    `region`, which are then undone in its pictures.
    """
    pattern, (_, within) = reader.pattern(), _looked_at(reader, region)
    if pattern is None or within is None:
        return pattern is not None
    known = np.isfinite(pattern.gain)
    gains = (pattern.gain[known & place] - 1 for place in (within, ~within))
    marks, others = (robust_sd(gain) if len(gain) else 0.0 for gain in gains)
    if marks > MARKED * max(others, LEAST_GAIN) or 2 * known[within].sum() < within.sum():
        raise ValueError(
            f"map of the pixels: it differs by {100 * marks:.2g} % in the region of the marks and"
            f" by {100 * others:.2g} % elsewhere, and shows nothing in"
            f" {100 * np.mean(~known[within]):.2g} % of it, because the marks were in view when it"
            " was measured, and are taken off like dust; calibrate pattern without them, or from"
            " flat fields"
        )
    return True


def seen_motion(
    reader: SessionReader, times: dict[int, float], region: tuple[str, ...] = ()
) -> SeenMotion:
    """What the pictures of some frames, with their times, show of the motion since the first.

    Parameters
    ----------
    region : tuple of str
        Polygons as in `dic.region`: only pixels in them are looked at.

    Raises
    ------
    ValueError
        What is seen does not move as a whole.
    """
    seen, spread = np.full((2, len(times)), np.nan), 0.0
    for n, field in enumerate(_fields(reader, times, *_looked_at(reader, region))):
        known = np.isfinite(field.ux_px)
        if known.any():
            seen[:, n] = [np.median(u[known]) for u in (field.ux_px, field.uy_px)]
            off = robust_sd(field.ux_px[known] - seen[0, n])
            spread = max(spread, off - SPREAD * math.hypot(*seen[:, n]))
    if spread > SPREAD_PX:
        raise ValueError(
            f"motion: the displacements of one picture differ by {spread:.2g} px, up to"
            f" {SPREAD_PX:g} px are those of what moves as a whole; let the block touch nothing"
        )
    return SeenMotion(np.array(list(times.values())), *seen)


def direction_of_drive(
    reader: SessionReader, times: dict[int, float], region: tuple[str, ...] = ()
) -> Direction:
    """Where positive travel goes in the picture: `camera.angle` of the settings, or by what the
    block outside of `region` has moved when its stage is farthest, where `camera.angle_from` says
    so.

    Raises
    ------
    ValueError
        The block hardly moves in these pictures.
    """
    config = settings_of(reader)
    if config.camera.angle_from == "angle":
        return Direction.at(config.camera.angle)
    travel = np.interp(np.array(list(times.values())), *travel_of(reader))
    travel -= travel[0]
    far = int(np.argmax(np.abs(travel)))
    ends = [[*times][n] for n in (0, far)]
    _, field = _fields(reader, ends, *_looked_at(reader, region, is_within=False))
    everywhere = np.ones(field.ux_px.shape, np.bool_)
    found = drive_direction(field.ux_px, field.uy_px, everywhere, least=LEAST_PX)
    if found is None:
        raise ValueError(
            f"camera.angle: the block moves by less than {LEAST_PX:g} px in the pictures, so that"
            " the direction of its drive is not seen; set camera.angle, and camera.angle_from ="
            " 'angle'"
        )
    return found if travel[far] > 0 else found.reversed


def fields_of_session(path: Path) -> Data:
    """The displacement (px) since the first picture at points of the picture, ``u`` of shape
    (frames, 2, ny, nx), NaN where it is not measured, with their places ``x`` and ``y`` (px), and
    the time (s) and the position of the stage (m) of each picture.

    Raises
    ------
    ValueError
        There are no pictures, or the stage rests.
    """
    with opened(path) as (reader, config):
        stage_s, position = travel_of(reader, config.camera.pixel)
        times = times_of_frames(reader, MOST_FRAMES)
        # each box by itself: a field that is smoothed makes a lens stronger
        dic = replace(_looked_at(reader, ())[0], method="icgn", order=1)
        u = []
        for field in _fields(reader, times, dic):
            every = max(1, math.isqrt(field.ux_px.size // MOST_POINTS))
            x, y = field.x_px[::every], field.y_px[::every]
            u.append(_known(field)[:, ::every, ::every])
        shape = reader.header.frame_shape
    time = np.array(list(times.values()))
    places = dict(zip("xy", np.meshgrid(x, y), strict=True))
    return places | {
        "u": np.array(u, dtype=np.float32),
        "time_s": time,
        "travel_m": np.interp(time, stage_s, position),
        "step_m": encoder_step(position),
        "box": BOX_PX,
        "shape": shape,
        "drift_sd": config.uncertainty.drift,
    }


def displacement_of_pictures(before: Path, after: Path) -> F64:
    """The displacement (px) of a block between two pictures, shape (2, ny, nx), NaN where it is not
    measured.

    Raises
    ------
    ValueError
        The pictures are not of one size.
    """
    first, second = read_image(before), read_image(after)
    return _known(correlate(first, second, box=BOX_PX, step=STEP_PX, method="shared", order=1))


def _known(field: Field) -> F64:
    return np.where(field.status == Status.OK, np.stack([field.ux_px, field.uy_px]), np.nan)
