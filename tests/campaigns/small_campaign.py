"""Campaigns of runs that take a second each."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from command_line import call
from short_run import BLIND, SHORT, without_pictures
from typer.testing import Result

FEW_IMAGES = "camera.divisor=250"
TINY = dict(
    setting.split("=", 1)
    for setting in (*SHORT, *BLIND, "run.travel=8", "dic.threads=1", FEW_IMAGES)
)
Write = Callable[..., Path]
Command = Callable[..., Result]
TWO_LOADS = ("vary.run.normal_force = [0.03, 0.04]", 'sessions = "{name}-{load}N"')
SESSIONS = ["tiny-0.03N.h5", "tiny-0.04N.h5"]


def text_of(*lines: str) -> str:
    """A campaign of tiny runs, with further lines."""
    settings = "\n".join(f"settings.{name} = {_value(text)}" for name, text in TINY.items())
    return "\n".join(('name = "tiny"', settings, *lines)) + "\n"


def _value(text: str) -> str:
    """A value of an override as one of TOML."""
    return text if text[0].isdigit() else f"'{text}'"


def called(*arguments: object, answers: str = "") -> Result:
    """`slipscope campaign`, as fast as possible and without a window."""
    return call("campaign", *arguments, "--headless", "--pace", "max", input=answers)


def work_in(folder: Path, patch: pytest.MonkeyPatch) -> None:
    """Work in that folder, without the pictures."""
    patch.chdir(folder)
    without_pictures(patch)


def copied(done: Path, folder: Path) -> Path:
    """The file of a campaign, in a folder with a copy of all that it has made."""
    shutil.copytree(done, folder, dirs_exist_ok=True)
    return folder / "campaign.toml"


def mark(path: Path) -> tuple[int, int, int]:
    """What tells a file from any other, and from itself once somebody has written to it."""
    about = path.stat()
    return about.st_ino, about.st_size, about.st_mtime_ns


def sessions_in(folder: Path) -> list[str]:
    """The sessions of a folder, by name."""
    return sorted(path.name for path in folder.glob("*.h5"))
