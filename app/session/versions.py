"""What a session was made with."""

from __future__ import annotations

import os
import platform
from functools import cache
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

_VECTORS = ("avx", "f16c", "fma", "neon", "sse4", "sve")


def versions() -> dict[str, str]:
    """Name -> version of this program and its libraries, and the computer it runs on, for the
    session's record.
    """
    computer = {
        "computer": platform.node(),
        "platform": platform.platform(),
        "python": platform.python_version(),
    }
    return computer | processor() | _packages()


@cache  # reading them takes milliseconds, and they stay what they are while the program runs
def _packages() -> dict[str, str]:
    names = ("slipscope", "numpy", "scipy", "numba", "opencv-python-headless", "h5py")
    return {name: metadata.version(name) for name in names}


def processor() -> dict[str, str]:
    """What of it says on which processor results were computed."""
    return {"processor": f"{_model()}, {os.cpu_count()} cores", "instructions": _instructions()}


def _model() -> str:
    """What the maker calls the processor, where the system says so."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        lines = []  # no Linux
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return next(iter(named), platform.processor() or platform.machine())


@cache
def _instructions() -> str:
    """The processor that numba compiles for and the vectors that it and numpy use, which their
    environment variables can narrow.
    """
    from llvmlite import binding

    name = os.environ.get("NUMBA_CPU_NAME") or binding.get_host_cpu_name()
    features = os.environ.get("NUMBA_CPU_FEATURES")
    if features is None:
        features = binding.get_host_cpu_features().flatten()
    vectors = sorted(f[1:] for f in features.split(",") if f[:1] == "+")
    used = [f for f in vectors if f.startswith(_VECTORS)]
    extensions: Any = np.show_config(mode="dicts")["SIMD Extensions"]
    found = [*extensions.get("baseline", []), *extensions.get("found", [])]
    return f"{' '.join([name, *used])}; numpy {' '.join(found)}"
