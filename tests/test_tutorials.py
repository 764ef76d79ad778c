"""The tutorials work as they are written: their files, their commands, their tests and their keys.

A block of code that begins with a comment of a file name is that file; each line of a block `sh` is
a command. Runs with a window are done without one, in a small world.
"""

from __future__ import annotations

import re
import runpy
import shlex
from pathlib import Path
from typing import Any

import pytest
import typer
from command_line import call, given
from short_run import SHORT, without_budget, without_pictures

from app.cli import app
from app.settings import config
from app.study import one
from app.study.noise import NOTHING

DOCS = Path(__file__).parents[1] / "docs"
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```", re.MULTILINE | re.DOTALL)
FILE = re.compile(r"# (\S+\.\w+)\n")


def commands(text: str) -> list[str]:
    """The commands of a block, each of which may go on in the next line."""
    return text.replace("\\\n", " ").splitlines()


def done(line: str, folder: Path) -> None:
    """Do a command of a tutorial, in the current folder."""
    words = shlex.split(line)
    match words:
        case ["mkdir", name]:
            Path(name).mkdir()
        case ["mv", pattern, target]:
            for path in Path().glob(pattern):
                path.rename(Path(target) / path.name)
        case ["export", _]:
            pass
        case ["python", "-m", "pytest", name]:
            for test, function in runpy.run_path(name).items():
                if test.startswith("test_"):
                    function(folder)
        case ["slipscope", *rest] if "hil-emulated" in rest:  # done in tests/drivers
            config.load(
                Path("hil-emulated"), [rest[n + 1] for n, w in enumerate(rest) if w == "--set"]
            )
        case ["slipscope", "check-driver", *_, "--move"]:
            pass  # in real time, which a busy computer has not
        case ["slipscope"]:  # the run that the reader starts in the window
            done("slipscope run -o first.h5", folder)
        case ["slipscope", *rest]:
            if rest[0] in ("run", "replay") and "--headless" not in rest:
                small = given(*SHORT) if rest[0] == "run" else []
                rest += ["--headless", "--pace", "max", *small]
            result = call(*rest)
            expected = 1 if rest[0] == "check-driver" else 0
            assert result.exit_code in (0, expected), f"{line}: {result.output}"
        case _:
            raise AssertionError(f"not a command of a tutorial: {line}")


def test_the_command_line_understands_every_command() -> None:
    program: Any = typer.main.get_command(app)
    lines = [
        shlex.split(line)
        for page in DOCS.glob("tutorial-*.md")
        for language, text in BLOCK.findall(page.read_text(encoding="utf-8"))
        for line in commands(text)
        if language == "sh" and line.startswith("slipscope ")
    ]
    assert len(lines) > 20
    for _, name, *arguments in lines:
        program.commands[name].make_context(name, arguments)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["evening", "images", pytest.param("hil", marks=pytest.mark.long)])
def test_a_tutorial_works_as_it_is_written(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    monkeypatch.syspath_prepend(str(tmp_path / "here"))
    for display in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(display, raising=False)
    blocks = BLOCK.findall((DOCS / f"tutorial-{name}.md").read_text(encoding="utf-8"))
    assert len(blocks) >= 3
    monkeypatch.setattr(one, "box_noise", lambda *_: NOTHING)
    without_pictures(monkeypatch)
    with without_budget():  # nothing of these shows anywhere
        follow(blocks, tmp_path)


def follow(blocks: list[tuple[str, str]], folder: Path) -> None:
    """Write the files of a tutorial and do its commands, in the current folder."""
    for language, text in blocks:
        if named := FILE.match(text):
            Path(named[1]).write_text(text, encoding="utf-8")
        else:
            assert language == "sh"
            for line in commands(text):
                done(line, folder)


def test_the_keys_of_the_evening_are_those_of_the_window() -> None:
    text = (DOCS / "tutorial-evening.md").read_text(encoding="utf-8")
    keys = pytest.importorskip("app.gui.keys", exc_type=ImportError)  # where Qt does not load
    known = {key for action in keys.ACTS for key in action.keys} | set(keys.GO_TO.values())
    named = set(re.findall(r"\b(?:F\d+|Ctrl\+\w|Esc)\b", text))
    assert len(named) >= 8
    assert named <= known
    for part, key in (("bench", "1"), ("setup", "2"), ("experiment", "3"), ("sessions", "4")):
        assert keys.GO_TO[part] == f"Ctrl+{key}"
