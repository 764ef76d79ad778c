"""`slipscope calibrate scale`: size of a pixel, direction of the drive and distortion, from a block
that touches nothing and is moved, or from a picture of a checkerboard or of ruled lines.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from analysis.options import Section, option
from app.calibrations.block_fields import displacement_of_pictures, fields_of_session
from app.calibrations.calibration import (
    Calibration,
    CalibrationResult,
    Data,
    calibration_run,
    is_session,
)
from app.calibrations.charts import above_residual, draw_map
from app.settings.protocol_steps import Drive, Hold, Reference, Reverse
from app.system.errors import UserError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from analysis.calibration.scale import ImageScale
    from app.settings.sections import Config


@dataclass(frozen=True, kw_only=True)
class ScaleOptions(Section):
    """What moves, or what the picture shows."""

    travel: float = option(300.0, "Travel of the block forth, and back", "um", gt=0, le=20000)
    velocity: float = option(20.0, "Velocity of the block", "um/s", gt=0, le=1000)
    corners: tuple[int, int] = option(
        (0, 0), "Inner corners of a checkerboard along its rows and columns; (0, 0): ruled lines"
    )
    distance: float = option(
        0.0, "For an image: side of a square, or distance of neighbouring lines", "um", ge=0, le=1e5
    )
    pixel: float = option(
        7.04, "For an image of ruled lines: size of a pixel, to within 20 %", "um", gt=0, le=1000
    )
    relative: float = option(
        0.05, "Standard uncertainty of the stage's travel, or of that distance", "%", ge=0, le=10
    )


class ScaleCalibration(Calibration[ScaleOptions]):
    """Size of a pixel on the interface, angle and distortion."""

    name = "scale"
    title = (
        "Size of a pixel, direction of the drive and distortion of the lens, from a block that"
        " touches nothing and is moved, or from an image of a checkerboard or of ruled lines."
    )
    files = "SESSION.h5 [BEFORE.png AFTER.png]|PICTURE"
    Options = ScaleOptions

    def plan(self, config: Config, options: ScaleOptions) -> tuple[Config, ...]:
        """See `Calibration.plan`."""
        steps = (
            Reference(time=0.5),
            Drive(travel=options.travel, velocity=options.velocity),
            Hold(time=1.0),
            Reverse(times=1, velocity=options.velocity),
            Hold(time=1.0),
        )
        return (calibration_run(config, steps, velocity=options.velocity),)

    def gather(self, sources: Sequence[Path], options: ScaleOptions) -> Data:
        """See `Calibration.gather`: fields of the displacement and travels, with that between two
        pictures of a motion across them; or the picture.
        """
        from app.files.grey_images import read_image

        path, *across = sources
        if len(across) not in {0, 2} or (across and not is_session(path)):
            raise UserError(
                f"{sources[-1]}: {len(sources)} files found; give a session, with two pictures from"
                " before and after the block was pushed across its drive if you like, or a picture"
            )
        if not is_session(path):
            if not options.distance:
                raise UserError(
                    f"{path}: a picture needs --distance, the side of a square or the pitch"
                    " of the lines in um, and --corners for a checkerboard"
                )
            return {"image": read_image(path)}
        pushed = {"across": displacement_of_pictures(*across)} if across else {}
        return {**fields_of_session(path), **pushed}

    def fit(self, data: Data, options: ScaleOptions) -> CalibrationResult:
        """See `Calibration.fit`."""
        from analysis.calibration.scale import TravelScale, is_mirrored
        from app.records.quantities import Measurement

        found = self._scale(data, options)
        corner = 100 * found.k
        share, lens_sd = 100 * found.m_per_px_sd / found.m_per_px, 100 * found.k_sd
        values = [
            Measurement("size of a pixel", "", found.m_per_px, found.m_per_px_sd, "um",
                        key="pixel_m"),
            Measurement("distortion at the corners, %", "k", corner, lens_sd, "", is_signed=True,
                        key="distortion_percent"),
            Measurement("angle in the picture, degrees", "", math.degrees(found.angle),
                        math.degrees(found.angle_sd), "", is_signed=True, key="angle_degrees"),
        ]  # fmt: skip
        settings = {
            "camera.pixel": found.m_per_px * 1e6,
            "camera.distortion": corner,
            "uncertainty.pixel": share,
            "uncertainty.distortion": lens_sd,
        }
        remarks = [f"what is left of the places is {found.rms_px:.2g} px (rms)"]
        if not isinstance(found, TravelScale):
            remarks.append("a target tells neither the direction of the drive nor a mirror")
            return CalibrationResult(tuple(values), settings, tuple(remarks))
        settings["camera.angle"] = math.degrees(found.angle)
        for name, unit, value, sd, key in (
            ("backlash", "um", found.backlash_m, found.backlash_sd, "backlash_m"),
            ("drift, px/s", "", math.hypot(*found.drift_px_per_s), found.drift_sd, "drift_px_s"),
        ):
            if math.isfinite(value):
                values.append(
                    Measurement(name, "", float(value), float(sd), unit, is_signed=True, key=key)
                )
        if "across" in data:
            is_odd = is_mirrored(found.angle, *data["across"])
            remarks.append(f"the picture is {'mirrored' if is_odd else 'not mirrored'}")
        else:
            remarks.append("travels along one axis do not tell whether the picture is mirrored")
        return CalibrationResult(tuple(values), settings, tuple(remarks))

    def _scale(self, data: Data, options: ScaleOptions) -> ImageScale:
        from analysis.calibration.scale import scale_of_travels
        from analysis.calibration.targets import scale_of_checkerboard, scale_of_lines

        share = options.relative
        if "u" in data:
            return scale_of_travels(
                *(data["travel_m"], data["x"], data["y"], data["u"][:, 0], data["u"][:, 1]),
                (int(data["shape"][0]), int(data["shape"][1])),
                time_s=data["time_s"],
                drift_sd=data["drift_sd"],
                relative_sd=share,
                **{name: data[name] for name in ("box", "step_m") if name in data},
            )
        if all(options.corners):
            return scale_of_checkerboard(
                data["image"], options.corners, options.distance, relative_sd=share
            )
        return scale_of_lines(data["image"], options.distance, options.pixel, relative_sd=share)

    def draw(self, figure: Figure, data: Data, findings: CalibrationResult) -> None:
        """See `Calibration.draw`: the picture, or displacements against travels and what is left
        of a line.
        """
        import numpy as np

        if "image" in data:
            draw_map(figure.subplots(), data["image"])
            return
        labels = "travel (um)", "displacement (px)", "off a line (px)"
        upper, lower = above_residual(figure, *labels)
        travel = 1e6 * (data["travel_m"] - data["travel_m"][0])
        seen = np.nanmedian(data["u"].reshape(len(travel), 2, -1), axis=2)
        for axis, name in enumerate(("along x", "along y")):
            line = np.polynomial.Polynomial.fit(travel, seen[:, axis], 1)
            upper.plot(travel, seen[:, axis], ".", label=name)
            lower.plot(travel, seen[:, axis] - line(travel), ".", label=name)
        upper.legend()
