"""A program of its own in this Python."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
FOLDERS = (ROOT, ROOT / "tests", ROOT / "tests/session")


def python(
    *arguments: object,
    code: int | None = None,
    environment: dict[str, str] | None = None,
    cwd: Path = ROOT,
    timeout: float = 400,
) -> subprocess.CompletedProcess[str]:
    """Python with these arguments until it ends, with that exit code if one is given; it finds
    SlipScope and what tests share.
    """
    found = {"PYTHONPATH": os.pathsep.join(map(str, FOLDERS))}
    done = subprocess.run(
        [sys.executable, *map(str, arguments)],
        cwd=cwd,
        env=os.environ | found | (environment or {}),
        capture_output=True,
        text=True,
        encoding="utf-8",
        check=False,
        timeout=timeout,
    )
    assert code in (None, done.returncode), done.stdout + done.stderr
    return done
