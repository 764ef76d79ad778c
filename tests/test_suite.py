"""A test that ends its process, or never comes back, fails by its name, and the others go on."""

import json
import os
import re
import shlex
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
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
