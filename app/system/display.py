"""Whether a window can be opened on this machine.

This is checked without loading Qt, which would end the process where it cannot open one.
"""

from __future__ import annotations

import ctypes
import os
import sys
from importlib.util import find_spec

from drivers import installation

WINDOW_PACKAGES = {"PySide6-Essentials": "PySide6", "pyqtgraph": "pyqtgraph"}
"""What only the window needs -> its module; workers of a cluster do without."""
# libraries that the Qt wheels expect of the system -> the Debian package of each
_BASE = {
    "libglib-2.0.so.0": "libglib2.0-0",
    "libEGL.so.1": "libegl1",
    "libGL.so.1": "libgl1",
    "libxkbcommon.so.0": "libxkbcommon0",
    "libfontconfig.so.1": "libfontconfig1",
    "libfreetype.so.6": "libfreetype6",
    "libdbus-1.so.3": "libdbus-1-3",
}
_XCB = {
    "libxcb-cursor.so.0": "libxcb-cursor0",
    "libxcb-icccm.so.4": "libxcb-icccm4",
    "libxcb-keysyms.so.1": "libxcb-keysyms1",
    "libxcb-shape.so.0": "libxcb-shape0",
    "libxcb-xkb.so.1": "libxcb-xkb1",
    "libxkbcommon-x11.so.0": "libxkbcommon-x11-0",
}


def display_problem() -> str | None:
    """Why no window can be opened on this machine, in one sentence; None where one can.

    Its packages must be installed. Windows and macOS always have a display. On Linux a display must
    be named and reachable (``QT_QPA_PLATFORM=offscreen`` counts as one), and the libraries that Qt
    expects must load.
    """
    for package, module in WINDOW_PACKAGES.items():
        if find_spec(module) is None:
            return (
                f"no window: the package {package} is not installed; to install it:"
                f" {installation.add(package, needed=True)}; or run with --headless"
            )
    return _problem_on_linux() if sys.platform.startswith("linux") else None


def _problem_on_linux() -> str | None:
    platform = _platform()
    if not platform:
        return (
            "no window: neither DISPLAY nor WAYLAND_DISPLAY is set; log in to a desktop, use ssh"
            " -X, or run with --headless"
        )
    if missing := missing_libraries(platform):
        return f"no window: {missing}, or run with --headless"
    if platform == "xcb" and not _x_server_answers():
        return (
            f"no window: the X server '{os.environ['DISPLAY']}' named by DISPLAY does not answer;"
            " start it, or run with --headless"
        )
    return None


def missing_libraries(platform: str) -> str:
    """Which libraries of the system Qt lacks on Linux for one of its platforms, and what installs
    them; empty where it has all.
    """
    needed = _BASE | _XCB if platform == "xcb" else _BASE
    missing = {library: package for library, package in needed.items() if not _loads(library)}
    if not missing:
        return ""
    packages = " ".join(dict.fromkeys(missing.values()))
    return f"{', '.join(missing)} not found on this system; install with: apt install {packages}"


def _platform() -> str:
    """The platform that Qt would use: "xcb", "wayland", one named in QT_QPA_PLATFORM, or ""."""
    named = os.environ.get("QT_QPA_PLATFORM", "").split(";")[0].split(":")[0]
    has_x, has_wayland = bool(os.environ.get("DISPLAY")), bool(os.environ.get("WAYLAND_DISPLAY"))
    if named == "xcb":
        return "xcb" if has_x else ""
    if named.startswith("wayland"):
        return "wayland" if has_wayland else ""
    return named or ("wayland" if has_wayland else "xcb" if has_x else "")


def _loads(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True


def _x_server_answers() -> bool:
    xcb = ctypes.CDLL("libxcb.so.1")
    xcb.xcb_connect.restype = ctypes.c_void_p
    connection = ctypes.c_void_p(xcb.xcb_connect(None, None))
    answers = bool(xcb.xcb_connection_has_error(connection) == 0)
    xcb.xcb_disconnect(connection)
    return answers
