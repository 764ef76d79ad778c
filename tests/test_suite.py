"""A test that ends its process, or never comes back, fails by its name, and the others go on."""

import json
import os
import re
import shlex
import subprocess
import sys
import tomllib

import pytest
from python_program import ROOT, python

# the last test of its file, so that nothing is left to do but what another process has begun; a
# lock that no signal interrupts; a thread that the interpreter would wait for
HOSTILE = """
import ctypes, threading, time

LOCK, lock = ctypes.create_string_buffer(128), ctypes.PyDLL(None).pthread_mutex_lock

def test_before(): time.sleep(0.2)
def test_of_no_return(): lock(LOCK), lock(LOCK)
def test_between(): pass
def test_that_leaves_a_thread(): threading.Thread(target=time.sleep, args=(300,)).start()
def test_that_crashes(): ctypes.string_at(0)
"""
QUIET = "import time\ndef test_a(): time.sleep(0.5)\ndef test_b(): time.sleep(0.5)\n"


@pytest.mark.slow
def test_the_suite_survives_a_crash_and_a_hang(tmp_path):
    options = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["pytest"]["ini_options"]
    words = shlex.split(options["addopts"].replace("-n logical", "-n 2"))
    names = "faulthandler_exit_on_timeout", "filterwarnings", "markers"
    kept = {name: options[name] for name in names}
    times = {"timeout": 6, "faulthandler_timeout": 8}
    assert 0 < options["timeout"] < options["faulthandler_timeout"]
    # what TOML and JSON write alike
    given = [f"{name} = {json.dumps(value)}" for name, value in (kept | times).items()]
    (tmp_path / "pyproject.toml").write_text("[tool.pytest.ini_options]\n" + "\n".join(given))
    (tmp_path / "test_a_hostile.py").write_text(HOSTILE)
    (tmp_path / "test_b_quiet.py").write_text(QUIET)
    done = subprocess.run(
        [sys.executable, "-m", "pytest", *words, "-p", "no:cacheprovider", "--color=no"],
        cwd=tmp_path,
        env={k: v for k, v in os.environ.items() if not k.startswith("PYTEST_")},
        capture_output=True,
        text=True,
        timeout=400,
        check=False,
    )
    assert done.returncode == 1, done.stdout + done.stderr
    failed = re.findall(r"^FAILED \S+::(\w+) - worker 'gw\d' crashed", done.stdout, re.MULTILINE)
    assert sorted(failed) == ["test_of_no_return", "test_that_crashes"]
    assert re.fullmatch(r"2 failed, 5 passed in .*s.*", done.stdout.splitlines()[-1].strip("= "))


def test_no_test_of_a_stop_is_left_out_as_slow():
    """Nor one of the supervisor, or of the rules of the architecture: docs/decisions/0009."""
    kinds = ("stop", "supervis", "architecture")
    files = (ROOT / "tests").rglob("test_*.py")
    kept = [path for path in files if any(kind in path.stem for kind in kinds)]
    assert len(kept) > 8
    assert not [path.name for path in kept if "mark.slow" in path.read_text(encoding="utf-8")]


WITHOUT_QT = """
import sys

from app.system import display

display._loads = lambda library: False
sys.modules |= dict.fromkeys(f"PySide6.Qt{part}" for part in ("Core", "Gui", "Widgets"))

import pytest

sys.exit(pytest.main(sys.argv[1:]))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="elsewhere Qt has what it needs")
def test_without_the_libraries_of_qt_the_tests_of_the_window_are_left_out():
    """No file of tests beside theirs imports Qt itself, and the plugin of pytest stays away."""
    tests = ROOT / "tests"
    qt = re.compile(r"^ *(from|import) (PySide6|pyqtgraph|pytestqt)", re.MULTILINE)
    beside = [path for path in tests.rglob("*.py") if "gui" not in path.relative_to(tests).parts]
    assert not [path for path in beside if qt.search(path.read_text(encoding="utf-8"))]
    others = [path for path in tests.iterdir() if path.name not in ("gui", "test_display.py")]
    words = "-k", "no_display_is_named", *(f"--ignore={path}" for path in others)
    done = python("-c", WITHOUT_QT, "-n", "0", "-p", "no:cacheprovider", *words, code=0)
    assert "tests/gui was left out, because Qt does not load: libglib-2.0.so.0" in done.stdout
    assert re.search(r"\n=+ 1 passed, \d+ deselected in ", done.stdout), done.stdout
