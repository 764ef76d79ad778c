"""Compiled functions that cannot be kept, or were kept and are damaged, are compiled anew."""

import ast
import os
import runpy
import shutil
import sys
import time
import warnings
from contextlib import closing
from pathlib import Path

import numba
import numpy as np
import pytest
import scipy
from python_program import ROOT, python

from analysis import kernels
from analysis.dic import open_tracker, strips
from analysis.dic.refining import explain
from app.evaluation.compiling import compile_analysis
from app.settings import config
from app.settings.sections import Config, Sample

DOUBLE = """
from analysis.kernels import compiled

@compiled
def double(x):
    return 2 * x

@compiled(error_model="numpy")
def inverse(x):
    return 1 / x
"""


@pytest.fixture
def module(tmp_path, monkeypatch):
    """Runs a module of two compiled functions as a new process would; what was warned of."""
    (tmp_path / "doubles.py").write_text(DOUBLE, encoding="utf-8")
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path / "kept"))

    def run():
        monkeypatch.setattr(kernels, "cache_warnings", [])
        names = runpy.run_path(str(tmp_path / "doubles.py"))
        with warnings.catch_warnings(action="ignore"):
            assert names["double"](3) == 6
            assert names["inverse"](4.0) == 0.25
        return kernels.cache_warnings

    return run


@pytest.mark.slow
def test_damaged_code_is_compiled_anew_and_told_once(module, tmp_path):
    assert module() == []
    files = sorted((tmp_path / "kept").rglob("double*.nb?"))
    whole = {file: file.read_bytes() for file in files}
    assert {file.suffix for file in files} == {".nbi", ".nbc"}
    for file, content in whole.items():
        middle, n = len(content) // 2, len(content)
        turned = bytes([content[middle] ^ 16])
        for damaged in (
            *(content[: n * k // 4] for k in range(4)),
            bytes(n),
            content[:middle] + turned + content[middle + 1 :],
            content[: n - 64] + bytes(64),
        ):
            file.write_bytes(damaged)
            told = module()
            assert len(told) <= 1
            assert all("is damaged" in one and "made anew" in one for one in told), told
            assert told or file.suffix == ".nbi"  # an index of something else is just not used
            assert module() == []
            for each, held in whole.items():
                each.write_bytes(held)


def test_a_disk_without_room_does_not_stop_what_is_computed(module, tmp_path):
    assert module() == []
    for file in (tmp_path / "kept").rglob("*.nb?"):
        file.unlink()
        file.mkdir()  # nothing can be written in its place
        (file / "in the way").touch()
    told = module()
    assert len(told) == 2
    assert "cannot be kept" in told[-1]


@pytest.mark.slow
def test_where_nothing_can_be_written_the_program_runs_and_says_so(tmp_path, monkeypatch):
    """A user without a home, whose compiled code goes to the folder for temporary files."""
    copy = tmp_path / "program"
    for package in ("analysis", "app", "drivers"):
        shutil.copytree(ROOT / package, copy / package, ignore=shutil.ignore_patterns("*.nb?"))
    (tmp_path / "file").touch()
    nowhere = str(tmp_path / "file" / "home")
    (tmp_path / "temporary").mkdir()
    homes = ("HOME", "USERPROFILE", "LOCALAPPDATA", "XDG_CACHE_HOME", "XDG_STATE_HOME")
    environment = dict.fromkeys(homes, nowhere) | {"PYTHONPATH": str(copy)}
    environment |= dict.fromkeys(("TMPDIR", "TEMP", "TMP"), str(tmp_path / "temporary"))
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    done = python("-m", "app", "doctor", cwd=tmp_path, environment=environment)
    assert "kept in" in done.stdout
    done = python("-m", "app", "model", "-o", "f.csv", cwd=tmp_path, environment=environment)
    assert done.stderr.count("compiled code cannot be kept in the user") == 1
    assert "Traceback" not in done.stderr
    kept = list((tmp_path / "temporary").rglob("*.nbc"))
    assert kept
    if os.name == "posix":
        assert kept[0].parents[1].stat().st_mode & 0o777 == 0o700
        assert kept[0].parents[2].stat().st_mode & 0o777 == 0o700


def test_a_folder_that_others_can_write_to_is_not_used(tmp_path, monkeypatch):
    if os.name != "posix":
        return
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(kernels.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setattr(kernels.platformdirs, "user_cache_dir", lambda *_: str(tmp_path / "user"))
    monkeypatch.setattr(kernels, "cache_warnings", [])
    for name in ("slipscope-{}", "user/kernels", "slipscope-kernels-{}"):
        folder = tmp_path / name.format(os.getuid())
        folder.mkdir(parents=True)
        folder.chmod(0o777)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        assert kernels.compiled(abs_of)(-3) == 3
        assert kernels.place() == ""
    assert [str(one.message) for one in caught] == kernels.cache_warnings
    assert "can be kept nowhere" in kernels.cache_warnings[0]
    assert not list(tmp_path.rglob("*.nb?"))


def test_where_the_place_of_a_function_cannot_be_written_nothing_is_kept_elsewhere(
    tmp_path, monkeypatch, module
):
    """Elsewhere a function would be found after an edit of another that it holds."""

    def refused(locator):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(kernels._Locator, "ensure_cache_path", refused)
    with warnings.catch_warnings(action="ignore"):
        told = module()
    assert len(told) == 1
    assert "numba finds no place there); the next start compiles again" in told[0]
    assert not list(tmp_path.rglob("*.nb?"))


CALLEE = """
from analysis.kernels import compiled

@compiled
def callee(x):
    return FACTOR * x
"""
CALLER = """
from analysis.callee import callee
from analysis.kernels import compiled

@compiled
def caller(x):
    return callee(x) + 1.0
"""


@pytest.mark.slow
def test_an_edit_of_a_function_changes_those_in_other_files_that_hold_it(tmp_path):
    """And a copy of the same files, made later somewhere else, needs to compile nothing."""
    package = tmp_path / "analysis"
    package.mkdir()
    shutil.copy(kernels.__file__, package / "kernels.py")
    (package / "__init__.py").touch()
    (package / "caller.py").write_text(CALLER)
    # Python tells a source that was edited within the same second by nothing but its size
    env = {"NUMBA_CACHE_DIR": str(tmp_path / "kept"), "PYTHONDONTWRITEBYTECODE": "1"}
    code = (
        "from analysis.caller import caller; from analysis.kernels import is_kept;"
        "print(is_kept(caller), caller(2.0), is_kept(caller), is_kept(print))"
    )

    def called(folder=tmp_path):
        done = python("-c", code, cwd=folder, environment=env | {"PYTHONPATH": str(folder)})
        assert done.returncode == 0, done.stderr
        return done.stdout.split()

    for factor, is_kept, value in (
        (2.0, "False", "5.0"),
        (3.0, "False", "7.0"),
        (2.0, "True", "5.0"),  # as `git checkout` gives it back
    ):
        (package / "callee.py").write_text(CALLEE.replace("FACTOR", str(factor)))
        assert called() == [is_kept, value, "True", "False"]
    copy = tmp_path / "copies" / "one"
    shutil.copytree(package, copy / "analysis", ignore=lambda *_: {"__pycache__"})
    for path in (copy / "analysis").iterdir():
        os.utime(path, (0, 0))
    assert called(copy) == ["True", "5.0", "True", "False"]


def test_whatever_a_compiled_function_holds_is_among_the_sources():
    """Also the constants, which are part of the code."""
    sources = {Path(path) for path in kernels.sources()}
    holders = {
        path
        for package in ("analysis", "drivers", "app")
        for path in (ROOT / package).rglob("*.py")
        if "kernels import compiled" in path.read_text(encoding="utf-8")
    }
    assert holders <= sources
    for path in holders:
        tree = ast.parse(path.read_text(encoding="utf-8"))
        imported = {
            name.asname or name.name: node.module
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom)
            for name in node.names
        }
        for function in (node for node in tree.body if isinstance(node, ast.FunctionDef)):
            if not any("compiled" in ast.unparse(one) for one in function.decorator_list):
                continue
            body = ast.Module(function.body, [])
            for name in (node.id for node in ast.walk(body) if isinstance(node, ast.Name)):
                module = imported.get(name, "").split(".")
                if module[0] in ("analysis", "drivers", "app"):
                    holder = ROOT.joinpath(*module).with_suffix(".py")
                    if not holder.exists():  # the name is that of a module
                        holder = ROOT.joinpath(*module, f"{name}.py")
                    assert holder in sources, f"{path.name}: {function.name} holds {name}"


def test_what_other_sources_have_left_goes_once_it_was_not_used_for_a_while(tmp_path, monkeypatch):
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(kernels, "version", lambda: "now")
    kernels._own.cache_clear()
    own = Path(kernels.place())
    assert own.name == "now"
    (own.parent / "former").mkdir()
    (own.parent / "former" / "a.nbi").touch()
    (own.parent / "recent").mkdir()
    long_ago = time.time() - kernels.UNUSED_S - 60
    for name in ("former", "now"):
        os.utime(own.parent / name, (long_ago, long_ago))
    kernels._own.cache_clear()
    assert kernels.place() == str(own)  # a start is a use
    assert {path.name for path in own.parent.iterdir()} == {"now", "recent"}
    assert own.stat().st_mtime > long_ago + 60
    kernels._own.cache_clear()


def test_a_program_whose_folder_was_removed_goes_on(module, tmp_path):
    compile_it = kernels.compiled(abs_of)
    shutil.rmtree(kernels.place())
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert compile_it(-2) == 2
    kernels._own.cache_clear()


def abs_of(x):
    return x if x > 0 else -x


@pytest.mark.parametrize("pixel_format", ["Mono8", "Mono12"])
def test_a_run_compiles_for_its_own_pixels_before_it_begins(pixel_format):
    settings = config.load(None, [f"camera.pixel_format={pixel_format}"])
    compile_analysis(settings)
    used = strips.load_rows, strips.sum_cells, explain
    before = [len(kernel.signatures) for kernel in used]
    images = np.random.default_rng(1).integers(0, 255, (2, 80, 400)).astype(settings.camera.dtype)
    with closing(open_tracker(settings.correlation, images[0])) as tracker:
        for image in (images[1], images[0] // 2):  # light of which some points are seen once more
            tracker.track(image)
    assert [len(kernel.signatures) for kernel in used] == before


WHOLE_RUN = """
import gc, sys
from pathlib import Path
from numba.core.dispatcher import Dispatcher
from short_run import SMALL
from app.evaluation.compiling import compile_analysis
from app.runs import live
from app.settings import config

def compiled_of_the_analysis():
    made = (one for one in gc.get_objects() if isinstance(one, Dispatcher))
    kernels = [one for one in made if one.py_func.__module__.startswith("analysis.")]
    return {f"{one.py_func.__name__}{types}" for one in kernels for types in one.signatures}

if __name__ == "__main__":
    settings = config.load(None, [*SMALL, "run.travel=10"])
    run = live.make_run(settings, Path(sys.argv[1]), pace=None)
    compile_analysis(settings)
    before = compiled_of_the_analysis()
    run.start()
    assert run.wait(300).state == "done"
    print(len(before), *sorted(compiled_of_the_analysis() - before))
"""


def test_a_whole_run_compiles_nothing_after_its_begin(tmp_path):
    """In a new process: the search for the contact, too, is compiled before a frame comes."""
    (tmp_path / "whole_run.py").write_text(WHOLE_RUN, encoding="utf-8")
    done = python(tmp_path / "whole_run.py", tmp_path / "run.h5")
    assert done.returncode == 0, done.stderr
    before, *late = done.stdout.split()
    assert int(before) > 10
    assert late == []


def test_what_tractions_of_a_layer_interpolate_with_is_imported_before_a_run(monkeypatch):
    compile_analysis(Config())
    monkeypatch.delattr(scipy, "interpolate", raising=False)
    monkeypatch.delitem(sys.modules, "scipy.interpolate", raising=False)
    compile_analysis(Config())
    assert "scipy.interpolate" not in sys.modules  # a half-space needs none
    compile_analysis(Config(sample=Sample(thickness=8e-3)))
    assert "scipy.interpolate" in sys.modules
