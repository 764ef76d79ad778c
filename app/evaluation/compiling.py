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
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from analysis import dic
from analysis.contact.disc import micro_contact_disc
from analysis.contact.marks import compile_marks
from analysis.contact.registration import rigid_shift
from analysis.contact.rings import central_value, ring_means
from analysis.dic.correlation import is_compiled
from analysis.friction.stick import fit_stick_radius
from analysis.mechanics.half_space import layer_correction
from app.settings.sections import Config
from app.system.errors import UserError


def compile_analysis(config: Config) -> None:
    """Compile the correlation of these settings and that of the block with its background, the
    means over rings, the fit of c, the search for marks; what this process has compiled before is
    there. What tractions of a layer interpolate with is imported.
    """
    block = config.sample
    if config.stress.method != "none" and block.thickness > 0:
        layer_correction(0.0, block.young_modulus, block.poisson, block.depth)
    _compile_analysis(config.correlation, np.dtype(config.camera.dtype))


@cache
def _compile_analysis(correlation: dic.Correlation, dtype: np.dtype[Any]) -> None:
    compile_correlation(correlation, dtype)
    grey = np.random.default_rng(0).integers(0, 255, (64, 64)).astype(dtype)
    rigid_shift(grey, grey)
    _compile_contact()


def compile_correlation(correlation: dic.Correlation, dtype: Any) -> None:
    """Compile what a correlation of images of a type needs: the first time on a machine in two
    processes, which halves the seconds that it takes; `UserError` where no image is correlated so.
    """
    if correlation.refusal:
        raise UserError(correlation.refusal)
    if not is_compiled(correlation):
        with _compiling_search(correlation, dtype):
            dic.compile_kernels(correlation, dtype, "field")
    dic.compile_kernels(correlation, dtype)  # what was compiled beside comes from the cache


@contextmanager
def _compiling_search(correlation: dic.Correlation, dtype: Any) -> Iterator[None]:
    """Meanwhile another process compiles the search and what the contact needs. Should it fail,
    they are compiled here.
    """
    paths = os.pathsep.join(path or str(Path.cwd()) for path in sys.path)
    other = subprocess.Popen(  # no multiprocessing, which runs the main script of the caller again
        [sys.executable, "-P", "-m", "app.evaluation.compiling"],
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
    except BaseException:
        other.kill()
        raise
    finally:
        other.wait()


def _compile_search() -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # it ends with the process that waits for it
    correlation, dtype = pickle.load(sys.stdin.buffer)
    dic.compile_kernels(correlation, dtype, "search")
    _compile_contact()


def _compile_contact() -> None:
    r, ones = np.linspace(0.0, 1.0, 8), np.ones(8)
    ring_means(ones, ones, 1.0, theta=ones)
    central_value(r, ones, ones, 2.0)
    fit_stick_radius(r, r, ones, 1.0)
    micro_contact_disc(r, r, (8, 8))
    compile_marks()


if __name__ == "__main__":
    _compile_search()
