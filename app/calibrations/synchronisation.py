"""Times: the exposure after its trigger, one channel after the other, the camera's clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

from analysis.options import Section, option
from app.calibrations.calibration import Calibration, CalibrationResult, Data, calibration_run
from app.calibrations.given_files import is_session, table_of
from app.settings.protocol_steps import Hold
from app.settings.sections import Config
from app.system.errors import UserError

STAMPS = "the samples of the triggers and the times that the camera gave to their frames"
MOST_SAMPLES = 1 << 18  # of the two channels


@dataclass(frozen=True, kw_only=True)
class SynchronisationOptions(Section):
    """What is wired for it."""

    time: float = option(20.0, "Duration of the measurement", "s", gt=0, le=1e5)
    common_signal: bool = option(
        False, "One source of noise is wired to both inputs of the forces, for their skew"
    )
    camera_clock: bool = option(
        False, "The camera gives times to its images, for the drift of its clock; 3600 s are usual"
    )


class Synchronisation(Calibration[SynchronisationOptions]):
    """Lag, jitter, skew and drift of clocks."""

    name = "timing"
    title = (
        "Lag of the exposures after their triggers, skew of the two force channels, and drift of"
        " the camera's clock."
    )
    files = "SESSION.h5|STAMPS.csv..."
    Options = SynchronisationOptions
    of_files = "common_signal", "camera_clock"

    def plan(self, config: Config, options: SynchronisationOptions) -> tuple[Config, ...]:
        """See `Calibration.plan`."""
        if not (config.forces.exposure_counter or options.common_signal or options.camera_clock):
            raise UserError(
                "calibrate timing: forces.exposure_counter is not set, so that no exposure is seen;"
                " wire the camera's exposure output and set it, or give --common-signal or"
                " --camera-clock"
            )
        return (calibration_run(config, (Hold(time=options.time),)),)

    def gather(self, sources: Sequence[Path], options: SynchronisationOptions) -> Data:
        """See `Calibration.gather`; a table has the columns sample and stamp_s."""
        from app.calibrations.session_readings import opened
        from app.evaluation.setup import sensor_chain
        from app.files.text_tables import NUMBER, TIME

        data: dict[str, Any] = {}
        for first, second in combinations(sources, 2):
            if is_session(first) == is_session(second):
                raise UserError(
                    f"calibrate timing: {first} and {second} were given; give one session, and one"
                    " table of stamps if you like"
                )
        for path in sources:
            if not is_session(path):
                columns = {
                    "stamp_sample": ("sample", NUMBER, "sample"),
                    "stamp_stamp": ("stamp", TIME, "stamp_s"),
                }
                data |= table_of(path, columns, STAMPS)
                continue
            with opened(path) as (reader, config):
                taken = reader.triggers()
                taken = taken[taken["received"]]
                data["rate_hz"] = reader.header.sample_rate_hz
                if options.camera_clock and "stamp_sample" not in data:
                    data |= {f"stamp_{name}": taken[name] for name in ("sample", "stamp")}
                if config.forces.exposure_counter:
                    data["lags"] = taken["sample"] - taken["index"] * config.camera.divisor
                if options.common_signal:
                    newtons = reader.forces().forces[:MOST_SAMPLES]
                    data["volts"] = sensor_chain(config).volts(newtons)
        if "stamp_sample" in data and "rate_hz" not in data:
            raise UserError(
                "calibrate timing: a table of stamps alone does not say the rate of the samples;"
                " give its session beside it"
            )
        return data

    def fit(self, data: Data, options: SynchronisationOptions) -> CalibrationResult:
        """See `Calibration.fit`."""
        import numpy as np

        from analysis import timing

        result, rate = CalibrationResult(), data["rate_hz"]
        if "lags" in data:
            lag = timing.exposure_lag(data["lags"], rate)
            lags = data["lags"] / rate * 1e3
            result.chart("frame", "lag (ms)", (np.arange(len(lags)), lags, "."))
            late = "exposure after its trigger", "", "ms", lag.lag_s, lag.sd_s
            result.add("exposure_lag_s", *late, is_signed=True)
            result.add("exposure_jitter_s", "jitter of the exposures", "", "ms", lag.jitter_s)
            count = f"{len(data['lags'])} exposures, {lag.odd} of them odd"
            result.remark(f"{count}, within {lag.range_s * 1e3:.3g} ms")
        if "volts" in data:
            first, second = data["volts"].T
            skew = timing.channel_skew(first, second, rate)
            both = [(np.arange(200), one[:200]) for one in (first, second)]
            result.chart("sample", "both channels (V)", *both)
            late = "shear channel after the normal one", "", "ms", skew.skew_s, skew.sd_s
            result.add("channel_skew_s", *late, is_signed=True)
        if "stamp_sample" in data:
            board, camera = data["stamp_sample"], data["stamp_stamp"]
            clock = timing.clock_drift(board, camera, rate)
            board = (board - board[0]) / rate
            ahead = (camera - camera[0] - board) * 1e3
            result.chart("time (s)", "camera's clock ahead (ms)", (board, ahead, "."))
            result.add(
                "clock_drift",
                "camera's clock over the board's, less 1",
                "",
                "",
                clock.drift,
                clock.sd,
                is_signed=True,
            )
            result.remark(
                f"the camera's clock was up to {clock.furthest_s * 1e3:.3g} ms from a steady drift,"
                f" which changed by {clock.wander * 1e6:.2g} ppm (rms)"
            )
        if not result.values:
            raise ValueError(
                "timing: the sessions count no exposures, have no common signal, and no table of"
                " stamps was given; set forces.exposure_counter, or give --common-signal or"
                " --camera-clock"
            )
        return result
