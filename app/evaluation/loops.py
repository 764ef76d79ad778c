"""What a drive that turns back says, and what comes before the onset of sliding: loops, Masing's
rule, the stiffness of the interface, precursors.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from analysis.arrays import F64
from analysis.friction.cycles import (
    interface_stiffness,
    local_work,
    loop_work,
    masing_deviation,
    precursor_slip,
)
from analysis.friction.local_law import InvertedRun, LocalLaw
from app.evaluation.budget import Measured
from app.evaluation.law_fit import inverted
from app.records.legs import legs_of
from app.records.snapshot_numbers import all_series, series_of

DOUBTFUL = 0.5  # relative uncertainty from which a stiffness is none


def local_results(
    measured: Measured, law: LocalLaw, hertz_m: float, onset_s: float
) -> dict[str, Any]:
    """Fields of the summary about legs, loops, the stiffness of the interface and precursors; of
    all frames of the drive.
    """
    drive, legs = measured.drive, legs_of(measured.drive)
    x, Q = all_series(drive, "travel_m", "shear_force_n")
    found: dict[str, Any] = {}
    if len(legs) > 1:
        first = legs[0]
        found["masing"] = tuple(
            masing_deviation(x[first], Q[first], x[leg], Q[leg]) for leg in legs[1:]
        )
        cycles = [slice(a.start, b.stop) for a, b in zip(legs[1::2], legs[2::2], strict=False)]
        found["loop_work_j"] = tuple(loop_work(x[cycle], Q[cycle]) for cycle in cycles)
    frames = inverted(measured, hertz_m)
    if frames is None or not math.isfinite(law.E):
        return found
    run = frames.run()
    scale = law.E / frames.inversion.E
    place = {s.frame: i for i, s in enumerate(drive)}
    solved = zip(frames.frames, run.frames, strict=True)
    at = np.array([place[s.frame] for s, is_solved in solved if is_solved])
    if len(legs) > 1:
        found["local_work_j"] = tuple(
            _work(run, scale, (at >= c.start) & (at < c.stop)) for c in cycles
        )
    time = series_of(drive, "time_s")[at]
    of_first = at < legs[0].stop
    k, k_sd = interface_stiffness(
        run.slip[of_first],
        scale * run.sigma[of_first],
        scale * run.sigma_sd[of_first],
        law.mu * law.L,
    )
    is_resolved = k_sd < DOUBTFUL * k
    k, k_sd = (np.where(is_resolved, v, np.nan) for v in (k, k_sd))
    found["interface_stiffness_pa_m"] = _held(k)
    found["interface_stiffness_sd_pa_m"] = _held(k_sd)
    found["precursor_slip_m"] = _held(precursor_slip(time[of_first], run.slip[of_first], onset_s))
    return found


def _work(run: InvertedRun, scale: float, chosen: Any) -> float:
    if chosen.sum() < 2:
        return math.nan
    return local_work(run.radius, run.slip[chosen], scale * run.sigma[chosen]).total


def _held(values: F64) -> tuple[float, ...]:
    return tuple(float(v) if math.isfinite(v) else math.nan for v in values)
