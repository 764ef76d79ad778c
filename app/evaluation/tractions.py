"""The shear traction under each displacement field of a run: set up once on the reference frame,
then quick enough for every frame.
"""

from __future__ import annotations

import math

import numpy as np

from analysis.arrays import F32, F64
from analysis.contact.orientation import ALONG_X, Direction
from analysis.contact.rings import Rings
from analysis.friction.largest_stress import stress_peak
from analysis.inversion.axisymmetric import AxisymmetricInversion
from analysis.inversion.iterative import conjugate_gradient
from analysis.inversion.material import as_seen
from analysis.inversion.problem import InversionProblem
from analysis.inversion.result import EndOfInversion, RadialInversion
from app.records.record_types import StressProfile, Traction
from app.settings.sections import Config

ITERATIONS = 5
OFTEN = 0.1  # share of the frames from which a doubt is told
PEAK_REACH = 0.12  # half width of the cubic through the largest traction, share of a
# of that, by which the cubic's top is off that of an elasto-plastic traction
UNEVEN = 1 / 25
# in sqrt(R h), and in pitches: beyond, a rough contact has less than 1 % of its pressure
RIM, MARGIN = 2.0, 2


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
        sample, pixel_m = config.sample, config.camera.pixel
        self._pitch = config.dic.step * pixel_m
        if not hertz_radius_m > 0:
            raise ValueError(
                "stress: there is no normal force, so that the contact has no radius; press it"
                " before the reference is taken"
            )
        self._profile = radial_inversion(config, x_m, y_m, hertz_radius_m)
        self._frames = self._uncovered = self._doubtful = self._oblique = 0
        self._refused, self._refusal = 0, ""
        self._fields = self._unconverged = self._without = 0
        self._reach = PEAK_REACH * hertz_radius_m
        self._problem: InversionProblem | None = None
        self._last: F64 | None = None
        if config.stress.field:
            mask = np.hypot(x_m, y_m) < self._profile.mask_radius
            E, nu = sample.young_modulus, sample.poisson
            box = config.dic.averaging_box_px * pixel_m
            self._problem = InversionProblem(
                mask, self._pitch, E, nu, box=box, thickness=sample.depth
            )

    def notes(self) -> list[str]:
        """What limits the tractions of the run so far."""
        n, said = self._frames, []
        if self._refused:
            said.append(
                f"shear traction: {self._refused} of {n} frames were not inverted; the first:"
                f" {self._refusal}"
            )
        if self._oblique:
            said.append(
                f"field of the shear traction: in {self._oblique} frames there is none, since the"
                " drive does not go along the rows of the picture; turn the camera"
            )
        if self._without:
            said.append(
                f"field of the shear traction: {self._without} frames have none, since too few"
                " points were measured"
            )
        if self._unconverged:
            said.append(
                f"field of the shear traction: in {self._unconverged} of {self._fields} frames it"
                f" had not converged after {ITERATIONS} iterations; for its fine detail use"
                " slipscope invert"
            )
        if self._uncovered > OFTEN * n:
            said.append(
                f"shear traction: in {self._uncovered} of {n} frames the field does not cover the"
                " contact; widen it"
            )
        if self._doubtful > OFTEN * n:
            said.append(
                f"shear traction: in {self._doubtful} of {n} frames the residual is above the noise"
                " or the traction not 0 at the rim"
            )
        return said

    def field(self, ux_m: F64, sd_m: F64, drive: Direction = ALONG_X) -> F32 | None:
        """The traction of every grid point from u_x on the material grid, lens compliance removed;
        None where the settings do not ask for it, or the field does not allow it. Both are along
        the drive, which must go along the rows of the picture, either way.

        Five conjugate gradients from the last field's solution: detail that one field's noise hides
        lags by a few frames.
        """
        if self._problem is None:
            return None
        if not drive.is_along_rows:
            self._oblique += 1
            return None
        seen, seen_sd = as_seen(ux_m, sd_m, self._pitch, drive)
        try:
            found = conjugate_gradient(
                self._problem, seen, seen_sd, start=self._last, iterations=ITERATIONS
            )
        except ValueError:
            self._without += 1
            return None
        self._fields += 1
        self._unconverged += found.stopped in (EndOfInversion.ITERATIONS, EndOfInversion.STAGNATION)
        self._last = found.sigma
        return found.sigma.astype(np.float32)

    def of(self, rings: Rings) -> tuple[Traction, StressProfile] | tuple[None, None]:
        """The traction under the rings of a frame, None where they do not allow an inversion."""
        self._frames += 1
        try:
            found = self._profile.solve(rings)
        except ValueError as error:
            self._refused, self._refusal = self._refused + 1, self._refusal or str(error)
            return None, None
        self._uncovered += not found.is_covered
        self._doubtful += not found.is_converged and found.stopped is not EndOfInversion.SILENT
        inside = found.radius < self._profile.mask_radius
        c = largest_traction(found, self._profile.mask_radius, self._reach)
        traction = Traction(*c, found.D, found.D_sd, found.Q, found.Q_sd)
        profile = StressProfile(found.radius[inside], found.sigma[inside], found.sigma_sd[inside])
        return traction, profile


def largest_traction(
    found: RadialInversion, mask_radius: float, reach: float
) -> tuple[float, float]:
    """c, the radius of the largest traction, and its uncertainty, metres: by noise, and by what the
    curve through it is off; `reach` as for `stress_peak`.
    """
    inside = found.radius < mask_radius
    covariance = found.covariance[np.ix_(inside, inside)]
    peak = stress_peak(found.radius[inside], found.sigma[inside], covariance, reach=reach)
    return peak.radius, math.hypot(peak.radius_sd, UNEVEN * reach)


def mask_radius_m(config: Config, hertz_radius_m: float) -> float:
    """The distance from the contact's centre beyond which there is no traction, metres."""
    return hertz_radius_m + RIM * config.sample.rim + MARGIN * config.dic.step * config.camera.pixel


def radial_inversion(
    config: Config, x_m: F64, y_m: F64, hertz_radius_m: float, averaging: float = 1.0
) -> AxisymmetricInversion:
    """The inversion of the ring means of a run; parameters and errors as for `Tractions`.

    `averaging` is the side of the box over which u_x is averaged over that of the settings.
    """
    sample, dic, pixel_m = config.sample, config.dic, config.camera.pixel
    pitch = config.dic.step * pixel_m
    return AxisymmetricInversion(
        x_m,
        y_m,
        pitch,
        mask_radius_m(config, hertz_radius_m),
        sample.young_modulus,
        sample.poisson,
        edge=hertz_radius_m,
        box=averaging * (dic.box if dic.is_quadratic else dic.averaging_box_px) * pixel_m,
        is_quadratic=dic.is_quadratic,
        noise_box=config.dic.noise_box_px * pixel_m,
        thickness=sample.depth,
    )
