"""`slipscope` as a user calls it, and one short recorded experiment to call it on."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from command_line import call, given
from made_once import made_once
from short_run import SHORT
from typer.testing import Result

Command = Callable[..., Result]


@pytest.fixture
def slipscope(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Command:
    """The command, in an empty folder and without a display."""
    monkeypatch.chdir(tmp_path)
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM"):
        monkeypatch.delenv(name, raising=False)
    return call


@pytest.fixture(scope="session")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Result]:
    """A short experiment on the simulated bench: its session, with the picture beside it, and what
    the command said (as JSON).
    """

    def make(folder: Path) -> tuple[Path, Result]:
        path = folder / "short.h5"
        result = call(*("run", "--headless", "--pace", "max", "-o", path, "--json", *given(*SHORT)))
        assert result.exit_code == 0, result.output
        result.exc_info = None  # which cannot be pickled
        return path, result

    return made_once(tmp_path_factory, "recorded", make)


@pytest.fixture
def session(recorded: tuple[Path, Result], tmp_path: Path) -> Path:
    """A copy of the recorded session, free to be spoiled."""
    copy = tmp_path / "session.h5"
    shutil.copyfile(recorded[0], copy)
    os.utime(copy, ns=(10**18, 10**18))
    return copy
