"""A factory for windows whose runs are scripted."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from app.settings.sections import Config
from app.system.stopping import StopAnswer


class Makes:
    """Makes every run and replay by one function; all else that a factory can is not asked."""

    def __init__(self, make: Callable[[], Any]) -> None:
        self._make = make

    def run(self, config: Config, session: Path | None) -> Any:
        return self._make()

    def replay(self, session: Path) -> Any:
        return self._make()

    def preview(self, config: Config) -> Any:
        raise OSError("scripted bench: it cannot be connected without a run")

    def runs_under_way(self) -> list[tuple[str, str]]:
        return []

    def attach(self, name: str) -> Any:
        raise OSError(f"{name}: no such run")

    def stop_others(self, own: Any) -> StopAnswer | None:
        return None
