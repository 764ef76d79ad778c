"""`slipscope calibrate radius`: the apparent radius of several runs against Hertz and against the
extension by the roughness (paper, Fig. 3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from analysis.options import Section, option
from app.calibrations.calibration import Calibration, CalibrationResult, Data
from app.calibrations.charts import above_residual
from app.calibrations.free_block import relative_sd_of_forces
from app.settings.config import settings_of
from app.system.errors import UserError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from analysis.calibration.radius_law import FittedRadii, RadiusLaw


@dataclass(frozen=True, kw_only=True)
class RadiusOptions(Section):
    """What the radii are compared with; what is left out is that of the sessions."""

    modulus: float = option(0.0, "E for the comparison; 0: sample.young_modulus", "MPa", ge=0)


class RadiusCalibration(Calibration[RadiusOptions]):
    """a(P)."""

    name = "radius"
    title = "Apparent contact radius over the loads of several runs, against Hertz and sqrt(R h)."
    files = "SESSION.h5..."
    valid_days = 3650
    Options = RadiusOptions

    def gather(self, sources: Sequence[Path], options: RadiusOptions) -> Data:
        """Load and apparent radius of each session, with their uncertainties, and what their
        settings say of the sample.
        """
        import numpy as np

        from app.session.reader import SessionReader

        rows, constants = [], set()
        for path in sources:
            with SessionReader(path) as reader:
                config = settings_of(reader)
                contact, summary = reader.contact(), reader.outcome.summary
            if contact is None or summary is None:
                raise UserError(
                    f"{path}: the apparent radius or the load was not measured; give sessions of"
                    " whole runs with a background"
                )
            s, u = config.sample, config.uncertainty
            newtons, _ = relative_sd_of_forces(config)
            constants.add(
                (s.lens_radius, s.roughness, s.poisson, s.young_modulus, u.roughness,
                 u.young_modulus, u.lens_radius, u.pixel, newtons)
            )  # fmt: skip
            rows.append(
                (
                    summary.normal_force_n,
                    contact.apparent_radius_m,
                    contact.apparent_radius_sd_m,
                    u.zero,
                )
            )
        if len(constants) > 1:
            raise UserError(
                f"{sources[-1]}: its sample or the uncertainties of its settings are others than"
                " those of the sessions before; give sessions of the same settings"
            )
        R, h, nu, E, *shares = constants.pop()
        P, a, a_sd, P_sd = np.array(rows, dtype=np.float64).T
        constants_of = {"R": R, "h": h, "nu": nu, "E": E, "shares": shares}
        return {"P": P, "a": a, "a_sd": a_sd, "P_sd": P_sd, **constants_of}

    def fit(self, data: Data, options: RadiusOptions) -> CalibrationResult:
        """E and the extension, and whether either law holds."""
        from app.records.quantities import Measurement

        law = _law(data, options)
        rows = (
            ("modulus by radii less sqrt(R h)", law.rough, "modulus_pa"),
            ("modulus by radii alone, extension free", law.free, "free_modulus_pa"),
            ("modulus by Hertz's radii", law.smooth, "hertz_modulus_pa"),
        )
        values = [
            Measurement(name, "E", one.E, one.E_sd, "MPa", key=key, doubt=_doubt(one))
            for name, one, key in rows
        ]
        values += [
            Measurement("extension beyond Hertz", "a - a_H", law.free.extension,
                        law.free.extension_sd, "um", is_signed=True, key="extension_m"),
            Measurement("extension by the roughness", "sqrt(R h)", law.expected_m,
                        law.rough.extension_sd, "um", key="expected_extension_m"),
        ]  # fmt: skip
        laws = (("Hertz", law.smooth), ("with sqrt(R h)", law.rough), ("both free", law.free))
        chi2 = ", ".join(f"{name} {one.chi2:.1f} of {one.freedom}" for name, one in laws)
        return CalibrationResult(tuple(values), {}, (f"chi2: {chi2}", *law.notes), law)

    def draw(self, figure: Figure, data: Data, findings: CalibrationResult) -> None:
        """Radii and laws, and what is left of the extension by the roughness."""
        import numpy as np

        law: RadiusLaw = findings.fit
        above, below = above_residual(figure, "normal force (N)", "radius (mm)", "extension (um)")
        P, a, a_sd = data["P"], data["a"], data["a_sd"]
        above.errorbar(P, a * 1e3, a_sd * 1e3, fmt="o", ms=4, label="apparent radius")
        loads = np.linspace(0, P.max() * 1.05, 200)
        R, nu = data["R"], data["nu"]
        for name, one in (("Hertz, its own E", law.smooth), ("with sqrt(R h)", law.rough)):
            radius = np.cbrt(0.75 * loads * R * (1 - nu**2) / one.E) + one.extension
            above.plot(loads, radius * 1e3, label=f"{name}: E = {one.E * 1e-6:.2f} MPa")
        above.legend()
        excess_um, sd_um = law.excess_m * 1e6, law.excess_sd_m * 1e6
        below.errorbar(P, excess_um, sd_um, fmt="o", ms=4, label="a - a_H, E of the settings")
        below.axhline(law.expected_m * 1e6, color="0.5", label="sqrt(R h)")
        below.legend()


def _law(data: Data, options: RadiusOptions) -> RadiusLaw:
    from analysis import radius_law

    h_sd, E_sd, *relative = data["shares"]
    E, h = options.modulus or data["E"], data["h"]
    return radius_law(
        data["P"],
        data["a"],
        data["R"],
        h,
        data["nu"],
        P_sd=data["P_sd"],
        a_sd=data["a_sd"],
        h_sd=h_sd * h,
        relative_sd=(relative[0], relative[1], relative[2]),
        modulus=(E, E_sd * E),
    )


def _doubt(law: FittedRadii) -> str:
    return "" if law.likelihood > 1e-3 else "the law does not hold"
