"""Fields of the displacement of a block that touches nothing, in the pictures of a session."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.calibrations.free_block import times_of_frames, travel_of
from app.settings.config import settings_of

if TYPE_CHECKING:
    from analysis.dic.field import Field
    from app.calibrations.calibration import Data

MOST_FRAMES = 80
BOX_PX, STEP_PX = 40, 20
MOST_POINTS = 1500  # of a field that are kept


def fields_of_session(path: Path) -> Data:
    """The displacement (px) since the first picture at points of the picture, ``u`` of shape
    (frames, 2, ny, nx), NaN where it is not measured, with their places ``x`` and ``y`` (px), and
    the time (s) and the position of the stage (m) of each picture.

    Raises
    ------
    ValueError
        There are no pictures, or the stage rests.
    """
    import numpy as np

    from analysis.calibration.stage_motion import encoder_step
    from analysis.dic import open_tracker
    from app.session.reader import SessionReader

    with SessionReader(path) as reader:
        config = settings_of(reader)
        stage_s, position = travel_of(reader, config.camera.pixel)
        times = times_of_frames(reader, MOST_FRAMES)
        first = reader.frame(next(iter(times)))[2]
        dic = replace(config.dic, box=BOX_PX, step=STEP_PX, update="never", method="icgn")
        with open_tracker(replace(dic, order=1, region=()), first) as tracker:
            every = max(1, math.isqrt(math.prod(tracker.grid.shape) // MOST_POINTS))
            thin = np.s_[::every, ::every]
            x, y = np.meshgrid(tracker.grid.x_px, tracker.grid.y_px)
            u = [_known(tracker.track(reader.frame(one)[2]))[:, *thin] for one in times]
    time = np.array(list(times.values()))
    return {
        "x": x[thin],
        "y": y[thin],
        "u": np.array(u, dtype=np.float32),
        "time_s": time,
        "travel_m": np.interp(time, stage_s, position),
        "step_m": encoder_step(position),
        "box": BOX_PX,
        "shape": first.shape,
        "drift_sd": config.uncertainty.drift,
    }


def displacement_of_pictures(before: Path, after: Path) -> Any:
    """The displacement (px) of a block between two pictures, shape (2, ny, nx), NaN where it is not
    measured.

    Raises
    ------
    ValueError
        The pictures are not of one size.
    """
    from analysis.dic import correlate
    from app.files.grey_images import read_image

    first, second = read_image(before), read_image(after)
    return _known(correlate(first, second, box=BOX_PX, step=STEP_PX, method="shared", order=1))


def _known(field: Field) -> Any:
    import numpy as np

    from analysis.dic import Status

    return np.where(field.status == Status.OK, np.stack([field.ux_px, field.uy_px]), np.nan)
