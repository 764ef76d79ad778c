"""TAB completes the values of options and arguments, and the help shows commands in groups."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from pathlib import Path

import pytest
import typer
from python_program import python
from typer.testing import Result

from analysis.settings import PRESETS
from app.cli import completion
from app.cli.command_options import PANELS
from app.cli.file_commands import OF_RESULTS, OF_SESSION
from app.cli.program import app
from app.files.kinds import KINDS, RESULTS
from app.report.paper.collection import FIGURES
from app.report.paper.style import FORMATS, PALETTES
from app.settings.config import bench_names
from drivers.sources import DRIVERS

Command = Callable[..., Result]
ASKED = {
    "run --set dic.b": ["dic.box="],
    "run --set dic.metho": ["dic.method=shared", "dic.method=icgn", "dic.method=direct"],
    "run --set dic.method=i": ["dic.method=icgn"],
    "replay a.h5 --set camera.source": [f"camera.source={name}" for name in DRIVERS["camera"]],
    "run --set sim.no_such": [],
    "run --pace m": ["max"],
    "run sl": ["slide-hold-slide", "slow.toml"],
    "run sub/": ["sub/other.toml"],
    "campaign s": ["six-loads", "slow.toml"],
    "config ": [*bench_names(), "six-loads"],
    "info ": ["run.h5"],
    "replay nowhere/": [],
    "analyze run.h5 --preset ": [*reversed(PRESETS), "session"],
    "figures r.h5 -o f --only ": [*FIGURES],
    "figures r.h5 -o f --format ": [*FORMATS],
    "figures r.h5 -o f --colours ": [*PALETTES],
    "export run.h5 --what st": ["stress", "stage"],
    "calibrate fo": ["forces", "force-noise"],
    "tradeoff --method d": ["direct"],
}
ASK = """
import contextlib, io, json, os, sys
from app.cli import program
found = {}
for line in json.loads(sys.argv[1]):
    words = ["slipscope", *line.split(" ")]
    os.environ |= {"COMP_WORDS": " ".join(words), "COMP_CWORD": str(len(words) - 1)}
    os.environ["_SLIPSCOPE_COMPLETE"] = "complete_bash"
    with contextlib.redirect_stdout(io.StringIO()) as output, contextlib.suppress(SystemExit):
        program.app(prog_name="slipscope")
    found[line] = output.getvalue().split("\\n")
print(json.dumps([found, sorted(sys.modules)]))
"""
HEAVY = {"PySide6", "pyqtgraph", "h5py", "numba", "cv2", "matplotlib", "scipy"}


def completed(folder: Path, lines: Iterable[str]) -> tuple[dict[str, list[str]], set[str]]:
    """What is offered for each line in a folder, and the modules that this has loaded."""
    done = python("-c", ASK, json.dumps(list(lines)), cwd=folder)
    assert done.returncode == 0, done.stderr
    found, loaded = json.loads(done.stdout)
    return {line: [one for one in words if one] for line, words in found.items()}, set(loaded)


def test_values_are_completed_without_a_heavy_import(tmp_path: Path) -> None:
    for name in ("slow.toml", "sub/other.toml", "run.h5", "my run.h5", "notes.txt"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    found, loaded = completed(tmp_path, ASKED)
    assert found == ASKED
    assert not HEAVY & loaded


def test_the_name_of_a_command_is_completed_without_the_settings_and_the_calibrations(
    tmp_path: Path,
) -> None:
    found, loaded = completed(tmp_path, ["ca"])
    assert found == {"ca": ["campaign", "calibrate", "cameras"]}
    assert not {"app.calibrations.kinds", "app.settings.config", "msgspec"} & loaded


def test_the_names_of_exports_are_those_that_there_are() -> None:
    assert set(OF_SESSION) == set(KINDS[".csv"])
    assert set(OF_RESULTS) == set(RESULTS[".csv"])
    assert (OF_SESSION[0], OF_RESULTS[0]) == (KINDS[".csv"][0], RESULTS[".csv"][0])


def test_settings_come_with_their_meaning() -> None:
    offered = dict(completion.settings("sample."))
    assert offered["sample.young_modulus="] == "Young's modulus E of the block"
    assert len(completion.settings("")) > 150


@pytest.mark.parametrize("shell", ["zsh", "fish", "powershell"])
def test_other_shells_show_the_meaning(shell: str) -> None:
    line = "slipscope run --set dic.bo"
    asked = {
        "_SLIPSCOPE_COMPLETE": f"complete_{shell}",
        "_TYPER_COMPLETE_ARGS": line,
        "_TYPER_COMPLETE_FISH_ACTION": "get-args",
        "_TYPER_COMPLETE_WORD_TO_COMPLETE": "dic.bo",
    }
    code = "from app.cli import program; program.app(prog_name='slipscope')"
    done = python("-c", code, environment=asked)
    assert "dic.box=" in done.stdout, done.stderr
    assert dict(completion.settings("dic.box"))["dic.box="].split(",")[0] in done.stdout


def test_every_command_is_in_one_group_of_the_help(slipscope: Command) -> None:
    program = typer.main.get_command(app)
    context = typer.Context(program)
    grouped = [name for names in PANELS.values() for name in names]
    assert program.list_commands(context) == grouped
    assert len(set(grouped)) == len(grouped)
    text = slipscope("--help").stdout
    assert text.index("Experiments") < text.index("campaign") < text.index("Sessions")
    assert text.index("Maintenance") < text.index("doctor")
