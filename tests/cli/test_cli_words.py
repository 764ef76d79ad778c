"""What the program writes on the terminal: texts as they are, help, completion, JSON."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from command_line import given
from python_program import python
from short_run import SHORT
from test_cli_commands import save_texture
from typer.testing import Result

from app.cli.terminal import print_line, print_rows, print_table, say

Command = Callable[..., Result]


def test_a_bench_whose_forces_are_too_noisy_does_not_work(slipscope: Command) -> None:
    result = slipscope("check", *given(*SHORT, "sim.force_noise=99"))
    assert result.exit_code == 1
    assert "FAILS  shear sensor: " in result.stdout
    assert "too noisy for a contact of 0.03 N" in " ".join(result.stdout.split())
    assert "the bench does not work" in result.stdout


@pytest.mark.parametrize("command", [(), ("run",), ("dic",), ("check",)])
def test_help_names_no_type_after_an_option_without_a_value(
    slipscope: Command, command: tuple[str, ...]
) -> None:
    shown = slipscope(*command, "--help").stdout
    assert "--help" in shown
    assert "<bool>" not in shown
    assert "BOOLEAN" not in shown


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shell", "words"),
    [("bash", "complete -o default -F"), ("zsh", "#compdef slipscope"), ("fish", "complete --")],
)
def test_a_shell_completes_commands(shell: str, words: str) -> None:
    environment = {"_TYPER_COMPLETE_TEST_DISABLE_SHELL_DETECTION": "1"}
    program = "import sys; sys.argv[0] = 'slipscope'; from app.cli import main; main()"
    script = python("-c", program, "--show-completion", shell, environment=environment)
    assert script.returncode == 0, script.stderr
    assert words in script.stdout
    assert "_SLIPSCOPE_COMPLETE" in script.stdout
    if shell == "bash":
        asked = {
            "_SLIPSCOPE_COMPLETE": "complete_bash",
            "COMP_WORDS": "slipscope rep",
            "COMP_CWORD": "1",
        }
        found = python("-c", program, environment=asked)
        assert found.stdout.split() == ["replay", "repair"]


@pytest.mark.skipif(sys.platform == "win32", reason="no file has such a name")
def test_names_are_printed_as_they_are(
    slipscope: Command, session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name = "a:end:b[red]c.h5"
    (session.parent / name).write_bytes(session.read_bytes())
    for result in (
        slipscope("info", name),
        slipscope("config", ":end:[bold]x[/bold]"),
        slipscope("export", name, "-o", ":end:[b].csv", "--what", "counts"),
        slipscope("replay", "no:end:[b].h5", "--headless"),
        slipscope("run", "--headless", "-o", ":end:.txt"),
        slipscope(":end:"),
    ):
        assert ":end:" in result.output, result.output
        assert "🔚" not in result.output
    for line in ("a:end:b", "[red]a[/red]"):
        say(line)
        print_rows(line, [(line, line, line)])
        print_table([line], [[line]], texts=[line])
        print_line(line)
        shown = capsys.readouterr()
        assert shown.err == f"slipscope: {line}\n"
        assert shown.out.count(line) == 7, shown.out


def test_dic_as_json(slipscope: Command, tmp_path: Path) -> None:
    save_texture(tmp_path, ".png", np.uint8, 100)
    result = slipscope("dic", "a.png", "b.png", "-o", "f.csv", "--search", "4", "--json")
    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert (found["frames"], found["output"]) == (1, "f.csv")
    assert found["statuses"]["ok"] > 0.9 * found["points"]
    assert 0 < found["ux_std_px"] < 0.05
    refused_ = slipscope("dic", "a.png", "no.png", "-o", "g.csv", "--json")
    assert refused_.exit_code == 2
    assert "no.png" in json.loads(refused_.stdout)["error"]
