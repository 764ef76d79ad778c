"""`slipscope calibrate roughness`: the rough face from maps of its heights."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from analysis.options import Section, option
from app.calibrations.calibration import Calibration, CalibrationResult, Data
from app.calibrations.charts import draw_map

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from analysis.calibration.roughness import Roughness

MOST_UNCERTAIN = 0.5  # share of h, beyond which it is not known
FAINT = 0.01  # share of the peak pressure
APART = 3.0  # standard uncertainties by which the h of two maps differ that are told


@dataclass(frozen=True, kw_only=True)
class MapOptions(Section):
    """How the maps are read and what of them counts."""

    pitch: float = option(
        0.0, "Distance of neighbouring heights; 0: that of the .sur file", "um", ge=0
    )
    scale: float = option(
        0.0, "Height of one unit of the map; 0: that of the .sur file", "um", ge=0
    )
    form: str = option(
        "quadratic", "Form that is removed from the map", choices=("none", "plane", "quadratic")
    )
    longest: float = option(0.0, "Longest wavelength included; 0: that of the map", "um", ge=0)
    shortest: float = option(0.0, "Shortest wavelength included; 0: two pitches", "um", ge=0)
    scale_uncertainty: float = option(
        0.5, "Standard uncertainty of the scale of the heights", "%", ge=0, le=20
    )
    load: float = option(0.5, "Load of the pressure of Greenwood and Tripp", "N", gt=0, le=10)


class RoughnessCalibration(Calibration[MapOptions]):
    """h, and what follows from it."""

    name = "roughness"
    title = "Standard deviation h of the heights of the rough face, and the lengths that follow."
    files = "MAP.sur|MAP.csv|MAP.npy|MAP.tif..."
    valid_days = 3650
    Options = MapOptions

    def gather(self, sources: Sequence[Path], options: MapOptions) -> Data:
        """The heights of each map, in micrometres."""
        import numpy as np

        from app.files.height_maps import read_height_map

        maps = [read_height_map(path, options.pitch, options.scale) for path in sources]
        heights = {f"map_{n}_um": (m.z * 1e6).astype(np.float32) for n, m in enumerate(maps, 1)}
        return {**heights, "pitch_m": np.array([m.pitch for m in maps])}

    def fit(self, data: Data, options: MapOptions) -> CalibrationResult:
        """Their common h: each map is of another place."""
        import numpy as np

        from analysis import elastic_length, hertz
        from analysis.calibration.summits import summits
        from analysis.friction.joint import common_value
        from analysis.settings import Sample
        from app.records.quantities import Measurement

        found = self._each(data, options)
        h, sds = np.array([(one.h, one.h_sd) for one in found]).T
        scale_sd = options.scale_uncertainty
        common = common_value(h, sds, np.full((len(h), 1), scale_sd))
        mean, sd = common.value, common.sd
        length = float(np.median([one.correlation_length for one in found]))
        share = sd / mean
        if share > MOST_UNCERTAIN:
            raise ValueError(
                f"roughness: h is {mean * 1e6:.3g} +- {sd * 1e6:.2g} um, {100 * MOST_UNCERTAIN:g} %"
                " of it is the most; give more maps, or a map of many correlation lengths"
            )
        sample, top = Sample(), summits(found[0])
        L, rim = elastic_length(mean, sample.poisson), math.sqrt(sample.lens_radius * mean)
        values = [
            Measurement("rms of the heights", "h", mean, sd, "um", key="roughness_m"),
            Measurement("correlation length", "", length, unit="um", key="correlation_length_m"),
            Measurement(f"elastic length, nu = {sample.poisson:g}", "L", L, L * share, "um",
                        key="length_m"),
            Measurement(f"extension, R = {sample.lens_radius * 1e3:g} mm", "sqrt(R h)", rim,
                        rim * share / 2, "um", key="extension_m"),
            Measurement("distance of summits, 1/sqrt(eta)", "", top.density**-0.5, unit="um",
                        key="summit_distance_m"),
            Measurement("radius of summits", "beta", top.radius, unit="um", key="summit_radius_m"),
        ]  # fmt: skip
        remarks = [
            f"waves from {found[0].shortest * 1e6:.3g} to {found[0].longest * 1e6:.3g} um count:"
            " h of another range is another number",
            *dict.fromkeys(note for one in found for note in one.notes),
        ]
        if len(h) > 1:
            apart = float(np.ptp(h)) / math.hypot(*sds[[h.argmin(), h.argmax()]])
            if apart > APART:
                remarks.append(
                    f"the maps differ by up to {apart:.1f} standard uncertainties: the face is not"
                    " the same everywhere; the uncertainty is widened by that"
                )
        P, R = options.load, sample.lens_radius
        block = sample.young_modulus, sample.poisson, R
        r, pressures = np.empty(0), {}
        try:
            rough, a = top.contact(P, *block), hertz.contact_radius(P, *block)
        except ValueError as error:
            remarks.append(f"there is no pressure of Greenwood and Tripp: {error}")
        else:
            r = np.linspace(0, min(rough.reach, 2 * a), 400)
            pressures = {"Greenwood, Tripp": rough.pressure(r), "Hertz": hertz.pressure(r, P, a)}
            reach = rough.radius_at(FAINT) - a
            values.append(
                Measurement(f"extension to {FAINT:.0%} of the peak pressure, P = {P:g} N", "",
                            reach, unit="um", key="pressure_extension_m")
            )  # fmt: skip
            remarks.append(
                f"mu = {top.mu(R):.3g} of Greenwood and Tripp by the moments of the first map; the"
                " summits are sharper and more, the shorter the waves that count"
            )
        settings = {
            "sample.roughness": mean * 1e6,
            "uncertainty.roughness": 100 * share,
        }
        return CalibrationResult(tuple(values), settings, tuple(remarks), (found, r, pressures))

    def draw(self, figure: Figure, data: Data, findings: CalibrationResult) -> None:
        """The first map without its form, the spectrum of each, and the pressure."""
        import numpy as np

        found: tuple[Roughness, ...]
        found, r, pressures = findings.fit
        left, right, *last = figure.subplots(1, 3 if pressures else 2)
        first, pitch = found[0], float(data["pitch_m"][0])
        reach, pitch_um = 4e6 * first.h, pitch * 1e6
        rows, columns = first.residual.shape
        how = {"extent": (0, columns * pitch_um, rows * pitch_um, 0), "vmin": -reach, "vmax": reach}
        draw_map(left, first.residual * 1e6, "height (um)", unit="um", **how)
        for n, one in enumerate(found, 1):
            right.loglog(one.wavenumber * 1e-6, one.spectrum * 1e24, label=f"map {n}")
        right.axvline(2 * np.pi / first.correlation_length * 1e-6, lw=0.5, color="0.5")
        right.set(xlabel="wave number (rad/um)", ylabel="power spectral density (um^4)")
        right.legend()
        for axes in last:
            for name, p in pressures.items():
                axes.plot(r * 1e3, p * 1e-3, label=name)
            axes.set(xlabel="r (mm)", ylabel="p (kPa)")
            axes.legend()

    def _each(self, data: Data, options: MapOptions) -> tuple[Roughness, ...]:
        from analysis import roughness

        return tuple(
            roughness(
                data[f"map_{n}_um"] * 1e-6,
                float(pitch),
                form=options.form,
                longest=options.longest or math.inf,
                shortest=options.shortest,
            )
            for n, pitch in enumerate(data["pitch_m"], 1)
        )
