"""The true state of the simulated world at one sample, for its cameras and for tests of an
analysis.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from analysis.arrays import F64, all_floats, floats
from analysis.mechanics import hertz
from analysis.mechanics.greenwood_tripp import RoughContact
from analysis.mechanics.tabulated_pressure import TabulatedPressure
from drivers.sim.adhering_contact import AdheringContact
from drivers.sim.optics import IDEAL, Lens
from drivers.sim.sheared import Sheared


@dataclass(frozen=True, slots=True, kw_only=True)
class TrueState:
    """The contact at one sample.

    The lab point x shows the material point ``X = x - rigid + g(x - lens_centre)``, where g is the
    displacement G*sigma (see `radial`) and X is the place of the material point at sample 0. Lab
    coordinates are those of the image: metres from the centre of the top-left pixel, x to the
    right, y down.

    Attributes
    ----------
    sample : int
    normal_force_n, shear_force_n : float
    stage_m : float
        Travel of the stage since sample 0, as it reports it.
    block_m : float
        Displacement of the block, far from the contact, along the drive, relative to the lab since
        contact.
    lens_m : float
        Displacement of the lens along the drive.
    rigid_m : (x, y)
        Displacement of the block, far from the contact, in the image since sample 0: by pressing,
        by the drive and by the drift of the image.
    lens_centre_m : (x, y)
        Centre of the contact in the image.
    hertz_radius_m, apparent_radius_m : float
        a_H, and a_H + sqrt(R h), or the radius of faces that adhere, or of a table; 0 without
        contact.
    rough : RoughContact, TabulatedPressure or None
        The rough face, or the pressure of a table, under the normal force; None where it is smooth.
    adhering : AdheringContact or None
        The faces of a contact with adhesion.
    friction : float
        mu under the normal force.
    drive : (x, y)
        Unit vector of the drive in the image.
    contact : Sheared or None
        The sheared contact; None before the drive.
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
    friction: float
    rough: RoughContact | TabulatedPressure | None = None
    adhering: AdheringContact | None = None
    drive: tuple[float, float]
    contact: Sheared | None = field(compare=False)

    @property
    def stick_radius_m(self) -> float:
        """Radius inside which nothing slips or, under a law without such a radius, at which the
        traction is largest; a_H at rest, 0 without contact.
        """
        return self.contact.stick_radius if self.contact else self.hertz_radius_m

    def radial(self, r_m: ArrayLike) -> tuple[F64, F64]:
        """G*sigma in metres at the distance `r_m` from the contact's centre, as (g0, g2), see
        `Sheared.radial`.
        """
        r = floats(r_m)
        return self.contact.radial(r) if self.contact else (np.zeros_like(r), np.zeros_like(r))

    def traction(self, r_m: ArrayLike) -> F64:
        """Shear traction along the drive in pascals at the distance `r_m` from the contact's
        centre.
        """
        r = floats(r_m)
        return self.contact.traction(r) if self.contact else np.zeros_like(r)

    def pressure(self, r_m: ArrayLike) -> F64:
        """Pressure in pascals at the distance `r_m` from the contact's centre."""
        if (face := self.adhering or self.rough) is not None:
            return face.pressure(r_m)
        return hertz.pressure(r_m, self.normal_force_n, self.hertz_radius_m)

    def surface(self, x_m: ArrayLike, y_m: ArrayLike) -> tuple[F64, F64]:
        """G*sigma (gx, gy) in metres at points (x, y) of the image."""
        x, y = (
            floats(x_m) - self.lens_centre_m[0],
            floats(y_m) - self.lens_centre_m[1],
        )
        along, across = self.drive
        double = 2 * np.arctan2(y, x)
        g0, g2 = self.radial(np.hypot(x, y))
        cos, sin = g2 * np.cos(double), g2 * np.sin(double)
        return along * (g0 + cos) + across * sin, across * (g0 - cos) + along * sin


@dataclass(frozen=True, slots=True)
class Truth:
    """The result that an analysis should have at one sample.

    Attributes
    ----------
    state : TrueState
    pixel_m : float
        Size of a pixel on the interface.
    mu_s : float
        Q/P at the onset; of a block that relaxes, NaN until it slides.
    onset_sample : int or None
        First sample at which the whole contact slides, see `Contact.onset`; None if it does not
        slide yet.
    state_at : callable
        The state at another sample.
    lens : Lens
        Of the camera.
    peaks : tuple of (float, float)
        Of each hold so far after which the stage went on the same way: its duration (s), and the
        greatest Q/P of the slide after it.
    """

    state: TrueState
    pixel_m: float
    mu_s: float
    onset_sample: int | None
    state_at: Callable[[int], TrueState]
    lens: Lens = IDEAL
    peaks: tuple[tuple[float, float], ...] = ()

    def displacement_px(
        self, x_px: ArrayLike, y_px: ArrayLike, reference_sample: int
    ) -> tuple[F64, F64]:
        """Displacement (ux, uy) in the image since `reference_sample` of the material that was at
        (x, y) then; pixels, shape of `x_px`.

        A frame shows the middle of its exposure: take the truth and the reference at
        ``frame.sample + exposure_samples // 2``.
        """
        before, now = self.state_at(reference_sample), self.state
        seen_x, seen_y = all_floats(*np.broadcast_arrays(x_px, y_px))
        x, y = (v * self.pixel_m for v in self.lens.ideal(seen_x, seen_y))
        gx, gy = before.surface(x, y)
        goal_x, goal_y = (
            v + g + now.rigid_m[i] - before.rigid_m[i]
            for i, (v, g) in enumerate(((x, gx), (y, gy)))
        )
        new_x, new_y = goal_x, goal_y
        for _ in range(20):  # strains are a few per cent: each turn gains more than one digit
            gx, gy = now.surface(new_x, new_y)
            new_x, new_y = goal_x - gx, goal_y - gy
        new_x, new_y = self.lens.seen(new_x / self.pixel_m, new_y / self.pixel_m)
        return new_x - seen_x, new_y - seen_y
