"""`analysis` as a library: typed, exported by name, explained with units."""

from __future__ import annotations

import doctest
import enum
import inspect
import os
import pkgutil
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from blobs import Speckle

import analysis
from docs import reference

ROOT = Path(__file__).parents[1]
RIGHT = """
import numpy as np
import analysis
from analysis.dic import Correlation, open_tracker

tracker = open_tracker(Correlation(box=20), np.zeros((40, 40), np.uint8))
reveal_type(tracker.track(np.zeros((40, 40), np.uint8)).ux_px.dtype)
radius: float = analysis.hertz.contact_radius(0.5, 3.4e6, 0.5, 0.13)
"""
SESSION = """
import slipscope

with slipscope.Session("sample7.h5") as s:
    reveal_type(s.fields[0].ux_m)
    radius: float = slipscope.theory.hertz.contact_radius(0.5, 3.4e6, 0.5, 0.13)
slipscope.run(3)
"""
SCRIPTS = {  # of somebody who has the library
    "right": RIGHT,
    "wrong": RIGHT + "tracker.track('a name')\n",
    "unknown": "import analysis\nanalysis.no_such_name\n",
    "session": SESSION,
}


@pytest.mark.parametrize("package", ["analysis", "app", "drivers", "slipscope"])
def test_the_types_are_shipped(package: str) -> None:
    setup = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["tool"]
    shipped = {
        path
        for pattern in setup["setuptools"]["package-data"]["*"]
        for path in (ROOT / package).rglob(pattern)
    }
    assert ROOT / package / "py.typed" in shipped
    assert shipped.issuperset((ROOT / package).rglob("*.pyi"))


@pytest.mark.slow
def test_scripts_that_import_the_library_are_checked(tmp_path: Path) -> None:
    kept = Path(os.environ.get("MYPY_CACHE_DIR", ROOT / ".mypy_cache")).absolute()
    for name, script in SCRIPTS.items():
        (tmp_path / f"{name}.py").write_text(script)
    done = subprocess.run(
        [
            *(sys.executable, "-m", "mypy", "--strict", "--follow-imports=silent"),
            *("--config-file=", f"--cache-dir={kept / 'scripts'}"),
            *(f"{name}.py" for name in SCRIPTS),
        ],
        cwd=tmp_path,
        env={"MYPYPATH": str(ROOT), "PATH": "", "SYSTEMROOT": r"C:\Windows"},
        capture_output=True,
        text=True,
        check=False,
        timeout=400,
    )
    said = done.stdout + done.stderr
    of = {name: "\n".join(re.findall(rf"^{name}\.py:.*", said, re.MULTILINE)) for name in SCRIPTS}
    assert ("numpy.float32" in of["right"]) or "_nbit_base._32Bit]" in of["right"], said
    assert "error" not in of["right"], said
    assert 'incompatible type "str"' in of["wrong"]
    assert "no_such_name" in of["unknown"]
    assert "float64" in of["session"] or "_nbit_base._64Bit]" in of["session"], said
    assert 'incompatible type "int"' in of["session"]
    assert "Found 3 errors in 3 files (checked 4 source files)" in said


PACKAGES = ("calibration", "contact", "dic", "friction", "inversion", "mechanics")
QUANTITY = re.compile(
    r"\bshapes?\b|metres|newtons|pascals|pixels|radians|\bpx\b|_px\b|\bum\b|\bSI\b|\bseconds\b"
    r"|grey levels|dimensionless|unit vector|joules|J/m\^2|m/s|\((?:m|N|Pa|s)\)"
)


def exported() -> Iterator[tuple[str, Any]]:
    """Everything that is exported, and the functions of the modules that are."""
    for package in PACKAGES:
        for name in getattr(analysis, package).__all__:
            one = getattr(analysis, name)
            yield name, one
            if isinstance(one, ModuleType):
                own = inspect.getmembers(one, inspect.isfunction)
                yield from (
                    (f"{name}.{function}", what)
                    for function, what in own
                    if what.__module__ == one.__name__ and not function.startswith("_")
                )


def test_the_packages_show_what_they_export_and_nothing_else() -> None:
    for package in PACKAGES:
        module = getattr(analysis, package)
        assert dir(module) == sorted(module.__all__)
    names = [name for package in PACKAGES for name in getattr(analysis, package).__all__]
    assert dir(analysis) == sorted([*names, *PACKAGES])
    assert len(names) == len(set(names))
    calibrations = analysis.calibration.__all__
    assert len(names) - len(calibrations) <= 63
    assert len(calibrations) <= 18
    with pytest.raises(AttributeError, match="no attribute 'sigma'"):
        _ = analysis.sigma


def test_all_that_is_exported_is_explained_with_units() -> None:
    for name, one in exported():
        text = inspect.getdoc(one) or ""
        assert text, f"{name} has no docstring"
        if not (isinstance(one, type) and issubclass(one, enum.Enum)):
            assert QUANTITY.search(text), f"{name}: no unit, and no shape"


def test_a_docstring_links_to_modules_and_to_what_is_exported_only() -> None:
    names = {name.rpartition(".")[2] for name, _ in exported()}
    for name, one in exported():
        for link in re.findall(r"(?<!`)`(analysis\.[\w.]+)`(?!`)", inspect.getdoc(one) or ""):
            is_module = isinstance(pkgutil.resolve_name(link), ModuleType)
            assert is_module or link.rpartition(".")[2] in names, f"{name}: {link}"


def test_the_page_leads_from_the_paper_to_the_functions() -> None:
    page = (ROOT / "docs/analysis.md").read_text(encoding="utf-8")
    assert reference.functions().rstrip() in page, "python docs/reference.py"


def test_every_function_has_an_example_that_is_true() -> None:
    runner, finder = doctest.DocTestRunner(), doctest.DocTestFinder(recurse=False)
    for name, one in exported():
        if isinstance(one, ModuleType):
            continue
        found = finder.find(one, name, globs=dict(vars(inspect.getmodule(one))))
        examples = [test for test in found if test.examples]
        assert examples or not inspect.isfunction(one) or "." in name, f"{name} has no example"
        for test in examples:
            runner.run(test)
    assert runner.failures == 0
    assert runner.tries > 100


def test_two_pictures_of_any_type_are_correlated_in_one_call() -> None:
    speckle = Speckle((90, 120))
    for kind in (np.uint8, np.float64):
        first, second = (speckle.image(ux).astype(kind) for ux in (0.0, 1.4))
        field = analysis.correlate(first, second, um_per_px=2.5, threads=1)
        assert (field.status == 0).mean() > 0.9
        assert abs(np.nanmedian(field.ux_px) - 1.4) < 0.01
        assert abs(np.nanmedian(field.ux_um) - 3.5) < 0.025
        assert field.ux_px.shape == (len(field.y_px), len(field.x_px))
        np.testing.assert_allclose(np.diff(field.x_um), 25.0)
    wide = analysis.correlate(first, second, preset="fast", threads=1)
    assert np.diff(wide.x_px).tolist() == [20.0] * (len(wide.x_px) - 1)
    assert np.isnan(wide.x_um).all()


@pytest.mark.parametrize(
    ("reference", "settings", "says"),
    [
        (np.zeros((4, 4, 3)), {}, r"reference: a 2-D array .*found shape \(4, 4, 3\)"),
        ([[1.0]], {}, "reference: a 2-D array .*found list"),
        (np.zeros((90, 90), int), {}, "use uint8, uint16, float32 or float64"),
        (np.zeros((90, 90)), {"box": 2}, "box must be a whole number at least 4"),
        (np.zeros((9, 9)), {}, "use a smaller box"),
    ],
)
def test_what_can_not_be_correlated_is_refused_in_a_sentence(
    reference: Any, settings: dict[str, Any], says: str
) -> None:
    with pytest.raises(ValueError, match=says):
        analysis.correlate(reference, np.zeros((90, 90)), **settings)
    with pytest.raises(TypeError, match="use correlate"):
        analysis.open_tracker(np.zeros((90, 90)), np.zeros((90, 90)))


def test_help_on_the_settings_explains_each() -> None:
    text = inspect.getdoc(analysis.Correlation)
    assert text is not None
    for name in inspect.signature(analysis.Correlation).parameters:
        assert re.search(rf"^{name} : .*default .*\n    \w", text, re.MULTILINE), name
    assert "box : int, px, at least 4 and at most 200; default 20" in text
