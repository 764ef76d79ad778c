"""`slipscope calibrate camera`: noise, gain and full well of the camera, and the best exposure,
from pairs of pictures of a scene at rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from analysis.options import Section, option
from app.calibrations.calibration import Calibration, CalibrationResult, Data, calibration_run
from app.settings.protocol_steps import Hold, Reference

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from app.settings.sections import Config

SHARES = 0.1, 0.25, 0.5, 1.0  # of the exposure of the settings
FRAMES = 8  # of a session that are compared in pairs


@dataclass(frozen=True, kw_only=True)
class CameraOptions(Section):
    """What is known of the pictures, and what the exposure may do."""

    dark: float = option(0.0, "Mean grey level without light", "grey levels", ge=0, le=65535)
    top: float = option(
        0.0,
        "Highest grey level; 0: that of the session's camera, or of the image type, unless the"
        " levels are cut off below it",
        "grey levels",
        ge=0,
        le=65535,
    )
    saturated: float = option(0.1, "Share of pixels that may be saturated", "%", gt=0, le=10)
    longest: float = option(0.0, "Longest exposure; 0: any", "ms", ge=0, le=1000)


class CameraCalibration(Calibration[CameraOptions]):
    """Photon-transfer curve of the camera."""

    name = "camera"
    title = (
        "Noise, gain and full well of the camera (EMVA 1288) and the best exposure, from a block"
        " at rest under several exposures, or from pairs of images."
    )
    files = "SESSION.h5...|PICTURES"
    Options = CameraOptions

    def plan(self, config: Config, options: CameraOptions) -> tuple[Config, ...]:
        """See `Calibration.plan`: one run for each exposure."""
        steps = (Reference(time=0.3), Hold(time=1.0 + FRAMES / config.frame_rate_hz))
        exposure = config.camera.exposure
        return tuple(
            calibration_run(config, steps, camera=replace(config.camera, exposure=share * exposure))
            for share in SHARES
        )

    def gather(self, sources: Sequence[Path], options: CameraOptions) -> Data:
        """See `Calibration.gather`: the variance by grey level of each pair."""
        import numpy as np

        from analysis.calibration.photon_transfer import noise_levels
        from app.calibrations.picture_series import exposure_series

        series = exposure_series(sources, options.top, FRAMES)
        found = [noise_levels(first, second, series.top) for first, second in series.pairs]
        firsts = [images[0] for images in series.pictures]
        unsaturated = [n for n, one in enumerate(firsts) if (one >= series.top).mean() < 1e-3]
        brightest = max(unsaturated, key=lambda n: float(firsts[n].mean()), default=0)
        return {
            **{
                name: np.concatenate([getattr(one, name) for one in found])
                for name in ("level", "variance", "count")
            },
            "mean": np.array([float(np.mean(one)) for one in firsts]),
            "exposure_s": np.array(series.exposures_s),
            "top": series.top,
            "image": firsts[brightest],
            "image_exposure_s": series.exposures_s[brightest],
        }

    def fit(self, data: Data, options: CameraOptions) -> CalibrationResult:
        """See `Calibration.fit`."""
        import math

        from analysis.calibration.photon_transfer import (
            NoiseLevels,
            best_exposure,
            photon_transfer,
        )
        from app.records.quantities import Measurement

        top, taken = data["top"], data["image_exposure_s"]
        known = math.isfinite(taken)
        found = photon_transfer(
            NoiseLevels(data["level"], data["variance"], data["count"]),
            top,
            dark=options.dark,
            mean_level=data["mean"] if known else (),
            exposure_s=data["exposure_s"] if known else (),
        )
        best = best_exposure(
            data["image"],
            taken if known else 1.0,
            found,
            top,
            most_saturated=options.saturated,
            longest_s=options.longest or math.inf,
        )
        values = [
            Measurement("gain, grey levels per electron", "K", found.gain, found.gain_sd,
                        key="gain"),
            Measurement("read noise, grey levels", "", found.read_noise, found.read_noise_sd,
                        key="read_noise"),
            Measurement("full well, electrons", "", float(found.full_well),
                        float(found.full_well_sd),
                        key="full_well"),
            Measurement("largest signal over noise", "SNR", found.largest_snr,
                        key="largest_snr"),
            Measurement("contrast over noise, at the best exposure", "",
                        best.contrast / best.noise, key="contrast_over_noise"),
        ]  # fmt: skip
        if math.isfinite(found.nonlinearity):
            values.append(
                Measurement("nonlinearity, %", "", 100 * found.nonlinearity, key="nonlinearity")
            )
        exposure = (
            f"{1e3 * best.exposure_s:.3g} ms" if known else f"{best.exposure_s:.3g} times longer"
        )
        remarks = [
            f"the best exposure is {exposure}, by which the mean of the brightest picture is"
            f" {best.mean_level:.0f} grey levels, and {100 * best.saturated:.2g} % of the"
            " pixels are saturated",
            f"pixels of the grey level {top:.0f} and above count as saturated",
        ]
        if not options.dark:
            remarks.append("the grey level without light was taken for 0; give --dark if it is not")
        return CalibrationResult(tuple(values), {}, tuple(remarks))

    def draw(self, figure: Figure, data: Data, findings: CalibrationResult) -> None:
        """See `Calibration.draw`: the photon-transfer curve."""
        import numpy as np

        axes = figure.subplots()
        gain, read = (next(v.value for v in findings.values if v.key == key)
                      for key in ("gain", "read_noise"))  # fmt: skip
        axes.plot(data["level"], data["variance"], ".", label="pairs of pictures")
        line = np.linspace(0, data["top"], 50)
        axes.plot(line, gain * line + read**2 + 1 / 12, "-", label="read and shot noise")
        axes.set(xlabel="grey level", ylabel="variance (grey levels^2)")
        axes.legend()
