"""`slipscope calibrate timing`: the exposure after its trigger, the second channel after the first,
and the camera's clock beside the board's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
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
from app.settings.config import settings_of
from app.settings.protocol_steps import Hold
from app.system.errors import UserError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from app.settings.sections import Config

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
        from app.evaluation.setup import sensor_chain
        from app.files.text_tables import NUMBER, TIME, read_table
        from app.session.reader import SessionReader

        data: dict[str, Any] = {}
        for path in sources:
            if not is_session(path):
                table = read_table(path, {"sample": NUMBER, "stamp": TIME})
                if not table.has("sample", "stamp"):
                    raise UserError(
                        f"{path}: the header has no sample or stamp_s; give the samples of the"
                        " triggers and the times that the camera gave to their frames"
                    )
                data |= {f"stamp_{name}": table.numbers[name] for name in ("sample", "stamp")}
                continue
            with SessionReader(path) as reader:
                config, taken = settings_of(reader), reader.triggers()
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
        from analysis import timing
        from app.records.quantities import Measurement

        found, remarks = [], []
        if "lags" in data:
            lag = timing.exposure_lag(data["lags"], data["rate_hz"])
            found += [
                Measurement("exposure after its trigger", "", lag.lag_s, lag.sd_s, "ms",
                            is_signed=True, key="exposure_lag_s"),
                Measurement("jitter of the exposures", "", lag.jitter_s, unit="ms",
                            key="exposure_jitter_s"),
            ]  # fmt: skip
            count = f"{len(data['lags'])} exposures, {lag.odd} of them odd"
            remarks.append(f"{count}, within {lag.range_s * 1e3:.3g} ms")
        if "volts" in data:
            first, second = data["volts"].T
            skew = timing.channel_skew(first, second, data["rate_hz"])
            found.append(
                Measurement("shear channel after the normal one", "", skew.skew_s, skew.sd_s, "ms",
                            is_signed=True, key="channel_skew_s")
            )  # fmt: skip
        if "stamp_sample" in data:
            clock = timing.clock_drift(data["stamp_sample"], data["stamp_stamp"], data["rate_hz"])
            found.append(
                Measurement("camera's clock over the board's, less 1", "", clock.drift, clock.sd,
                            is_signed=True, key="clock_drift")
            )  # fmt: skip
            remarks.append(
                f"the camera's clock was up to {clock.furthest_s * 1e3:.3g} ms from a steady drift"
            )
        if not found:
            raise ValueError(
                "timing: the sessions count no exposures, have no common signal, and no table of"
                " stamps was given; set forces.exposure_counter, or give --common-signal or"
                " --camera-clock"
            )
        return CalibrationResult(tuple(found), {}, tuple(remarks))

    def draw(self, figure: Figure, data: Data, findings: CalibrationResult) -> None:
        """See `Calibration.draw`."""
        import numpy as np

        shown = [name for name in ("lags", "volts", "stamp_sample") if name in data]
        rate = data["rate_hz"]
        for axes, name in zip(np.atleast_1d(figure.subplots(len(shown), 1)), shown, strict=True):
            if name == "lags":
                axes.plot(data["lags"] / rate * 1e3, ".")
                axes.set(xlabel="frame", ylabel="lag (ms)")
            elif name == "volts":
                axes.plot(data["volts"][:200])
                axes.set(xlabel="sample", ylabel="both channels (V)")
            else:
                board = (data["stamp_sample"] - data["stamp_sample"][0]) / rate
                ahead = data["stamp_stamp"] - data["stamp_stamp"][0] - board
                axes.plot(board, ahead * 1e3, ".")
                axes.set(xlabel="time (s)", ylabel="camera's clock ahead (ms)")
