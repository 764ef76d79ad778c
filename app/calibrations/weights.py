"""Stiffness and sensitivity of the two cantilevers and their cross-talk, from known weights, known
displacements, or both.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from analysis.options import Section, option
from app.calibrations.calibration import Calibration, CalibrationResult, Data, calibration_run
from app.settings.hung_weights import AXES, asking_for, growing_newtons
from app.settings.protocol_steps import Ask, Hold
from app.settings.sections import Config
from app.system.errors import UserError
from drivers.sources import driver

SIMULATED_S = 2.0  # in which a simulated operator hangs a weight, without an answer


@dataclass(frozen=True, kw_only=True)
class WeightOptions(Section):
    """How the sensors are loaded."""

    normal: str = option(
        "0.25 0.5 0.75 1", "Weights on the normal sensor in N, in increasing order; '': none"
    )
    shear: str = option(
        "0.25 0.5 0.75 1", "Weights on the shear sensor in N, in increasing order; '': none"
    )
    cycles: int = option(3, "Number of times the weights are added and removed again", ge=1, le=10)
    hold: float = option(3.0, "Reading time of each weight", "s", ge=0.5, le=60)
    load_uncertainty: float = option(
        0.1, "Standard uncertainty that all weights share", "%", ge=0, le=10
    )
    displacement_uncertainty: float = option(
        0.1, "Standard uncertainty that all displacements share", "%", ge=0, le=10
    )
    sensitivity_normal: float = option(
        0.0, "Sensitivity of the normal sensor; 0: measured, or that of the session", "um/V", ge=0
    )
    sensitivity_shear: float = option(
        0.0, "Sensitivity of the shear sensor; 0: measured, or that of the session", "um/V", ge=0
    )

    def weights(self, axis: str) -> list[float]:
        """Newtons, without the 0 at the beginning."""
        less = math.nextafter(1000.0, 0.0)
        return growing_newtons(axis, getattr(self, axis), "weights", most=less)


class ForceCalibration(Calibration[WeightOptions]):
    """Volts to newtons."""

    name = "forces"
    title = "Stiffness and sensitivity of both cantilevers, and their cross-talk, by known weights."
    files = "SESSION.h5...|TABLE.csv..."
    valid_days = 365
    Options = WeightOptions

    def plan(self, config: Config, options: WeightOptions) -> tuple[Config, ...]:
        """One run: each weight is asked for, then read."""
        is_simulated = driver("forces", config.forces.source).nature in ("simulated", "emulated")
        steps: list[Ask | Hold] = []
        for axis in AXES:
            weights = options.weights(axis)
            most = config.limits.normal_force if axis == "normal" else config.limits.shear_force
            if weights and weights[-1] >= most:
                raise UserError(
                    f"calibrate forces: a weight of {weights[-1]:g} N is not below"
                    f" limits.{axis}_force = {most:g} N; leave it out, or raise the limit"
                )
            up_and_down = [*weights, *weights[-2::-1], 0.0] if weights else []
            for newtons in [0.0] * bool(weights) + up_and_down * options.cycles:
                asked = asking_for(newtons, axis)
                if is_simulated:
                    asked = replace(asked, timeout=SIMULATED_S, unanswered="go on")
                steps += [asked, Hold(time=options.hold)]
        if not steps:
            raise UserError("calibrate forces: no weight is given; give --normal or --shear")
        return (calibration_run(config, steps, is_of_forces=True),)

    def gather(self, sources: Sequence[Path], options: WeightOptions) -> Data:
        """Mean readings at each weight or displacement."""
        from app.calibrations.loaded_readings import loaded_readings

        return loaded_readings(sources)

    def fit(self, data: Data, options: WeightOptions) -> CalibrationResult:
        """Newtons per volt by weights, metres per volt by displacements, stiffness by both."""
        from app.calibrations.force_fit import force_result

        return force_result(data, options)
