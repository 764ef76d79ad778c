"""The rules of the house, as tests: who imports whom, what starts fast, how long a file may get,
what must be explained.
"""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest
from importlinter.api import read_configuration
from importlinter.application import use_cases
from importlinter.configuration import configure
from structure import structure

ROOT = Path(__file__).parents[1]
PACKAGES = ("analysis", "drivers", "app", "slipscope")
LONGEST_FILE = 500
HEAVY = {"PySide6", "pyqtgraph", "h5py", "numba", "cv2", "matplotlib", "scipy", "numpy"}


def sources() -> list[Path]:
    return sorted(path for package in PACKAGES for path in (ROOT / package).rglob("*.py"))


def modules_after(statement: str) -> set[str]:
    """Names in ``sys.modules`` of a fresh interpreter that has run `statement`."""
    code = f"{statement}\nimport json, sys\nprint(json.dumps(sorted(sys.modules)))"
    done = subprocess.run(
        [sys.executable, "-c", code],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
        timeout=400,
    )
    assert done.returncode == 0, done.stderr
    return set(json.loads(done.stdout.splitlines()[-1]))


def test_the_import_contracts_hold(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    configure()
    monkeypatch.chdir(ROOT)
    assert len(read_configuration(str(ROOT / "pyproject.toml"))["contracts_options"]) >= 12
    is_kept = use_cases.lint_imports(config_filename=str(ROOT / "pyproject.toml"), cache_dir=None)
    assert is_kept, capsys.readouterr().out


def test_the_house_can_be_overlooked() -> None:
    found = structure()
    assert 0 < len(found.floors) <= 20, "rooms that stand on each other, or too many"
    assert max(found.floors.values()) <= 11
    assert len(found.arrows) <= 120
    assert len(found.same_modules) <= 15, found.same_modules
    assert found.same_classes == {}, "a name that stands for more than one thing"


def test_the_command_line_starts_without_anything_heavy() -> None:
    assert not HEAVY & modules_after("import app.cli.program, app.settings.sections")


def test_an_export_loads_neither_scipy_nor_numba() -> None:
    loaded = modules_after("import app.cli.file_commands, app.files.exporting")
    assert not HEAVY - {"numpy", "cv2", "h5py"} & loaded


def test_the_display_is_looked_for_without_qt() -> None:
    assert not {"PySide6", "pyqtgraph"} & modules_after(
        "from app.system.display import display_problem\ndisplay_problem()"
    )


def test_a_headless_run_never_imports_qt() -> None:
    assert not {"PySide6", "pyqtgraph"} & modules_after(
        "import app.runs.live, app.replay.reanalysis, app.cli.run_and_replay, app.report.figures"
    )


def test_a_replay_imports_no_device() -> None:
    loaded = modules_after("import app.replay.reanalysis, app.cli.run_and_replay, app.cli.inspect")
    drivers = {name for name in loaded if name.startswith("drivers.")}
    settings = {"drivers.settings", "drivers.sim", "drivers.sim.settings", "drivers.sim.faults"}
    assert drivers <= {"drivers.errors", "drivers.protocols"} | settings


def test_the_analysis_opens_no_file_and_no_vendor_library() -> None:
    names = " ".join(
        f"analysis.{path.stem}"
        for path in (ROOT / "analysis").glob("*")
        if (path / "__init__.py").exists()
    )
    loaded = modules_after(f"import {', '.join(names.split())}")
    assert not {"h5py", "PySide6", "matplotlib", "nidaqmx", "app", "drivers"} & loaded


def test_every_file_can_be_read_in_one_sitting() -> None:
    files = [*sources(), *(ROOT / "tests").rglob("*.py"), *(ROOT / "benchmarks").rglob("*.py")]
    lengths = {
        str(path.relative_to(ROOT)): len(path.read_text(encoding="utf-8").splitlines())
        for path in files
    }
    assert {name: n for name, n in lengths.items() if n > LONGEST_FILE} == {}, (
        "longer than a sitting; find the two things that each does"
    )


def undocumented(path: Path) -> list[str]:
    """Public modules, classes, functions and methods without a docstring; members of a Protocol may
    speak for themselves.
    """
    tree = ast.parse(path.read_text(encoding="utf-8"))
    missing = [] if ast.get_docstring(tree) or not tree.body else ["the module"]

    def look(node: ast.AST, prefix: str, exempt: bool) -> None:
        for item in ast.iter_child_nodes(node):
            if not isinstance(item, ast.FunctionDef | ast.ClassDef) or item.name.startswith("_"):
                continue
            if not exempt and not ast.get_docstring(item):
                missing.append(prefix + item.name)
            if isinstance(item, ast.ClassDef):
                is_protocol = any(
                    isinstance(base, ast.Name) and base.id == "Protocol" for base in item.bases
                )
                look(item, f"{prefix}{item.name}.", is_protocol)

    look(tree, "", False)
    return missing


def test_everything_public_says_what_it_is() -> None:
    silent = {str(path.relative_to(ROOT)): undocumented(path) for path in sources()}
    assert {name: missing for name, missing in silent.items() if missing} == {}


def test_no_machine_is_named_in_the_project() -> None:
    """Paths of somebody's home would work on one machine only."""
    roots = ("/" + "home/", "/" + "root/", "/" + "Users/", "C:" + "\\\\Users")
    named = [
        path
        for path in [*sources(), ROOT / "pyproject.toml"]
        if any(root in path.read_text(encoding="utf-8") for root in roots)
    ]
    assert not named


def test_a_bench_of_real_devices_loads_no_window_no_analysis_and_no_hdf5() -> None:
    loaded = modules_after(
        "import app.processes.bench, drivers.daq.ni_daq, drivers.cameras.pylon_camera,"
        " drivers.stages.newport_stage"
    )
    assert (
        not {"PySide6", "pyqtgraph", "matplotlib", "numba", "scipy", "analysis.dic", "h5py"}
        & loaded
    )


def test_the_supervisor_is_small() -> None:
    path = ROOT / "app" / "processes" / "supervisor.py"
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 100
    assert not HEAVY & modules_after("import app.processes.supervisor, drivers.stages.newport_line")
