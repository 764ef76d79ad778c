"""Takes pictures of the window in its main states, at the sizes of usual screens.

    python docs/screenshots.py -o pictures [--size 1366x768 1920x1080 1920x1080@2]

The window is used as an operator would, on the simulated bench; its sessions and the pictures go to
the folder. ``@2`` is a screen with doubled pixels. It needs no display: without one Qt draws off
the screen. It takes three minutes for each size; the pictures of docs/window.md are among them.
"""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from app.system.stopping import CUT_POWER

if TYPE_CHECKING:
    from PySide6.QtWidgets import QWidget

SETTINGS = ("about.sample=PDMS 7, rough", "about.operator=A. Nobody", "stress.field=true")
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

    from app.gui.run_factory import RunFactory
    from app.gui.window import MainWindow
    from app.gui.window_model import WindowModel
    from app.settings.config import load

    QSettings.setPath(
        QSettings.Format.IniFormat, QSettings.Scope.UserScope, str(folder / f"memory-{size}")
    )
    application = QApplication(["slipscope"])
    application.setStyle("Fusion")
    pixels, _, scale = size.partition("@")
    width, height = (round(int(n) / float(scale or 1)) for n in pixels.split("x"))
    evening = folder / f"evening-{size}"
    shutil.rmtree(evening, ignore_errors=True)
    evening.mkdir()
    made: list[Any] = []
    model = WindowModel(RunFactory(made.append), load(None, SETTINGS), evening / "sample7-0.5N.h5")
    window = MainWindow(model=model)
    window.showNormal()
    window.resize(width, height)
    window.docks.arrange()
    taken = 0

    def until(is_so: Callable[[], bool], least_s: float = 0.6) -> None:
        begun = time.monotonic()
        while time.monotonic() - begun < least_s or not is_so():
            application.processEvents()
            time.sleep(0.005)
            if time.monotonic() - begun > PATIENCE_S:
                raise TimeoutError(f"screenshots: nothing came of it in {PATIENCE_S:.0f} s")

    def picture(name: str, of: QWidget = window, least_s: float = 0.6) -> None:
        nonlocal taken
        until(lambda: True, least_s)
        taken += 1
        path = folder / f"{size}-{taken:02}-{name}.png"
        of.grab().save(str(path))
        print(path, f"{of.width()} x {of.height()}", flush=True)

    def shear_n() -> float:
        view = window._view
        if view is None or view.ended or view.curves.newest is None:
            return 0.0
        return float(view.curves.newest.conditions.shear_force_n)

    def phase() -> str:
        return window._view.phase if window._view is not None else ""

    def ended() -> bool:
        return window._pending is None and window.outcome() is not None

    def begin() -> None:
        window.begin()
        until(lambda: window._pending is None and window._started and not ended())

    for name in window.docks.by_name:
        window.docks.show(name)
        picture(f"idle-{name}")
    window.docks.arrange()
    window.docks.show("bench")
    window.bench.connect_bench()
    until(lambda: window.bench.link.picture is not None, 3.0)
    picture("connected")
    window.bench.disconnect_bench()
    begin()
    until(lambda: phase() == "contact", 2.0)
    picture("load")
    until(lambda: shear_n() > 0.3)
    picture("partial-slip")
    window.interface.show_cut.setChecked(True)
    window.interface.which.setCurrentIndex(window.interface.which.findData("sigma_kPa"))
    picture("traction-and-cut", least_s=1.5)
    window.interface.show_cut.setChecked(False)
    window.interface.which.setCurrentIndex(window.interface.which.findData("ux_um"))
    window.docks.show("health")
    picture("health", least_s=1.5)
    window.docks.show("curves")
    until(lambda: ended() or (phase() == "drive" and shear_n() > 0.46), 3.0)
    picture("sliding")
    until(ended, 1.0)
    window.docks.show("result")
    picture("done")
    window.docks.show("curves")
    window.toggle_theme()
    picture("done-light")
    window.docks.show("setup")
    picture("set-up-light")
    window.toggle_theme()
    model.set_session(evening / "sample7-stopped.h5")
    begin()
    until(lambda: shear_n() > 0.1)
    window.stop_motion()
    until(ended, 3.0)
    picture("stopped")
    window._say(f"{CUT_POWER}: the serial line of the stage does not answer.", True)
    picture("stop-failed")
    window.notice.clear()
    window.open_session(evening / "sample7-0.5N.h5")
    until(lambda: window._view is not None and shear_n() > 0.25)
    window.playback.toggle()
    picture("replay", least_s=1.5)
    window.sessions.list_folder(evening)
    window.docks.show("sessions")
    picture("sessions", least_s=2.0)
    window.sessions._compare(sorted(evening.glob("*.h5")))
    until(lambda: bool(window.sessions.comparisons))
    picture("compare", window.sessions.comparisons[0])
    window.show_keys()
    picture("keys", window._keys)
    window.close_after_run()
    window.close_after_run()
    for one in made:  # a thread that still computes can not outlive the interpreter
        one.source.wait()


if __name__ == "__main__":
    main()
