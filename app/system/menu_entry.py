"""The program in the menu of the desktop: a desktop entry with an icon on Linux, a shortcut in the
start menu on Windows. pip cannot make them, as desktops do not look into environments; so the user
asks for them, and removes them again.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Callable
from importlib.resources import files
from pathlib import Path

from app.system.errors import UserError
from app.system.outputs import new_file

ARGUMENTS = "-P -m slipscope"
WHAT = "Friction experiments: forces, images, displacement fields"
ENTRY = """[Desktop Entry]
Type=Application
Name=SlipScope
Comment={what}
Exec={command} {arguments}
TryExec={program}
Icon=slipscope
Terminal=false
Categories=Science;Physics;
StartupWMClass=slipscope
"""
SHORTCUT = """$ErrorActionPreference = 'Stop'
$made = (New-Object -ComObject WScript.Shell).CreateShortcut($env:SLIPSCOPE_LINK)
$made.TargetPath = $env:SLIPSCOPE_PROGRAM
$made.Arguments = $env:SLIPSCOPE_ARGUMENTS
$made.WorkingDirectory = $env:SLIPSCOPE_FOLDER
$made.IconLocation = $env:SLIPSCOPE_ICON
$made.Description = $env:SLIPSCOPE_WHAT
$made.Save()"""  # what is in the environment needs no quotes


def places() -> tuple[Path, Path]:
    """Where the entry and its icon lie, in the user's own folders.

    Raises
    ------
    UserError
        This system has neither.
    """
    if sys.platform == "win32":
        roaming = Path(os.environ.get("APPDATA") or Path.home() / "AppData/Roaming")
        menu = roaming / "Microsoft/Windows/Start Menu/Programs"
        return menu / "SlipScope.lnk", roaming / "slipscope/slipscope.ico"
    elif sys.platform == "linux":
        given = os.environ.get("XDG_DATA_HOME", "")
        data = Path(given) if os.path.isabs(given) else Path.home() / ".local/share"
        icons = data / "icons/hicolor/scalable/apps"
        return data / "applications/slipscope.desktop", icons / "slipscope.svg"
    else:
        raise UserError(f"menu-entry: {sys.platform} has no menu that is known; start slipscope")


def add(save_icon: Callable[[Path], None]) -> tuple[Path, Path]:
    """Make the entry and its icon anew; where they lie.

    Parameters
    ----------
    save_icon : callable
        Writes the icon as a file of the type that Windows takes (.ico); not called on Linux.

    Raises
    ------
    UserError
        They cannot be written.
    """
    entry, icon = places()
    try:
        for place in (entry, icon):
            place.parent.mkdir(parents=True, exist_ok=True)
        if sys.platform == "win32":
            save_icon(icon)
            _shortcut(entry, icon)
        else:
            with new_file(icon, overwrite=True) as file:
                file.write_bytes(files("app").joinpath("gui/icons/slipscope.svg").read_bytes())
            text = ENTRY.format(
                what=WHAT,
                command=_quoted(sys.executable),
                arguments=ARGUMENTS,
                program=sys.executable.replace("\\", r"\\"),
            )
            with new_file(entry, overwrite=True) as file:
                file.write_text(text, encoding="utf-8")
    except OSError as error:
        raise UserError(f"{entry}: it cannot be written ({error.strerror or error})") from None
    return entry, icon


def remove() -> list[Path]:
    """Remove the entry and its icon; those that were there.

    Raises
    ------
    UserError
        One cannot be removed.
    """
    gone = [place for place in places() if place.exists()]
    for place in gone:
        try:
            place.unlink()
        except OSError as error:
            raise UserError(f"{place}: it cannot be removed ({error.strerror})") from None
    return gone


def _quoted(word: str) -> str:
    """A word of a command as the specification of desktop entries wants it: escaped as a word, and
    then as a value.
    """
    escaped = re.sub(r'(["`$\\])', r"\\\1", word).replace("%", "%%")
    return '"' + escaped.replace("\\", r"\\") + '"'


def _shortcut(link: Path, icon: Path) -> None:
    """Have Windows make a shortcut; OSError if it does not."""
    without_console = Path(sys.executable).with_name("pythonw.exe")
    given = {
        "LINK": link,
        "PROGRAM": without_console if without_console.exists() else sys.executable,
        "ARGUMENTS": ARGUMENTS,
        "FOLDER": Path.home(),
        "ICON": icon,
        "WHAT": WHAT,
    }
    done = subprocess.run(
        ["powershell", "-NoProfile", "-NonInteractive", "-Command", SHORTCUT],
        env=os.environ | {f"SLIPSCOPE_{name}": str(value) for name, value in given.items()},
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    if done.returncode:
        raise OSError(done.stderr.strip()[:300])
