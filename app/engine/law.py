"""The local friction law and Young's modulus from the tractions of a drive."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from analysis.friction.local_law import LocalLaw, fit_local_law
from analysis.friction.modulus import Modulus, balance_modulus
from app.numbers import series_of
from app.records import Snapshot
from app.settings import Config

FORCE_NOISE_N = 1e-3  # of the mean over an exposure, where the record is too short to tell


def local_law(config: Config, drive: Sequence[Snapshot]) -> tuple[LocalLaw, Modulus]:
    """The local friction law and Young's modulus from the tractions of a drive; NaN where there are
    none.
    """
    measured = [s for s in drive if s.traction is not None]
    if not measured:
        return LocalLaw(), Modulus()
    sample, pixel_m = config.sample, config.camera.pixel
    P, Q, integral, integral_sd = (
        series_of(measured, name)
        for name in ("normal_force_n", "shear_force_n", "stress_force_n", "stress_force_sd_n")
    )
    noise = FORCE_NOISE_N
    if len(Q) > 8:
        noise = float(1.4826 * np.median(np.abs(np.diff(Q, 2))) / math.sqrt(6))
    noise = max(noise, 0.01 * FORCE_NOISE_N)
    # a long series keeps the rings of some frames
    rings = [s.rings for s in measured if s.rings is not None]
    is_ringed = np.array([s.rings is not None for s in measured])
    n = max(len(one.radius_m) for one in rings)
    radii, ux, sd = (
        np.array([np.pad(row, (0, n - len(row)), constant_values=np.nan) for row in rows])
        for rows in zip(*((one.radius_m, one.ux_m, one.sd_m) for one in rings), strict=True)
    )
    law = fit_local_law(
        np.nanmedian(radii, axis=0),
        ux,
        sd,
        P[is_ringed],
        Q[is_ringed],
        E=sample.young_modulus,
        nu=sample.poisson,
        R=sample.lens_radius,
        Q_sd=noise,
        thickness=sample.depth,
        box=config.dic.averaging_box_px * pixel_m,
        width=config.dic.step * pixel_m,
    )
    return law, balance_modulus(integral, integral_sd, Q, sample.young_modulus, Q_sd=noise)
