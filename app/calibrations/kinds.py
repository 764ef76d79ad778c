"""All calibrations, by name."""

from __future__ import annotations

from typing import Any

from app.calibrations.calibration import Calibration

_ALL: tuple[Calibration[Any], ...] = ()
KINDS: dict[str, Calibration[Any]] = {one.name: one for one in _ALL}
