"""Noise of the force sensors, the wander of their zeros, and the hum by name, of a free block."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from analysis.options import Section, option
from app.calibrations.calibration import Calibration, CalibrationResult, Data, calibration_run
from app.settings.protocol_steps import Hold
from app.settings.sections import Config

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

        rate, result = data["rate"], CalibrationResult(columns=2)
        wander, allan = [], []
        spectra: list[tuple[Any, ...]] = []
        for i, symbol in enumerate(SENSORS):
            try:
                found = sensor_noise(data["forces"][:, i].astype(float), rate)
            except ValueError as error:
                raise ValueError(f"{symbol}: {error}") from None
            wander.append(found.wander(options.run_time))
            result.add("", f"noise of {symbol}", "", "mN", found.sd, found.sd_sd)
            result.add("", f"white noise of {symbol}", "", "mN", found.white, found.white_sd)
            result.add(
                "",
                f"drift of the zero of {symbol} in {options.run_time:g} s",
                "",
                "mN",
                found.drift * options.run_time,
                found.drift_sd * options.run_time,
                is_signed=True,
            )
            for line in found.lines:
                result.add("", f"{symbol}, {line.name}, rms", "", "mN", line.rms, line.rms_sd)
            samples = max(0.0, (found.white - 2 * found.white_sd) / RESOLUTION_N) ** 2
            result.remark(
                f"{symbol}: a single sample resolves 1 mN"
                if samples <= 1
                else f"{symbol}: the mean of {samples / rate * 1e3:.2g} ms resolves 1 mN, a single"
                f" sample {1e3 * found.white:.2g} mN",
                f"{symbol}: {', '.join(f'{o.name} ({o.hz:.2f} Hz)' for o in found.lines)}"
                if found.lines
                else f"{symbol}: no hum and no other line above the noise",
            )
            density = 1e3 * found.density[1:-1] ** 0.5
            spectra.append((found.hz[1:-1], density, "-", symbol))
            spectra += [([o.hz] * 2, [density.min(), density.max()], f"C{i}:") for o in found.lines]
            allan.append((found.tau, 1e3 * found.allan, ".-", "", 1e3 * found.allan_sd))
        result.chart("frequency (Hz)", "spectral density (mN/sqrt(Hz))", *spectra, is_log=True)
        result.chart("averaging time (s)", "Allan deviation (mN)", *allan, is_log=True)
        if math.isfinite(sum(wander)):
            result.settings["uncertainty.zero"] = 1e3 * max(wander)
            result.remark(ZEROED)
        else:
            result.remark(
                f"the record of {len(data['forces']) / rate:.0f} s is too short for the drift of"
                f" the zeros in {options.run_time:g} s; record {4 * options.run_time:g} s or more"
            )
        return result
