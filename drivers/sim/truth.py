"""What is true in the simulated world at one sample: for its cameras, and for those who check an analysis against it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from analysis.mechanics import cattaneo_mindlin

F64 = NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class State:
    """The contact at one sample.

    The lab point x shows the material point ``X = x - rigid + g(x - lens_centre)``, where g is the displacement G*sigma that `radial` gives
    and X is where the material point was at sample 0. Lab coordinates are those of the image: metres from the centre of the top-left
    pixel, x in the driving direction, y down.

    Attributes
    ----------
    sample : int
    normal_force_n, shear_force_n : float
    stage_m : float
        Travel of the stage since sample 0.
    block_m : float
        Displacement of the block, far from the contact, relative to the lab since contact.
    lens_m : float
        Displacement of the lens in the lab.
    rigid_m : (x, y)
        Displacement of the block, far from the contact, in the image since sample 0: while it is pressed on, and driven.
    lens_centre_m : (x, y)
        Centre of the contact in the image.
    hertz_radius_m, apparent_radius_m, stick_radius_m : float
        a_H, a_H + sqrt(R h) and c; 0 without contact.
    friction, young_modulus_pa, poisson : float
    """

    sample: int
    normal_force_n: float
    shear_force_n: float
    stage_m: float
    block_m: float
    lens_m: float
    rigid_m: tuple[float, float]
    lens_centre_m: tuple[float, float]
    hertz_radius_m: float
    apparent_radius_m: float
    stick_radius_m: float
    friction: float
    young_modulus_pa: float
    poisson: float

    def radial(self, r_m: ArrayLike) -> tuple[F64, F64]:
        """G*sigma in metres at the distance `r_m` from the contact's centre: ``gx = g0 + g2 cos 2 theta``, ``gy = g2 sin 2 theta``."""
        r = np.asarray(r_m, dtype=np.float64)
        if self.shear_force_n == 0:
            return np.zeros_like(r), np.zeros_like(r)
        return cattaneo_mindlin.radial_displacement(
            r, self.shear_force_n, self.friction, self.normal_force_n, self.hertz_radius_m, self.young_modulus_pa, self.poisson
        )

    def surface(self, x_m: ArrayLike, y_m: ArrayLike) -> tuple[F64, F64]:
        """G*sigma (gx, gy) in metres at points (x, y) of the image."""
        x, y = np.asarray(x_m, dtype=np.float64) - self.lens_centre_m[0], np.asarray(y_m, dtype=np.float64) - self.lens_centre_m[1]
        double = 2 * np.arctan2(y, x)
        g0, g2 = self.radial(np.hypot(x, y))
        return g0 + g2 * np.cos(double), g2 * np.sin(double)


@dataclass(frozen=True, slots=True)
class Truth:
    """What an analysis should find at one sample.

    Attributes
    ----------
    state : State
    pixel_m : float
        Size of a pixel on the interface.
    mu_s : float
        Friction coefficient at which the whole contact slides.
    onset_sample : int or None
        First sample at which the whole contact slides; None where it has not yet.
    state_at : callable
        The state at another sample.
    """

    state: State
    pixel_m: float
    mu_s: float
    onset_sample: int | None
    state_at: Callable[[int], State]

    def displacement_px(self, x_px: ArrayLike, y_px: ArrayLike, reference_sample: int) -> tuple[F64, F64]:
        """Displacement (ux, uy) in the image, since `reference_sample`, of what was seen at (x, y) then; pixels, shape of `x_px`.

        A frame shows the middle of its exposure: ask for the truth and the reference at ``frame.sample + exposure_samples // 2``.
        """
        before, now = self.state_at(reference_sample), self.state
        x, y = (np.asarray(v, dtype=np.float64) * self.pixel_m for v in np.broadcast_arrays(x_px, y_px))
        gx, gy = before.surface(x, y)
        goal_x, goal_y = (v + g + now.rigid_m[i] - before.rigid_m[i] for i, (v, g) in enumerate(((x, gx), (y, gy))))
        new_x, new_y = goal_x, goal_y
        for _ in range(20):  # strains are a few per cent: each turn gains more than one digit
            gx, gy = now.surface(new_x, new_y)
            new_x, new_y = goal_x - gx, goal_y - gy
        return (new_x - x) / self.pixel_m, (new_y - y) / self.pixel_m
