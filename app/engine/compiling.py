"""Compiles what the analysis of a run uses, so that nothing compiles during the run; cached for the
next start.
"""

from __future__ import annotations

import numpy as np

from analysis import dic
from analysis.contact.rings import ring_means
from app.settings import Config


def compile_analysis(config: Config) -> None:
    """Compile the correlation of these settings, and the means over rings."""
    dic.compile_kernels(config.correlation)
    ring_means(np.ones(8), np.ones(8), 1.0, theta=np.ones(8))
