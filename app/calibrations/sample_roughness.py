"""`slipscope calibrate roughness`: the rough face from maps of its heights."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from analysis.options import Section, option
from app.calibrations.calibration import Calibration, CalibrationResult, Data
from app.calibrations.charts import GreyMap

if TYPE_CHECKING:
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
    of_files = "pitch", "scale"

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

        found = self._each(data, options)
        h, sds = np.array([(one.h, one.h_sd) for one in found]).T
        common = common_value(h, sds, np.full((len(h), 1), options.scale_uncertainty))
        mean, sd, share = common.value, common.sd, common.sd / common.value
        length = float(np.median([one.correlation_length for one in found]))
        if share > MOST_UNCERTAIN:
            raise ValueError(
                f"roughness: h is {mean * 1e6:.3g} +- {sd * 1e6:.2g} um, {100 * MOST_UNCERTAIN:g} %"
                " of it is the most; give more maps, or a map of many correlation lengths"
            )
        sample, top = Sample(), summits(found[0])
        result, nu, R, P = CalibrationResult(), sample.poisson, sample.lens_radius, options.load
        L, rim = elastic_length(mean, nu), math.sqrt(R * mean)
        for row in (
            ("roughness_m", "rms of the heights", "h", "um", mean, sd),
            ("correlation_length_m", "correlation length", "", "um", length),
            ("length_m", f"elastic length, nu = {nu:g}", "L", "um", L, L * share),
            ("extension_m", f"extension, R = {R * 1e3:g} mm", "sqrt(R h)", "um", rim,
             rim * share / 2),
            ("summit_distance_m", "distance of summits, 1/sqrt(eta)", "", "um", top.density**-0.5),
            ("summit_radius_m", "radius of summits", "beta", "um", top.radius),
        ):  # fmt: skip
            result.add(*row)
        result.remark(
            f"waves from {found[0].shortest * 1e6:.3g} to {found[0].longest * 1e6:.3g} um count:"
            " h of another range is another number",
            *dict.fromkeys(note for one in found for note in one.notes),
        )
        if len(h) > 1:
            apart = float(np.ptp(h)) / math.hypot(*sds[[h.argmin(), h.argmax()]])
            if apart > APART:
                result.remark(
                    f"the maps differ by up to {apart:.1f} standard uncertainties: the face is not"
                    " the same everywhere; the uncertainty is widened by that"
                )
        first, pitch = found[0], float(data["pitch_m"][0]) * 1e6
        reach, name = 4e6 * first.h, "height (um)"
        result.charts = (GreyMap(first.residual * 1e6, name, "", pitch, "um", reach),)
        spectra: list[tuple[Any, ...]] = [
            (one.wavenumber * 1e-6, one.spectrum * 1e24, "-", f"map {n}")
            for n, one in enumerate(found, 1)
        ]
        spectra.append(
            ([2e-6 * np.pi / first.correlation_length] * 2, spectra[0][1][[0, -1]], "k:", "")
        )
        result.chart("wave number (rad/um)", "power spectral density (um^4)", *spectra, is_log=True)
        try:
            rough, a = top.contact(P, *sample.bodies), hertz.contact_radius(P, *sample.bodies)
        except ValueError as error:
            result.remark(f"there is no pressure of Greenwood and Tripp: {error}")
        else:
            r = np.linspace(0, min(rough.reach, 2 * a), 400)
            laws = ("Greenwood, Tripp", rough.pressure(r)), ("Hertz", hertz.pressure(r, P, a))
            pressures = [(r * 1e3, p * 1e-3, "-", name) for name, p in laws]
            result.chart("r (mm)", "p (kPa)", *pressures)
            name = f"extension to {FAINT:.0%} of the peak pressure, P = {P:g} N"
            result.add("pressure_extension_m", name, "", "um", rough.radius_at(FAINT) - a)
            result.remark(
                f"mu = {top.mu(R):.3g} of Greenwood and Tripp by the moments of the first map; the"
                " summits are sharper and more, the shorter the waves that count"
            )
        result.set("sample.roughness", mean * 1e6, share)
        return result

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
