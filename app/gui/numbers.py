"""Numbers as the operator reads them: rounded to their uncertainty, with unit and tone."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum

NOT_KNOWN = "–"


class Tone(StrEnum):
    """How a value or a state is coloured."""

    NEUTRAL = "neutral"
    GOOD = "good"
    BUSY = "busy"
    WARN = "warn"
    BAD = "bad"


@dataclass(frozen=True, slots=True)
class Cell:
    """A named value with its unit; `detail` is its uncertainty or range."""

    name: str
    value: str
    unit: str = ""
    detail: str = ""
    tone: Tone = Tone.NEUTRAL


def number(value: float, decimals: int) -> str:
    """`value` with a true minus sign; a dash for NaN."""
    return f"{value:.{decimals}f}".replace("-", "−") if math.isfinite(value) else NOT_KNOWN


def grouped(count: int) -> str:
    """`count` with its thousands set apart."""
    return f"{count:,}".replace(",", "\u202f")


def decimals_for(sd: float, least: int) -> int:
    """Decimals that show two digits of the uncertainty, `least` where there is none."""
    if not math.isfinite(sd) or sd <= 0:
        return least
    return min(6, max(0, 1 - math.floor(math.log10(sd))))


def disk_text(free_bytes: int) -> str:
    """Free space in the largest fitting unit; a dash where nothing is recorded (a negative number)."""
    if free_bytes < 0:
        return NOT_KNOWN
    for size, unit in ((1e12, "TB"), (1e9, "GB")):
        if free_bytes >= size:
            return f"{free_bytes / size:.3g} {unit}"
    return f"{free_bytes / 1e6:.0f} MB"


def measured(name: str, value: float, sd: float, least: int, unit: str = "") -> Cell:
    """`value` rounded to its standard uncertainty `sd`, which becomes the cell's detail; `least`
    decimals where there is none.
    """
    if not math.isfinite(value):
        return Cell(name, NOT_KNOWN)
    decimals = decimals_for(sd, least)
    detail = f"± {number(sd, decimals)}" if math.isfinite(sd) and sd > 0 else ""
    return Cell(name, number(value, decimals), unit, detail)
