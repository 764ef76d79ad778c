"""The icon of the program."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtGui import QGuiApplication, QIcon

FILE = Path(__file__).parent / "icons" / "slipscope.svg"
SIDE_PX = 256


def program_icon() -> QIcon:
    """The icon of windows; the program must have a `QGuiApplication`."""
    return QIcon(str(FILE))


def save_icon(path: Path) -> None:
    """Write the icon as an image of the type that the ending names; OSError if that fails."""
    application = QGuiApplication.instance() or QGuiApplication(["slipscope"])
    if not program_icon().pixmap(SIDE_PX, SIDE_PX).save(str(path)):
        raise OSError(f"{path.suffix} images cannot be written there")
    del application
