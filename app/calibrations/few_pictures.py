"""The camera of a run that needs none of its pictures, and may last long."""

from __future__ import annotations

from dataclasses import replace

from app.settings.sections import Config
from drivers.settings import CameraSettings

EVERY_S = 5.0


def few_pictures(config: Config) -> CameraSettings:
    """The camera of the settings, with a picture now and then only."""
    seldom = round(EVERY_S * config.forces.sample_rate)
    return replace(config.camera, divisor=max(config.camera.divisor, seldom))
