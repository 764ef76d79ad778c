"""What the documentation of a bench says is what there is: faults, sources, settings."""

import os
import re
import subprocess
import sys
import textwrap
import tomllib
from pathlib import Path

import pytest

from analysis.options import options
from app.settings import config
from app.settings.sections import Config
from drivers.sim.faults import FAULTS
from drivers.sources import DRIVERS

ROOT = Path(__file__).parents[2]
TEXT = (ROOT / "docs" / "bench.md").read_text(encoding="utf-8")


def test_every_fault_is_explained_and_no_other():
    section = TEXT.split("## What goes wrong")[1].split("\n## ")[0]
    assert set(re.findall(r"^\| `([\w-]+) ", section, re.MULTILINE)) == set(FAULTS)


@pytest.mark.parametrize("kind", DRIVERS)
def test_every_source_is_named(kind):
    assert all(f"`{name}`" in TEXT for name in DRIVERS[kind])


def test_every_setting_that_is_named_exists():
    for table, key in re.findall(r"`(forces|camera|actuator|replay|sim|run)\.(\w+)", TEXT):
        assert key in options(config.tables()[table]), f"{table}.{key}"


@pytest.mark.parametrize("name", config.bench_names())
def test_a_bench_that_comes_with_the_program_is_well_formed(name):
    settings = config.load(Path(name))
    assert settings != Config()
    text = (config.BENCHES / f"{name}.toml").read_text(encoding="utf-8")
    assert config.from_data(tomllib.loads(text), name) == settings


@pytest.mark.slow
def test_the_examples_of_tests_with_a_bench_run(tmp_path):
    plugin, tests = re.findall(r"^```python\n(.*?)```", TEXT, re.DOTALL | re.MULTILINE)
    (tmp_path / "conftest.py").write_text(plugin)
    (tmp_path / "test_bench.py").write_text(tests)
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "pytest",
            "-q",
            "-p",
            "no:cacheprovider",
            "-p",
            "no:pytest-qt",
            "--rootdir",
            ".",
        ],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT), "PYTEST_ADDOPTS": ""},
        capture_output=True,
        text=True,
        check=False,
        timeout=500,
    )
    assert done.returncode == 0, done.stdout
    assert "2 passed" in done.stdout


def test_the_example_of_options_declares_them():
    (example,) = re.findall(r"^  ```python\n(.*?)```", TEXT, re.DOTALL | re.MULTILINE)
    names = {}
    exec(textwrap.dedent(example), names)
    kind = names["Stage"].Options
    assert kind().pitch == pytest.approx(0.0005)
    assert options(kind)["pitch"].unit == "mm"
