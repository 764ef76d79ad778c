"""A calibration that is as short as one can be."""

import numpy as np

from analysis.options import Section
from app.calibrations.calibration import Calibration, CalibrationResult, calibration_run
from app.records.quantities import Measurement
from app.settings.protocol_steps import Drive, Hold, Reference
from slipscope import Session


class Speed(Calibration[Section]):
    """The velocity of the stage of a free block, by its own readings."""

    name = "speed"
    title = "velocity of the stage"

    def plan(self, config, options):
        steps = [Reference(time=0.5), Drive(travel=10e-6, velocity=5e-6), Hold(time=0.3)]
        return (calibration_run(config, steps),)

    def gather(self, sources, options):
        with Session(sources[0]) as session:
            time_s, position_m = session.stage
            return {"time_s": time_s, "position_m": position_m}

    def fit(self, data, options):
        moves = np.ptp(data["position_m"]) > 0
        if not moves:
            raise ValueError("speed: the stage was to move, it stood still; let it move")
        way = np.abs(np.gradient(data["position_m"], data["time_s"]))
        speed = np.median(way[way > 0])
        found = Measurement("velocity", "v", speed, 0.01 * speed, "um/s", key="velocity_m_s")
        return CalibrationResult((found,), {"camera.pixel": speed * 1e6}, ("a remark",))

    def draw(self, figure, data, findings):
        axes = figure.subplots()
        axes.plot(data["time_s"], data["position_m"] * 1e6)
        axes.set_xlabel("time (s)")
        axes.set_ylabel("position (um)")
