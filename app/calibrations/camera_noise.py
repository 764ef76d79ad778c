"""`slipscope calibrate camera`: noise, gain and full well of the camera, and the best exposure,
from pairs of pictures of a scene at rest.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from analysis.options import Section, option
from app.calibrations.calibration import (
    Calibration,
    CalibrationResult,
    Data,
    calibration_run,
    is_session,
)
from app.calibrations.free_block import end_of_pictures, times_of_frames
from app.settings.config import settings_of
from app.settings.protocol_steps import Hold, Reference
from app.system.errors import UserError

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
        from app.files.grey_images import pictures_of, read_image
        from app.session.reader import SessionReader

        series: list[tuple[float, list[Any]]] = []
        stated = options.top
        if is_session(sources[0]):
            for source in sources:
                with SessionReader(source) as reader:
                    config = settings_of(reader)
                    stated = stated or float(config.correlation.full_scale)
                    images = [reader.frame(n)[2] for n in list(times_of_frames(reader, FRAMES))]
                    series.append((config.camera.exposure, images))
        else:
            pages = pictures_of(sources)
            if len(pages) % 2:
                raise UserError(
                    f"camera: {len(pages)} pictures were given; pictures are taken in pairs, one"
                    " after the other, of each brightness"
                )
            images = [read_image(one) for one in pages]
            series = [(np.nan, images[n : n + 2]) for n in range(0, len(images), 2)]
        pictures = [one for _, images in series for one in images]
        top = options.top or end_of_pictures(pictures, stated)
        if not stated and top > 255 and top > max(one.max() for one in pictures):
            raise UserError(
                f"{sources[0]}: pictures of 16 bits do not say at which grey level their camera is"
                " saturated; give --top, 4095 for one of 12 bits"
            )
        found = [
            noise_levels(images[n], images[n + 1], top)
            for _, images in series
            for n in range(0, len(images) - 1, 2)
        ]
        brightest = max(
            (one for _, images in series for one in images[:1] if (one >= top).mean() < 1e-3),
            key=lambda image: float(image.mean()),
            default=series[0][1][0],
        )
        exposure = next(e for e, images in series if any(one is brightest for one in images))
        return {
            **{
                name: np.concatenate([getattr(one, name) for one in found])
                for name in ("level", "variance", "count")
            },
            "mean": np.array([float(np.mean(images[0])) for _, images in series]),
            "exposure_s": np.array([exposure for exposure, _ in series]),
            "top": top,
            "image": brightest,
            "image_exposure_s": exposure,
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
