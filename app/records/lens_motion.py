"""The motion of the lens in the picture, which displacement fields still contain."""

from __future__ import annotations

import math

from analysis.contact.orientation import ALONG_X, Direction
from app.records.record_types import FrameMotion


def drive_of(motion: FrameMotion) -> Direction:
    """Where the drive goes in the picture of a frame; along its rows where no record says so."""
    angle = motion.drive_angle_rad
    return Direction.at(angle) if math.isfinite(angle) else ALONG_X


def lens_xy_m(motion: FrameMotion) -> tuple[float, float]:
    """How far the lens has moved along x and y of the picture since the reference, metres."""
    drive = drive_of(motion)
    return drive.x * motion.lens_m, drive.y * motion.lens_m
