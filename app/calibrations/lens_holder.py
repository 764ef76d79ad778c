"""`slipscope calibrate compliance`: how far the holder of the lens gives way to Q, by marks on the
lens that the camera sees, or by a gauge.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from analysis.options import UNITS, Section, option
from app.calibrations.calibration import (
    Calibration,
    CalibrationResult,
    Data,
    calibration_run,
    is_session,
)
from app.calibrations.free_block import (
    direction_of_drive,
    readings_at,
    relative_sd_of_forces,
    seen_motion,
    times_of_frames,
)
from app.settings.config import settings_of
from app.settings.protocol_steps import Approach, Drive, Hold, Reference, Reverse
from app.system.errors import UserError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from app.session.reader import SessionReader
    from app.settings.sections import Config

MOST_FRAMES = 600
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
    takes_several = False
    files = "SESSION.h5|GAUGE.csv"
    Options = LensHolderOptions

    def plan(self, config: Config, options: LensHolderOptions) -> tuple[Config, ...]:
        """See `Calibration.plan`."""
        marked = replace(config, dic=replace(config.dic, region=_region(config, options)))
        drive, back = Drive(until_ratio=options.ratio), Reverse(times=2 * options.cycles - 1)
        steps = Approach(), Reference(time=REST_S), drive, back, Hold(time=REST_S)
        return (calibration_run(marked, steps),)

    def gather(self, sources: Sequence[Path], options: LensHolderOptions) -> Data:
        """See `Calibration.gather`; a table has the columns time_s, Q_N and moved_um, and channel
        where there is one.
        """
        from app.files.text_tables import FORCE, LENGTH, NUMBER, TIME, read_table
        from app.session.reader import SessionReader
        from app.settings.config import load

        if is_session(sources[0]):
            with SessionReader(sources[0]) as reader:
                return self._seen(reader, options)
        columns = {"time": TIME, "q": FORCE, "moved": LENGTH, "channel": NUMBER}
        table = read_table(sources[0], columns)
        if not table.has("time", "q", "moved"):
            raise UserError(
                f"{sources[0]}: the header has no time_s, Q_N or moved_um; give the time, the shear"
                " force and how far the gauge says that the holder has moved"
            )
        names = {"time": "time_s", "q": "shear_force_n", "moved": "moved_m", "channel": "channel"}
        data = {name: table.numbers[given] for given, name in names.items() if table.has(given)}
        _, of_force = relative_sd_of_forces(load(None, ()))  # of the bench nothing is known
        return data | {"scale_sd": of_force, "is_gauge": True}

    def _seen(self, reader: SessionReader, options: LensHolderOptions) -> Data:

        config, rate = settings_of(reader), reader.header.sample_rate_hz
        rests = [one.sample for one in reader.events() if one.text == "reference"]
        times = times_of_frames(reader, MOST_FRAMES, rests[0] / rate if rests else 0.0)
        region = _region(config, options)
        seen = seen_motion(reader, times, region)
        drive = direction_of_drive(reader, times, region)
        readings = readings_at(reader, seen.time_s, options.channel)
        return dict(zip(("shear_force_n", "channel"), readings, strict=False)) | {
            "time_s": seen.time_s,
            "moved_m": (drive.x * seen.ux_px + drive.y * seen.uy_px) * config.camera.pixel,
            "angle": drive.angle,
            "scale_sd": math.hypot(config.uncertainty.pixel, relative_sd_of_forces(config)[1]),
        }

    def fit(self, data: Data, options: LensHolderOptions) -> CalibrationResult:
        """See `Calibration.fit`."""
        from analysis import compliance
        from app.records.quantities import Measurement

        found = compliance.holder_compliance(
            data["time_s"], data["shear_force_n"], data["moved_m"], data.get("channel")
        )
        by_gauge = options.gauge_uncertainty if "is_gauge" in data else 0.0
        scale_sd = math.hypot(data["scale_sd"], by_gauge)
        value, by_scale = found.value_m_n, found.value_m_n * scale_sd
        values = [
            Measurement("compliance of the lens holder", "C", value, found.sd_m_n, "um/N",
                        systematic=by_scale, key="lens_compliance_m_n"),
            Measurement("drift of the lens in the picture", "", found.drift_m_s,
                        found.drift_sd_m_s, "um/s", is_signed=True, key="drift_m_s"),
        ]  # fmt: skip
        if "channel" in data:
            per_unit = found.per_unit_m, found.per_unit_sd_m, "um"
            name, key = "drift with the channel, per unit", "per_channel_m"
            values.append(Measurement(name, "", *per_unit, is_signed=True, key=key))
        sd = math.hypot(found.sd_m_n, by_scale)
        if sd > value:
            raise ValueError(
                f"compliance: {value / UNITS['um/N']:.2g} +- {sd / UNITS['um/N']:.1g} um/N is not"
                " resolved; load the contact further in shear, or take more readings"
            )
        settings = {"sample.lens_compliance": value / UNITS["um/N"]}
        settings["uncertainty.lens_compliance"] = 100 * sd / value
        remarks = [f"what is left scatters by {found.rms_m * 1e9:.3g} nm"]
        if by_gauge:
            remarks.append(
                f"{100 * by_gauge:g} % of the gauge, and of Q what the settings of a bench have by"
                " default, are in the uncertainty"
            )
        if "angle" in data:
            angle = math.degrees(data["angle"])
            remarks.append(f"the drive goes at {angle:.1f} degrees in the picture")
        return CalibrationResult(tuple(values), settings, tuple(remarks))

    def draw(self, figure: Figure, data: Data, findings: CalibrationResult) -> None:
        """See `Calibration.draw`."""
        upper, lower = figure.subplots(2, 1)
        time, Q, moved = (data[name] for name in ("time_s", "shear_force_n", "moved_m"))
        C, drift = (one.value for one in findings.values[:2])
        upper.plot(Q, moved * 1e6, ".")
        upper.set(xlabel="Q (N)", ylabel="motion of the lens (um)")
        left = moved - C * Q - drift * time
        lower.plot(time, (left - left.mean()) * 1e9, ".")
        lower.set(xlabel="time (s)", ylabel="left of it (nm)")


def _region(config: Config, options: LensHolderOptions) -> tuple[str, ...]:
    region = options.region or config.dic.region
    if not region:
        raise UserError(
            "calibrate compliance: nothing says where the lens is seen, and the block cannot tell"
            " how far it moves; put marks on the lens beside the contact and give their --region,"
            " or the table of a gauge"
        )
    return region
