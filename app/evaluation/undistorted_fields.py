"""Recorded fields, which are those of the picture, as a lens without distortion shows them."""

from __future__ import annotations

import numpy as np

from analysis.arrays import F64, floats
from analysis.undistorted import ideal_displacement, ideal_places
from app.records.record_types import DisplacementField
from app.settings.sections import Config


def undistorted(
    config: Config, field: DisplacementField, x_px: F64, y_px: F64
) -> tuple[F64, F64, F64, F64]:
    """u_x, u_y and their uncertainties in pixels, shape (ny, nx), where such a lens would show the
    points of the field's grid, shape (nx,) and (ny,); as recorded if there is no distortion.
    """
    parts = field.ux_px, field.uy_px, field.ux_std_px, field.uy_std_px
    ux, uy, ux_sd, uy_sd = map(floats, parts)
    lens, across, down = (config.camera.distortion, config.camera.shape), x_px, y_px[:, None]
    if not config.camera.distortion:
        return ux, uy, ux_sd, uy_sd
    from analysis.inversion.material import evened  # with scipy, which a table of fields spares

    x, y = ideal_places(across, down, *lens)
    off = np.stack([y - down, x - across]) / (x_px[1] - x_px[0])
    ux, uy = ideal_displacement(across, down, ux, uy, *lens)
    ux, ux_sd = evened(ux, ux_sd, off)
    uy, uy_sd = evened(uy, uy_sd, off)
    return ux, uy, ux_sd, uy_sd
