"""The local friction law, Young's modulus and the pressure from the ring means of a drive."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from analysis.contact.rings import Rings
from analysis.friction.local_law import LocalLaw, fit_local_law
from analysis.inversion.axisymmetric import AxisymmetricInversion
from app.engine.setup import grid_of
from app.engine.tractions import radial_inversion
from app.numbers import series_of
from app.records import ContactResult, RingProfile, Snapshot
from app.settings import Config

FORCE_NOISE_N = 1e-3  # of the mean over an exposure, where the record is too short to tell


def local_law(
    config: Config, drive: Sequence[Snapshot], contact: ContactResult | None, hertz_m: float
) -> LocalLaw:
    """The local friction law from the rings of a drive; NaN where no traction was computed.

    `hertz_m` is Hertz's contact radius under the normal force, metres.
    """
    if contact is None or not any(s.traction for s in drive):
        return LocalLaw()
    measured = [s for s in drive if s.rings is not None]  # a long series keeps those of some frames
    P, Q = (series_of(measured, name) for name in ("normal_force_n", "shear_force_n"))
    inversion = radial_inversion(config, *_places(config, contact), hertz_m)
    rings = [_counted(s.rings, inversion) for s in measured if s.rings is not None]
    return fit_local_law(rings, P, Q, inversion, Q_sd=force_noise(Q))


def force_noise(Q: np.ndarray) -> float:
    """Standard deviation of the noise of a force from frame to frame, newtons."""
    noise = FORCE_NOISE_N
    if len(Q) > 8:
        noise = float(1.4826 * np.median(np.abs(np.diff(Q, 2))) / math.sqrt(6))
    return max(noise, 0.01 * FORCE_NOISE_N)


def _places(config: Config, contact: ContactResult) -> tuple[np.ndarray, np.ndarray]:
    """Grid points from the contact's centre, metres, shape (ny, nx)."""
    grid, pixel_m = grid_of(config), config.camera.pixel
    x, y = contact.centre_px
    columns, rows = np.meshgrid(grid.x_px - x, grid.y_px - y)
    return columns * pixel_m, rows * pixel_m


def _counted(rings: RingProfile, inversion: AxisymmetricInversion) -> Rings:
    """The rings with the number of points that a whole one has."""
    n = min(len(rings.ux_m), len(inversion.radius))
    count = np.where(np.isfinite(rings.ux_m[:n]), inversion.points[:n].round(), 0)
    return Rings(rings.radius_m[:n], rings.ux_m[:n], rings.sd_m[:n], count.astype(np.int64))
