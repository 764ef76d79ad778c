"""`slipscope calibrate adhesion`: E and the work of adhesion of the smooth back of the block by a
JKR test.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from analysis.options import Section, option
from app.calibrations.calibration import (
    Calibration,
    CalibrationResult,
    Data,
    calibration_run,
)
from app.calibrations.charts import above_residual
from app.settings.hung_weights import growing_newtons
from app.settings.protocol_steps import Approach, Background, Hold

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from analysis.calibration.adhesion import AdhesionTest
    from app.settings.sections import Config

SHEAR = 0.05  # share of P


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
        """One run: the loads up and down, at rest at each. A shear of a few per cent of P, which
        the noise of Q is of the lowest loads, changes no radius.
        """
        steps: list[Background | Approach | Hold] = [Background()]
        loads = growing_newtons("loads", options.loads, "loads", fewest=1, most=10.0)
        for load in [*loads, *loads[-2::-1]]:
            steps += [Approach(normal_force=load), Hold(time=options.rest)]
        tolerance = max(config.run.shear_tolerance, SHEAR)
        run = replace(config.run, shear_tolerance=tolerance)
        return (calibration_run(replace(config, run=run), steps),)

    def gather(self, sources: Sequence[Path], options: JkrOptions) -> Data:
        """Radius and force of each contact, and what the settings say of the bench."""
        from app.calibrations.smooth_contacts import contacts_of

        return contacts_of(sources)

    def fit(self, data: Data, options: JkrOptions) -> CalibrationResult:
        """E of both branches, w of each."""
        from app.records.quantities import Measurement

        found = _tested(data, options)
        R = options.lens_radius or data["R"]
        values = [
            Measurement("Young's modulus", "E", found.E, found.E_scatter_sd, "MPa",
                        systematic=math.sqrt(max(found.E_sd**2 - found.E_scatter_sd**2, 0.0)),
                        key="modulus_pa"),
            Measurement("work of adhesion, loading", "w", found.w, found.w_sd, "mJ/m2",
                        key="work_j_m2"),
        ]  # fmt: skip
        if math.isfinite(found.w_unloading):
            values += [
                Measurement("work of adhesion, unloading", "w", found.w_unloading,
                            found.w_unloading_sd, "mJ/m2", key="unloading_work_j_m2"),
                Measurement("hysteresis of adhesion", "", found.hysteresis, found.hysteresis_sd,
                            "mJ/m2", is_signed=True, key="hysteresis_j_m2"),
            ]  # fmt: skip
        if math.isfinite(found.w_pull_off):
            name = "work of adhesion by the pull-off"
            values.append(
                Measurement(name, "w", found.w_pull_off, unit="mJ/m2", key="pull_off_work_j_m2")
            )
        correlation = found.E_w_covariance / (found.E_sd * found.w_sd)
        remarks = [
            f"E and w are correlated by {correlation:.2f}; Tabor's parameter {found.tabor:.3g};"
            f" the radius of the lens is {R * 1e3:g} mm, Poisson's ratio {data['nu']:g} +-"
            f" {_nu_sd(data, options):g}, which is in the uncertainty of E",
            *found.notes,
        ]
        if found.outliers:
            remarks.append(f"{found.outliers} outlying points are left out")
        settings = {
            "sample.young_modulus": found.E * 1e-6,
            "uncertainty.young_modulus": 100 * found.E_sd / found.E,
        }
        return CalibrationResult(tuple(values), settings, tuple(remarks), R)

    def draw(self, figure: Figure, data: Data, findings: CalibrationResult) -> None:
        """Radii over forces with the fit, and what is left."""
        import numpy as np

        from analysis import jkr

        known = {one.key: one.value for one in findings.values}
        E, R, nu = known["modulus_pa"], findings.fit, data["nu"]
        labels = "normal force (N)", "contact radius (mm)", "residual (um)"
        above, below = above_residual(figure, *labels)
        a, P, falls = data["a"], data["P"], data["unloading"].astype(bool)
        for branch, key, name in (
            (~falls, "work_j_m2", "loading"),
            (falls, "unloading_work_j_m2", "unloading"),
        ):
            w = max(known.get(key, 0.0), 0.0)
            if not branch.any() or key not in known:
                continue
            points = above.plot(P[branch], a[branch] * 1e3, "o", ms=4, label=name)[0]
            low = max(float(P.min()), jkr.pull_off_force(w, R) if w else 0.0)
            forces = np.linspace(low, float(P.max()), 200)
            colour = points.get_color()
            above.plot(forces, jkr.contact_radius(forces, w, E, nu, R) * 1e3, color=colour)
            off = a[branch] - jkr.contact_radius(P[branch], w, E, nu, R)
            below.errorbar(
                P[branch], off * 1e6, data["a_sd"][branch] * 1e6, fmt="o", ms=4, color=colour
            )
        above.legend()


def _nu_sd(data: Data, options: JkrOptions) -> float:
    return options.poisson_uncertainty or data["nu_sd"]


def _tested(data: Data, options: JkrOptions) -> AdhesionTest:
    import numpy as np

    from analysis import adhesion_test

    falls = data["unloading"].astype(bool)
    used = np.ones_like(falls) if options.branches == "both" else ~falls
    columns = {name: data[name][used] for name in ("a_sd", "P_sd")}
    lens, picture, newtons = data["shares"]
    return adhesion_test(
        data["a"][used],
        data["P"][used],
        options.lens_radius or data["R"],
        data["nu"],
        unloading=falls[used],
        zero_sd=data["zero_sd"],
        edge_sd=options.edge * data["pixel"],
        relative_sd=(lens, picture, newtons),
        nu_sd=_nu_sd(data, options),
        pull_off=options.pull_off or np.nan,
        **columns,
    )
