"""How far the holder of the lens gives way to Q, by marks on the lens, or by a gauge."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from analysis.options import UNITS, Section, option
from app.calibrations.calibration import Calibration, CalibrationResult, Data, calibration_run
from app.calibrations.given_files import is_session, table_of
from app.settings.config import settings_of
from app.settings.protocol_steps import Approach, Drive, Hold, Reference, Reverse
from app.settings.sections import Config

if TYPE_CHECKING:
    from app.session.reader import SessionReader

MOST_FRAMES = 600
GAUGE = "the time, the shear force and how far the gauge says that the holder has moved"
UNMAPPED = (
    "the bench has no map of its pixels; unequal pixels make the compliance too small, by some per"
    " cent where they differ by 3 %: slipscope calibrate pattern, first"
)
REST_S = 3.0  # before and after the loading: a drift is told from the force


@dataclass(frozen=True, kw_only=True)
class LensHolderOptions(Section):
    """Where the lens is seen, and what else moves it."""

    region: tuple[str, ...] = option(
        (), "Region of the image that shows marks on the lens: polygons, as in dic.region"
    )
    ratio: float = option(0.6, "Q/P up to which the contact is loaded", gt=0, le=10)
    cycles: int = option(2, "Number of times the contact is loaded and unloaded", ge=1, le=100)
    gauge_uncertainty: float = option(
        0.5, "Standard uncertainty of the gauge, as a share of its reading", "%", ge=0, le=20
    )
    channel: str = option(
        "",
        "Name of a further channel (forces.auxiliary) that may move the lens, such as a"
        " temperature",
    )


class LensHolder(Calibration[LensHolderOptions]):
    """Compliance of the lens holder, and its drift."""

    name = "compliance"
    title = (
        "Compliance of the lens holder and its drift, from marks on the lens that move with Q, or"
        " from a gauge at the holder."
    )
    files = "SESSION.h5|GAUGE.csv"
    Options = LensHolderOptions
    of_files = "region", "channel"

    def plan(self, config: Config, options: LensHolderOptions) -> tuple[Config, ...]:
        """See `Calibration.plan`."""
        from app.calibrations.free_block import region_of_marks

        region = region_of_marks(config, options.region)
        marked = replace(config, dic=replace(config.dic, region=region))
        drive, back = Drive(until_ratio=options.ratio), Reverse(times=2 * options.cycles - 1)
        steps = Approach(), Reference(time=REST_S), drive, back, Hold(time=REST_S)
        return (calibration_run(marked, steps),)

    def gather(self, sources: Sequence[Path], options: LensHolderOptions) -> Data:
        """Motion of the lens along the drive (m) and Q (N) at times, and what else moves it."""
        from app.calibrations.session_readings import opened, relative_sd_of_forces
        from app.files.text_tables import FORCE, LENGTH, NUMBER, TIME
        from app.settings.config import load

        if is_session(sources[0]):
            with opened(sources[0]) as (reader, _):
                return self._seen(reader, options)
        columns = {
            "time_s": ("time", TIME, "time_s"),
            "shear_force_n": ("q", FORCE, "Q_N"),
            "moved_m": ("moved", LENGTH, "moved_um"),
            "channel": ("channel", NUMBER, ""),
        }
        _, of_force = relative_sd_of_forces(load(None, ()))  # of no bench in particular
        return table_of(sources[0], columns, GAUGE) | {"scale_sd": of_force, "is_gauge": True}

    def _seen(self, reader: SessionReader, options: LensHolderOptions) -> Data:
        from app.calibrations import free_block, session_readings

        config, rate = settings_of(reader), reader.header.sample_rate_hz
        begins = next((one.sample for one in reader.events() if one.text == "reference"), 0)
        times = session_readings.times_of_frames(reader, MOST_FRAMES, begins / rate)
        region = free_block.region_of_marks(config, options.region)
        is_mapped = free_block.has_map(reader, region)
        seen = free_block.seen_motion(reader, times, region)
        _, of_force = session_readings.relative_sd_of_forces(config)
        drive = free_block.direction_of_drive(reader, times, region)
        readings = session_readings.readings_at(reader, seen.time_s, options.channel)
        return dict(zip(("shear_force_n", "channel"), readings, strict=False)) | {
            "time_s": seen.time_s,
            "moved_m": (drive.x * seen.ux_px + drive.y * seen.uy_px) * config.camera.pixel,
            "angle": drive.angle,
            "is_mapped": is_mapped,
            "scale_sd": math.hypot(config.uncertainty.pixel, of_force),
        }

    def fit(self, data: Data, options: LensHolderOptions) -> CalibrationResult:
        """See `Calibration.fit`."""
        from analysis import compliance

        time, Q, moved = (data[name] for name in ("time_s", "shear_force_n", "moved_m"))
        found = compliance.holder_compliance(time, Q, moved, data.get("channel"))
        value, unit = found.value_m_n, UNITS["um/N"]
        by_gauge = options.gauge_uncertainty if "is_gauge" in data else 0.0
        by_scale = value * math.hypot(data["scale_sd"], by_gauge)
        sd = math.hypot(found.sd_m_n, by_scale)
        if sd > value:
            raise ValueError(
                f"compliance: {value / unit:.2g} +- {sd / unit:.1g} um/N is not resolved; load the"
                " contact further in shear, or take more readings"
            )
        result = CalibrationResult()
        holder = "compliance of the lens holder", "C", "um/N", value, found.sd_m_n
        result.add("lens_compliance_m_n", *holder, systematic=by_scale)
        drift = "drift of the lens in the picture", "", "um/s", found.drift_m_s, found.drift_sd_m_s
        result.add("drift_m_s", *drift, is_signed=True)
        if "channel" in data:
            per_unit = found.per_unit_m, found.per_unit_sd_m
            name = "drift with the channel, per unit"
            result.add("per_channel_m", name, "", "um", *per_unit, is_signed=True)
        result.set("sample.lens_compliance", value / unit, sd / value)
        result.remark(f"what is left scatters by {found.rms_m * 1e9:.3g} nm")
        if by_gauge:
            result.remark(
                f"{100 * by_gauge:g} % of the gauge, and of Q what the settings of a bench have by"
                " default, are in the uncertainty"
            )
        if "angle" in data:
            turned = math.degrees(data["angle"])
            result.remark(f"the drive goes at {turned:.1f} degrees in the picture")
        if not data.get("is_mapped", True):
            result.remark(UNMAPPED)
        left = moved - value * Q - found.drift_m_s * time
        result.chart("Q (N)", "motion of the lens (um)", (Q, moved * 1e6, "."))
        result.chart("time (s)", "left of it (nm)", (time, (left - left.mean()) * 1e9, "."))
        return result
