"""On a computer without any vendor's package the program starts, runs the simulated bench, and says
what is missing.
"""

import json
from pathlib import Path

import pytest
from python_program import python

ROOT = Path(__file__).parents[2]
VENDORS = ("nidaqmx", "grpc", "pypylon", "harvesters", "genicam", "serial")

SOURCES = {
    "forces.source=nidaqmx": "nidaqmx>=1.0",
    "forces.source=nidaqmx-emulated": "nidaqmx>=1.0",
    "camera.source=pylon": "pypylon>=26",
    "camera.source=pylon-emulated": "pypylon>=26",
    "actuator.source=smc100": "pyserial>=3.5",
    "actuator.source=conex-cc-emulated": "pyserial>=3.5",
}
SMALL = ("--set", "camera.width=480", "--set", "camera.height=360")
COMMANDS = {  # what is tried -> its command
    **{
        one: ("check", "--set", one, "--set", "actuator.port=/dev/nothing", *SMALL)
        for one in SOURCES
    },
    "doctor": ("doctor",),
    "simulated": ("check", *SMALL),
}
MODULES = [f"drivers.{path.stem}" for path in (ROOT / "drivers").glob("*.py")]
RUN_EACH = f"""
import sys
import {", ".join(MODULES)}
loaded = sorted(set({VENDORS!r}) & sys.modules.keys())
for name in {VENDORS!r}:
    sys.modules[name] = None
import contextlib, io, json
from app.cli import main
ends = {{"loaded": loaded}}
for name, words in json.loads(sys.argv[1]).items():
    sys.argv = ["slipscope", *words]
    with contextlib.redirect_stdout(io.StringIO()) as output:
        try:
            code = main()
        except SystemExit as end:
            code = end.code
    ends[name] = code or 0, output.getvalue()
print(json.dumps(ends))
"""


@pytest.fixture(scope="module")
def ended():
    """Exit code and words of each command, and which libraries all drivers load by themselves."""
    done = python("-c", RUN_EACH, json.dumps(COMMANDS))
    assert done.returncode == 0, done.stderr
    assert "Traceback" not in done.stderr
    return json.loads(done.stdout)


def test_no_driver_module_loads_a_vendor_library(ended):
    assert ended["loaded"] == []


def test_doctor_says_what_is_missing(ended):
    code, words = ended["doctor"]
    assert code == 0, words
    for what in ("nidaqmx[grpc]>=1.0", "pypylon>=26", "harvesters>=1.4.3"):
        assert f'pip install "{what}"' in " ".join(words.split())


def test_the_simulated_bench_works(ended):
    code, words = ended["simulated"]
    assert code == 0, words
    assert "the bench works" in words


@pytest.mark.parametrize(("setting", "package"), SOURCES.items())
def test_a_driver_without_its_package_says_how_to_get_it(ended, setting, package):
    code, words = ended[setting]
    assert code == 1, words
    assert f'pip install "{package}"' in words
