"""Size of a pixel, direction of the drive and distortion, from a free block or from a target."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from analysis.options import Section, option
from app.calibrations.calibration import Calibration, CalibrationResult, Data, driven_run
from app.calibrations.charts import GreyMap
from app.calibrations.given_files import is_session
from app.settings.protocol_steps import Hold, Reverse
from app.settings.sections import Config
from app.system.errors import UserError

if TYPE_CHECKING:
    from analysis.calibration.scale import ImageScale

KNOWN = "time_s", "drift_sd", "box", "step_m"  # of a session


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
        rest, back = Hold(time=1.0), Reverse(times=1, velocity=options.velocity)
        return (driven_run(config, options.travel, options.velocity, (rest, back, rest)),)

    def gather(self, sources: Sequence[Path], options: ScaleOptions) -> Data:
        """Fields of the displacement and travels, with that by a push across them; or a picture."""
        from app.calibrations.free_block import displacement_of_pictures, fields_of_session
        from app.files.grey_images import read_image

        # files that were picked come in any order
        path, *across = sorted(
            sources, key=lambda one: (not is_session(one), one.stem.lower().startswith("after"))
        )
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
        import numpy as np

        from analysis.calibration.scale import TravelScale, is_mirrored

        found, result = self._scale(data, options), CalibrationResult()
        corner, lens_sd = 100 * found.k, 100 * found.k_sd
        angle, angle_sd = math.degrees(found.angle), math.degrees(found.angle_sd)
        lens, turned = "distortion at the corners, %", "angle in the picture, degrees"
        result.add("pixel_m", "size of a pixel", "", "um", found.m_per_px, found.m_per_px_sd)
        result.add("distortion_percent", lens, "k", "", corner, lens_sd, is_signed=True)
        result.add("angle_degrees", turned, "", "", angle, angle_sd, is_signed=True)
        result.set("camera.pixel", found.m_per_px * 1e6, found.m_per_px_sd / found.m_per_px)
        result.set("camera.distortion", corner, found.k_sd)
        result.remark(f"what is left of the places is {found.rms_px:.2g} px (rms)")
        if not isinstance(found, TravelScale):
            result.remark("a target shows neither the direction of the drive nor a mirror")
            result.charts = (GreyMap(data["image"]),)
            return result
        result.settings["camera.angle"] = angle
        if math.isfinite(play := found.backlash_m):
            result.add("backlash_m", "backlash", "", "um", play, found.backlash_sd, is_signed=True)
        if math.isfinite(drift := math.hypot(*found.drift_px_per_s)):
            result.add("drift_px_s", "drift, px/s", "", "", drift, found.drift_sd, is_signed=True)
        if "across" in data:
            is_odd = is_mirrored(found.angle, *data["across"])
            result.remark(f"the picture is {'mirrored' if is_odd else 'not mirrored'}")
        else:
            result.remark("travels along one axis do not show whether the picture is mirrored")
        travel = data["travel_m"] - data["travel_m"][0]
        seen = np.nanmedian(data["u"].reshape(len(travel), 2, -1), axis=2)
        lines = np.polynomial.polynomial.polyfit(travel, seen, 1)
        left = seen - np.polynomial.polynomial.polyval(travel, lines).T
        for name, shown in (("displacement (px)", seen), ("off a line (px)", left)):
            curves = [(1e6 * travel, shown[:, i], ".", f"along {'xy'[i]}") for i in (0, 1)]
            result.chart("travel (um)", name, *curves)
        return result

    def _scale(self, data: Data, options: ScaleOptions) -> ImageScale:
        from analysis.calibration.scale import scale_of_travels
        from analysis.calibration.targets import scale_of_checkerboard, scale_of_lines

        known: dict[str, Any] = {"relative_sd": options.relative}
        if "u" in data:
            known |= {name: data[name] for name in KNOWN if name in data}
            rows, columns = (int(size) for size in data["shape"])
            travel, x, y, u = (data[name] for name in ("travel_m", "x", "y", "u"))
            return scale_of_travels(travel, x, y, u[:, 0], u[:, 1], (rows, columns), **known)
        image, distance = data["image"], options.distance
        if all(options.corners):
            return scale_of_checkerboard(image, options.corners, distance, **known)
        return scale_of_lines(image, distance, options.pixel, **known)
