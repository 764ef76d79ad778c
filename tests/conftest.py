"""What holds for every test: one thread of linear algebra, examples that are not judged by their
speed, and the order of the tests.
"""

from __future__ import annotations

import atexit
import gc
import os
import shutil
import subprocess
import sys
import tempfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None

# as the command does, and before numpy is loaded: two processes of two threads each would only
# wait for one another
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# nothing is kept in the home of whoever runs the tests
os.environ["SLIPSCOPE_HOME"] = tempfile.mkdtemp(prefix="slipscope-home-")
# each of some hundred processes would compile the whole program where Python is to keep nothing
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

import pytest
from hypothesis import HealthCheck, settings

from app.system.display import missing_libraries

sys.dont_write_bytecode = False  # as there
atexit.register(shutil.rmtree, os.environ["SLIPSCOPE_HOME"], ignore_errors=True)
settings.register_profile("slipscope", deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("slipscope")

FIRST_BY = 15  # niceness: a thread of a test in real time outweighs some thirty others
# where Python keeps the tests that it has compiled: there from the first collection on
KEPT_TESTS = Path(__file__).parent / "session" / "__pycache__"
COMPILE = """
import sys
from functools import partial
from app.evaluation.compiling import compile_analysis
from app.runs.live import prepare
from app.settings.config import load

for config in (load(None, [setting]) for setting in sys.argv[1:]):
    prepare(config, partial(compile_analysis, config), lambda what: None)
"""
# what nearly all tests need, and then, beside one another, what many would compile side by side
COMPILED = (
    ["dic.method=shared"],
    ["dic.preset=accurate"],
    ["dic.method=icgn", "dic.method=direct"],
)


class Room:
    """Where tests run: several at a time in the processes of one checkout, and one in real time.

    That one goes first for the processors, beside the others, where the system allows it (Linux,
    the administrator). Elsewhere it is alone, and keeps the room for the next test if that is one
    of real time, too: the others have stopped already.
    """

    def __init__(self, checkout: str) -> None:
        name = f"slipscope-tests-{os.getuid()}-{zlib.crc32(checkout.encode()):08x}"
        self._gate, self._room, self._first = (
            os.open(os.path.join(tempfile.gettempdir(), f"{name}.{lock}"), os.O_CREAT | os.O_RDWR)
            for lock in ("gate", "room", "first")
        )
        self._is_kept = False
        self._niceness = os.nice(0)

    @contextmanager
    def entered(self, *, is_real_time: bool, is_kept: bool) -> Iterator[None]:
        """Wait until there is room; it is kept afterwards, or others may enter."""
        if is_real_time and self._goes_first():
            fcntl.flock(self._first, fcntl.LOCK_EX)
            try:
                yield
            finally:
                os.setpriority(os.PRIO_PROCESS, 0, self._niceness)
                fcntl.flock(self._first, fcntl.LOCK_UN)
            return
        if not self._is_kept:
            fcntl.flock(self._gate, fcntl.LOCK_EX)  # nobody enters while one waits for the room
            fcntl.flock(self._room, fcntl.LOCK_EX if is_real_time else fcntl.LOCK_SH)
            fcntl.flock(self._gate, fcntl.LOCK_UN)
        self._is_kept = is_kept
        try:
            yield
        finally:
            if not is_kept:
                fcntl.flock(self._room, fcntl.LOCK_UN)

    def _goes_first(self) -> bool:
        """Whether this thread, and what it starts, now goes before all other tests."""
        with suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, 0, self._niceness - FIRST_BY)
        return os.getpriority(os.PRIO_PROCESS, 0) < self._niceness


ROOM = pytest.StashKey[Room]()
# a minimal Linux lacks libraries of Qt: there all but the tests of the window run
NO_QT = missing_libraries("offscreen") if sys.platform.startswith("linux") else ""
pytest_plugins = [] if NO_QT else ["pytestqt.plugin"]
collect_ignore = ["gui"] if NO_QT else []


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Say that the tests of the window were left out."""
    if NO_QT:
        terminalreporter.line(f"tests/gui was left out, because Qt does not load: {NO_QT}")


def pytest_xdist_auto_num_workers() -> int:
    """Two processes for each processor: many tests wait for devices, windows or processes."""
    return 2 * (os.cpu_count() or 1)


def pytest_sessionstart(session: pytest.Session) -> None:
    """Before the whole suite: compile once what much of it needs, not in each process."""
    config = session.config
    if fcntl is not None:
        config.stash[ROOM] = Room(str(config.rootpath))
    if config.option.file_or_dir or config.option.collectonly or hasattr(config, "workerinput"):
        return
    first, *then = ([sys.executable, "-c", COMPILE, *each] for each in COMPILED)
    collect = [sys.executable, "-m", "pytest", "--collect-only", "-qq", "-n", "0"]
    for once in ([first] if KEPT_TESTS.exists() else [first, collect], then):
        begun = [
            subprocess.Popen(each, cwd=config.rootpath, stdout=subprocess.DEVNULL) for each in once
        ]
        for each in begun:
            each.wait()


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[object]:
    """Look for no garbage in what is imported, now or later: there is none."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


# In this order tests are given to the processes, each of which begins with an equal part and, when
# it has done its own, takes over the last of another's. First those that compile the kernels, then
# those in real time, of which two beside one another would take each other's processor. Of two
# processes the second begins with mechanics, which needs few kernels.
FIRST = ("dic", "sim")
# these compare with real time: they go before the others, or no other runs beside them
REAL_TIME = (
    "test_hil_bench.py",
    "test_hil_faults.py",
    "test_real_bench.py",
    "test_documentation.py",
    "test_actuator_newport.py",
)
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


# in these folders runs are concluded without the shares of the inputs, but for the files that look
# at them
PLAIN = ("drivers", "engine", "gui", "labs", "processes")
BUDGETED = ("test_budget.py", "test_pipeline.py", "test_readings.py", "test_sessions_panel.py")


@pytest.fixture(scope="module", autouse=True)
def _no_budget(request: pytest.FixtureRequest) -> Iterator[None]:
    if request.path.parent.name not in PLAIN or request.path.name in BUDGETED:
        yield
        return
    from short_run import without_budget

    with without_budget():
        yield


@pytest.fixture
def short_path() -> Iterator[Path]:
    """A folder for benches of a test: its name leaves room for the address of a process, which may
    have some hundred characters, wherever the folders of the tests are.
    """
    place = next((one for one in ("/dev/shm", "/tmp") if os.access(one, os.W_OK)), None)
    with tempfile.TemporaryDirectory(dir=place, ignore_cleanup_errors=True) as folder:
        yield Path(folder)


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item, nextitem: pytest.Item | None) -> Iterator[None]:
    """Let a test of real time wait until no other runs, and others wait for it."""
    if fcntl is None:
        return (yield)
    room = item.config.stash[ROOM]
    now, later = (bool(one) and one.path.name in REAL_TIME for one in (item, nextitem))
    with room.entered(is_real_time=now, is_kept=now and later):
        return (yield)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Order the tests as they are to be given to the processes."""

    def place(item: pytest.Item) -> int:
        folder = item.path.parent.name
        if folder in FIRST:
            return FIRST.index(folder) - len(FIRST) - 1
        if item.path.name in REAL_TIME:
            return -1
        return FOLDERS.index(folder) if folder in FOLDERS else len(FOLDERS)

    items.sort(key=place)
