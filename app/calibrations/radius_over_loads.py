"""`slipscope calibrate radius`: the apparent radius of several runs against Hertz and against the
extension by the roughness (paper, Fig. 3).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from analysis.options import Section, option
from app.calibrations.calibration import Calibration, CalibrationResult, Data
from app.calibrations.given_files import same_in_all
from app.system.errors import UserError

UNLIKELY = 1e-3  # likelihood below which a law does not hold


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

        from app.calibrations.session_readings import opened, relative_sd_of_forces

        rows, constants = [], {}
        for path in sources:
            with opened(path) as (reader, config):
                contact, summary = reader.contact(), reader.outcome.summary
            if contact is None or summary is None:
                raise UserError(
                    f"{path}: the apparent radius or the load was not measured; give sessions of"
                    " whole runs with a background"
                )
            s, u = config.sample, config.uncertainty
            newtons, _ = relative_sd_of_forces(config)
            shares = u.roughness, u.young_modulus, u.lens_radius, u.pixel, newtons
            constants[path] = s.lens_radius, s.roughness, s.poisson, s.young_modulus, *shares
            radius, radius_sd = contact.apparent_radius_m, contact.apparent_radius_sd_m
            rows.append((summary.normal_force_n, radius, radius_sd, u.zero))
        what = "constants of the sample, or uncertainties of the settings"
        R, h, nu, E, *shares_of_all = same_in_all(what, constants)
        P, a, a_sd, P_sd = np.array(rows, dtype=np.float64).T
        constants_of = {"R": R, "h": h, "nu": nu, "E": E, "shares": shares_of_all}
        return {"P": P, "a": a, "a_sd": a_sd, "P_sd": P_sd, **constants_of}

    def fit(self, data: Data, options: RadiusOptions) -> CalibrationResult:
        """E and the extension, and whether either law holds."""
        import numpy as np

        from analysis import radius_law

        P, R, h, nu = (data[name] for name in ("P", "R", "h", "nu"))
        h_sd, E_sd, lens, picture, newtons = data["shares"]
        E = options.modulus or data["E"]
        law = radius_law(
            P,
            data["a"],
            R,
            h,
            nu,
            P_sd=data["P_sd"],
            a_sd=data["a_sd"],
            h_sd=h_sd * h,
            relative_sd=(lens, picture, newtons),
            modulus=(E, E_sd * E),
        )
        result = CalibrationResult()
        for key, name, one in (
            ("modulus_pa", "modulus by radii less sqrt(R h)", law.rough),
            ("free_modulus_pa", "modulus by radii alone, extension free", law.free),
            ("hertz_modulus_pa", "modulus by Hertz's radii", law.smooth),
        ):
            doubt = "" if one.likelihood > UNLIKELY else "the law does not hold"
            result.add(key, name, "", "MPa", one.E, one.E_sd, doubt=doubt)
        beyond, expected = law.free, law.expected_m
        result.add(
            "extension_m",
            "extension beyond Hertz",
            "a - a_H",
            "um",
            beyond.extension,
            beyond.extension_sd,
            is_signed=True,
        )
        result.add(
            "expected_extension_m",
            "extension by the roughness",
            "sqrt(R h)",
            "um",
            expected,
            law.rough.extension_sd,
        )
        laws = (("Hertz", law.smooth), ("with sqrt(R h)", law.rough), ("both free", law.free))
        chi2 = ", ".join(f"{name} {one.chi2:.1f} of {one.freedom}" for name, one in laws)
        result.remark(f"chi2: {chi2}", *law.notes)
        loads = np.linspace(0, P.max() * 1.05, 200)
        curves = [(P, data["a"] * 1e3, "o", "apparent radius", data["a_sd"] * 1e3)]
        for name, one in (("Hertz, its own E", law.smooth), ("with sqrt(R h)", law.rough)):
            radius = np.cbrt(0.75 * loads * R * (1 - nu**2) / one.E) + one.extension
            curves.append((loads, radius * 1e3, "-", f"{name}: E = {one.E * 1e-6:.2f} MPa", None))
        result.chart("normal force (N)", "radius (mm)", *curves)
        excess = P, law.excess_m * 1e6, "o", "a - a_H, E of the settings", law.excess_sd_m * 1e6
        line = loads[[0, -1]], np.full(2, expected * 1e6), "-", "sqrt(R h)"
        result.chart("normal force (N)", "extension (um)", excess, line)
        return result
