"""On a computer without any vendor's package the program starts, runs the simulated bench, and says
what is missing.
"""

import json
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
VENDORS = ("nidaqmx", "grpc", "pypylon", "harvesters", "genicam", "serial")
BLOCK = f"""
import sys
for name in {VENDORS!r}:
    sys.modules[name] = None
"""

SOURCES = {
    "forces.source=nidaqmx": "nidaqmx>=1.0",
    "forces.source=nidaqmx-emulated": "nidaqmx>=1.0",
    "camera.source=pylon": "pypylon>=26",
    "camera.source=pylon-emulated": "pypylon>=26",
    "actuator.source=smc100": "pyserial>=3.5",
    "actuator.source=conex-cc-emulated": "pyserial>=3.5",
}
CHECK_EACH = """
import contextlib, io, json
from app.cli import main
ends = {}
for setting in json.loads(sys.argv[1]):
    sys.argv = ["slipscope", "check", "--set", setting, "--set", "actuator.port=/dev/nothing"]
    with contextlib.redirect_stdout(io.StringIO()) as output:
        try:
            main()
        except SystemExit as end:
            ends[setting] = end.code, output.getvalue()
print(json.dumps(ends))
"""


def run(code, *arguments):
    return subprocess.run(
        [sys.executable, "-c", BLOCK + code, *arguments],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=400,
        encoding="utf-8",
    )


def slipscope(*arguments):
    return run("from app.cli import main\nmain()", *arguments)


def test_no_driver_module_loads_a_vendor_library():
    names = [f"drivers.{path.stem}" for path in (ROOT / "drivers").glob("*.py")]
    code = f"import {', '.join(names)}, sys\nprint(sorted(set({VENDORS!r}) & sys.modules.keys()))"
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
        timeout=400,
    )
    assert done.stdout.strip() == "[]"


def test_doctor_says_what_is_missing():
    done = slipscope("doctor")
    assert done.returncode == 0, done.stderr
    for what in ("nidaqmx[grpc]>=1.0", "pypylon>=26", "harvesters>=1.4.3"):
        assert f'pip install "{what}"' in " ".join(done.stdout.split())
    assert "Traceback" not in done.stderr


def test_the_simulated_bench_works():
    done = slipscope("check", "--set", "camera.width=480", "--set", "camera.height=360")
    assert done.returncode == 0, done.stdout + done.stderr
    assert "the bench works" in done.stdout


@pytest.fixture(scope="module")
def checked():
    """Exit code and words of `slipscope check` with each source, and what was on standard error."""
    done = run(CHECK_EACH, json.dumps(list(SOURCES)))
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), done.stderr


@pytest.mark.parametrize(("setting", "package"), SOURCES.items())
def test_a_driver_without_its_package_says_how_to_get_it(checked, setting, package):
    ends, errors = checked
    code, words = ends[setting]
    assert code == 1, words
    assert f'pip install "{package}"' in words
    assert "Traceback" not in errors
