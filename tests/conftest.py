"""What holds for every test: one thread of linear algebra, examples that are not judged by their
speed, and the order of the tests.
"""

from __future__ import annotations

import atexit
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

# as the command does, and before numpy is loaded: two processes of two threads each would only
# wait for one another
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# nothing is kept in the home of whoever runs the tests
os.environ["SLIPSCOPE_HOME"] = tempfile.mkdtemp(prefix="slipscope-home-")

import pytest
from hypothesis import settings

atexit.register(shutil.rmtree, os.environ["SLIPSCOPE_HOME"], ignore_errors=True)
settings.register_profile("slipscope", deadline=None)
settings.load_profile("slipscope")

COMPILE = """
from app.evaluation.compiling import compile_analysis
from app.settings.sections import Config

compile_analysis(Config())
"""


def pytest_xdist_auto_num_workers() -> int:
    """Two processes for each processor: about half of the tests' time is spent waiting."""
    return 2 * (os.cpu_count() or 1)


def pytest_sessionstart(session: pytest.Session) -> None:
    """Before the whole suite: compile once what nearly all of it needs, not in each process."""
    config = session.config
    if not (
        config.option.file_or_dir or config.option.collectonly or hasattr(config, "workerinput")
    ):
        subprocess.run([sys.executable, "-c", COMPILE], cwd=config.rootpath, check=False)


# In this order tests are given to the processes, each of which begins with an equal part and, when
# it has done its own, takes over the last of another's. First those that compile the kernels, then
# those in real time, of which two beside one another would take each other's processor. Of two
# processes the second begins with mechanics, which needs few kernels.
FIRST = ("dic", "sim")
WALL_CLOCK = ("test_hil_bench.py", "test_hil_faults.py", "test_blocked_window.py", "test_repair.py")
# no other test runs beside these: they compare with real time
ALONE = (*WALL_CLOCK[:3], "test_real_bench.py")
FOLDERS = (
    "drivers",
    "engine",
    "processes",
    "cli",
    "campaigns",
    "notebooks",
    "mechanics",
    "inversion",
    "friction",
    "gui",
    "study",
    "report",
    "session",
    "extremes",
    "contact",
    "calibration",
)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Let a test of real time wait until no other runs on this computer, and others wait for it."""
    if fcntl is None:
        return (yield)
    place = os.path.join(tempfile.gettempdir(), f"slipscope-tests-{os.getuid()}")
    is_alone = item.path.name in ALONE
    with open(f"{place}.gate", "w") as gate, open(f"{place}.room", "w") as room:
        fcntl.flock(gate, fcntl.LOCK_EX)  # nobody else enters while one waits for the room
        fcntl.flock(room, fcntl.LOCK_EX if is_alone else fcntl.LOCK_SH)
        fcntl.flock(gate, fcntl.LOCK_UN)
        return (yield)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Order the tests as they are to be given to the processes."""

    def place(item: pytest.Item) -> int:
        folder = item.path.parent.name
        if folder in FIRST:
            return FIRST.index(folder) - len(FIRST) - 1
        if item.path.name in WALL_CLOCK:
            return -1
        return FOLDERS.index(folder) if folder in FOLDERS else len(FOLDERS)

    items.sort(key=place)
