"""E and the work of adhesion of the smooth back of the block, by a JKR test."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from analysis.options import Section, option
from app.calibrations.calibration import Calibration, CalibrationResult, Data, calibration_run
from app.settings.hung_weights import growing_newtons
from app.settings.protocol_steps import Approach, Background, Hold
from app.settings.sections import Config

SHEAR = 0.05  # share of P, which the noise of Q is of the lowest loads; it changes no radius


@dataclass(frozen=True, kw_only=True)
class JkrOptions(Section):
    """Loads, and what is used of the points."""

    loads: str = option(
        "0.02 0.05 0.1 0.15 0.2 0.3 0.4 0.5",
        "Loads of a run in N, in increasing order; the run then unloads in the same steps",
    )
    rest: float = option(5.0, "Rest of the contact at each load", "s", gt=0, le=3600)
    branches: str = option("both", "Branches that are used", choices=("both", "loading"))
    edge: float = option(
        1.0, "Standard uncertainty of the edge of the contact that all radii share", "px", ge=0
    )
    poisson_uncertainty: float = option(
        0.0,
        "Standard uncertainty of Poisson's ratio; 0: that of the session's settings, or the"
        " default",
        ge=0,
        le=0.2,
    )
    lens_radius: float = option(
        0.0, "Radius of the lens; 0: that of the session's settings, or the default", "mm", ge=0
    )
    pull_off: float = option(
        0.0, "Pull-off force of the contact, below 0; 0: not observed", "N", le=0
    )


class AdhesionCalibration(Calibration[JkrOptions]):
    """A JKR test."""

    name = "adhesion"
    title = "Young's modulus and work of adhesion by a JKR test of the smooth back of the block."
    files = "SESSION.h5|TABLE.csv"
    valid_days = 365
    Options = JkrOptions

    def plan(self, config: Config, options: JkrOptions) -> tuple[Config, ...]:
        """One run: the loads up and down, at rest at each."""
        steps: list[Background | Approach | Hold] = [Background()]
        loads = growing_newtons("loads", options.loads, "loads", fewest=1, most=10.0)
        for load in [*loads, *loads[-2::-1]]:
            steps += [Approach(normal_force=load), Hold(time=options.rest)]
        return (calibration_run(config, steps, shear=SHEAR),)

    def gather(self, sources: Sequence[Path], options: JkrOptions) -> Data:
        """Radius and force of each contact, and what the settings say of the bench."""
        from app.calibrations.smooth_contacts import contacts_of

        return contacts_of(sources[0])

    def fit(self, data: Data, options: JkrOptions) -> CalibrationResult:
        """E of both branches, w of each."""
        import numpy as np

        from analysis import adhesion_test, jkr

        falls = data["unloading"].astype(bool)
        used = ~falls if options.branches == "loading" else np.ones_like(falls)
        columns = {name: data[name][used] for name in ("a", "P", "a_sd", "P_sd")}
        R, nu = options.lens_radius or data["R"], data["nu"]
        nu_sd = options.poisson_uncertainty or data["nu_sd"]
        lens, picture, newtons = data["shares"]
        found = adhesion_test(
            **columns,
            R=R,
            nu=nu,
            unloading=falls[used],
            zero_sd=data["zero_sd"],
            edge_sd=options.edge * data["pixel"],
            relative_sd=(lens, picture, newtons),
            nu_sd=nu_sd,
            pull_off=options.pull_off or np.nan,
        )
        result = CalibrationResult()
        shared = math.sqrt(max(found.E_sd**2 - found.E_scatter_sd**2, 0.0))
        modulus = "Young's modulus", "E", "MPa", found.E, found.E_scatter_sd
        result.add("modulus_pa", *modulus, systematic=shared)
        P = data["P"]
        read, left = list[tuple[Any, ...]](), list[tuple[Any, ...]]()
        for key, name, branch, w, sd in (
            ("work_j_m2", "loading", ~falls, found.w, found.w_sd),
            ("unloading_work_j_m2", "unloading", falls, found.w_unloading, found.w_unloading_sd),
        ):
            if not math.isfinite(w):
                continue
            result.add(key, f"work of adhesion, {name}", "w", "mJ/m2", w, sd)
            held = max(w, 0.0), found.E, nu, R
            least = jkr.pull_off_force(held[0], R) if held[0] else 0.0
            loads = np.linspace(max(float(P.min()), least), float(P.max()), 200)
            a, colour = data["a"][branch], f"C{len(left)}"
            off = 1e6 * (a - jkr.contact_radius(P[branch], *held))
            read += [
                (P[branch], 1e3 * a, f"{colour}o", name),
                (loads, 1e3 * jkr.contact_radius(loads, *held), f"{colour}-"),
            ]
            left.append((P[branch], off, f"{colour}o", "", 1e6 * data["a_sd"][branch]))
        result.chart("normal force (N)", "contact radius (mm)", *read)
        result.chart("normal force (N)", "residual (um)", *left)
        if math.isfinite(lost := found.hysteresis):
            hysteresis = "hysteresis of adhesion", "", "mJ/m2", lost, found.hysteresis_sd
            result.add("hysteresis_j_m2", *hysteresis, is_signed=True)
        if math.isfinite(torn := found.w_pull_off):
            result.add("pull_off_work_j_m2", "work of adhesion by the pull-off", "w", "mJ/m2", torn)
        correlation = found.E_w_covariance / (found.E_sd * found.w_sd)
        result.remark(
            f"E and w are correlated by {correlation:.2f}; Tabor's parameter {found.tabor:.3g};"
            f" the radius of the lens is {R * 1e3:g} mm, Poisson's ratio {nu:g} +- {nu_sd:g}, which"
            " is in the uncertainty of E",
            *found.notes,
        )
        if found.outliers:
            result.remark(f"{found.outliers} outlying points are left out")
        result.set("sample.young_modulus", found.E * 1e-6, found.E_sd / found.E)
        return result
