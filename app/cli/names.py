"""What the command line says about names, pace and figures, read and checked."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Any

from analysis.options import number_in
from app.system.errors import UserError

JsonData = dict[str, Any]  # its keys name SI units; `terminal.print_json` prints it
WIDTHS_MM = 60, 400  # of a figure


def check_known(option: str, value: str, known: Collection[str]) -> None:
    """Refuse what an option was given if it is none of these; UserError."""
    if value not in known:
        raise UserError(f"{option} {value}: not known; use {', '.join(known)}")


def parse_pace(text: str) -> float | None:
    """Simulated seconds per second; None for "max".

    Raises
    ------
    UserError
        Neither "max" nor a positive number.
    """
    if text == "max":
        return None
    try:
        pace = number_in(text)
    except ValueError:
        pace = math.nan
    if not (math.isfinite(pace) and pace > 0):
        raise UserError(
            f"--pace: '{text}' is not a pace; give 1 (real time), max (as fast as the machine), or"
            " another number more than 0"
        )
    return pace
