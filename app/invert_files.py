"""Shear tractions from displacement fields in files: sessions, ``slipscope dic``, or anybody's
tables.
"""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TextIO

import numpy as np
from numpy.typing import NDArray

from analysis.contact.rings import ring_means
from analysis.inversion.axisymmetric import AxisymmetricInversion
from analysis.inversion.conjugate import conjugate_gradient
from analysis.inversion.problem import InversionProblem, mask_radius
from analysis.inversion.regularised import RegularisedInversion
from analysis.inversion.result import Inversion, RadialInversion
from analysis.inversion.van_cittert import van_cittert
from analysis.mechanics import hertz
from app.errors import UserError

F64 = NDArray[np.float64]

SUFFIXES = (".csv", ".npz")
HALF = 0.5  # of the bump that the contact makes in the field: what its centre is computed from


@dataclass(frozen=True, slots=True)
class Series:
    """Fields to invert, SI units.

    Attributes
    ----------
    x_m, y_m : ndarray, shape (nx,) and (ny,)
    centre_m : (float, float) or None
        Of the contact, (x, y); None: to be found in the last field.
    count : int
        Of fields.
    fields : callable
        Gives number, u_x and standard uncertainty (NaN: none) of each field, shape (ny, nx).
    """

    x_m: F64
    y_m: F64
    centre_m: tuple[float, float] | None
    count: int
    fields: Callable[[], Iterator[tuple[int, F64, F64]]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Block:
    """What the fields were measured on, SI units: force, modulus, Poisson's ratio, sphere,
    roughness, thickness, correlation boxes.
    """

    P: float
    E: float
    nu: float
    R: float
    roughness: float
    thickness: float
    box: float
    noise_box: float


@dataclass(frozen=True, slots=True)
class Inverted:
    """One field's result; `profile` is (r, sigma, sd) about the centre."""

    number: int
    result: Inversion
    profile: tuple[F64, F64, F64]

    @property
    def peak_radius_m(self) -> float:
        """Where the profile is largest."""
        r, sigma, _ = self.profile
        return float(r[np.nanargmax(sigma)])


def find_centre(x_m: F64, y_m: F64, ux_m: F64) -> tuple[float, float]:
    """Centre of the contact: centroid of the upper half of the bump that it makes in u_x, (x, y) in
    metres.

    Raises
    ------
    UserError
        There is no bump.
    """
    rim = np.concatenate([ux_m[0], ux_m[-1], ux_m[:, 0], ux_m[:, -1]])
    bump = (
        np.nan_to_num(np.nanmedian(rim) - ux_m) if np.isfinite(rim).any() else np.zeros(ux_m.shape)
    )
    weight = np.maximum(bump - HALF * bump.max(), 0.0)
    if not weight.sum() > 0:
        raise UserError(
            "invert: no contact stands out of the last field; give its place with --centre"
        )
    return float(weight.sum(axis=0) @ x_m / weight.sum()), float(
        weight.sum(axis=1) @ y_m / weight.sum()
    )


def invert_series(
    series: Series, block: Block, method: str, failures: list[str]
) -> tuple[tuple[float, float], Iterator[Inverted]]:
    """The contact's centre, and the result of each field, one at a time; those that can not be
    inverted are named in `failures`.

    Raises
    ------
    UserError
        The fields do not allow it.
    """
    pitch = float(series.x_m[1] - series.x_m[0])
    if abs(float(series.y_m[1] - series.y_m[0]) / pitch - 1) > 1e-3:
        raise UserError(
            "invert: the points lie at another distance along x than along y; interpolate them on a"
            " square grid"
        )
    centre = series.centre_m
    if centre is None:
        *_, (_, last, _) = series.fields()
        centre = find_centre(series.x_m, series.y_m, last)
    x, y = np.meshgrid(series.x_m - centre[0], series.y_m - centre[1])
    try:
        a = hertz.contact_radius(block.P, block.E, block.nu, block.R)
        radius = mask_radius(block.P, block.E, block.nu, block.R, block.roughness, pitch)
        solve = _solver(method, x, y, pitch, radius, a, block)
    except ValueError as error:
        raise UserError(str(error)) from None
    return centre, _results(series, solve, x, y, pitch, radius, failures)


Solve = Callable[[F64, F64 | None], Inversion]


def _solver(
    method: str, x: F64, y: F64, pitch: float, radius: float, a: float, block: Block
) -> Solve:
    E, nu, box, noise_box, thickness = (
        block.E,
        block.nu,
        block.box,
        block.noise_box,
        block.thickness,
    )
    r, theta = np.hypot(x, y), np.arctan2(y, x)
    if method == "axisymmetric":
        profile = AxisymmetricInversion(
            x, y, pitch, radius, E, nu, edge=a, box=box, noise_box=noise_box, thickness=thickness
        )
        return lambda ux, sd: profile.solve(ring_means(r, ux, pitch, theta=theta))
    if method == "regularised":
        return RegularisedInversion(
            x, y, radius, E, nu, edge=a, box=box, noise_box=noise_box, thickness=thickness
        ).solve
    problem = InversionProblem(r < radius, pitch, E, nu, box=box, thickness=thickness)
    return (
        (lambda ux, sd: conjugate_gradient(problem, ux, sd))
        if method == "cgls"
        else (lambda ux, sd: van_cittert(problem, ux, sd))
    )


def _results(
    series: Series, solve: Solve, x: F64, y: F64, pitch: float, radius: float, failures: list[str]
) -> Iterator[Inverted]:
    r, theta = np.hypot(x, y), np.arctan2(y, x)
    for number, ux, sd in series.fields():
        try:
            found = solve(ux, sd if np.isfinite(sd).any() else None)
        except ValueError as error:
            failures.append(f"field {number}: {error}")
            continue
        if isinstance(found, RadialInversion):
            inside = found.radius < radius
            profile = found.radius[inside], found.sigma[inside], found.sigma_sd[inside]
        else:
            rings = ring_means(r, found.sigma, pitch, radius, theta=theta)
            profile = rings.radius, rings.mean, rings.standard_error
        yield Inverted(number, found, profile)


class TableWriter:
    """Writes results as they come: profiles to a CSV, and for methods of the whole field the
    points; or all to an npz at the end.

    A CSV has the columns frame, r_mm, sigma_kpa, sigma_sd_kpa, or frame, x_mm, y_mm, sigma_kpa,
    sigma_sd_kpa, residual_um. An npz has frame, D_m, D_sd_m, Q_n, Q_sd_n, radius_m, profile_pa,
    profile_sd_pa and, of whole fields, x_m, y_m, sigma_pa, sigma_sd_pa, residual_m. The file
    appears when it is complete.
    """

    def __init__(self, path: Path, series: Series) -> None:
        self._path, self._series, self._kept = path, series, list[Inverted]()
        self._part = path.with_name(f"{path.name}.part")
        self._table: TextIO | None = None
        if path.suffix.lower() == ".csv":
            self._table = self._part.open("w", newline="", encoding="utf-8")
            self._csv = csv.writer(self._table)

    def write(self, one: Inverted) -> None:
        """Take one result."""
        is_whole = not isinstance(one.result, RadialInversion)
        if self._table is None:
            self._kept.append(one)
            return
        if self._table.tell() == 0:
            names = ["x_mm", "y_mm"] if is_whole else ["r_mm"]
            self._csv.writerow(
                [
                    "frame",
                    *names,
                    "sigma_kpa",
                    "sigma_sd_kpa",
                    *(["residual_um"] if is_whole else []),
                ]
            )
        if is_whole:
            x, y = np.meshgrid(self._series.x_m * 1e3, self._series.y_m * 1e3)
            found = one.result
            columns = [x, y, found.sigma * 1e-3, found.sigma_sd * 1e-3, found.residual * 1e6]
        else:
            columns = [one.profile[0] * 1e3, one.profile[1] * 1e-3, one.profile[2] * 1e-3]
        for row in zip(*(c.ravel() for c in columns), strict=True):
            self._csv.writerow([one.number, *(f"{value:.7g}" for value in row)])

    def close(self, *, is_complete: bool) -> None:
        """Put the complete file in its place, or take the part away."""
        if self._table is not None:
            self._table.close()
        elif is_complete:
            with self._part.open("wb") as file:
                np.savez(file, **self._arrays())
        if is_complete:
            os.replace(self._part, self._path)
        else:
            self._part.unlink(missing_ok=True)

    def _arrays(self) -> dict[str, Any]:
        results = [one.result for one in self._kept]
        arrays: dict[str, Any] = {
            "frame": np.array([one.number for one in self._kept]),
            "D_m": np.array([found.D for found in results]),
            "D_sd_m": np.array([found.D_sd for found in results]),
            "Q_n": np.array([found.Q for found in results]),
            "Q_sd_n": np.array([found.Q_sd for found in results]),
            "radius_m": self._kept[0].profile[0],
            "profile_pa": np.array([one.profile[1] for one in self._kept]),
            "profile_sd_pa": np.array([one.profile[2] for one in self._kept]),
        }
        if not isinstance(results[0], RadialInversion):
            arrays |= {"x_m": self._series.x_m, "y_m": self._series.y_m}
            for name, attribute in (
                ("sigma_pa", "sigma"),
                ("sigma_sd_pa", "sigma_sd"),
                ("residual_m", "residual"),
            ):
                arrays[name] = np.array([getattr(found, attribute) for found in results])
        return arrays


def noise_of(found: Inversion) -> float:
    """Root mean square of the residual in units of the noise."""
    return math.sqrt(found.chi2)
