"""All calibrations, by name."""

from __future__ import annotations

from typing import Any

from app.calibrations.actuator import ActuatorCalibration
from app.calibrations.calibration import Calibration
from app.calibrations.camera_noise import CameraCalibration
from app.calibrations.correlation_noise import CorrelationNoise
from app.calibrations.coupling import CouplingCalibration
from app.calibrations.force_noise import ForceNoiseCalibration
from app.calibrations.lens_holder import LensHolder
from app.calibrations.pattern_map import PatternCalibration
from app.calibrations.pixel_scale import ScaleCalibration
from app.calibrations.radius_over_loads import RadiusCalibration
from app.calibrations.sample_adhesion import AdhesionCalibration
from app.calibrations.sample_roughness import RoughnessCalibration
from app.calibrations.synchronisation import Synchronisation
from app.calibrations.weights import ForceCalibration

_ALL: tuple[Calibration[Any], ...] = (
    ForceCalibration(),
    CouplingCalibration(),
    ForceNoiseCalibration(),
    ActuatorCalibration(),
    CorrelationNoise(),
    LensHolder(),
    ScaleCalibration(),
    PatternCalibration(),
    CameraCalibration(),
    Synchronisation(),
    AdhesionCalibration(),
    RoughnessCalibration(),
    RadiusCalibration(),
)
KINDS: dict[str, Calibration[Any]] = {one.name: one for one in _ALL}
