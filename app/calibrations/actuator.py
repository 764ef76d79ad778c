"""`slipscope calibrate actuator`: how the stage moves, by its own readings and by pictures of a
block that touches nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from analysis.options import Section, option
from app.calibrations.calibration import Calibration, CalibrationResult, Data, calibration_run
from app.calibrations.free_block import seen_motion, times_of_frames, travel_of
from app.settings.config import settings_of
from app.settings.protocol_steps import Drive, Hold, Reference, Reverse

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from app.settings.sections import Config

MOST_FRAMES = 400
EDGE = 0.05  # share of the travel at either end, where the stage gets under way
ALIKE = 0.02  # of a period, in which it is that of the pixels
SURE = 0.01  # probability of a false alarm, below which a period is one


@dataclass(frozen=True, kw_only=True)
class ActuatorOptions(Section):
    """How it is measured."""

    travel: float = option(80.0, "Travel forth, and back", "um", gt=0, le=20000)
    velocity: float = option(0.0, "Velocity; 0: run.velocity", "um/s", ge=0, le=1000)
    cycles: int = option(1, "Number of motions forth and back", ge=1, le=100)


class ActuatorCalibration(Calibration[ActuatorOptions]):
    """Velocity, backlash, periodic error and straightness of the stage."""

    name = "actuator"
    title = (
        "Real velocity of the stage against the commanded one, its backlash, periodic error and"
        " straightness, from a block that touches nothing."
    )
    takes_several = False
    files = "SESSION.h5"
    Options = ActuatorOptions

    def plan(self, config: Config, options: ActuatorOptions) -> tuple[Config, ...]:
        """See `Calibration.plan`."""
        speed = options.velocity or config.run.velocity
        there = Drive(travel=options.travel, velocity=speed)
        back = Reverse(times=2 * options.cycles - 1, velocity=speed)
        steps = Reference(time=0.5), there, back, Hold(time=0.3)
        return (calibration_run(config, steps, velocity=speed),)

    def gather(self, sources: Sequence[Path], options: ActuatorOptions) -> Data:
        """See `Calibration.gather`."""
        from app.session.reader import SessionReader

        with SessionReader(sources[0]) as reader:
            config = settings_of(reader)
            stage_time_s, stage_m = travel_of(reader, config.camera.pixel)
            seen = seen_motion(reader, times_of_frames(reader, MOST_FRAMES))
            return {
                "stage_time_s": stage_time_s,
                "stage_m": stage_m,
                "time_s": seen.time_s,
                "ux_m": seen.ux_px * config.camera.pixel,
                "uy_m": seen.uy_px * config.camera.pixel,
                "pixel_m": config.camera.pixel,
                "asked_m_s": config.run.velocity,
                "scale_sd": config.uncertainty.pixel,
            }

    def fit(self, data: Data, options: ActuatorOptions) -> CalibrationResult:
        """See `Calibration.fit`."""
        import numpy as np

        from analysis import stage_motion
        from app.records.quantities import Measurement

        at: Any = np.interp(data["time_s"], data["stage_time_s"], data["stage_m"])
        stage_leg, leg = self._legs(data, at)
        time, ux, uy = (data[name] for name in ("time_s", "ux_m", "uy_m"))
        asked, scale_sd = data["asked_m_s"], data["scale_sd"]
        own = stage_motion.steady_velocity(
            data["stage_time_s"][stage_leg], data["stage_m"][stage_leg], asked
        )
        straight = stage_motion.straightness(ux[leg], uy[leg])
        # the camera may see the drive go to its left
        along = math.cos(straight.angle) * ux + math.sin(straight.angle) * uy
        along *= math.copysign(1.0, float(along[np.argmax(at)]))
        seen = stage_motion.steady_velocity(time[leg], along[leg], asked, scale_sd=scale_sd)
        screw = stage_motion.periodic_error(at[leg], along[leg] - seen.value_m_s * time[leg])
        doubt = "" if screw.false_alarm < SURE else "no more than noise"
        if abs(screw.period_m / data["pixel_m"] - 1) < ALIKE:
            doubt = "its period is a pixel: of the correlation, not of the stage"
        lost = stage_motion.backlash(time, at, along - screw.at(at))
        angle = math.degrees(straight.angle), math.degrees(straight.angle_sd)
        found = [
            Measurement(name, symbol, value, sd, unit, key=key, is_signed=not symbol)
            for name, symbol, value, sd, unit, key in (
                ("velocity by pictures", "v", seen.value_m_s, seen.sd_m_s, "um/s", "velocity_m_s"),
                ("velocity by the stage", "v_s", own.value_m_s, own.sd_m_s, "um/s", "stage_m_s"),
                ("velocity over asked", "v/v_0", own.ratio, own.ratio_sd, "", "velocity_ratio"),
                ("backlash", "", lost.lost_m, lost.sd_m, "um", "backlash_m"),
                ("direction in the picture, degrees", "", *angle, "", "angle_degrees"),
                ("bow of the travel", "", straight.bow_m, straight.bow_sd_m, "um", "bow_m"),
                ("period of its error", "l", screw.period_m, screw.period_sd_m, "um", "period_m"),
            )
        ]  # fmt: skip
        size, key = (screw.amplitude_m, screw.amplitude_sd_m, "um"), "periodic_error_m"
        found.append(Measurement("its amplitude", "A", *size, doubt=doubt, key=key))
        remark = (
            f"a period has a false alarm of {screw.false_alarm:.2g}; none longer than"
            f" {float(np.ptp(at[leg])) / 1.5 * 1e6:.3g} um is seen in this travel"
        )
        return CalibrationResult(tuple(found), {}, (remark,))

    def _legs(self, data: Data, at: Any) -> tuple[Any, Any]:
        """Which readings of the stage, and which pictures, are of the first leg."""
        import numpy as np

        time, stage = data["stage_time_s"], data["stage_m"]
        turn = int(np.argmax(stage))
        low, high = stage[0] + np.array([EDGE, 1 - EDGE]) * (stage[turn] - stage[0])
        own, seen = (
            (place > low) & (place < high) & (when < time[turn])
            for place, when in ((stage, time), (at, data["time_s"]))
        )
        return own, seen

    def draw(self, figure: Figure, data: Data, findings: CalibrationResult) -> None:
        """See `Calibration.draw`."""
        import numpy as np

        at: Any = np.interp(data["time_s"], data["stage_time_s"], data["stage_m"])
        upper, lower = figure.subplots(2, 1)
        upper.plot(data["stage_time_s"], (data["stage_m"] - at[0]) * 1e6, label="stage")
        upper.plot(data["time_s"], data["ux_m"] * 1e6, "--", label="picture")
        upper.set(xlabel="time (s)", ylabel="travel (um)")
        upper.legend()
        off = data["ux_m"] - (at - at[0])
        lower.plot((at - at[0]) * 1e6, off * 1e9, ".", label="picture - stage, along x")
        lower.plot((at - at[0]) * 1e6, data["uy_m"] * 1e9, ".", label="across")
        lower.set(xlabel="travel (um)", ylabel="deviation (nm)")
        lower.legend()
