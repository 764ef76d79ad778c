"""The fields of a session at its numbered instants: displacements in the whole picture, and the
shear traction by the most accurate inversion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import closing

import numpy as np

from analysis.arrays import F64
from analysis.contact.orientation import Direction
from analysis.inversion.material import as_seen
from analysis.inversion.regularised import RegularisedInversion
from app.evaluation.pipeline import Pipeline
from app.evaluation.setup import grid_of, hertz_radius_m, places_m
from app.evaluation.tractions import mask_radius_m
from app.evaluation.undistorted_fields import undistorted
from app.records.effort import Effort, Product
from app.records.lens_motion import drive_of, lens_xy_m
from app.records.pixel_pattern import PixelPattern
from app.records.record_types import Snapshot
from app.records.study_results import Instants
from app.session.reader import SessionReader
from app.settings.sections import Config

WHOLE = Effort(int(Product.CONTACT | Product.PICTURE | Product.SETTLED))


def instants_of(
    config: Config,
    session: SessionReader,
    pattern: PixelPattern | None,
    before: Sequence[Snapshot],
    chosen: Sequence[Snapshot],
    modulus_pa: float,
) -> Instants:
    """The fields of some frames of a session.

    Parameters
    ----------
    pattern : PixelPattern or None
        What is undone in every picture.
    before : sequence of Snapshot
        The frames that the fields rest on: of the free block, and the reference; with a rolling
        shutter also the frame before each of those chosen.
    chosen : sequence of Snapshot
        The frames, in order.
    modulus_pa : float
        Young's modulus of the run, for the traction; NaN: that of the settings.
    """
    grid, pixel_m = grid_of(config), np.float64(config.camera.pixel)
    centre, shots = _correlated(config, session, pattern, before, chosen)
    centre_x, centre_y = places_m(config, *centre)
    x_m, y_m = grid.x_px * pixel_m - centre_x, grid.y_px * pixel_m - centre_y
    invert = _inversion(config, x_m, y_m, shots[-1] if shots else None)
    scale = modulus_pa / config.sample.young_modulus if math.isfinite(modulus_pa) else 1.0
    fields = np.full((3, len(shots), *grid.shape), np.nan, np.float32)
    for ux, uy, stress, shot in zip(*fields, shots, strict=True):
        field, motion = shot.field, shot.motion
        if field is None or motion is None:
            continue
        drive, (lens_x, lens_y) = drive_of(motion), lens_xy_m(motion)
        u, v, sd, _ = (w * pixel_m for w in undistorted(config, field, grid.x_px, grid.y_px))
        ux[:], uy[:] = u - lens_x, v - lens_y
        if invert is not None and drive.is_along_rows:
            stress[:] = scale * _traction(invert, drive.along(u, v) - motion.lens_m, sd, drive)
    return Instants(np.array([shot.frame for shot in shots], np.int64), x_m, y_m, *fields)


def _correlated(
    config: Config,
    session: SessionReader,
    pattern: PixelPattern | None,
    before: Sequence[Snapshot],
    chosen: Sequence[Snapshot],
) -> tuple[tuple[float, float], list[Snapshot]]:
    """Centre of the contact in pixels, and the frames with their fields."""
    pipeline = Pipeline(config, pattern)
    # once each: a rolling shutter is not corrected by a frame itself
    once = {s.frame: s for s in (*before, *chosen)}
    with closing(pipeline):
        shots = {
            s.frame: pipeline.step(
                s.frame, s.sample, session.frame(s.frame)[2], s.conditions, WHOLE
            )
            for s in sorted(once.values(), key=lambda s: s.sample)
        }
    centre = pipeline.contact.centre_px if pipeline.contact else (0.0, 0.0)
    return centre, [shots[s.frame] for s in chosen]


def _inversion(
    config: Config, x_m: F64, y_m: F64, shot: Snapshot | None
) -> RegularisedInversion | None:
    """What inverts the fields; None where there is no force or the settings ask for no traction."""
    hertz_m = hertz_radius_m(config, shot.conditions.normal_force_n) if shot else math.nan
    if not math.isfinite(hertz_m) or config.stress.method == "none":
        return None
    sample, pixel_m = config.sample, config.camera.pixel
    try:
        return RegularisedInversion(
            x_m,
            y_m,
            mask_radius_m(config, hertz_m),
            sample.young_modulus,
            sample.poisson,
            edge=hertz_m,
            box=config.dic.averaging_box_px * pixel_m,
            noise_box=config.dic.noise_box_px * pixel_m,
            thickness=sample.depth,
        )
    except ValueError:  # the contact is not in the picture: the notes of the run say so
        return None


def _traction(invert: RegularisedInversion, u: F64, sd: F64, drive: Direction) -> F64:
    """The traction along the drive at every point, NaN where the field does not allow it."""
    seen, seen_sd = as_seen(u, sd, float(invert.problem.pitch), drive)
    try:
        return invert.solve(seen, seen_sd).sigma
    except ValueError:
        return np.full(u.shape, np.nan)
