"""What the documentation of a bench says is what there is: faults, sources, settings."""

import re
import tomllib
from pathlib import Path

import pytest

from analysis.options import options
from app.settings import config
from app.settings.sections import Config
from drivers.sim.faults import FAULTS
from drivers.sources import DRIVERS

TEXT = (Path(__file__).parents[2] / "docs" / "bench.md").read_text(encoding="utf-8")


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


def test_the_example_of_a_test_on_the_emulated_bench_runs(tmp_path):
    blocks = re.findall(r"```python\n(.*?)```", TEXT, re.DOTALL)
    (code,) = [block for block in blocks if "def test_" in block]
    names = {}
    exec(compile(code, "docs/bench.md", "exec"), names)
    names["test_a_noisy_line_ends_nothing"](tmp_path)
