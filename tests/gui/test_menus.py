"""Buttons that open a menu."""

import subprocess
import sys
from pathlib import Path


def test_a_button_is_not_lit_any_more_after_its_menu() -> None:
    script = Path(__file__).with_name("menu_by_mouse.py")
    place = Path(__file__).parents[2]
    done = subprocess.run([sys.executable, script], cwd=place, check=False)
    assert done.returncode == 0
