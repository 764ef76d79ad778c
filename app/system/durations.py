"""Times in words."""

from __future__ import annotations


def duration(seconds: float) -> str:
    """A time in words, ``12 min``."""
    if seconds < 100:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"
