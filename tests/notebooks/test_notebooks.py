"""The notebooks of docs/notebooks run, and what they say when they do is what they show."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import nbformat
import pytest

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "docs/notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
SIX, TWO = "loads = (0.04, 0.06, 0.08, 0.1, 0.13, 0.16)", "loads = (0.04, 0.16)"
MOST_BYTES = 200_000
# in a process of its own, whose kernel is another; its arguments: notebook and output
RUN = (
    "import sys, nbformat; from nbclient import NotebookClient;"
    " notebook = nbformat.read(sys.argv[1], 4);"
    " NotebookClient(notebook, timeout=500, kernel_name='python3', coalesce_streams=True)"
    ".execute();"
    " nbformat.write(notebook, sys.argv[2])"
)
NUMBER = re.compile(r"[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?")


def outputs(notebook: Any) -> list[tuple[str, str]]:
    """Kind and text of each output, of a picture without its bytes."""
    found = []
    for cell in notebook.cells:
        for output in cell.get("outputs", []):
            held = output.get("data", {})
            kind = "picture" if "image/png" in held else output.output_type
            found.append((kind, output.get("text", held.get("text/plain", ""))))
    return found


def executed(path: Path, tmp_path: Path) -> list[tuple[str, str]]:
    """The outputs of a notebook that was run."""
    folders = {f"{name}_DIR": str(tmp_path) for name in ("JUPYTER_CONFIG", "JUPYTER_RUNTIME")}
    env = os.environ | folders | {"PYTHONPATH": str(ROOT), "IPYTHONDIR": str(tmp_path)}
    env |= {"TMPDIR": str(tmp_path)}  # where it records
    done = subprocess.run(
        [sys.executable, "-c", RUN, str(path), str(tmp_path / "run.ipynb")],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
        timeout=560,
        env=env,
    )
    assert done.returncode == 0, done.stderr[-4000:]
    return outputs(nbformat.read(tmp_path / "run.ipynb", 4))


def is_same(found: str, expected: str) -> bool:
    """Whether two texts are equal, but for the last digits, which are those of the processor."""
    numbers = ([float(n) for n in NUMBER.findall(text)] for text in (found, expected))
    return NUMBER.sub("#", found) == NUMBER.sub("#", expected) and next(numbers) == pytest.approx(
        next(numbers), rel=0.05, abs=1e-6
    )


@pytest.mark.parametrize("name", ["one_session", pytest.param("six_loads", marks=pytest.mark.long)])
def test_a_notebook_runs_and_says_what_it_shows(name: str, tmp_path: Path) -> None:
    path = FOLDER / f"{name}.ipynb"
    shown, said = outputs(nbformat.read(path, 4)), executed(path, tmp_path)
    assert [kind for kind, _ in said] == [kind for kind, _ in shown]
    assert sum(kind == "picture" for kind, _ in said) >= 3
    for (_, expected), (_, found) in zip(shown, said, strict=True):
        assert is_same(found, expected), found


def test_the_six_loads_run_with_two_of_them(tmp_path: Path) -> None:
    """Of each load it says what it shows; what all have in common is another number."""
    path, fewer = FOLDER / "six_loads.ipynb", tmp_path / "fewer.ipynb"
    text = path.read_text(encoding="utf-8")
    assert text.count(SIX) == 1
    fewer.write_text(text.replace(SIX, TWO), encoding="utf-8")
    shown, said = outputs(nbformat.read(path, 4)), executed(fewer, tmp_path)
    assert [kind for kind, _ in said] == [kind for kind, _ in shown]
    lines = [
        (line, expected.splitlines())
        for (_, expected), (_, found) in zip(shown, said, strict=True)
        for line in found.splitlines()
        if line.startswith("P = ")
    ]
    assert len(lines) == 3 * 2
    for line, those in lines:
        assert any(is_same(line, one) for one in those), line


@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_is_small_and_knows_no_computer(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    assert len(text) < MOST_BYTES
    assert not re.search(r"/(tmp|home|root|work|usr)/", text)
    notebook = json.loads(text)
    for cell in notebook["cells"]:
        lines = "".join(cell["source"]).splitlines()
        assert max(map(len, lines)) <= 100
        assert len(lines) <= 20, "cells are short"
        if cell["cell_type"] == "code":
            assert cell["execution_count"], "every cell was run"


def test_there_are_two() -> None:
    assert [path.stem for path in NOTEBOOKS] == ["one_session", "six_loads"]
