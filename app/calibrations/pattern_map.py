"""`slipscope calibrate pattern`: what camera and glass add to every picture, from a block that is
moved, or from a flat field; with dark pictures: files or their folders are named dark and flat.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from analysis.options import Section, option
from app.calibrations.calibration import Calibration, CalibrationResult, Data, driven_run
from app.calibrations.charts import GreyMap
from app.calibrations.given_files import is_session
from app.records.quantities import counted
from app.settings.sections import Config
from app.system.errors import UserError

if TYPE_CHECKING:
    from analysis.calibration.pixel_map import PixelMap

DARK, FLAT = "dark", "flat"
TRAVEL_PX = 40.0


@dataclass(frozen=True, kw_only=True)
class PatternOptions(Section):
    """How it is measured."""

    pictures: int = option(60, "Number of images of the moved block that are used", ge=12, le=400)
    top: float = option(
        0.0,
        "Highest grey level of a flat field; 0: that of the image type, unless the levels are cut"
        " off below it",
        "grey levels",
        ge=0,
        le=65535,
    )


class PatternCalibration(Calibration[PatternOptions]):
    """Dark level and relative gain of each pixel, and marks on the glass."""

    name = "pattern"
    title = (
        "Pattern that stays in the image while the block moves: dark level and gain of each"
        " pixel, and marks, from a block that touches nothing and is moved, or from images whose"
        " files or folders are named dark and flat."
    )
    files = "SESSION.h5|PICTURES..."
    valid_days = 30
    Options = PatternOptions
    of_files = "pictures", "top"

    def plan(self, config: Config, options: PatternOptions) -> tuple[Config, ...]:
        """See `Calibration.plan`."""
        travel = TRAVEL_PX * config.camera.pixel
        speed = travel * config.frame_rate_hz / options.pictures
        return (driven_run(config, travel, speed),)

    def gather(self, sources: Sequence[Path], options: PatternOptions) -> Data:
        """See `Calibration.gather`: the map, which pictures are too large to be kept for."""
        import numpy as np

        from analysis.calibration.pixel_map import dark_levels, map_of_flat, map_of_motion
        from app.calibrations.free_block import seen_motion
        from app.calibrations.picture_series import end_of_pictures, is_named, pictures_named
        from app.calibrations.session_readings import opened, times_of_frames

        sessions = [one for one in sources if is_session(one)]
        pictures = [one for one in sources if one not in sessions]
        for one in pictures:
            if not (is_named(one, DARK) or is_named(one, FLAT)):
                raise UserError(
                    f"{one}: neither this picture nor its folder has a name that begins with dark"
                    " or flat; rename it, or leave it out"
                )
        flat = pictures_named(pictures, FLAT)
        dark: Any = 0.0
        is_hot, dark_sd = None, 0.0
        if len(sessions) + bool(flat) != 1:
            raise UserError(
                f"pattern: {counted(len(sessions), 'session')} and"
                f" {counted(len(flat), 'picture')} named flat were given; give one session of a"
                " moved block, or pictures named flat"
            )
        if darkened := pictures_named(pictures, DARK):
            dark, is_hot, dark_sd = dark_levels(darkened)
        if flat:
            top = options.top or end_of_pictures(flat)
            return _kept(map_of_flat(flat, dark, is_hot, top, dark_sd), flat[0])
        with opened(sessions[0]) as (reader, _):
            times = times_of_frames(reader, options.pictures)
            seen = seen_motion(reader, times)
            images = [reader.frame(frame)[2] for frame in times]
        shift = np.stack([seen.ux_px, seen.uy_px], axis=1)
        return _kept(map_of_motion(images, shift, dark, is_hot, dark_sd), images[0])

    def fit(self, data: Data, options: PatternOptions) -> CalibrationResult:
        """See `Calibration.fit`."""
        import numpy as np

        from analysis.calibration.pixel_map import PixelMap

        is_bad, sd, level = data["is_bad"], data["sd"], data["level"]
        known = data.get("is_told"), data.get("share", 1.0)
        unequal = PixelMap(data["dark"], data["gain"], is_bad, sd, *known).unequal()
        result = CalibrationResult()
        spread = [100 * one for one in unequal]
        result.add("unequal_percent", "unequal pixels, %", "", "", *spread)
        bad = 100 * float(is_bad.mean())
        result.add("bad_percent", "pixels at marks, hot or dead, %", "", "", bad)
        result.add("gain_sd_percent", "uncertainty of a pixel's gain, %", "", "", 100 * sd)
        result.remark(
            f"the map is known to {sd * level:.2g} grey levels in one pixel of a picture of"
            f" {level:.3g} grey levels"
        )
        off = 100 * (data["gain"].astype(np.float64) - 1)
        most = 3 * float(off[~is_bad].std()) or 1.0
        result.charts = (
            GreyMap(off, "gain - 1 (%)", "pattern", most=most),
            GreyMap(is_bad, title="marks", colours="gray_r"),
        )
        return result


def _kept(found: PixelMap, image: Any) -> Data:
    """A map as arrays, in a precision whose rounding is far below its uncertainty."""
    import numpy as np

    return {
        "gain": found.gain.astype(np.float32),
        "dark": found.dark.astype(np.float32),
        "is_bad": found.is_bad,
        "is_told": np.ones_like(found.is_bad) if found.is_told is None else found.is_told,
        "sd": found.sd,
        "share": found.share,
        "level": float(np.mean(image)),
    }
