"""The time of day, as files state it."""

from __future__ import annotations

from datetime import UTC, datetime


def now() -> str:
    """Time of day, ISO 8601."""
    return datetime.now(UTC).astimezone().isoformat(timespec="seconds")
