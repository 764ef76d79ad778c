"""Compiles what the analysis of a run uses, so that nothing compiles during the run; cached for the
next start.
"""

from __future__ import annotations

import multiprocessing
import signal
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
        spawn = multiprocessing.get_context("spawn")
        other = spawn.Process(target=_compile_search, args=(correlation, dtype), daemon=True)
        other.start()
        dic.compile_kernels(correlation, dtype, "field")
        other.join()
    dic.compile_kernels(correlation, dtype)  # what was compiled beside comes from the cache


def _compile_search(correlation: dic.Correlation, dtype: Any) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # it ends with the process that waits for it
    dic.compile_kernels(correlation, dtype, "search")
    _compile_rings()


def _compile_rings() -> None:
    ring_means(np.ones(8), np.ones(8), 1.0, theta=np.ones(8))
