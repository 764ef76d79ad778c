"""The shear traction under each displacement field of a run: set up once on the reference frame, then quick enough for every frame."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.contact.rings import Rings
from analysis.inversion.axisymmetric import AxisymmetricInversion
from app.config import Config, averaging_box_px

F64 = NDArray[np.float64]

MARGIN = 2  # pitches by which the mask is larger than the apparent contact


class Tractions:
    """Inverts the fields of one run.

    Parameters
    ----------
    config : Config
    x_m, y_m : ndarray, shape (ny, nx)
        Grid points from the contact's centre.
    hertz_radius_m : float
        Contact radius under the normal force.

    Raises
    ------
    ValueError
        The field does not allow it; the message says why.
    """

    def __init__(self, config: Config, x_m: F64, y_m: F64, hertz_radius_m: float) -> None:
        sample, pixel_m = config.sample, config.camera.pixel * 1e-6
        self._pitch = config.dic.step * pixel_m
        if not hertz_radius_m > 0:
            raise ValueError("stress: there is no normal force, so that the contact has no radius; press it before the reference is taken")
        rough = math.sqrt(sample.lens_radius * 1e-3 * sample.roughness * 1e-6)
        self._profile = AxisymmetricInversion(
            x_m,
            y_m,
            self._pitch,
            hertz_radius_m + rough + MARGIN * self._pitch,
            sample.young_modulus * 1e6,
            sample.poisson,
            edge=hertz_radius_m,
            box=averaging_box_px(config.dic) * pixel_m,
            noise_box=config.dic.box * pixel_m,
            thickness=sample.thickness * 1e-3 or math.inf,
        )

    def of(self, rings: Rings) -> dict[str, Any]:
        """What a snapshot says of the shear traction, by its names there; nothing where the rings do not allow an inversion."""
        try:
            found = self._profile.solve(rings)
        except ValueError:
            return {}
        inside = found.radius < self._profile.mask_radius
        return {
            "block_m": found.D,
            "block_sd_m": found.D_sd,
            "stress_force_n": found.Q,
            "stress_force_sd_n": found.Q_sd,
            "stress_radius_m": found.radius[inside],
            "stress_pa": found.sigma[inside],
            "stress_sd_pa": found.sigma_sd[inside],
        }
