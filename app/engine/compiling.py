"""Compiles what the analysis of a run uses, so that nothing compiles during the run; cached for the
next start.
"""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from analysis import dic
from analysis.contact.rings import ring_means
from app.settings import Config


def compile_analysis(config: Config) -> None:
    """Compile the correlation of these settings, and the means over rings."""
    compile_correlation(config.correlation, config.camera.dtype)
    _compile_rings()


def compile_correlation(correlation: dic.Correlation, dtype: Any) -> None:
    """Compile what a correlation of images of a type needs: the first time on a machine in two
    processes, which halves the seconds that it takes.
    """
    if not dic.is_compiled(correlation):
        with _compiling_search(correlation, dtype):
            dic.compile_kernels(correlation, dtype, "field")
    dic.compile_kernels(correlation, dtype)  # what was compiled beside comes from the cache


@contextmanager
def _compiling_search(correlation: dic.Correlation, dtype: Any) -> Iterator[None]:
    """Meanwhile another process compiles the search and the rings. Should it fail, they are
    compiled here.
    """
    paths = os.pathsep.join(path or str(Path.cwd()) for path in sys.path)
    other = subprocess.Popen(  # no multiprocessing, which runs the main script of the caller again
        [sys.executable, "-P", "-m", "app.engine.compiling"],
        stdin=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=os.environ | {"PYTHONPATH": paths},
    )
    assert other.stdin is not None
    try:
        with suppress(OSError), other.stdin as line:
            pickle.dump((correlation, dtype), line)
        yield
    finally:
        other.wait()


def _compile_search() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # it ends with the process that waits for it
    correlation, dtype = pickle.load(sys.stdin.buffer)
    dic.compile_kernels(correlation, dtype, "search")
    _compile_rings()


def _compile_rings() -> None:
    ring_means(np.ones(8), np.ones(8), 1.0, theta=np.ones(8))


if __name__ == "__main__":
    _compile_search()
