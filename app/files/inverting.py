"""Shear tractions from a series of displacement fields."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import repeat
from pathlib import Path
from typing import Any

import numpy as np
from scipy import ndimage

from analysis.arrays import F64
from analysis.contact.orientation import Direction
from analysis.contact.rings import ring_means
from analysis.inversion.coupled import CoupledProblem
from analysis.inversion.material import as_seen
from analysis.inversion.methods import inverter
from analysis.inversion.problem import mask_radius
from analysis.inversion.result import Inversion, RadialInversion
from analysis.options import SettingError, options
from app.files.field_files import FieldSeries
from app.session.tables import in_units
from app.settings.sections import ContactSettings, InversionSettings, flag
from app.system.errors import UserError
from app.system.outputs import new_file, write_csv

ENDINGS = (".csv", ".npz")
# share of the bump that the contact makes in the field: the part above gives the contact's centre
HALF = 0.5


@dataclass(frozen=True, slots=True)
class InvertedField:
    """The traction under one field along the drive; `profile` is its azimuthal mean about the
    contact's centre as (r, sigma, standard uncertainty), `across` the component across the drive.
    """

    number: int
    result: Inversion
    profile: tuple[F64, F64, F64]
    across: F64 | None = None

    @property
    def peak(self) -> tuple[float, float]:
        """The radius, m, at which the profile is largest, of either sign, and its value, Pa."""
        r, sigma, _ = self.profile
        largest = np.nanargmax(np.abs(sigma))
        return float(r[largest]), float(sigma[largest])

    @property
    def residual_over_noise(self) -> float:
        """Root mean square of the residual in units of the noise."""
        return math.sqrt(self.result.chi2)


def with_centre(series: FieldSeries) -> FieldSeries:
    """The series with the contact's centre, computed from the last field unless it is known: the
    centroid of the upper half of the bump that the contact makes in u_x, of either sign.

    Raises
    ------
    UserError
        There is no bump.
    """
    if series.centre_m is not None:
        return series
    *_, (_, ux, _) = series.fields()
    rim = np.concatenate([ux[0], ux[-1], ux[:, 0], ux[:, -1]])
    usual = np.nanmedian(rim) if np.isfinite(rim).any() else np.nan
    lag = ndimage.median_filter(np.nan_to_num(usual - ux), 3)  # without single wild points
    bump = max(lag, -lag, key=np.max)  # of a block that goes to -x it is upside down
    weight = np.maximum(bump - HALF * bump.max(), 0.0)
    if not weight.sum() > 0:
        raise UserError(
            "invert: no contact stands out of the last field; give its place with --centre"
        )
    x, y = np.meshgrid(series.x_m, series.y_m)
    weight, moved = weight / weight.sum(), np.nan_to_num(ux)
    now_x, now_y = x + series.direction.x * moved, y + series.direction.y * moved
    centre = float(np.vdot(weight, now_x)), float(np.vdot(weight, now_y))
    return replace(series, centre_m=centre)


def contact_of(series: FieldSeries, given: Mapping[str, Any]) -> InversionSettings:
    """What the fields were measured on and how they are inverted: what is given, by the names of
    `InversionSettings` in SI units, and else what the series knows.

    Raises
    ------
    UserError
        Something is not known, or cannot be.
    """
    known = {"roughness": 0.0, "thickness": 0.0, **series.contact, **given}
    missing = [flag(name) for name in options(ContactSettings) if name not in known]
    if missing:
        raise UserError(
            f"invert: {', '.join(missing)} not given; a file of fields does not say what they were"
            " measured on"
        )
    if unknown := sorted(set(known) - set(options(InversionSettings))):
        raise UserError(
            f"invert: {unknown[0]} is not known; give {', '.join(options(InversionSettings))}"
        )
    try:
        return InversionSettings(**known)
    except SettingError as error:
        raise UserError(f"invert: {error}") from None


def invert_series(
    series: FieldSeries, settings: InversionSettings, failures: list[str]
) -> Iterator[InvertedField]:
    """The traction under each field of a series whose centre is known, one at a time.

    Fields that cannot be inverted are left out; `failures` gets a sentence about each.

    Raises
    ------
    UserError
        The fields do not allow any inversion.
    """
    pitch, centre, drive = series.pitch_m, series.centre_m, series.direction
    if centre is None:
        raise ValueError("invert_series: the centre must be known; use `with_centre`")
    if abs(float(series.y_m[1] - series.y_m[0]) / pitch - 1) > 1e-3:
        raise UserError(
            "invert: the points lie at another distance along x than along y; interpolate them on a"
            " square grid"
        )
    is_coupled, across = settings.method == "coupled", series.across
    if is_coupled and across is None:
        raise UserError(
            f"invert: {series.path} has no displacement across the drive, and --method coupled"
            " needs both; give a session"
        )
    if settings.method not in ("axisymmetric", "coupled") and not drive.is_along_rows:
        raise UserError(
            f"invert: the drive goes at {math.degrees(drive.angle):.1f} degrees from the rows of"
            f" the fields, and --method {settings.method} needs one along them; use --method"
            " axisymmetric or coupled, or turn the camera"
        )
    x, y = np.meshgrid(series.x_m - centre[0], series.y_m - centre[1])
    P, E, nu, R = settings.normal_force, settings.modulus, settings.poisson, settings.radius
    r, theta = np.hypot(x, y), np.arctan2(y, x)
    try:
        radius = mask_radius(P, E, nu, R, settings.roughness, pitch)
        if is_coupled and across is not None:
            problem = CoupledProblem(
                r < radius, pitch, E, nu, box=series.box_m, thickness=settings.depth
            )
            theta = np.arctan2(drive.across(x, y), drive.along(x, y))
            return _inverted(
                series, partial(_both, problem, drive), across(), radius, r, theta, failures
            )
        solve = inverter(
            x,
            y,
            P=P,
            E=E,
            nu=nu,
            R=R,
            method=settings.method,
            roughness=settings.roughness,
            box=series.box_m,
            noise_box=series.noise_box_m,
            thickness=settings.depth,
            direction=drive,
        )
    except ValueError as error:
        raise UserError(str(error)) from None
    return _inverted(
        series, lambda u, sd: (solve(u, sd), None), repeat(()), radius, r, theta, failures
    )


def _both(
    problem: CoupledProblem, drive: Direction, u: F64, u_sd: F64, v: F64, v_sd: F64
) -> tuple[Inversion, F64]:
    """The inversion turned to be along the drive, and the traction across it."""
    pitch = problem.pitch
    along, along_sd = as_seen(u, u_sd, pitch, drive)
    across, across_sd = as_seen(v, v_sd, pitch, drive, moves=u)
    back = drive.mirrored
    fields = back.along(along, across), back.across(along, across)
    one, other = problem.solve(fields, (along_sd, across_sd))
    found = replace(
        one,
        sigma=drive.along(one.sigma, other.sigma),
        D=float(drive.along(one.D, other.D)),
        Q=float(drive.along(one.Q, other.Q)),
        residual=drive.along(one.residual, other.residual),
    )
    return found, drive.across(one.sigma, other.sigma)


def _inverted(
    series: FieldSeries,
    solve: Callable[..., tuple[Inversion, F64 | None]],
    beside: Iterable[tuple[F64, ...]],
    radius: float,
    r: F64,
    theta: F64,
    failures: list[str],
) -> Iterator[InvertedField]:
    """What `solve` makes of each field and of what is measured beside it."""
    for (number, u, sd), more in zip(series.fields(), beside, strict=False):
        try:
            result, across = solve(u, sd, *more)
        except ValueError as error:
            failures.append(f"field {number}: {error}")
            continue
        if isinstance(result, RadialInversion):
            inside = result.radius < radius
            profile = result.radius[inside], result.sigma[inside], result.sigma_sd[inside]
        else:
            rings = ring_means(r, result.sigma, series.pitch_m, radius, theta=theta)
            profile = rings.radius, rings.mean, rings.standard_error
        yield InvertedField(number, result, profile, across)


def write_tractions(
    path: Path, series: FieldSeries, inverted: Sequence[InvertedField], overwrite: bool
) -> None:
    """Write the tractions as a table (.csv) or as arrays (.npz).

    A CSV has the columns frame, r_mm, sigma_kPa, sigma_sd_kPa or, of methods that invert the whole
    field, frame, x_mm, y_mm, sigma_kPa, sigma_sd_kPa, residual_um and, of both components,
    sigma_across_kPa. An npz has frame, D_m, D_sd_m, Q_N, Q_sd_N, is_converged, stopped,
    radius_m, profile_Pa, profile_sd_Pa and, of whole fields, x_m, y_m, sigma_Pa, sigma_sd_Pa,
    residual_m, sigma_across_Pa.
    """
    is_whole = not isinstance(inverted[0].result, RadialInversion)
    with new_file(path, overwrite) as unfinished:
        if path.suffix.lower() == ".npz":
            with unfinished.open("xb") as file:
                np.savez(file, **_arrays(series, inverted, is_whole))
            return
        with unfinished.open("x", encoding="utf-8", newline="\n") as table:
            for one in inverted:
                columns = _columns(series, one, is_whole)
                if one is inverted[0]:
                    write_csv(table, [("frame", *columns)])
                points = zip(*(values.ravel().tolist() for values in columns.values()), strict=True)
                rows = ((one.number, *point) for point in points)
                write_csv(table, rows, missing="nan")


def _columns(series: FieldSeries, one: InvertedField, is_whole: bool) -> dict[str, F64]:
    """The columns of the traction under one field."""
    if not is_whole:
        r, sigma, sd = one.profile
        return in_units(r_mm=r, sigma_kPa=sigma, sigma_sd_kPa=sd)
    x, y = np.meshgrid(series.x_m, series.y_m)
    found = one.result
    columns = in_units(
        x_mm=x,
        y_mm=y,
        sigma_kPa=found.sigma,
        sigma_sd_kPa=found.sigma_sd,
        residual_um=found.residual,
    )
    return columns if one.across is None else columns | in_units(sigma_across_kPa=one.across)


def _arrays(
    series: FieldSeries, inverted: Sequence[InvertedField], is_whole: bool
) -> dict[str, Any]:
    arrays: dict[str, Any] = {
        "frame": np.array([one.number for one in inverted]),
        "radius_m": inverted[0].profile[0],
        "profile_Pa": np.array([one.profile[1] for one in inverted]),
        "profile_sd_Pa": np.array([one.profile[2] for one in inverted]),
        "is_converged": np.array([one.result.is_converged for one in inverted]),
        "stopped": np.array([str(one.result.stopped) for one in inverted]),
    }
    attributes = {"D_m": "D", "D_sd_m": "D_sd", "Q_N": "Q", "Q_sd_N": "Q_sd"}
    if is_whole:
        arrays |= {"x_m": series.x_m, "y_m": series.y_m}
        attributes |= {"sigma_Pa": "sigma", "sigma_sd_Pa": "sigma_sd", "residual_m": "residual"}
        if inverted[0].across is not None:
            arrays["sigma_across_Pa"] = np.array([one.across for one in inverted])
    for name, attribute in attributes.items():
        arrays[name] = np.array([getattr(one.result, attribute) for one in inverted])
    return arrays
