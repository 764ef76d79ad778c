"""Master curve of friction: sigma/p against u_x at all radii and frames (paper, section 6 and Fig.
15), of a law that `local_law` has found.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from analysis.arrays import F64
from analysis.friction.local_law import LocalLaw
from analysis.robust import robust_sd

BINS = 40


class MasterCurve(NamedTuple):
    """Medians over bins of equal numbers of points: slip (m), sigma/p, robust standard deviation of
    a point; shape (bins,).
    """

    slip: F64
    ratio: F64
    sd: F64


def master_curve(law: LocalLaw, bins: int = BINS) -> MasterCurve:
    """The points of a law, all radii and frames together; empty where there are none."""
    good = np.isfinite(law.slip) & np.isfinite(law.ratio)
    slip, ratio = law.slip[good], law.mu * law.ratio[good]
    parts = [b for b in np.array_split(np.argsort(slip), bins) if b.size]
    return MasterCurve(
        np.array([np.median(slip[b]) for b in parts]),
        np.array([np.median(ratio[b]) for b in parts]),
        np.array([robust_sd(ratio[b] - np.median(ratio[b])) for b in parts]),
    )
