"""What one process of the suite makes and all of them read."""

from __future__ import annotations

import os
import pickle
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

try:
    import fcntl
except ImportError:  # Windows, where each process makes its own
    fcntl = None


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], Any]) -> Any:
    """What `make` returns, pickled, of the first process that asks for this name; the others wait
    for it. `make` is given an empty folder; what it leaves there is to be read only.
    """
    common = factory.getbasetemp()
    if fcntl and "PYTEST_XDIST_WORKER" in os.environ:
        common = common.parent  # of all processes
    folder, made = common / name, common / f"{name}.pickle"
    with (common / f"{name}.lock").open("w") as lock:
        if fcntl:
            fcntl.flock(lock, fcntl.LOCK_EX)
        if not made.exists():
            shutil.rmtree(folder, ignore_errors=True)  # of one that failed
            folder.mkdir()
            made.write_bytes(pickle.dumps(make(folder)))
    return pickle.loads(made.read_bytes())
