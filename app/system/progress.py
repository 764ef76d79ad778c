"""How long work tells how far it has come."""

from __future__ import annotations

from collections.abc import Callable

ShareDone = Callable[[float], None]  # of all, 0 to 1
HowFar = Callable[[str, float], None]  # what is done now, and the share of all


def unheard(*_: object) -> None:
    """Nobody is told."""
