"""Takes pictures of the window in its main states, at the sizes of usual screens.

    python docs/screenshots.py -o pictures [--size 1366x768 1920x1080 1920x1080@2]

The window is used as an operator would, on the simulated bench; its session and the pictures go to
the folder. ``@2`` is a screen with doubled pixels. It needs no display: without one Qt draws off
the screen.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

SIZES = ("1366x768", "1920x1080", "1920x1080@2")
PATIENCE_S = 300.0


def main() -> None:
    """Take the pictures at each size, in a process of its own: Qt reads the scale at its start."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--output", type=Path, required=True)
    parser.add_argument("--size", nargs="+", default=SIZES)
    parser.add_argument("--this", help=argparse.SUPPRESS)
    given = parser.parse_args()
    given.output.mkdir(parents=True, exist_ok=True)
    if given.this:
        take(given.output, given.this)
        return
    for size in given.size:
        _, _, scale = size.partition("@")
        environment = dict(os.environ, QT_SCALE_FACTOR=scale or "1")
        if not any(environment.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY")):
            environment["QT_QPA_PLATFORM"] = "offscreen"
        command = [sys.executable, __file__, "-o", str(given.output), "--this", size]
        subprocess.run(command, check=True, env=environment)


def take(folder: Path, size: str) -> None:
    """Take the pictures at one size."""
    from PySide6.QtCore import QSettings
    from PySide6.QtWidgets import QApplication

    from app.commands.workshop import Workshop
    from app.config import load
    from app.gui.desk import Desk
    from app.gui.window import MainWindow

    QSettings.setPath(
        QSettings.Format.IniFormat, QSettings.Scope.UserScope, str(folder / f"memory-{size}")
    )
    application = QApplication(["slipscope"])
    application.setStyle("Fusion")
    pixels, _, scale = size.partition("@")
    width, height = (round(int(n) / float(scale or 1)) for n in pixels.split("x"))
    session = folder / f"evening-{size}.h5"
    session.unlink(missing_ok=True)
    made: list[Any] = []
    desk = Desk(Workshop(made.append, pace=2.0), load(None), session)
    window = MainWindow(desk=desk)
    window.showNormal()
    window.resize(width, height)

    def until(is_so: Callable[[], bool], least_s: float = 0.5) -> None:
        begun = time.monotonic()
        while time.monotonic() - begun < least_s or not is_so():
            application.processEvents()
            time.sleep(0.005)
            if time.monotonic() - begun > PATIENCE_S:
                raise TimeoutError(f"screenshots: nothing came of it in {PATIENCE_S:.0f} s")

    def picture(name: str) -> None:
        until(lambda: True)
        path = folder / f"{size}-{name}.png"
        window.grab().save(str(path))
        print(path, f"{window.width()} x {window.height()}", flush=True)

    def shear_n() -> float:
        view = window._view
        if view is None or view.curves.newest is None:
            return 0.0
        return float(view.curves.newest.conditions.shear_force_n)

    for name in window.docks.by_name:
        window.docks.show(name)
        picture(f"0-{name}")
    window.docks.arrange()
    window.begin()
    until(lambda: window._view is not None and window._view.phase == "contact")
    picture("1-contact")
    until(lambda: shear_n() > 0.3)
    picture("2-partial-slip")
    for name in ("result", "health", "log"):
        window.docks.show(name)
    until(lambda: window.outcome() is not None, 1.0)
    window.docks.show("result")
    picture("3-done")
    window.begin()
    until(lambda: shear_n() > 0.1)
    window.stop_motion()
    until(lambda: window.outcome() is not None, 3.0)
    picture("4-stopped")
    window.open_session(session)
    until(lambda: window._view is not None and shear_n() > 0.2)
    window.playback.toggle()
    picture("5-replay")
    window.show_keys()
    until(lambda: True)
    window._keys.grab().save(str(folder / f"{size}-6-keys.png"))
    window.close()


if __name__ == "__main__":
    main()
