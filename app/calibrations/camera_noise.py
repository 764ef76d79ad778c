"""`slipscope calibrate camera`: noise, gain and full well of the camera, and the best exposure,
from pairs of pictures of a scene at rest.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from analysis.options import Section, option
from app.calibrations.calibration import Calibration, CalibrationResult, Data, calibration_run
from app.settings.protocol_steps import Hold, Reference
from app.settings.sections import Config
from app.system.errors import UserError

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
    files = "SESSION.h5...|PICTURES..."
    Options = CameraOptions
    of_files = ("top",)

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
        import numpy as np

        from analysis.calibration import photon_transfer

        top, taken = data["top"], data["image_exposure_s"]
        known = math.isfinite(taken)
        if options.longest and not known:
            raise UserError(
                "calibrate camera: pictures do not say how long they were exposed, so that"
                f" --longest {1e3 * options.longest:g} cannot be kept; give sessions, or leave it"
                " out"
            )
        levels = (data[name] for name in ("level", "variance", "count"))
        found = photon_transfer.photon_transfer(
            photon_transfer.NoiseLevels(*levels),
            top,
            dark=options.dark,
            mean_level=data["mean"] if known else (),
            exposure_s=data["exposure_s"] if known else (),
        )
        best = photon_transfer.best_exposure(
            data["image"],
            taken if known else 1.0,
            found,
            top,
            most_saturated=options.saturated,
            longest_s=options.longest or math.inf,
        )
        result = CalibrationResult()
        result.add("gain", "gain, grey levels per electron", "K", "", found.gain, found.gain_sd)
        result.add(
            "read_noise", "read noise, grey levels", "", "", found.read_noise, found.read_noise_sd
        )
        result.add("full_well", "full well, electrons", "", "", found.full_well, found.full_well_sd)
        result.add("largest_snr", "largest signal over noise", "SNR", "", found.largest_snr)
        name = "contrast over noise, at the best exposure"
        result.add("contrast_over_noise", name, "", "", best.contrast / best.noise)
        if math.isfinite(found.nonlinearity):
            result.add("nonlinearity", "nonlinearity, %", "", "", 100 * found.nonlinearity)
        exposure = (
            f"{1e3 * best.exposure_s:.3g} ms" if known else f"{best.exposure_s:.3g} times longer"
        )
        result.remark(
            f"the best exposure is {exposure}, by which the mean of the brightest picture is"
            f" {best.mean_level:.0f} grey levels, and {100 * best.saturated:.2g} % of the"
            " pixels are saturated",
            f"pixels of the grey level {top:.0f} and above count as saturated",
        )
        if not options.dark:
            result.remark("the grey level without light was taken for 0; give --dark if it is not")
        line = np.linspace(0, top, 50)
        result.chart(
            "grey level", "variance (grey levels^2)",
            (data["level"], data["variance"], ".", "pairs of pictures"),
            (line, found.gain * line + found.read_noise**2 + 1 / 12, "-", "read and shot noise"),
        )  # fmt: skip
        return result
