"""`slipscope menu-entry` puts the program into the menu of the desktop, and takes it out again."""

from __future__ import annotations

import configparser
import json
import shlex
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from typer.testing import Result

from app.system import menu_entry

Command = Callable[..., Result]


@pytest.fixture
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The user's data folder, of a name with a space and an umlaut."""
    folder = tmp_path / "meine Einträge"
    monkeypatch.setenv("XDG_DATA_HOME", str(folder))
    monkeypatch.setattr(sys, "platform", "linux")
    return folder


def test_an_entry_starts_this_installation_and_is_removed_again(
    slipscope: Command, data: Path
) -> None:
    written = json.loads(slipscope("menu-entry", "--json").stdout)["written"]
    entry, icon = map(Path, written)
    assert {file for file in data.rglob("*") if file.is_file()} == {entry, icon}
    read = configparser.ConfigParser(interpolation=None)
    read.optionxform = str  # type: ignore[assignment,method-assign]
    read.read(entry, encoding="utf-8")
    keys = read["Desktop Entry"]
    command = shlex.split(keys["Exec"])
    assert (command[0], keys["TryExec"]) == (sys.executable, sys.executable)
    said = subprocess.run([*command, "--version"], capture_output=True, text=True, check=True)
    assert said.stdout.startswith("slipscope ")
    assert icon.relative_to(data) == Path(f"icons/hicolor/scalable/apps/{keys['Icon']}.svg")
    assert icon.read_bytes().startswith(b"<svg ")
    assert slipscope("menu-entry").exit_code == 0  # again, in place of the first

    assert slipscope("menu-entry", "--remove").exit_code == 0
    assert not [file for file in data.rglob("*") if file.is_file()]
    again = slipscope("menu-entry", "--remove")
    assert (again.exit_code, again.stdout) == (0, "there is no entry to remove\n")


def test_a_command_is_written_as_desktops_read_it(data: Path) -> None:
    """Unescaped as a value, then as a word in quotes: the specification of desktop entries."""
    word = '/op"t/my $lab/100%/a\\b/`x`/python'
    value = menu_entry._quoted(word).replace("\\\\", "\\")
    assert "100%%/" in value  # one alone is a field code
    inside = value[1:-1].replace("%%", "%")
    plain, rest = "", iter(inside)
    for letter in rest:
        plain += next(rest) if letter == "\\" else letter
    assert plain == word


def test_a_folder_that_cannot_be_written_to(slipscope: Command, data: Path) -> None:
    data.write_text("a file", encoding="utf-8")
    result = slipscope("menu-entry")
    assert result.exit_code == 2
    assert "slipscope.desktop: it cannot be written" in result.stderr


def test_windows_makes_a_shortcut_without_a_console(
    slipscope: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[dict[str, Any]] = []

    def run(words: list[str], **how: Any) -> subprocess.CompletedProcess[str]:
        asked.append({"words": words, **how["env"]})
        Path(how["env"]["SLIPSCOPE_LINK"]).touch()
        return subprocess.CompletedProcess(words, int(len(asked) > 1), "", "no such class")

    python = tmp_path / "env" / "python.exe"
    python.parent.mkdir()
    python.with_name("pythonw.exe").touch()
    monkeypatch.setenv("APPDATA", str(tmp_path / "Roaming"))
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setattr(sys, "executable", str(python))
    monkeypatch.setattr(subprocess, "run", run)
    link, icon = menu_entry.add(lambda file: file.write_bytes(b"icon") and None)
    assert link == tmp_path / "Roaming/Microsoft/Windows/Start Menu/Programs/SlipScope.lnk"
    assert asked[0]["words"][0] == "powershell"
    assert asked[0]["SLIPSCOPE_PROGRAM"] == str(python.with_name("pythonw.exe"))
    assert asked[0]["SLIPSCOPE_ICON"] == str(icon)
    for name in ("LINK", "PROGRAM", "ARGUMENTS", "FOLDER", "ICON", "WHAT"):
        assert asked[0]["words"][-1].count(f"$env:SLIPSCOPE_{name}") == 1
    with pytest.raises(Exception, match=r"SlipScope.lnk: it cannot be written \(no such class\)"):
        menu_entry.add(lambda file: None)
    assert menu_entry.remove() == [link, icon]


def test_a_system_without_a_known_menu_says_so(
    slipscope: Command, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sys, "platform", "darwin")
    result = slipscope("menu-entry")
    assert (result.exit_code, result.stderr.count("\n")) == (2, 1)
    assert "darwin" in result.stderr
