"""Campaigns of runs that take a second each."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from short_run import SHORT
from typer.testing import Result

# no traction, of which a summary takes longer than the run itself
TINY = dict(
    setting.split("=", 1)
    for setting in (*SHORT, "stress.method='none'", "run.travel=8", "dic.threads=1")
)
Write = Callable[..., Path]
Command = Callable[..., Result]


def text_of(*lines: str) -> str:
    """A campaign of tiny runs, with further lines."""
    settings = "\n".join(f"settings.{name} = {value}" for name, value in TINY.items())
    return "\n".join(('name = "tiny"', settings, *lines)) + "\n"
