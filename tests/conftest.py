"""What holds for every test: one thread of linear algebra, examples that are not judged by their
speed, and which tests share a process.
"""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
from typing import TYPE_CHECKING

# as the command does, and before numpy is loaded: two processes of two threads each would only
# wait for one another
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# nothing is kept in the home of whoever runs the tests
os.environ["SLIPSCOPE_HOME"] = tempfile.mkdtemp(prefix="slipscope-home-")

import pytest
from hypothesis import settings

if TYPE_CHECKING:
    from xdist.scheduler import LoadScopeScheduling
    from xdist.workermanage import Producer

atexit.register(shutil.rmtree, os.environ["SLIPSCOPE_HOME"], ignore_errors=True)
settings.register_profile("slipscope", deadline=None)
settings.load_profile("slipscope")

# In this order units of work are given to the processes. First the tests that compile the kernels,
# together, while another process does those that need none; last those of seconds.
KERNELS = ("dic", "sim")
FOLDERS = (
    *KERNELS,
    "mechanics",
    "inversion",
    "friction",
    "drivers",
    "engine",
    "processes",
    "cli",
    "campaigns",
    "gui",
    "report",
    "session",
    "extremes",
    "contact",
    "calibration",
)
# in real time: beside one another they would take each other's processor
WALL_CLOCK = ("test_hil_bench.py", "test_hil_faults.py", "test_blocked_window.py", "test_repair.py")


def unit_of(path: str) -> str:
    """What runs in one process, one after the other, with a test of this file."""
    *_, folder, name = path.split("/")
    return "wall clock" if name in WALL_CLOCK else "kernels" if folder in KERNELS else path


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Order the tests as they are to be given to the processes."""

    def place(item: pytest.Item) -> int:
        folder = item.path.parent.name
        return FOLDERS.index(folder) if folder in FOLDERS else len(FOLDERS)

    items.sort(key=place)


@pytest.hookimpl(optionalhook=True)  # not there without pytest-xdist
def pytest_xdist_make_scheduler(config: pytest.Config, log: Producer) -> LoadScopeScheduling | None:
    """Tests go to the processes by unit."""
    if config.getvalue("dist") != "loadscope":
        return None
    from xdist.scheduler import LoadScopeScheduling

    class ByUnit(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            return unit_of(nodeid.partition("::")[0])

    return ByUnit(config, log)
