"""`analysis` as a library: typed, exported by name."""

from __future__ import annotations

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
SCRIPT = """
import numpy as np
from analysis.dic import Correlation, open_tracker

tracker = open_tracker(Correlation(box=20), np.zeros((40, 40), np.uint8))
reveal_type(tracker.track(np.zeros((40, 40), np.uint8)).ux_px.dtype)
"""


@pytest.mark.parametrize("package", ["analysis", "app", "drivers"])
def test_the_types_are_shipped(package: str) -> None:
    setup = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]
    assert any(
        path.name == "py.typed"
        for pattern in setup["setuptools"]["package-data"]["*"]
        for path in (ROOT / package).glob(pattern)
    )


def checked_by_mypy(script: Path, *options: str) -> str:
    """What mypy says of a script of somebody who has the library."""
    done = subprocess.run(
        [
            *(sys.executable, "-m", "mypy", "--strict", "--follow-imports=silent", *options),
            *("--config-file=", f"--cache-dir={script.parent / 'cache'}", script.name),
        ],
        cwd=script.parent,
        env={"MYPYPATH": str(ROOT), "PATH": "", "SYSTEMROOT": r"C:\Windows"},
        capture_output=True,
        text=True,
        check=False,
        timeout=400,
    )
    return done.stdout + done.stderr


def test_a_script_that_imports_the_library_is_checked(tmp_path: Path) -> None:
    script = tmp_path / "experiment.py"
    script.write_text(SCRIPT)
    said = checked_by_mypy(script)
    assert "numpy.float32" in said or "floating[numpy._typing._nbit_base._32Bit]" in said, said
    assert "Success" in said, said
    script.write_text(SCRIPT + "tracker.track('a name')\n")
    assert 'incompatible type "str"' in checked_by_mypy(script)
