"""The rules of the house, as tests: who imports whom, what starts fast, how long a file may get,
what must be explained.
"""

from __future__ import annotations

import ast
import json
import re
from pathlib import Path

import pytest
from importlinter.api import read_configuration
from importlinter.application import use_cases
from importlinter.configuration import configure
from python_program import python
from structure import ROOT, sources, structure

LONGEST_FILE = 500
HEAVY = {"PySide6", "pyqtgraph", "h5py", "numba", "cv2", "matplotlib", "scipy", "numpy"}


def modules_after(*statements: str) -> list[set[str]]:
    """Names in ``sys.modules`` of a fresh interpreter after each of these statements."""
    told = "print(json.dumps(sorted(sys.modules)))"
    code = "\n".join(["import json, sys", *(f"{one}\n{told}" for one in statements)])
    done = python("-c", code)
    assert done.returncode == 0, done.stderr
    return [set(json.loads(line)) for line in done.stdout.splitlines()]


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


def test_the_page_of_the_house_shows_the_floors_as_they_are() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d+) \| (`.*?`) \|", page, re.MULTILINE)
    shown = {room: int(floor) for floor, rooms in rows for room in re.findall(r"`(\w+)`", rooms)}
    assert shown == {room: n for room, n in structure().floors.items() if room != "__main__"}


def test_each_part_loads_no_more_than_it_needs() -> None:
    """One after the other in one process: the lightest first."""
    qt = {"PySide6", "pyqtgraph"}
    library, line, supervisor, display, bench, export = modules_after(
        "import slipscope",
        "import app.cli.program, app.settings.sections",
        "import app.processes.supervisor, drivers.stages.newport_line",
        "from app.system.display import display_problem\ndisplay_problem()",
        "import app.processes.bench, drivers.daq.ni_daq, drivers.cameras.pylon_camera,"
        " drivers.stages.newport_stage",
        "import app.cli.file_commands, app.files.exporting",
    )
    assert not (HEAVY | {"app", "analysis", "drivers"}) & library
    assert not HEAVY & line
    assert not HEAVY & supervisor
    assert not qt & display
    # of real devices
    assert not (qt | {"matplotlib", "numba", "scipy", "analysis.dic", "h5py"}) & bench
    assert not HEAVY - {"numpy", "cv2", "h5py"} & export


def test_analysis_and_replay_load_no_device_and_a_headless_run_no_window() -> None:
    names = " ".join(
        f"analysis.{path.stem}"
        for path in (ROOT / "analysis").glob("*")
        if (path / "__init__.py").exists()
    )
    analysis, replay, run = modules_after(
        f"import {', '.join(names.split())}",
        "import app.replay.reanalysis, app.cli.run_and_replay, app.cli.inspect",
        "import app.runs.live, app.report.figures",
    )
    assert not {"h5py", "PySide6", "matplotlib", "nidaqmx", "app", "drivers"} & analysis
    settings = {"drivers.settings", "drivers.sim", "drivers.sim.settings", "drivers.sim.faults"}
    found = {name for name in replay if name.startswith("drivers.")}
    assert found <= {"drivers.errors", "drivers.protocols"} | settings
    assert not {"PySide6", "pyqtgraph"} & run


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


def test_the_supervisor_is_small() -> None:
    path = ROOT / "app" / "processes" / "supervisor.py"
    assert len(path.read_text(encoding="utf-8").splitlines()) <= 100
