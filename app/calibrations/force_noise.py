"""Noise of the force sensors, the wander of their zeros, and the hum by name, of a free block."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from analysis.options import Section, option
from app.calibrations.calibration import Calibration, CalibrationResult, Data, calibration_run
from app.settings.protocol_steps import Hold
from app.settings.sections import Config

if TYPE_CHECKING:
    from matplotlib.figure import Figure

RESOLUTION_N = 1e-3  # of the paper, section 2.1
SENSORS = ("P", "Q")
ZEROED = "uncertainty.zero holds for runs that begin with zeroed sensors, no longer than run_time"


@dataclass(frozen=True, kw_only=True)
class NoiseOptions(Section):
    """How long the block is watched, and how long runs are."""

    time: float = option(240.0, "Reading time of the sensors", "s", ge=10, le=3600)
    run_time: float = option(
        60.0, "Duration of a run over which the zero may drift", "s", gt=0, le=3600
    )


class ForceNoiseCalibration(Calibration[NoiseOptions]):
    """Noise of the sensors without a force."""

    name = "force-noise"
    title = (
        "Noise of the force sensors with a free block, drift of their zeros, and hum by frequency."
    )
    valid_days = 90
    Options = NoiseOptions

    def plan(self, config: Config, options: NoiseOptions) -> tuple[Config, ...]:
        """One run in which nothing moves and nobody presses."""
        return (calibration_run(config, [Hold(time=options.time)], is_of_forces=True),)

    def gather(self, sources: Sequence[Path], options: NoiseOptions) -> Data:
        """Forces while the block is free, of one session."""
        import numpy as np

        from app.calibrations.stretches import free_forces

        if len(sources) != 1:
            raise ValueError(
                f"{len(sources)} sessions found; give one, with a long time of a free block"
            )
        forces, rate = free_forces(sources[0])
        return {"forces": forces.astype(np.float32), "rate": rate}

    def fit(self, data: Data, options: NoiseOptions) -> CalibrationResult:
        """Noise of either sensor."""
        from analysis.calibration.sensor_noise import sensor_noise
        from app.records.quantities import Measurement

        rate = data["rate"]
        values, remarks, wander = [], [], []
        for i, symbol in enumerate(SENSORS):
            try:
                found = sensor_noise(data["forces"][:, i].astype(float), rate)
            except ValueError as error:
                raise ValueError(f"{symbol}: {error}") from None
            wander.append(found.wander(options.run_time))
            values += [
                Measurement(f"noise of {symbol}", "", found.sd, found.sd_sd, "mN"),
                Measurement(f"white noise of {symbol}", "", found.white, found.white_sd, "mN"),
                Measurement(
                    f"drift of the zero of {symbol} in {options.run_time:g} s", "",
                    found.drift * options.run_time, found.drift_sd * options.run_time, "mN",
                    is_signed=True,
                ),
                *(
                    Measurement(f"{symbol}, {line.name}, rms", "", line.rms, line.rms_sd, "mN")
                    for line in found.lines
                ),
            ]  # fmt: skip
            samples = max(0.0, (found.white - 2 * found.white_sd) / RESOLUTION_N) ** 2
            remarks.append(
                f"{symbol}: a single sample resolves 1 mN"
                if samples <= 1
                else f"{symbol}: the mean of {samples / rate * 1e3:.2g} ms resolves 1 mN, a single"
                f" sample {1e3 * found.white:.2g} mN"
            )
            remarks.append(
                f"{symbol}: {', '.join(f'{o.name} ({o.hz:.2f} Hz)' for o in found.lines)}"
                if found.lines
                else f"{symbol}: no hum and no other line above the noise"
            )
        settings = {}
        if math.isfinite(sum(wander)):
            settings["uncertainty.zero"] = 1e3 * max(wander)
            remarks.append(ZEROED)
        else:
            remarks.append(
                f"the record of {len(data['forces']) / rate:.0f} s does not tell how the zeros"
                f" wander in {options.run_time:g} s; read them for {4 * options.run_time:g} s"
            )
        return CalibrationResult(tuple(values), settings, tuple(remarks))

    def draw(self, figure: Figure, data: Data, findings: CalibrationResult) -> None:
        """Spectral density and Allan deviation."""
        from analysis.calibration.sensor_noise import sensor_noise

        left, right = figure.subplots(1, 2)
        for i, symbol in enumerate(SENSORS):
            found = sensor_noise(data["forces"][:, i].astype(float), data["rate"])
            left.loglog(found.hz[1:-1], 1e3 * found.density[1:-1] ** 0.5, lw=0.8, label=symbol)
            for line in found.lines:
                left.axvline(line.hz, lw=0.5, ls=":", color=f"C{i}")
            right.errorbar(
                found.tau, 1e3 * found.allan, 1e3 * found.allan_sd, fmt=".-", ms=3, lw=0.8
            )
        left.set_xlabel("frequency (Hz)")
        left.set_ylabel("spectral density (mN/sqrt(Hz))")
        left.legend()
        right.set_xscale("log")
        right.set_yscale("log")
        right.set_xlabel("averaging time (s)")
        right.set_ylabel("Allan deviation (mN)")
