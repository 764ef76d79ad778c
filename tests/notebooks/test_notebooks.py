"""The notebooks of docs/notebooks run, and what they say when they do is what they show."""

from __future__ import annotations

import json
import re
from itertools import islice
from pathlib import Path
from typing import Any

import nbformat
import pytest
from python_program import ROOT, python

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


def outputs(cells: list[Any]) -> list[tuple[str, str]]:
    """Kind and text of each output, of a picture without its bytes."""
    found = []
    for cell in cells:
        for output in cell.get("outputs", []):
            held = output.get("data", {})
            kind = "picture" if "image/png" in held else output.output_type
            found.append((kind, output.get("text", held.get("text/plain", ""))))
    return found


def cells_of(name: str) -> list[Any]:
    """The cells of a notebook."""
    cells: list[Any] = nbformat.read(FOLDER / f"{name}.ipynb", 4).cells
    return cells


def executed(folder: Path, *notebooks: list[Any]) -> list[list[tuple[str, str]]]:
    """The outputs of the cells of notebooks that were run in `folder`, each with no name of those
    before it, in one kernel.
    """
    new = nbformat.v4
    cells = [cell for one in notebooks for cell in (new.new_code_cell("%reset -f"), *one)]
    cells = [nbformat.from_dict({**cell, "id": str(n)}) for n, cell in enumerate(cells)]
    nbformat.write(new.new_notebook(cells=cells), folder / "asked.ipynb")
    folders = {f"{name}_DIR": str(folder) for name in ("JUPYTER_CONFIG", "JUPYTER_RUNTIME")}
    folders |= {"IPYTHONDIR": str(folder), "TMPDIR": str(folder)}  # where they record
    python("-c", RUN, "asked.ipynb", "run.ipynb",
           code=0, environment=folders, cwd=folder, timeout=1100)  # fmt: skip
    run = iter(nbformat.read(folder / "run.ipynb", 4).cells)
    return [outputs(list(islice(run, 1 + len(one)))) for one in notebooks]


def is_same(found: str, expected: str) -> bool:
    """Whether two texts are equal, but for the last digits, which are those of the processor."""
    numbers = ([float(n) for n in NUMBER.findall(text)] for text in (found, expected))
    return NUMBER.sub("#", found) == NUMBER.sub("#", expected) and next(numbers) == pytest.approx(
        next(numbers), rel=0.05, abs=1e-6
    )


def check_all(shown: list[tuple[str, str]], said: list[tuple[str, str]]) -> None:
    """A notebook said what it shows."""
    assert [kind for kind, _ in said] == [kind for kind, _ in shown]
    assert sum(kind == "picture" for kind, _ in said) >= 3
    for (_, expected), (_, found) in zip(shown, said, strict=True):
        assert is_same(found, expected), found


@pytest.mark.long
def test_six_loads_run_and_say_what_they_show(tmp_path: Path) -> None:
    cells = cells_of("six_loads")
    check_all(outputs(cells), *executed(tmp_path, cells))


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_one_session_and_two_of_six_loads_run_and_say_what_they_show(tmp_path: Path) -> None:
    """Of each load they say what they show; what all have in common is another number."""
    one, six, two = (cells_of(name) for name in ("one_session", "six_loads", "six_loads"))
    (loads,) = (cell for cell in two if SIX in cell.source)
    loads.source = loads.source.replace(SIX, TWO)
    of_one, said = executed(tmp_path, one, two)
    check_all(outputs(one), of_one)
    shown = outputs(six)
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
