"""The icon of the program is drawn, and saved as the type that Windows takes."""

from __future__ import annotations

from pathlib import Path

import pytest
from PIL import Image
from PySide6.QtWidgets import QApplication

from app.gui.icon import SIDE_PX, program_icon, save_icon


def test_the_icon_is_drawn_and_saved(qapp: QApplication, tmp_path: Path) -> None:
    assert program_icon().pixmap(64, 64).toImage().pixelColor(32, 37).name() == "#f0a202"
    save_icon(tmp_path / "slipscope.ico")
    with Image.open(tmp_path / "slipscope.ico") as saved:
        assert saved.size == (SIDE_PX, SIDE_PX)
    with pytest.raises(OSError, match=r"\.txt images cannot be written"):
        save_icon(tmp_path / "slipscope.txt")
