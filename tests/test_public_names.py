"""`slipscope`, the name that scripts and notebooks import: what it has, that its examples and those
of the pages are true, and who hides a part of it.
"""

from __future__ import annotations

import doctest
import inspect
import os
import re
import shutil
import sys
import tomllib
from fnmatch import fnmatchcase
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
import short_run
from blobs import Speckle
from python_program import ROOT, python

import slipscope
from drivers.sim.faults import timed

NAMES = {"Session", "Results", "UserError", "run", "analyze", "figures", "export"}
ON_ARRAYS = {"analysis", "dic", "invert", "theory"}


def blocks(page: str, heading: str = "") -> list[str]:
    """The Python of a page of the documentation, from a heading on."""
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    return re.findall(r"```python\n(.*?)```", text[text.index(heading) :], re.DOTALL)


def test_there_is_what_a_user_needs_and_nothing_else() -> None:
    assert set(slipscope.__all__) == set(dir(slipscope)) == NAMES | ON_ARRAYS
    assert all(hasattr(slipscope, name) for name in slipscope.__all__)
    assert slipscope.invert is slipscope.analysis.invert
    assert slipscope.theory.hertz is slipscope.analysis.hertz


def test_the_examples_are_true() -> None:
    runner, finder = doctest.DocTestRunner(), doctest.DocTestFinder(recurse=False)
    for name in sorted(NAMES - {"Results", "Session", "UserError"}):
        one = getattr(slipscope, name)
        text = inspect.getdoc(one) or ""
        assert all(f"{part}\n---" in text for part in ("Parameters", "Raises", "Examples")), name
        for test in finder.find(one, name, globs=dict(vars(inspect.getmodule(one)))):
            runner.run(test)
    for test in finder.find(slipscope, "slipscope"):
        runner.run(test)
    assert runner.failures == 0
    assert runner.tries > 4


@pytest.mark.parametrize(
    ("name", "ending"), [("analysis", ".py"), ("app", "/__init__.py"), ("drivers", ".py")]
)
def test_a_file_that_hides_a_package_is_named(name: str, ending: str, tmp_path: Path) -> None:
    own = tmp_path / f"{name}{ending}"
    own.parent.mkdir(exist_ok=True)
    own.write_text("x = 1\n")
    sentence = (
        f"{own} is found in place of SlipScope's own package '{name}'; rename it, or start Python"
        " in another folder"
    )
    for command, first, code in (
        (["-c", "import slipscope"], "ImportError: ", 1),
        (["-m", "slipscope", "--version"], "slipscope: ", 2),
        ([shutil.which("slipscope", path=str(Path(sys.executable).parent)), "--version"], "", 2),
    ):
        if command[0] is None:
            continue  # not installed
        found = {"PYTHONPATH": os.pathsep.join([str(tmp_path), str(ROOT)])}
        done = python(*command, cwd=tmp_path, environment=found)
        assert done.returncode == code
        assert done.stderr.splitlines()[-1].endswith(f"{first}{sentence}")
        assert code == 1 or len(done.stderr.splitlines()) == 1


def test_a_folder_of_images_of_that_name_hides_nothing(tmp_path: Path) -> None:
    (tmp_path / "app").mkdir()
    done = python("-c", "import slipscope; slipscope.run", cwd=tmp_path)
    assert done.returncode == 0, done.stderr


def test_the_distribution_holds_these_packages_and_no_other() -> None:
    setup = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]
    include = setup["setuptools"]["packages"]["find"]["include"]
    held = {
        name
        for name in ("slipscope", "app", "app.cli", "drivers.sim", "analysis", "app_old", "tests")
        if any(fnmatchcase(name, pattern) for pattern in include)
    }
    assert held == {"slipscope", "app", "app.cli", "drivers.sim", "analysis"}


def test_a_run_that_does_not_end_is_stopped_and_kept(tmp_path: Path) -> None:
    settings = [*short_run.SMALL, "run.travel=20"]
    with pytest.raises(TimeoutError, match=r"late\.h5: the run was not over after 0\.5 s"):
        slipscope.run(tmp_path / "late.h5", settings=settings, pace=1.0, timeout_s=0.5)
    if (tmp_path / "late.h5").exists():  # it was not while the kernels were compiled
        with slipscope.Session(tmp_path / "late.h5") as s:
            assert s.reason == "it was not over after 0.5 s"
    with pytest.raises(slipscope.UserError, match=r"unknown key 'run\.travl'"):
        slipscope.run(tmp_path / "odd.h5", settings=["run.travl=3"])


@pytest.mark.parametrize(
    ("text", "number"),
    [
        ("lost-trigger 1.2s 3", "lost-trigger 10 3"),  # the first at 1.2 s or later, of 8 a second
        ("lost-trigger 1.25s", "lost-trigger 10"),
        ("lost-trigger 40", "lost-trigger 40"),
        ("daq-overflow 2.5s 300", "daq-overflow 2500 300"),
        ("noisy-line 0s", "noisy-line 0"),
        ("stall 12", "stall 12"),
        ("lost-trigger soons", "lost-trigger soons"),
        ("lost-trigger", "lost-trigger"),
    ],
)
def test_a_fault_may_be_given_by_its_time(text: str, number: str) -> None:
    assert timed(text, 1000.0, 125) == number


def test_a_fault_of_the_travel_has_no_time(tmp_path: Path) -> None:
    with pytest.raises(slipscope.UserError, match=r"'stall 2s': the stage meets it at a travel"):
        slipscope.run(tmp_path / "odd.h5", faults=["stall 2s"])


# ------------------------------------------------------------------ the pages


def test_the_examples_for_arrays_run() -> None:
    speckle, x = Speckle((90, 120)), np.linspace(-4e-3, 4e-3, 61)
    contact = slipscope.analysis.SphereContact(P=0.5, E=3.4e6, nu=0.5, R=0.13, mu=0.9, L=1e-6)
    loading = slipscope.analysis.AxisymmetricLoading(contact, modes=24)
    states = [loading.driven(D) for D in np.linspace(2e-6, 80e-6, 20)]
    r = np.hypot(*np.meshgrid(x, x))
    of_frames = [state.D - state.displacement(r)[0] for state in states]
    noise = 20e-9 * np.random.default_rng(1).standard_normal(r.shape)
    names = {
        "reference": speckle.image(0.0),
        "image": speckle.image(1.4),
        "images": [speckle.image(0.3), speckle.image(0.6)],
        **{"x": x, "y": x, "ux": of_frames[10] + noise, "ux_of_frames": of_frames, "P": 0.5},
        "Q": [state.Q for state in states],
    }
    for block in blocks("analysis.md", "## In a notebook"):
        exec(compile(block, "docs/analysis.md", "exec"), names)
    assert pytest.approx(states[10].Q, rel=0.1) == names["field"].Q
    assert pytest.approx(states[10].Q, rel=0.03) == names["rings"].Q
    assert names["law"].mu == pytest.approx(0.9, rel=0.01)
    assert [np.nanmedian(one.ux_px).round(1) for one in names["fields"]] == [0.3, 0.6]


# a driver of one's own is written on `drivers`
OWN_DRIVERS = {"tutorial-hil.md": {"drivers"}}


def test_no_page_imports_anything_else() -> None:
    for page in sorted((ROOT / "docs").glob("*.md")):
        for block in blocks(page.name):
            imported = re.findall(r"^(?:from|import) (app|analysis|drivers)\b", block, re.MULTILINE)
            assert set(imported) <= OWN_DRIVERS.get(page.name, set()), page.name


def test_modules_are_no_names() -> None:
    """A submodule of that name would take the place of a function once it is imported."""
    files = {path.stem for path in (ROOT / "slipscope").glob("*.py")}
    assert not files & set(slipscope.__all__)
    assert isinstance(slipscope.dic, ModuleType)
