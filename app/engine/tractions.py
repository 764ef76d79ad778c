"""The shear traction under each displacement field of a run: set up once on the reference frame,
then quick enough for every frame.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from analysis.contact.rings import Rings
from analysis.friction.local_law import fit_local_law
from analysis.friction.modulus import balance_modulus
from analysis.friction.stress_peak import stress_peak
from analysis.inversion.axisymmetric import AxisymmetricInversion
from analysis.inversion.conjugate import conjugate_gradient
from analysis.inversion.problem import InversionProblem
from app.results import Snapshot
from app.settings import Config

F64 = NDArray[np.float64]

FORCE_NOISE_N = 1e-3  # of the mean over an exposure, where the record is too short to tell
ITERATIONS = 5
OFTEN = 0.1  # share of the frames from which a doubt is told
PEAK_REACH = 0.1  # of a: the parabola through the largest traction goes so far to either side
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
        sample, pixel_m = config.sample, config.camera.pixel
        self._pitch = config.dic.step * pixel_m
        if not hertz_radius_m > 0:
            raise ValueError(
                "stress: there is no normal force, so that the contact has no radius; press it"
                " before the reference is taken"
            )
        self._profile = AxisymmetricInversion(
            x_m,
            y_m,
            self._pitch,
            hertz_radius_m + sample.rim + MARGIN * self._pitch,
            sample.young_modulus,
            sample.poisson,
            edge=hertz_radius_m,
            box=config.dic.averaging_box_px * pixel_m,
            noise_box=config.dic.box * pixel_m,
            thickness=sample.depth,
        )

        self._frames = self._uncovered = self._doubtful = 0
        self._refused, self._refusal = 0, ""
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

    def field(self, ux_m: F64, sd_m: F64) -> dict[str, Any]:
        """The traction of every grid point from u_x on the material grid, lens compliance removed;
        nothing where it was not asked for.

        Five conjugate gradients from the last field's solution: detail that one field's noise hides
        lags by a few frames.
        """
        if self._problem is None:
            return {}
        places = as_seen(ux_m, self._pitch)
        try:
            found = conjugate_gradient(
                self._problem,
                _at(ux_m, places),
                _at(sd_m, places),
                start=self._last,
                iterations=ITERATIONS,
            )
        except ValueError:
            return {}
        self._last = found.sigma
        return {"stress_field_pa": found.sigma.astype(np.float32)}

    def of(self, rings: Rings) -> dict[str, Any]:
        """What a snapshot says of the shear traction, by its names there; nothing where the rings
        do not allow an inversion.
        """
        self._frames += 1
        try:
            found = self._profile.solve(rings)
        except ValueError as error:
            self._refused, self._refusal = self._refused + 1, self._refusal or str(error)
            return {}
        self._uncovered += not found.is_covered
        self._doubtful += not found.is_converged
        inside = found.radius < self._profile.mask_radius
        peak = stress_peak(
            found.radius[inside],
            found.sigma[inside],
            found.covariance[np.ix_(inside, inside)],
            reach=self._reach,
        )
        return {
            "peak_radius_m": peak.radius,
            "peak_radius_sd_m": peak.radius_sd,
            "block_m": found.D,
            "block_sd_m": found.D_sd,
            "stress_force_n": found.Q,
            "stress_force_sd_n": found.Q_sd,
            "stress_radius_m": found.radius[inside],
            "stress_pa": found.sigma[inside],
            "stress_sd_pa": found.sigma_sd[inside],
        }


def as_seen(ux_m: F64, pitch_m: float) -> tuple[Any, Any]:
    """Where on the material grid, in columns and rows, the points are that a camera at rest sees at
    its own grid's points.
    """
    rows, columns = np.indices(ux_m.shape, dtype=np.float32)
    moved = (np.nan_to_num(ux_m, nan=float(np.nanmedian(ux_m))) / pitch_m).astype(np.float32)
    x = columns
    for _ in range(2):  # gradients are a few per cent
        x = columns - cv2.remap(moved, x, rows, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return x, rows


def _at(values: F64, places: tuple[Any, Any]) -> F64:
    """A field at other places, NaN outside and next to points that were not measured."""
    typical = float(np.nanmedian(values))
    seen = cv2.remap(
        (values - typical).astype(np.float32),
        *places,
        cv2.INTER_CUBIC,
        borderMode=cv2.BORDER_CONSTANT,
        borderValue=np.nan,
    )
    return np.asarray(seen + typical, np.float64)


def local_law(
    config: Config, drive: Sequence[Snapshot]
) -> tuple[dict[str, float], tuple[str, ...]]:
    """What the summary of a drive says of the local friction law and of Young's modulus, by its
    names there, and notes.
    """
    measured = [s for s in drive if math.isfinite(s.stress_force_n)]
    if not measured:
        return {}, ()
    sample, pixel_m = config.sample, config.camera.pixel
    P, Q, integral, integral_sd = (
        np.array([getattr(s, name) for s in measured])
        for name in ("normal_force_n", "shear_force_n", "stress_force_n", "stress_force_sd_n")
    )
    noise = (
        float(1.4826 * np.median(np.abs(np.diff(Q, 2))) / math.sqrt(6))
        if len(Q) > 8
        else FORCE_NOISE_N
    )
    noise = max(noise, 0.01 * FORCE_NOISE_N)
    # a long series keeps the rings of some
    is_ringed = np.array([s.ring_radius_m.size > 0 for s in measured])
    n = max(len(s.ring_radius_m) for s in measured)
    radii, ux, sd = (
        np.array(
            [
                np.pad(getattr(s, name), (0, n - len(getattr(s, name))), constant_values=np.nan)
                for s in measured
            ]
        )[is_ringed]
        for name in ("ring_radius_m", "ring_ux_m", "ring_sd_m")
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
    modulus = balance_modulus(integral, integral_sd, Q, sample.young_modulus, Q_sd=noise)
    found = {
        "law_mu": law.mu,
        "law_mu_sd": law.mu_sd,
        "law_length_m": law.L,
        "law_length_sd_m": law.L_sd,
        "young_modulus_pa": modulus.E,
        "young_modulus_sd_pa": modulus.E_sd,
    }
    return found, (*law.notes, *modulus.notes)
