"""What a session was made with."""

from __future__ import annotations

import os
import platform
from importlib import metadata


def versions() -> dict[str, str]:
    """Name -> version of this program and its libraries, and the computer it runs on, for the
    session's record.
    """
    packages = ("slipscope", "numpy", "scipy", "numba", "opencv-python-headless", "h5py")
    computer = {
        "computer": platform.node(),
        "processor": f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores",
        "platform": platform.platform(),
        "python": platform.python_version(),
    }
    return computer | {name: metadata.version(name) for name in packages}
