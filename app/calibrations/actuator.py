"""How the stage moves, by its own readings and by pictures of a block that touches nothing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from analysis.options import Section, option
from app.calibrations.calibration import Calibration, CalibrationResult, Data, driven_run
from app.settings.protocol_steps import Hold, Reverse
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
    files = "SESSION.h5"
    Options = ActuatorOptions

    def plan(self, config: Config, options: ActuatorOptions) -> tuple[Config, ...]:
        """See `Calibration.plan`."""
        speed = options.velocity or config.run.velocity
        back = Reverse(times=2 * options.cycles - 1, velocity=speed)
        return (driven_run(config, options.travel, speed, (back, Hold(time=0.3))),)

    def gather(self, sources: Sequence[Path], options: ActuatorOptions) -> Data:
        """See `Calibration.gather`."""
        from app.calibrations.free_block import seen_motion
        from app.calibrations.session_readings import opened, times_of_frames, travel_of

        with opened(sources[0]) as (reader, config):
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
        along *= math.copysign(1.0, along[np.argmax(at)])
        seen = stage_motion.steady_velocity(time[leg], along[leg], asked, scale_sd=scale_sd)
        screw = stage_motion.periodic_error(at[leg], along[leg] - seen.value_m_s * time[leg])
        doubt = "" if screw.false_alarm < SURE else "no more than noise"
        if abs(screw.period_m / data["pixel_m"] - 1) < ALIKE:
            doubt = "its period is a pixel: of the correlation, not of the stage"
        lost = stage_motion.backlash(time, at, along - screw.at(at))
        angle = math.degrees(straight.angle), math.degrees(straight.angle_sd)
        result = CalibrationResult()
        for key, name, symbol, unit, value, sd in (
            ("velocity_m_s", "velocity by pictures", "v", "um/s", seen.value_m_s, seen.sd_m_s),
            ("stage_m_s", "velocity by the stage", "v_s", "um/s", own.value_m_s, own.sd_m_s),
            ("velocity_ratio", "velocity over asked", "v/v_0", "", seen.ratio, seen.ratio_sd),
            ("backlash_m", "backlash", "", "um", lost.lost_m, lost.sd_m),
            ("angle_degrees", "direction in the picture, degrees", "", "", *angle),
            ("bow_m", "bow of the travel", "", "um", straight.bow_m, straight.bow_sd_m),
            ("period_m", "period of its error", "l", "um", screw.period_m, screw.period_sd_m),
        ):
            result.add(key, name, symbol, unit, value, sd, is_signed=not symbol)
        result.add(
            "periodic_error_m",
            "its amplitude",
            "A",
            "um",
            screw.amplitude_m,
            screw.amplitude_sd_m,
            doubt=doubt,
        )
        result.remark(
            f"a period has a false alarm of {screw.false_alarm:.2g}; none longer than"
            f" {float(np.ptp(at[leg])) / 1.5 * 1e6:.3g} um is seen in this travel"
        )
        way_um = (at - at[0]) * 1e6
        stage_um = (data["stage_m"] - at[0]) * 1e6
        result.chart(
            "time (s)", "travel (um)",
            (data["stage_time_s"], stage_um, "-", "stage"),
            (time, data["ux_m"] * 1e6, "--", "picture"),
        )  # fmt: skip
        result.chart(
            "travel (um)", "deviation (nm)",
            (way_um, data["ux_m"] * 1e9 - way_um * 1e3, ".", "picture - stage, along x"),
            (way_um, data["uy_m"] * 1e9, ".", "across"),
        )  # fmt: skip
        return result

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
