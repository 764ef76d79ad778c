"""The legs of a drive that turns back."""

from __future__ import annotations

from collections.abc import Sequence

from analysis.friction.cycles import branches
from app.numbers import series_of
from app.records import Snapshot

REVERSED_M = 3e-6  # way back of the stage from which it is a reversal


def legs_of(drive: Sequence[Snapshot]) -> list[slice]:
    """The parts of a drive between its reversals, each with the frame at which it turned."""
    return branches(series_of(drive, "travel_m"), least=REVERSED_M) if drive else []


def first_loading(drive: Sequence[Snapshot]) -> list[Snapshot]:
    """The frames of a drive up to its first reversal."""
    legs = legs_of(drive)
    return list(drive[legs[0]] if len(legs) > 1 else drive)
