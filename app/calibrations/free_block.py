"""What the pictures of a session show of a motion: of a block that touches nothing, or of marks."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from app.settings.config import settings_of
from app.system.errors import UserError

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from analysis.contact.orientation import Direction
    from analysis.settings import Correlation
    from app.session.reader import SessionReader
    from app.settings.sections import Config

BOX_PX = 40  # of the boxes whose median is the motion
BORDER_PX = 4  # along the border of a region, which are not looked at
# of the displacements of one picture: by noise, and the share of its motion that a lens adds
SPREAD_PX, SPREAD = 0.1, 0.03
HALF = 5  # samples of a mean, on either side
LEAST_PX = 0.02  # of motion, whose direction is known to some degrees: a cosine of 1 to 0.3 %


@dataclass(frozen=True)
class SeenMotion:
    """Times of the middle of each exposure (s, from the first sample), and the displacement since
    the first of these pictures, pixels; all of shape (frames,).
    """

    time_s: NDArray[Any]
    ux_px: NDArray[Any]
    uy_px: NDArray[Any]


def times_of_frames(reader: SessionReader, most: int, from_s: float = 0.0) -> dict[int, float]:
    """Number and middle of the exposure (s) of up to so many frames, evenly chosen.

    Raises
    ------
    ValueError
        There are no pictures.
    """
    rate = reader.header.sample_rate_hz
    late = settings_of(reader).camera.exposure_samples(rate) / 2
    triggers = reader.triggers()
    triggers = triggers[triggers["received"] & (triggers["sample"] >= from_s * rate)]
    if not len(triggers):
        later = f" after {from_s:.3g} s" if from_s else ""
        raise ValueError(
            f"pictures: {reader.path} has none{later}; give a session whose camera took pictures"
        )
    every = max(1, -(-len(triggers) // most))
    return {int(t["index"]): (float(t["sample"]) + late) / rate for t in triggers[::every]}


def travel_of(reader: SessionReader, least_m: float = 0.0) -> tuple[NDArray[Any], NDArray[Any]]:
    """Times (s, from the first sample) at which the stage was read, and its positions (m).

    Raises
    ------
    ValueError
        It was not read, or moves by less than `least_m`.
    """
    samples, position = reader.positions()
    moved = float(position.max() - position.min()) if len(position) else -1.0
    if moved < least_m:
        found = f"moves by {moved * 1e6:.3g} um" if len(position) else "was not read"
        raise ValueError(
            f"travel: the stage {found} in {reader.path}, {least_m * 1e6:.3g} um or more are"
            " needed; give a session in which it drives"
        )
    return samples / reader.header.sample_rate_hz, position


def end_of_pictures(images: Sequence[NDArray[Any]], stated: float = 0.0) -> float:
    """The grey level at and above which pixels are saturated: the one that is stated (0: the end of
    the type), unless pictures of 16 bits are cut off at a lower one.
    """
    import numpy as np

    from analysis.saturation import end_of_scale

    kind = images[0].dtype
    stated = stated or (float(np.iinfo(kind).max) if kind.kind == "u" else math.inf)
    return min(end_of_scale(image, stated) for image in images)


def _looked_at(
    reader: SessionReader, region: tuple[str, ...], is_within: bool = True
) -> tuple[Correlation, NDArray[Any] | None]:
    """How pictures are correlated, and which of their pixels: those within `region`, or outside of
    it; None: all, as where there is no region.
    """
    import cv2
    import numpy as np

    from analysis.region import measured

    asked = settings_of(reader).dic
    dic = replace(asked, box=BOX_PX, step=BOX_PX // 2, update="never", region=())
    if not region:
        return dic, None
    rows, columns = reader.header.frame_shape
    polygons = replace(asked, region=region).polygons
    within = measured(polygons, np.arange(1.0 * columns), np.arange(1.0 * rows)[:, None])
    # across a border grey levels are interpolated from pixels that move otherwise
    around = np.ones((2 * BORDER_PX + 1,) * 2, np.uint8)
    usable = cv2.erode((within == is_within).astype(np.uint8), around).astype(np.bool_)
    return replace(dic, method="icgn", order=1), usable


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
    import numpy as np

    from analysis.dic import open_tracker
    from analysis.robust import robust_sd

    dic, usable = _looked_at(reader, region)
    seen: list[tuple[float, float]] = []
    spread, tracker = 0.0, None
    for frame in times:
        image = reader.frame(frame)[2]
        tracker = tracker or open_tracker(dic, image, usable=usable)
        field = tracker.track(image)
        known = np.isfinite(field.ux_px)
        if not known.any():
            seen.append((np.nan, np.nan))
            continue
        ux, uy = (float(np.median(u[known])) for u in (field.ux_px, field.uy_px))
        seen.append((ux, uy))
        off = robust_sd(field.ux_px[known] - ux)
        spread = max(spread, off - SPREAD * float(np.hypot(ux, uy)))
    if tracker is not None:
        tracker.close()
    if spread > SPREAD_PX:
        raise ValueError(
            f"motion: the displacements of one picture differ by {spread:.2g} px, up to"
            f" {SPREAD_PX:g} px are those of what moves as a whole; let the block touch nothing"
        )
    moved = np.reshape(seen, (-1, 2))
    return SeenMotion(np.array(list(times.values())), moved[:, 0], moved[:, 1])


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
    import numpy as np

    from analysis.contact.orientation import Direction, drive_direction
    from analysis.dic import open_tracker

    config = settings_of(reader)
    if config.camera.angle_from == "angle":
        return Direction.at(config.camera.angle)
    when = np.array(list(times.values()))
    travel = np.interp(when, *travel_of(reader))
    travel -= travel[0]
    far = int(np.argmax(np.abs(travel)))
    first, last = (reader.frame(list(times)[n])[2] for n in (0, far))
    dic, outside = _looked_at(reader, region, is_within=False)
    with open_tracker(dic, first, usable=outside) as tracker:
        field = tracker.track(last)
    everywhere = np.ones(field.ux_px.shape, np.bool_)
    found = drive_direction(field.ux_px, field.uy_px, everywhere, least=LEAST_PX)
    if found is None:
        raise ValueError(
            f"camera.angle: the block moves by less than {LEAST_PX:g} px in the pictures, so that"
            " the direction of its drive is not seen; set camera.angle, and camera.angle_from ="
            " 'angle'"
        )
    return found if travel[far] > 0 else found.reversed


def readings_at(reader: SessionReader, time_s: NDArray[Any], channel: str = "") -> list[Any]:
    """Mean Q (N) and, where it is named, a further channel around these times, each of shape (n,).

    Raises
    ------
    UserError
        There is no such channel.
    """
    import numpy as np

    header, samples = reader.header, reader.forces()
    columns = [samples.forces[:, 1]]
    if channel:
        names = list(header.auxiliary.name) if header.auxiliary else []
        if channel not in names or samples.auxiliary is None:
            raise UserError(
                f"{reader.path}: it has no channel '{channel}', but {', '.join(names) or 'none'};"
                " name one of forces.auxiliary"
            )
        columns.append(samples.auxiliary[:, names.index(channel)])
    middle = np.rint(time_s * header.sample_rate_hz).astype(int)
    return [
        np.array([column[max(0, at - HALF) : at + HALF].mean() for at in middle])
        for column in columns
    ]


def relative_sd_of_forces(config: Config) -> tuple[float, float]:
    """Relative standard uncertainties of P and Q, by the settings."""
    from app.evaluation.setup import sensor_chain

    by_stiffness = sensor_chain(config).relative_uncertainty()
    normal, shear = (math.hypot(one, config.uncertainty.sensitivity) for one in by_stiffness)
    return normal, shear
